// What a plane cuts: lines of made meshes and of files, and the drawing, beside those of `chpm section`.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import path from "node:path";
import { before, test } from "node:test";
import { camera, distance, level, memorySource, open, select, uniform } from "../chpm/index.js";
import { planeName, svg } from "../view/drawing.js";
import { section } from "../view/section.js";
import { CHPM, chpm, random, temporary } from "./tools.mjs";

const skip = CHPM ? false : "CHPM names no command";
const folder = temporary();
const X = [1, 0, 0];
const Z = [0, 0, 1];

before(() => {
  if (skip) return;
  for (const [name, kind] of [["torus", "torus"], ["iso", "isosurface"], ["plates", "plates"], ["far", "hard:far-double"], ["winding", "hard:winding"]]) {
    chpm("synth", kind, "--triangles", "60000", "-o", path.join(folder, `${name}.ply`), "-f", "-q");
    chpm("build", path.join(folder, `${name}.ply`), "-o", path.join(folder, `${name}.chpm`), "-f", "-q", "--cluster-triangles", "512");
  }
});

/** A mesh as a page of one cluster, all of whose vertices are shared. */
function part(positions, triangles, ids = positions.map((_, vertex) => vertex)) {
  const [low, high] = [Math.min, Math.max].map((end) => [0, 1, 2].map((axis) => end(...positions.map((p) => p[axis]))));
  const page = { cluster: { id: 0, boxMin: low, boxMax: high }, positions: Float32Array.from(positions.flat()), indices: () => Uint16Array.from(triangles.flat()), ids: () => ids, errorAt: () => 0 };
  return { page, position: positions.length };
}

/** A box: corners by their bits. */
function box(low, high) {
  const positions = Array.from({ length: 8 }, (_, n) => [0, 1, 2].map((axis) => ((n >> axis) & 1 ? high : low)[axis]));
  const faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
  return [positions, faces.flatMap(([a, b, c, d]) => [[a, b, c], [a, c, d]])];
}

/** A ball or a ring: a grid that goes around, once more across. */
function ring(count, across, place) {
  const positions = Array.from({ length: count * across }, (_, i) => place((2 * Math.PI * Math.floor(i / across)) / count, (2 * Math.PI * (i % across)) / across));
  const at = (i, j) => (i % count) * across + (j % across);
  const triangles = [];
  for (let i = 0; i < count; i++) for (let j = 0; j < across; j++) triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
  return [positions, triangles];
}

const near = (a, b, most = 1e-9) => assert.ok(Math.abs(a - b) <= most * Math.max(1, Math.abs(b)), `${a} and ${b}`);

test("boxes are cut through vertices, edges and faces, and between them", () => {
  const cube = part(...box([0, 0, 0], [2, 1, 3]));
  for (const [plane, length, area] of [[[Z, 1], 6, 2], [[X, 0.5], 8, 3], [[[-1, 0, 0], -0.5], 8, 3]]) {
    const found = section([cube], plane);
    near(found.length, length), near(found.area, area);
    assert.deepEqual([found.closed, found.openEnds], [1, 0]);
  }
  // A face in the plane counts as above: the lower one has nothing below it, the upper one closes what comes from below.
  assert.equal(section([cube], [Z, 0]).lines.length, 0);
  near(section([cube], [Z, 3]).area, 2);
  // Through two edges, and two diagonals.
  const slope = Math.SQRT1_2;
  const tilted = section([part(...box([0, 0, 0], [1, 1, 1]))], [[slope, -slope, 0], 0]);
  near(tilted.area, Math.SQRT2), near(tilted.length, 2 + 2 * Math.SQRT2);
  assert.equal(tilted.openEnds, 0);
});

test("holes are no area, and what is in them is", () => {
  const nested = [5, 4, 3].map((side, n) => part(...box([-side, -side, -side], [side, side, side]), Array.from({ length: 8 }, (_, i) => 8 * n + i)));
  const { lines, area, closed, openEnds } = section(nested, [Z, 0.5]);
  near(area, 100 - 64 + 36);
  assert.deepEqual([closed, openEnds, lines.map(({ depth }) => depth).sort()], [3, 0, [0, 1, 2]]);
});

test("a ring is closed wherever it is cut, also where vertices lie on the plane", () => {
  const [[count, across], [large, small]] = [[48, 24], [2, 0.5]];
  const torus = part(...ring(count, across, (a, b) => [(large + small * Math.cos(b)) * Math.cos(a), (large + small * Math.cos(b)) * Math.sin(a), small * Math.sin(b)]));
  const polygon = (n, r) => 0.5 * n * r * r * Math.sin((2 * Math.PI) / n);
  near(section([torus], [Z, 0]).area, polygon(count, large + small) - polygon(count, large - small), 1e-6);
  near(section([torus], [X, 0]).area, 2 * polygon(across, small), 1e-6);
  const next = random(5);
  const heights = [0, ...torus.page.positions.filter((_, i) => i % 3 === 2).slice(0, across)];
  for (let i = 0; i < 60; i++) {
    const way = [0, 1, 2].map(() => 2 * next() - 1);
    const normal = i % 2 ? Z : way.map((x) => x / Math.hypot(...way));
    const { openEnds, closed, area } = section([torus], [normal, i % 2 ? heights[i % heights.length] : 2 * next() - 1]);
    assert.equal(openEnds, 0);
    assert.ok(closed === 0 || area > 0 || i % 2, `${closed} lines around ${area}`);
  }
});

