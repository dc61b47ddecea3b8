// node check.mjs NAME=DIR=PLAIN[=OPTIONS] ...
//
// Shows tilesets to CesiumJS in a browser without a window, and checks for settled views that the tiles that it draws are those that their errors and
// boxes ask for, and that they have no crack. PLAIN is the folder of a tileset of the same file whose GLBs are not compressed: cracks are looked for in
// the bits of those, in the tileset's own frame, since on the earth the last bits of a place are not there. OPTIONS are those of Cesium3DTileset, as
// JSON; a set that has some is told of only. CHROMIUM names another browser, VIEWS another number of views, PICTURES a folder for a picture of each set.
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { outside, whole } from "../tileset.mjs";
import { browse } from "./browse.mjs";

const count = Number(process.env.VIEWS ?? 6);
const sets = process.argv.slice(2).map((word) => {
  const [name, dir, plain, options] = word.split("=");
  return { name, dir, plain, isOther: options !== undefined, options: options ? JSON.parse(options) : { dynamicScreenSpaceError: false } };
});
const problems = [];
/// Of the image, which page.html says.
const ROWS = 400;

/// What is to be drawn for an eye: the specification's rule.
function expected(root, eye, pixels) {
  const drawn = [];
  const walk = (tile) => {
    const away = outside(tile.boundingVolume.box, eye);
    const covered = away > 0 ? (tile.geometricError * ROWS) / (away * 2 * Math.tan(Math.PI / 3)) : Infinity;
    if (tile.children.length > 0 && tile.geometricError > 0 && covered > pixels) tile.children.forEach(walk);
    else if (tile.content) drawn.push(tile.content.uri.replace(/^.*tiles\//, ""));
  };
  walk(root);
  return drawn.sort();
}

/// Eyes about the model from where all of it is in the image.
function views(root) {
  const [x, y, z, ...halves] = root.content.boundingVolume.box;
  const size = Math.hypot(...halves);
  return Array.from({ length: count }, (_, i) => {
    const turn = 2.399963 * i;
    const rise = 0.9 * ((2 * ((i * 37) % 101)) / 101 - 1);
    const flat = Math.sqrt(1 - rise * rise);
    const from = [flat * Math.cos(turn), flat * Math.sin(turn), rise];
    const away = size * [1.25, 1.6, 2.5][i % 3];
    const eye = [x, y, z].map((center, axis) => center + away * from[axis]);
    const up = [-rise * Math.cos(turn), -rise * Math.sin(turn), flat];
    return { eye, forth: from.map((a) => -a), up, pixels: [0.1, 0.4, 1.6][(i + (i / 3 | 0)) % 3] };
  });
}

/// Edges of tiles that an odd number of triangles has, by the bits of their ends.
function openEdges(dir, names) {
  const edges = new Map();
  for (const name of names) {
    const glb = readFileSync(join(dir, "tiles", name));
    const length = glb.readUInt32LE(12);
    const { accessors, bufferViews, meshes } = JSON.parse(glb.toString("utf8", 20, 20 + length));
    if (!meshes) continue;
    const start = 28 + length;
    const { attributes, indices } = meshes[0].primitives[0];
    const view = bufferViews[accessors[attributes.POSITION].bufferView];
    const at = start + (view.byteOffset ?? 0);
    const key = (v) => glb.toString("latin1", at + v * (view.byteStride ?? 12), at + v * (view.byteStride ?? 12) + 12);
    const { bufferView, count, componentType } = accessors[indices];
    const first = start + (bufferViews[bufferView].byteOffset ?? 0);
    const corner = (i) => (componentType === 5123 ? glb.readUInt16LE(first + 2 * i) : glb.readUInt32LE(first + 4 * i));
    for (let i = 0; i < count; i += 3) {
      const ends = [0, 1, 2].map((j) => key(corner(i + j)));
      for (let j = 0; j < 3; j++) {
        const edge = [ends[j], ends[(j + 1) % 3]].sort().join("");
        edges.set(edge, (edges.get(edge) ?? 0) + 1);
      }
    }
  }
  return [...edges].filter(([, count]) => count % 2 === 1).map(([edge]) => edge);
}

const roots = new Map(sets.map(({ name, dir }) => [name, whole(dir)]));
const asked = Object.fromEntries(sets.map(({ name }) => [name, views(roots.get(name))]));

const { results = [{ failure: "the browser ended" }], said = [] } = await browse("page.html", (path) => {
  if (path === "/views.json") return JSON.stringify({ sets, views: asked });
  const [, of, set, ...rest] = path.split("/");
  const dir = of === "sets" ? sets.find(({ name }) => name === set)?.dir : null;
  return dir && readFileSync(join(dir, ...rest));
});
said.forEach((line) => problems.push(`the console: ${line}`));
for (const { name, plain, isOther } of sets) {
  const mine = results.filter(({ set }) => set === name);
  const finest = expected(roots.get(name), [0, 0, 0], -1);
  const border = new Set(openEdges(plain, finest).flatMap((edge) => [edge.slice(0, 12), edge.slice(12)]));
  let [cracked, edges, mixed, others] = [0, 0, 0, 0];
  for (const { eye, pixels, names, size, failures, picture } of mine) {
    if (failures.length > 0) problems.push(`${name}: ${failures[0]}`);
    if (size.some((length) => length !== ROWS)) problems.push(`${name}: an image of ${size}`);
    const cracks = openEdges(plain, names).filter((edge) => !(border.has(edge.slice(0, 12)) && border.has(edge.slice(12))));
    [cracked, edges, mixed] = [cracked + (cracks.length > 0), edges + cracks.length, mixed + (names.length > 1)];
    others += JSON.stringify(names) !== JSON.stringify(expected(roots.get(name), eye, pixels));
    if (picture && process.env.PICTURES) writeFileSync(join(process.env.PICTURES, `${name}.png`), Buffer.from(picture.split(",")[1], "base64"));
  }
  console.log(`${name}: ${mine.length} views, ${mixed} of several tiles, ${others} of other tiles than the rule's, ${cracked} with cracks, ${edges} crack edges`);
  if (!isOther && cracked + others > 0) problems.push(`${name}: ${cracked} views with cracks, ${others} of other tiles`);
  if (mine.length !== count) problems.push(`${name}: ${mine.length} views of ${count}`);
}
for (const { failure } of results) if (failure) problems.push(failure);
problems.slice(0, 20).forEach((problem) => console.error(problem));
process.exit(problems.length > 0 ? 1 : 0);
