// node place.mjs FOLDER NAME...
//
// Shows tilesets FOLDER/NAME to CesiumJS in a browser without a window, asks it for heights at the places of FOLDER/NAME.json (degrees of longitude and latitude, and metres), and
// fails where one is a metre off or nothing is there.
import { spawn } from "node:child_process";
import { once } from "node:events";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { dirname, extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const [folder, ...names] = process.argv.slice(2);
const TYPES = { ".html": "text/html", ".js": "text/javascript", ".json": "application/json", ".glb": "model/gltf-binary", ".css": "text/css", ".wasm": "application/wasm" };

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
    const isOfSets = path.startsWith("/sets/");
    const body = path === "/names.json" ? JSON.stringify(names) : readFileSync(isOfSets ? join(folder, path.slice(6)) : join(here, path));
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
const browser = spawn(process.env.CHROMIUM ?? "chromium", [...flags, `http://127.0.0.1:${server.address().port}/place.html`], { stdio: "ignore" });
const ended = once(browser, "exit").then(() => ({ failure: "the browser ended" }));
const results = await Promise.race([told, ended]);
browser.kill();
await ended;
server.close();
server.closeAllConnections();
rmSync(profile, { recursive: true, force: true, maxRetries: 20 });

let fails = Boolean(results.failure);
if (fails) console.error(results.failure);
for (const name of names) {
  const { code, points } = JSON.parse(readFileSync(join(folder, `${name}.json`)));
  const heights = results[name] ?? [];
  const off = points.map(([, , height], i) => (typeof heights[i] === "number" ? Math.abs(heights[i] - height) : Infinity));
  const [most, lost] = [Math.max(...off), off.filter((x) => x === Infinity).length];
  console.log(`${name} (EPSG:${code}): ${points.length} places, ${lost} without a tile, at most ${most.toFixed(3)} m off`);
  fails ||= !(most <= 1);
}
process.exit(fails ? 1 : 0);
