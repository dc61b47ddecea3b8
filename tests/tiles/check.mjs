// node check.mjs NAME=DIR[:open][:false] ...
//
// Shows tilesets to 3d-tiles-renderer in a browser without a window, and checks for settled views that the tiles that it draws are those that
// their own errors and boxes ask for, and that they have no crack; and every GLB by gltf-validator. A set marked `false` is shown with the boxes of
// its contents instead of its groups', and has to crack. CHROMIUM names another browser, VIEWS another number of views of each set.
import { spawn } from "node:child_process";
import { once } from "node:events";
import { mkdtempSync, readFileSync, readdirSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { dirname, extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";
import validator from "gltf-validator";
import { outside, whole } from "./tileset.mjs";

const here = dirname(fileURLToPath(import.meta.url));
const count = Number(process.env.VIEWS ?? 34);
const sets = process.argv.slice(2).map((word) => {
  const [name, place] = word.split("=");
  const [dir, ...marks] = place.split(":");
  return { name, dir, isFalse: marks.includes("false") };
});
const problems = [];

function name(tile) {
  return tile.content.uri.replace(/^.*tiles\//, "");
}

/// What is to be drawn for an eye: the specification's rule.
function expected(root, eye, pixels) {
  const drawn = [];
  const walk = (tile) => {
    const away = outside(tile.boundingVolume.box, eye);
    const covered = away > 0 ? (tile.geometricError * 1000) / (away * 2 * Math.tan(Math.PI / 4)) : Infinity;
    if (tile.children.length > 0 && tile.geometricError > 0 && covered > pixels) tile.children.forEach(walk);
    else if (tile.content) drawn.push(name(tile));
  };
  walk(root);
  return drawn.sort();
}

function views(root) {
  const [x, y, z, ...ways] = root.boundingVolume.box;
  const radius = Math.hypot(...ways);
  return Array.from({ length: count }, (_, i) => {
    const turn = 2.399963 * i;
    const rise = (2 * ((i * 37) % 101)) / 101 - 1;
    const flat = Math.sqrt(1 - rise * rise);
    const away = radius * [0.3, 0.6, 1.2, 3][i % 4];
    const eye = [x + away * flat * Math.cos(turn), y + away * flat * Math.sin(turn), z + away * rise];
    return { eye, pixels: [1, 4, 16][i % 3] };
  });
}

async function validate({ name, dir }) {
  const files = readdirSync(join(dir, "tiles"), { recursive: true }).filter((file) => file.endsWith(".glb"));
  for (const file of files) {
    // Images of two tiles lie beside them.
    const beside = async (uri) => new Uint8Array(readFileSync(join(dir, "tiles", dirname(file), uri)));
    const glb = new Uint8Array(readFileSync(join(dir, "tiles", file)));
    const { issues } = await validator.validateBytes(glb, { externalResourceFunction: beside });
    if (issues.numErrors + issues.numWarnings > 0) problems.push(`${name} ${file}: ${JSON.stringify(issues.messages[0])}`);
  }
  console.log(`${name}: ${files.length} GLBs valid`);
}

/// The box of each tile's own content: what one would take without thinking of the group.
function falsified(text) {
  const change = (tile) => {
    const box = tile.content?.boundingVolume?.box;
    if (box) tile.boundingVolume = { box };
    tile.children?.forEach(change);
  };
  const tileset = JSON.parse(text);
  change(tileset.root);
  return JSON.stringify(tileset);
}

const TYPES = { ".html": "text/html", ".js": "text/javascript", ".json": "application/json", ".glb": "model/gltf-binary" };
const roots = new Map(sets.map((set) => [set.name, whole(set.dir)]));
const asked = Object.fromEntries(sets.map((set) => [set.name, views(roots.get(set.name))]));

/// Serves the page, the packages and the sets on the loopback address, and answers what the page found.
function browse() {
  return new Promise((done, fail) => {
    const server = createServer((request, response) => {
      const path = normalize(decodeURIComponent(new URL(request.url, "http://localhost").pathname));
      if (path === "/results") {
        const parts = [];
        request.on("data", (part) => parts.push(part));
        request.on("end", () => {
          response.end();
          done([JSON.parse(Buffer.concat(parts)), end]);
        });
        return;
      }
      const [, of, set, ...rest] = path.split("/");
      const found = of === "sets" ? sets.find(({ name }) => name === set) : null;
      try {
        let body;
        if (path === "/views.json") body = JSON.stringify({ sets, views: asked });
        else body = readFileSync(found ? join(found.dir, ...rest) : join(here, path));
        if (found?.isFalse && path.endsWith(".json")) body = falsified(body);
        response.writeHead(200, { "Content-Type": TYPES[extname(path)] ?? "application/octet-stream" });
        response.end(body);
      } catch {
        response.writeHead(404);
        response.end();
      }
    });
    const profile = mkdtempSync(join(tmpdir(), "chromium-"));
    let browser;
    const end = async () => {
      // With all processes that it has started: they would go on writing.
      process.kill(-browser.pid, "SIGKILL");
      await once(browser, "exit");
      server.close();
      server.closeAllConnections();
      rmSync(profile, { recursive: true, force: true, maxRetries: 20 });
    };
    server.listen(0, "127.0.0.1", () => {
      const url = `http://127.0.0.1:${server.address().port}/page.html`;
      const flags = ["--headless=new", "--no-sandbox", "--disable-gpu", `--user-data-dir=${profile}`, url];
      browser = spawn(process.env.CHROMIUM ?? "chromium", flags, { stdio: "ignore", detached: true });
      browser.on("error", fail);
    });
  });
}

/// The ends of the edges that are open in the source: an odd edge elsewhere is a crack.
function crackEdges({ open }, border) {
  return open.filter((edge) => !edge.split(" - ").every((end) => border.has(end)));
}

for (const set of sets) if (!set.isFalse) await validate(set);
// One view from within, with no error allowed, is the source itself: what is open there is no crack.
for (const set of sets) asked[set.name].push({ eye: roots.get(set.name).boundingVolume.box.slice(0, 3), pixels: 1e-9 });
const [results, end] = await browse();
await end();
for (const set of sets) {
  const mine = results.filter((result) => result.set === set.name);
  const source = mine.pop();
  if (!source) continue;
  const border = new Set(source.open.flatMap((edge) => edge.split(" - ")));
  let [cracked, edges, mixed] = [0, 0, 0];
  for (const { eye, pixels, names, failures, ...result } of mine) {
    if (failures.length > 0) problems.push(`${set.name}: ${failures[0]}`);
    const cracks = crackEdges(result, border);
    [cracked, edges] = [cracked + (cracks.length > 0), edges + cracks.length];
    mixed += names.length > 1;
    if (set.isFalse) continue;
    const wanted = expected(roots.get(set.name), eye, pixels);
    if (JSON.stringify(names) !== JSON.stringify(wanted)) {
      problems.push(`${set.name} ${eye} ${pixels}: ${names.length} tiles drawn, ${wanted.length} expected`);
    }
  }
  console.log(
    `${set.name}: ${mine.length} views, ${mixed} of several tiles, ${cracked} with cracks, ${edges} crack edges; source of ${source.triangles} triangles`,
  );
  if (set.isFalse ? cracked === 0 : cracked > 0) problems.push(`${set.name}: ${cracked} views with cracks`);
  if (mine.length !== count) problems.push(`${set.name}: ${mine.length} views of ${count}`);
}
for (const { failure } of results) if (failure) problems.push(failure);
problems.slice(0, 20).forEach((problem) => console.error(problem));
process.exit(problems.length > 0 ? 1 : 0);
