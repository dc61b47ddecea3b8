// What is taken for hidden: boxes beside depths, and groups from picture to picture.

import assert from "node:assert/strict";
import { test } from "node:test";
import { Pyramid } from "../view/occlusion.js";
import { Sight } from "../view/sight.js";
import { random } from "./tools.mjs";

const [WIDTH, HEIGHT, SIDE] = [203, 117, 4];
/** A camera at zero that looks along -z, from 1 to 100. */
const [NEAR, FAR] = [1, 100];
const MATRIX = new Float32Array([1, 0, 0, 0, 0, 2, 0, 0, 0, 0, (FAR + NEAR) / (NEAR - FAR), -1, 0, 0, (2 * FAR * NEAR) / (NEAR - FAR), 0]);

/** The column, the row and the depth of a point in a picture. */
function seen([x, y, z]) {
  const depth = (MATRIX[10] * z + MATRIX[14]) / -z;
  return [(0.5 + (0.5 * x) / -z) * WIDTH, (0.5 + y / -z) * HEIGHT, 0.5 + 0.5 * depth];
}

/** What the graphics card gives for depths of all pixels. */
function squares(depths) {
  const [columns, rows] = [Math.ceil(WIDTH / SIDE), Math.ceil(HEIGHT / SIDE)];
  const bytes = new Uint8Array(4 * columns * rows);
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      let far = 0;
      for (let y = row * SIDE; y < Math.min(HEIGHT, (row + 1) * SIDE); y++) {
        for (let x = column * SIDE; x < Math.min(WIDTH, (column + 1) * SIDE); x++) far = Math.max(far, depths[y * WIDTH + x]);
      }
      const steps = Math.ceil(far * 16777215);
      bytes.set([steps & 255, (steps >> 8) & 255, steps >> 16], 4 * (row * columns + column));
    }
  }
  return bytes;
}

test("no point of a box that is hidden is before what was drawn at its pixel", () => {
  const next = random(5);
  let [hidden, partly] = [0, 0];
  for (let picture = 0; picture < 30; picture++) {
    // A wall that leans, with a hole.
    const [away, leans, hole] = [3 + 20 * next(), 0.1 * next(), [WIDTH * next(), HEIGHT * next(), 40 * next()]];
    const depths = Float32Array.from({ length: WIDTH * HEIGHT }, (_, i) => {
      const [x, y] = [i % WIDTH, Math.floor(i / WIDTH)];
      return Math.hypot(x - hole[0], y - hole[1]) < hole[2] ? 1 : seen([0, 0, -away - leans * x])[2];
    });
    const pyramid = new Pyramid(squares(depths), [WIDTH, HEIGHT], MATRIX);
    for (let box = 0; box < 200; box++) {
      const z = -2 - 60 * next();
      const center = [z * (2 * next() - 1), 0.5 * z * (2 * next() - 1), z];
      const half = [0, 1, 2].map(() => 8 * next() ** 3);
      const [low, high] = [-1, 1].map((sign) => center.map((x, axis) => x + sign * half[axis]));
      const isInside = pyramid.hides(low, high, false);
      if (!pyramid.hides(low, high, true)) {
        assert.ok(!isInside);
        continue;
      }
      hidden += 1;
      if (!isInside) partly += 1;
      for (let point = 0; point < 60; point++) {
        const [x, y, depth] = seen(low.map((x, axis) => x + (high[axis] - x) * (point < 8 ? (point >> axis) & 1 : next())));
        if (x < 0 || y < 0 || x >= WIDTH || y >= HEIGHT) {
          assert.ok(!isInside, "what is beside the picture is not known");
          continue;
        }
        assert.ok(depth > depths[Math.floor(y) * WIDTH + Math.floor(x)], `${low} ${high}: ${x} ${y}`);
      }
    }
  }
  assert.ok(hidden > 500 && partly > 20, `${hidden} ${partly}`);
});

test("what the near plane cuts, and what is before the eye's back, is not hidden", () => {
  const pyramid = new Pyramid(squares(new Float32Array(WIDTH * HEIGHT).fill(seen([0, 0, -1.01])[2])), [WIDTH, HEIGHT], MATRIX);
  assert.ok(pyramid.hides([-1, -1, -6], [1, 1, -5], true));
  for (const [low, high] of [[[-1, -1, -6], [1, 1, -0.9]], [[-1, -1, -6], [1, 1, 6]], [[-1, -1, 5], [1, 1, 6]]]) assert.ok(!pyramid.hides(low, high, true));
});

