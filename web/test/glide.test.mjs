// How what comes glides in.

import assert from "node:assert/strict";
import { test } from "node:test";
import { Glide } from "../view/glide.js";

/** Two clusters of one group, and one of another. */
const file = { cluster: (id) => ({ group: id >> 1, maxError: 40 }), group: (id) => ({ id, maxError: 40 }) };
const cut = (bound) => [0, 1, 2].map((cluster) => ({ cluster, bound }));

test("a group goes from its base to what is wanted, by a pixel a frame at the end, and its clusters alike", () => {
  const glide = new Glide();
  let [before, frames] = [40, 0];
  for (let now = 1e6; frames === 0 || glide.isGliding; now += 1000 / 60, frames += 1) {
    // What is new after a long rest is not there at once.
    const eased = glide.ease(file, cut(2), 2, frames === 0 ? now : now);
    assert.equal(eased[0].bound, eased[1].bound);
    if (frames > 0) assert.ok(before - eased[0].bound <= Math.max(1, before / 8) + 1e-6, `${before} to ${eased[0].bound}`);
    before = eased[0].bound;
    assert.ok(frames < 60);
  }
  assert.equal(before, 2);
  // Coarser at once.
  assert.deepEqual(glide.ease(file, cut(9), 2, 2e6).map(({ bound }) => bound), [9, 9, 9]);
  assert.ok(!glide.isGliding);
  // A slow machine is done as soon.
  const slow = new Glide();
  slow.ease(file, cut(2), 2, 0);
  slow.ease(file, cut(2), 2, 1000);
  assert.ok(!slow.isGliding);
});

test("base meshes, and pictures without any error allowed, do not glide", () => {
  const glide = new Glide();
  assert.deepEqual(glide.ease(file, cut(Infinity), 1), cut(Infinity));
  assert.deepEqual(glide.ease(file, cut(0), 0), cut(0));
  assert.ok(!glide.isGliding);
});
