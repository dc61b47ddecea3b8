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
    const bound = rule.bound({ sphere: { center, radius } });
    const nearest = Math.max(apart(eye, center) - radius, 0);
    const allowed = pixels * PIXEL * nearest;
    assert.ok(bound <= allowed * (1 + 1e-9), `${bound} at ${nearest}`);
    // Nor needlessly little: a single's rounding, and that of places far from zero.
    assert.ok(bound >= allowed * (1 - 1e-6) - 1e-12, `${bound} at ${nearest}`);
    near += nearest === 0 ? 1 : 0;
    // What is in the sphere is refined, unless it is as fine as can be told.
    if (nearest === 0) assert.equal(bound, 0);
    assert.equal(rule.wants({ sphere: { center, radius }, minError: bound }), false);
    assert.equal(rule.wants({ sphere: { center, radius }, minError: bound + 1e-6 }), true);
  }
  assert.ok(near > 20 && near < 400, `${near}`);
});

test("what lies before the near plane counts as at it", () => {
  const rule = camera({ eye: [0, 0, 0], fov: 60, near: 0.5, height: 1000, pixels: 1 });
  assert.ok(Math.abs(rule.bound({ sphere: { center: [0.1, 0, 0], radius: 1 } }) - 0.5 * PIXEL) < 1e-9);
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
