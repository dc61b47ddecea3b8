// Pages expanded and checked by a worker, so that the thread of a page is free meanwhile. Bytes go there and arrays come back without being copied.

import { partsAbove, placeAbove, unchain } from "./chained.js";
import { unpack } from "./packed.js";
import { Page, readPage } from "./page.js";
import { expect } from "./records.js";
import { ChpmError } from "./source.js";
import { xxh3 } from "./xxh3.js";
import { expand } from "./zstd.js";

/** The page of bytes as a file has them, checked. `above` is what {@link partsAbove} gives of the page that a chained one rests on. */
export function decode(header, cluster, bytes, zstd = expand, above = null) {
  const { id, pageChecksum, isPacked } = cluster;
  expect(xxh3(bytes) === pageChecksum, () => `the page of cluster ${id} is damaged: its checksum is another one`);
  const isChained = isPacked && header.isChained && placeAbove(bytes) !== null;
  expect(!isChained || above, () => `the page of cluster ${id} rests on one that is not here`);
  const expanded = isChained ? unchain(header, cluster, bytes, zstd, above) : isPacked ? unpack(header, cluster, bytes, zstd) : bytes;
  return readPage(header, cluster, expanded);
}

/** The way to a worker that runs {@link answerPages}. Hand it to `open`. */
export class Decoder {
  #worker;
  #asked = new Map();
  #count = 0;

  /** Until the worker says that it is there, and where it fails, pages are expanded without it: browsers refuse workers in many ways. */
  constructor(worker) {
    this.#worker = worker;
    this.isReady = false;
    /** How many pages it has sent. */
    this.come = 0;
    worker.addEventListener("message", ({ data }) => this.#hear(data));
    for (const type of ["error", "messageerror"]) worker.addEventListener(type, (event) => this.#fail(event));
  }

  /**
   * Promises of the pages of clusters, of which `bytes` are there from byte `start` of the file on. Their memory is gone then.
   * @param above by cluster, the page that it rests on, or none
   */
  pages(header, clusters, start, bytes, above = []) {
    const first = this.#count;
    this.#count += clusters.length;
    const pages = clusters.map((cluster, i) => new Promise((done, failed) => this.#asked.set(first + i, { cluster, done, failed })));
    // Whoever waits for a page gets its error; nobody may be waiting.
    pages.forEach((page) => page.catch(() => {}));
    const parts = above.map((page) => page && partsAbove(page));
    this.#worker.postMessage({ first, header, clusters, start, bytes, above: parts }, [bytes.buffer]);
    return pages;
  }

  #hear({ isReady, id, parts, message }) {
    if (isReady) this.isReady = true;
    const asked = this.#asked.get(id);
    if (!asked) return;
    this.#asked.delete(id);
    this.come += parts ? 1 : 0;
    if (parts) asked.done(new Page({ cluster: asked.cluster, ...parts }));
    else asked.failed(new ChpmError(message));
  }

  /** What was asked for is read once more by whoever asked. */
  #fail(event) {
    event.preventDefault();
    this.isReady = false;
    this.#worker.terminate();
    for (const { failed } of this.#asked.values()) failed(new ChpmError("the worker has failed"));
    this.#asked.clear();
  }
}

/** What a worker runs: it answers a {@link Decoder}. `prepare` may put more on each page, such as arrays that a picture needs. */
export function answerPages(scope, prepare = () => {}) {
  scope.addEventListener("message", ({ data: { first, header, clusters, start, bytes, above } }) => {
    clusters.forEach((cluster, i) => {
      const at = cluster.pageOffset - start;
      try {
        // A page that is not packed is a part of what came, and that cannot go away with each.
        const own = cluster.isPacked ? bytes.subarray(at, at + cluster.pageLength) : bytes.slice(at, at + cluster.pageLength);
        const page = decode(header, cluster, own, expand, above[i]);
        prepare(page);
        const { cluster: _, ...parts } = page;
        const buffers = Object.values(parts).map((part) => part?.buffer).filter(Boolean);
        scope.postMessage({ id: first + i, parts }, [...new Set(buffers)]);
      } catch (error) {
        if (!(error instanceof ChpmError)) throw error;
        scope.postMessage({ id: first + i, message: error.message });
      }
    });
  });
  scope.postMessage({ isReady: true });
}
