// The worker that expands pages for a page, or for an element in one.

import { Decoder, answerPages } from "../chpm/index.js";
import { faceAlone } from "./facing.js";

let decoder;

/** The way to a worker, one for all models of a page; null where the browser has none. What it says no to is done without. */
export function decoderOfPage() {
  if (decoder !== undefined) return decoder;
  try {
    // A page of one file has its script in itself, and so has its worker.
    const own = document.getElementById("chpm-script");
    const url = own ? URL.createObjectURL(new Blob([own.textContent], { type: "text/javascript" })) : new URL("./worker.js", import.meta.url);
    decoder = new Decoder(new Worker(url, { type: "module" }));
  } catch {
    decoder = null;
  }
  return decoder;
}

/** Whether this is the worker, where the rest of a page's script has nothing to do. */
export const isWorker = typeof document === "undefined" && typeof WorkerGlobalScope !== "undefined";
if (isWorker) answerPages(globalThis, faceAlone);
