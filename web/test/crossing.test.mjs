// Closed lines that cross, beside what the command tells of the same models.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { level, memorySource, open, select } from "../chpm/index.js";
import { crossing, side } from "../view/crossing.js";
import { planeName } from "../view/drawing.js";
import { section } from "../view/section.js";
import { CHPM, chpm, random, temporary } from "./tools.mjs";

const skip = CHPM ? false : "CHPM names no command";

/** A box with points in the middle of its sides, as triangulated faces have them. */
function box([x, y], [toX, toY]) {
  const [midX, midY] = [(x + toX) / 2, (y + toY) / 2];
  return [[x, y], [midX, y], [toX, y], [toX, midY], [toX, toY], [midX, toY], [x, toY], [x, midY]];
}

const rotated = (ring, by) => [...ring.slice(by), ...ring.slice(0, by)];

/** Whichever way each of two is turned, wherever it begins, and whichever comes first. */
function told(a, b) {
  const found = new Set();
  for (let turn = 0; turn < a.length * b.length * 8; turn++) {
    let [one, other] = [rotated(a, (turn >> 3) % a.length), rotated(b, Math.floor((turn >> 3) / a.length))];
    if (turn & 1) one = one.toReversed();
    if (turn & 2) other = other.toReversed();
    const crosses = crossing((turn & 4 ? [other, one] : [one, other]).map((ring) => ring.flat()));
    assert.equal(crosses[0], crosses[1]);
    found.add(crosses[0]);
  }
  assert.equal(found.size, 1, JSON.stringify([a, b]));
  return [...found][0];
}

const UNIT = box([0, 0], [1, 1]);

test("rings that overlap cross, and rings that touch do not", () => {
  for (const x of [0.3, 0.5, 0.9, -0.35]) assert.ok(told(UNIT, box([x, 0.11], [x + 0.9, 1.01])), `${x}`);
  // Along two sides, and through points alone.
  for (const other of [box([0.5, 0], [1.5, 1]), box([0.25, 0], [0.75, 2]), box([-0.5, 0.25], [0.5, 0.75]), [[0.5, 0], [1, 0.5], [2, -2]], [[0, 0], [1, 1], [3, 0]]]) assert.ok(told(UNIT, other), JSON.stringify(other));
  // The same one, beside it along a side or in a corner, apart, in it along none to all sides, around it; by a point on a side.
  const touching = [[[0, 0], [1, 1]], [[1, 0], [2, 1]], [[1, 0.25], [1.5, 0.75]], [[-1, 0.3], [0, 1.7]], [[1, 1], [2, 2]], [[1.5, 0], [2, 1]], [[0.25, 0.25], [0.75, 0.75]], [[0, 0.25], [0.75, 0.75]], [[0.5, 0], [1, 1]], [[0, 0.2], [1, 0.6]], [[-1, -1], [2, 2]]];
  for (const [low, high] of touching) assert.ok(!told(UNIT, box(low, high)), `${low} ${high}`);
  for (const other of [[[0.5, 0], [0.75, 0.5], [0.25, 0.5]], [[0.25, 0], [0.75, -0.5], [0.1, -0.5]], [[0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5]]]) assert.ok(!told(UNIT, other), JSON.stringify(other));
});

test("signs are exact, where those of rounded numbers are not", () => {
  let wrong = 0;
  const step = 2 ** -53;
  for (let i = 0; i < 64; i++) {
    for (let j = 0; j < 64; j++) {
      const [a, b, c] = [[0.5 + i * step, 0.5 + j * step], [12, 12], [24, 24]];
      // On the diagonal's line it is 0; else the side on which the point is.
      assert.ok(side(a, b, c) === Math.sign(i - j) * side([1, 0], b, c), `${i} ${j}`);
      if (Math.sign((a[0] - c[0]) * (b[1] - c[1]) - (a[1] - c[1]) * (b[0] - c[0])) !== side(a, b, c)) wrong += 1;
    }
  }
  assert.ok(wrong > 100, `${wrong}`);
});

test("the grid finds what all pairs have", () => {
  const next = random(7);
  let some = 0;
  for (let round = 0; round < 100; round++) {
    const rings = Array.from({ length: 8 }, () => {
      const [x, y, size] = [1.5 * next(), 1.5 * next(), 0.05 + 0.9 * next() * next()];
      const ring = box([x, y], [x + size, y + size * (0.02 + next())]);
      // One side in many steps.
      const steps = Math.floor(120 * next());
      const [from, to] = [ring[1], ring[2]];
      ring.splice(2, 0, ...Array.from({ length: steps }, (_, i) => [from[0] + ((i + 1) / (steps + 1)) * (to[0] - from[0]), from[1] - 0.01 * size * next()]));
      return ring.flat();
    });
    const expected = rings.map((ring, i) => rings.some((other, j) => i !== j && crossing([ring, other])[0]));
    assert.deepEqual(crossing(rings), expected);
    some += expected.filter(Boolean).length;
  }
  assert.ok(some > 100 && some < 700, `${some}`);
});

test("areas are told where the command tells them, the same ones", { skip }, async () => {
  const folder = temporary();
  let [crossed, whole] = [0, 0];
  for (const kind of ["hard:crossing", "isosurface"]) {
    const name = path.join(folder, "model.chpm");
    chpm("synth", kind, "--triangles", "3000", "-o", path.join(folder, "model.ply"), "-f", "-q");
    chpm("build", path.join(folder, "model.ply"), "-o", name, "-f", "-q");
    const file = await open(memorySource(readFileSync(name)));
    const { boxMin, boxMax, origin } = file.header;
    const cut = await select(file, level(0));
    const pages = await file.pages(cut.map(({ cluster }) => cluster));
    const parts = cut.map(({ cluster }) => ({ page: pages.get(cluster), position: pages.get(cluster).cluster.vertexCount }));
    for (const [axis, share] of [[0, 0.31], [1, 0.4], [1, 0.55], [2, 0.47]]) {
      const plane = [[0, 1, 2].map((x) => (x === axis ? 1 : 0)), boxMin[axis] + share * (boxMax[axis] - boxMin[axis])];
      const found = section(parts, plane);
      const told = JSON.parse(chpm("section", name, "--plane", planeName(plane, origin), "-o", path.join(folder, "plan.svg"), "-f", "--json", "-q")).sections[0];
      assert.deepEqual([found.crossing, found.area === null], [told.crossing, told.area === null], `${kind} ${axis} ${share}`);
      if (told.area === null) crossed += 1;
      else whole += 1;
      if (told.area !== null) assert.ok(Math.abs(found.area - told.area) <= 1e-9 * told.area, `${found.area} ${told.area}`);
    }
  }
  assert.ok(crossed > 0 && whole > 0, `${crossed} ${whole}`);
});
