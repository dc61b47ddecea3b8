// The selection alone, of records that are made up: no command, no file.

import assert from "node:assert/strict";
import { test } from "node:test";
import { NONE } from "../chpm/records.js";
import { camera, level, select, selectFromMemory, uniform } from "../chpm/select.js";
import { random } from "./tools.mjs";

/** Half an image of 1,000 rows at distance 1, for a vertical angle of 60 degrees: what a pixel covers there. */
const PIXEL = (2 * Math.tan(Math.PI / 6)) / 1000;

/** The distance of two points. */
const apart = (a, b) => Math.hypot(...a.map((x, axis) => x - b[axis]));

test("a camera allows no more than its pixels at any point of a sphere", () => {
  const next = random(3);
  const within = (size) => 2 * size * next() - size;
  let near = 0;
  for (let i = 0; i < 500; i++) {
    const origin = [within(1e3), within(1e3), within(1e3)];
    const [eye, center] = [0, 0].map(() => [within(6), within(6), within(6)]);
    const [radius, pixels] = [8 * next(), 0.1 + 4 * next()];
    const world = eye.map((x, axis) => x + origin[axis]);
    const rule = camera({ eye: world, fov: 60, height: 1000, pixels, origin });
    const bound = rule.bound({ sphere: { center, radius }, level: 0 });
    const nearest = Math.max(apart(eye, center) - radius, 0);
    const allowed = pixels * PIXEL * nearest;
    assert.ok(bound <= allowed * (1 + 1e-9), `${bound} at ${nearest}`);
    // Nor needlessly little: a single's rounding, and that of places far from zero.
    assert.ok(bound >= allowed * (1 - 1e-6) - 1e-12, `${bound} at ${nearest}`);
    near += nearest === 0 ? 1 : 0;
    // What is in the sphere is refined, unless it is as fine as can be told.
    if (nearest === 0) assert.equal(bound, 0);
    assert.equal(rule.wants({ sphere: { center, radius }, level: 0, minError: bound }), false);
    assert.equal(rule.wants({ sphere: { center, radius }, level: 0, minError: bound + 1e-6 }), true);
    // Texels that are larger than what is allowed are seen, too.
    const textured = camera({ eye: world, fov: 60, height: 1000, pixels, origin, texel: ({ texel }) => texel });
    for (const more of [0, 1e-6]) assert.equal(textured.wants({ sphere: { center, radius }, level: 0, minError: 0, texel: bound + more }), more > 0);
  }
  assert.ok(near > 20 && near < 400, `${near}`);
});

test("beyond the sides of the image any error is allowed, below wherever it is above", () => {
  const next = random(5);
  const eye = [3, -2, 1];
  const planes = [[0.6, 0, -0.8, 0], [-0.6, 0, -0.8, 0], [0, 0.6, -0.8, 0], [0, -0.6, -0.8, 0], [0, 0, -1, -0.1]];
  const rule = camera({ eye, fov: 60, near: 0.1, height: 1000, pixels: 1, planes });
  const [seen, missed] = [[3, -2, -9], [3, -2, 9]].map((center) => rule.bound({ sphere: { center, radius: 1 }, level: 0 }));
  assert.ok(seen < 1 && missed === Infinity, `${seen} ${missed}`);
  // Spheres that touch a side from beyond or nearly do, and others in them that touch it at the same point.
  let outside = 0;
  for (let i = 0; i < 5000; i++) {
    const plane = planes[i % 4];
    const along = [next() - 0.5, next() - 0.5, -next()];
    const depth = plane[0] * along[0] + plane[1] * along[1] + plane[2] * along[2];
    const at = along.map((x, axis) => eye[axis] + 1e3 * (x - depth * plane[axis]));
    const inward = (radius) => at.map((x, axis) => x - (radius + 4e-12 * (next() - 0.2)) * plane[axis]);
    const center = inward(1);
    const inner = inward(0.25);
    const radius = Math.hypot(...inner.map((x, axis) => x - center[axis])) + 0.25;
    const [above, below] = [{ sphere: { center, radius }, level: 1 }, { sphere: { center: inner, radius: 0.25 }, level: 0 }].map(rule.bound);
    assert.ok(below >= above, `${below} below ${above}`);
    outside += above === Infinity ? 1 : 0;
  }
  assert.ok(outside > 500 && outside < 4900, `${outside}`);
});

test("what lies before the near plane counts as at it", () => {
  const rule = camera({ eye: [0, 0, 0], fov: 60, near: 0.5, height: 1000, pixels: 1 });
  assert.ok(Math.abs(rule.bound({ sphere: { center: [0.1, 0, 0], radius: 1 }, level: 0 }) - 0.5 * PIXEL) < 1e-9);
});

/**
 * Clusters 0 to 2 are leaves, 3 merges 0 and 1, the root 4 merges 3 and 2. The leaves 1 and 2 are a group, whose border collapses in both alike:
 * [level, least error, coarse, fine] of each group.
 */
const GROUPS = [
  [0, 0, [0], []],
  [0, 0, [1, 2], []],
  [1, 1, [3], [0, 1]],
  [2, 2, [4], [2, 3]],
];

/** A file of which all has been fetched. */
function lopsided() {
  const groups = GROUPS.map(([level, minError, coarse, fine], id) => ({ id, level, minError, coarse, fine, coarseCount: coarse.length, fineCount: fine.length }));
  const owner = (id, of) => groups.findIndex((group) => group[of].includes(id));
  const clusters = [0, 1, 2, 3, 4].map((id) => {
    const [group, parent] = [owner(id, "coarse"), owner(id, "fine")];
    return { id, group, parentGroup: parent < 0 ? NONE : parent, level: groups[group].level };
  });
  return {
    header: { levelCount: 3 },
    cluster: (id) => clusters[id],
    group: (id) => groups[id],
    hasMembers: () => true,
    coarse: ({ coarse }) => coarse,
    fine: ({ fine }) => fine,
    roots: async () => [4],
  };
}

/** The bounds of a cut by cluster. */
const told = (cut) => Object.fromEntries(cut.map(({ cluster, bound }) => [cluster, bound]));

test("a group that is there in part is at its base mesh, as its border is", async () => {
  const file = lopsided();
  // The other member of 2's group is below 3, which stays: so the border between 2 and 3 has not been refined.
  assert.deepEqual(told(await select(file, level(1))), { 2: Infinity, 3: 0 });
  assert.deepEqual(told(await select(file, uniform(1.5))), { 2: Infinity, 3: 1.5 });
  // All of a group at the bound of the rule.
  assert.deepEqual(told(await select(file, level(0))), { 0: 0, 1: 0, 2: 0 });
  assert.deepEqual(told(await select(file, uniform(0.5))), { 0: 0.5, 1: 0.5, 2: 0.5 });
  assert.deepEqual(told(await select(file, uniform(4))), { 4: 4 });
});

test("what cannot be drawn yet leaves the rest of its group at base meshes", () => {
  const file = lopsided();
  const { cut, waiting } = selectFromMemory(file, [4], level(0), (id) => id !== 0);
  assert.deepEqual(told(cut), { 2: Infinity, 3: 0 });
  assert.deepEqual(waiting.map(({ group, fine }) => [group.id, fine]), [[2, [0, 1]]]);
});