/** A renderer that hides what it is told to, when it is told to. */
function staged() {
  const stage = { hidden: () => false, answer: null };
  const renderer = {
    painted: 0,
    occlusion: { isAsking: false },
    size: () => [WIDTH, HEIGHT],
    ask(_, then) {
      this.occlusion.isAsking = true;
      stage.answer = (comes = true) => {
        this.occlusion.isAsking = false;
        then(comes ? { hides: (low) => stage.hidden(low[0]) } : null);
      };
    },
  };
  let heard = 0;
  const sight = new Sight(null, { center: [0, 0, 0], stretch: [1, 1, 1], scale: 1 }, renderer, () => (heard += 1));
  const group = (id) => ({ id, sphere: { center: [id, 0, 0], radius: 0 } });
  const frame = (turn, now, cut, isComplete = true, sheets = false) => {
    sight.begin({ matrix: () => [turn] }, sheets, null, true, now);
    const hidden = [1, 2].filter((id) => sight.hides(group(id)));
    sight.end(cut, isComplete);
    return hidden;
  };
  return { stage, sight, frame, renderer, heard: () => heard };
}

const [A, B] = [[{ cluster: 1, bound: 1 }], [{ cluster: 2, bound: 1 }]];

test("at rest what is hidden is so at once, and two that hide each other in turn settle", () => {
  const { stage, sight, frame, heard } = staged();
  assert.deepEqual(frame(0, 0, A), []);
  assert.ok(!sight.knows(A));
  stage.hidden = (id) => id === 1;
  stage.answer();
  assert.equal(heard(), 1);
  assert.deepEqual(frame(0, 1, A), [1]);
  assert.ok(sight.knows(A) && !sight.knows(B));
  // Each answer is the other way round, and each time another cut is drawn.
  let [before, answers] = [null, 0];
  for (let round = 0; round < 20; round++) {
    stage.answer = null;
    before = frame(0, 2 + round, round & 1 ? A : B);
    if (!stage.answer) continue;
    stage.hidden = (id) => id === 1 + (answers & 1);
    answers += 1;
    stage.answer();
  }
  assert.deepEqual(before, []);
});

test("while the camera moves, what was seen a moment ago is not hidden, and pages are asked for now and then", () => {
  const { stage, sight, frame } = staged();
  frame(0, 0, A);
  stage.answer();
  assert.deepEqual(frame(1, 10, A), []);
  stage.hidden = () => true;
  stage.answer();
  assert.deepEqual(frame(2, 100, A), []);
  stage.answer();
  assert.deepEqual(frame(3, 600, A), [1, 2]);
  const ready = [4, 5, 6, 7, 8, 9, 10, 11].map((turn) => (frame(turn, 600 + turn, A), sight.isReady()));
  assert.deepEqual(ready, [false, false, false, true, false, false, false, true]);
  // It stands: as soon as there is an answer.
  stage.answer();
  frame(11, 700, A);
  stage.answer();
  frame(11, 701, A);
  assert.ok(sight.isReady());
});

test("where no answer comes, nothing is hidden, and nothing is waited for", () => {
  const { stage, sight, frame, heard } = staged();
  stage.hidden = () => true;
  frame(0, 0, A);
  stage.answer(false);
  assert.equal(heard(), 1);
  assert.deepEqual(frame(0, 1, B), []);
  assert.ok(sight.knows(B) && sight.isReady() && !sight.hidesCluster({ boxMin: [1, 0, 0], boxMax: [1, 0, 0] }));
});

test("a sheet that comes may have holes: what was hidden is asked about anew", () => {
  const { stage, sight, frame, renderer } = staged();
  stage.hidden = () => true;
  frame(0, 0, A, true, true);
  stage.answer();
  assert.deepEqual(frame(0, 1, A, true, true), [1, 2]);
  assert.ok(sight.knows(A));
  for (const [painted, sheets] of [[1, true], [1, false]]) {
    renderer.painted = painted;
    frame(0, 2, A, true, sheets);
    assert.ok(!sight.knows(A));
    stage.answer();
    frame(0, 3, A, true, sheets);
    assert.ok(sight.knows(A));
  }
});