test("ends are counted where a surface ends, and triangles that lie the other way are joined", () => {
  const [positions, triangles] = box([0, 0, 0], [1, 1, 1]);
  // Without its wall at x = 1 the line is open there.
  const open = section([part(positions, triangles.slice(0, 10))], [Z, 0.5]);
  near(open.length, 3);
  assert.deepEqual([open.lines.length, open.closed, open.openEnds, open.area], [1, 0, 2, 0]);
  const turned = triangles.map(([a, b, c], i) => (i % 3 ? [a, b, c] : [b, a, c]));
  const found = section([part(positions, turned)], [Z, 0.5]);
  near(found.area, 1);
  assert.equal(found.openEnds, 0);
  // Three walls on one edge.
  const fan = part([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0]], [[0, 1, 2], [0, 1, 3], [1, 0, 4]]);
  const { lines, openEnds } = section([fan], [Z, 0.5]);
  assert.deepEqual([lines.length, openEnds], [2, 4]);
  near(lines.reduce((sum, line) => sum + line.length, 0), 1.5);
});

/** The parts of a cut of a file, or each with all that its page has: where the source is flat, fewer vertices have no error either. */
async function partsOf(file, cut, isFull = false) {
  const pages = await file.pages(cut.map(({ cluster }) => cluster));
  return cut.map(({ cluster, bound }) => [pages.get(cluster), bound]).map(([page, bound]) => ({ page, position: isFull ? page.cluster.vertexCount : page.position(bound) }));
}

const load = async (name) => open(memorySource(readFileSync(path.join(folder, `${name}.chpm`))));

test("cuts of mixed levels have closed lines", { skip }, async () => {
  const file = await load("torus");
  await file.needTables();
  const { boxMin, boxMax } = file.header;
  let mixed = 0;
  const eye = [boxMax[0] + 0.05, 0.1, 0.2];
  for (const rule of [uniform(0.01), distance(0.003), camera({ eye, fov: 45, height: 600, pixels: 4 }), camera({ eye, fov: 45, height: 600, pixels: 1 })]) {
    const cut = await select(file, rule);
    mixed += new Set(cut.map(({ cluster }) => file.cluster(cluster).level)).size > 1 ? 1 : 0;
    const parts = await partsOf(file, cut);
    for (let axis = 0; axis < 3; axis++) {
      for (const share of [0.2, 0.4137, 0.5, 0.77]) {
        const normal = [0, 1, 2].map((x) => (x === axis ? 1 : 0));
        const found = section(parts, [normal, boxMin[axis] + share * (boxMax[axis] - boxMin[axis])]);
        assert.ok(found.closed > 0 && found.openEnds === 0 && found.area > 0, JSON.stringify([axis, share, found.closed, found.openEnds]));
        assert.ok(found.error <= Math.max(...parts.map(({ page, position }) => page.errorAt(position))));
      }
    }
  }
  assert.ok(mixed > 0, `${mixed} cuts of more than one level`);
});

/** All points of the paths of a drawing. */
const pointsOf = (text) => new Set([...text.matchAll(/ d="([^"]*)"/g)].flatMap(([, d]) => d.split(/[MLZ]+/).filter(Boolean)));
const sheetOf = (text) => /<svg[^>]*>/.exec(text)[0];

test("leaves are cut as `chpm section` cuts them, and drawn on the same sheet", { skip }, async () => {
  for (const [name, axis, share, sign] of [["torus", 2, 0.4, 1], ["iso", 0, 0.37, 1], ["iso", 1, 0.61, -1], ["plates", 0, 0.0211, -1], ["far", 0, 0.3, 1], ["winding", 2, 0.45, 1]]) {
    const file = await load(name);
    const { boxMin, boxMax, origin } = file.header;
    const normal = [0, 1, 2].map((x) => (x === axis ? sign : 0));
    const plane = [normal, sign * (boxMin[axis] + share * (boxMax[axis] - boxMin[axis]))];
    const found = section(await partsOf(file, await select(file, level(0)), true), plane);
    const drawn = path.join(folder, "plan.svg");
    const told = JSON.parse(chpm("section", path.join(folder, `${name}.chpm`), "--plane", planeName(plane, origin), "-o", drawn, "-f", "--json", "-q")).sections[0];
    near(found.length, told.length, 1e-6), near(found.area, told.area, 1e-6);
    assert.ok(told.lines > 0);
    assert.deepEqual([found.lines.length, found.closed, found.openEnds], [told.lines, told.closed, told.open_ends], name);
    const [own, other] = [svg(found, `${name}, ${planeName(plane, origin)}`, origin), readFileSync(drawn, "utf8")];
    assert.equal(sheetOf(own), sheetOf(other));
    const [points, others] = [pointsOf(own), pointsOf(other)];
    const common = [...points].filter((point) => others.has(point)).length;
    assert.ok(common > 0.99 * points.size && Math.abs(points.size - others.size) <= 0.01 * others.size, `${name}: ${common} of ${points.size} and ${others.size}`);
    for (const words of [/<title>.*<\/title>/, /<text y="9">.*<\/text>/, /<text x=.*<\/text>/]) {
      assert.equal(words.exec(own)?.[0], words.exec(other)?.[0]);
    }
  }
});
