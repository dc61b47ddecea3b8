// Pages of this folder in a browser without a window.
import { spawn } from "node:child_process";
import { once } from "node:events";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { dirname, extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const TYPES = { ".html": "text/html", ".js": "text/javascript", ".json": "application/json", ".glb": "model/gltf-binary", ".css": "text/css", ".wasm": "application/wasm" };

/// Serves this folder with the package, and what `answer` has for a path, on the loopback address; tells what the page posts to /results, or a `failure`.
export async function browse(page, answer) {
  let found;
  const told = new Promise((done) => (found = done));
  const server = createServer((request, response) => {
    const path = normalize(decodeURIComponent(new URL(request.url, "http://localhost").pathname));
    if (path === "/results") {
      const parts = [];
      request.on("data", (part) => parts.push(part));
      request.on("end", () => (response.end(), found(JSON.parse(Buffer.concat(parts)))));
      return;
    }
    try {
      const body = answer(path) ?? readFileSync(join(here, path));
      response.writeHead(200, { "Content-Type": TYPES[extname(path)] ?? "application/octet-stream" });
      response.end(body);
    } catch {
      response.writeHead(404).end();
    }
  });
  server.listen(0, "127.0.0.1");
  await once(server, "listening");
  const profile = mkdtempSync(join(tmpdir(), "chromium-"));
  const flags = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=600,600", `--user-data-dir=${profile}`];
  const browser = spawn(process.env.CHROMIUM ?? "chromium", [...flags, `http://127.0.0.1:${server.address().port}/${page}`], { stdio: "ignore" });
  const ended = once(browser, "exit").then(() => ({ failure: "the browser ended" }));
  const answered = await Promise.race([told, ended]);
  browser.kill();
  await ended;
  server.close();
  server.closeAllConnections();
  // Processes that it has started end a while later.
  rmSync(profile, { recursive: true, force: true, maxRetries: 20 });
  return answered;
}
