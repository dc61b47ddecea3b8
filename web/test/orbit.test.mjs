// The camera of the page: what it frames, and from where.

import assert from "node:assert/strict";
import { test } from "node:test";
import { Orbit, dot } from "../view/orbit.js";

/** An orbit over a canvas that nobody draws on, `covered` pixels of which lie below a panel. */
const orbit = (width, height, covered = 0) =>
  new Orbit({ clientWidth: width, clientHeight: height, addEventListener() {} }, () => {}, () => covered);

/** Where points are in what is left of the image: from -1 to 1 across and along. */
function seen(camera, points, [width, height], covered) {
  const [right, up, back] = camera.axes();
  const eye = camera.eye();
  const rise = Math.tan((camera.fov * Math.PI) / 360);
  return points.map((point) => {
    const way = point.map((x, axis) => x - eye[axis]);
    const depth = -dot(way, back);
    assert.ok(depth > camera.range()[0] && depth < camera.range()[1]);
    return [dot(way, right) / (depth * rise * ((width - covered) / height)), dot(way, up) / (depth * rise)];
  });
}

test("a silhouette touches the free part of the image from within, in its middle", () => {
  const bodies = [
    [[0, 0, 0], [3, 0.1, 0.2], [0.3, 4, -0.4], [0.2, 0.5, 1]],
    [[1e6, 0, 0], [1e6 + 1, 0, 0], [1e6, 9, 0], [1e6, 9, 2]],
    [[0, 0, 0], [1e-3, 0, 0], [0, 0, 1e-3], [1e-3, 1e-3, 1e-3]],
  ];
  for (const points of bodies) {
    for (const [width, height, covered] of [[1000, 700, 0], [1000, 700, 240], [400, 800, 0], [800, 10, 0], [10, 800, 0], [16384, 2, 0]]) {
      for (const sight of [[0, 0, -1], [1, 0, 0], [0.3, -0.8, 0.2]]) {
        const camera = orbit(width, height, covered);
        camera.look(sight);
        camera.frame(points, 10);
        const at = seen(camera, points, [width, height], covered);
        const most = Math.max(...at.flat().map(Math.abs));
        // From a tip it keeps away.
        const fits = Math.abs(most - 0.92) < 1e-6;
        assert.ok(fits || (points !== bodies[2] && sight[1] < 0 && most < 0.92 && most > 0.85), `${most}`);
        // In the middle of the direction in which it fits.
        const off = [0, 1].map((axis) => [Math.min, Math.max].map((end) => end(...at.map((p) => p[axis])))).map(([low, high]) => Math.abs(low + high));
        assert.ok(!fits || Math.min(...off) < 1e-6, `${off}`);
      }
    }
  }
});

test("a model is looked at as whoever made the page says", () => {
  for (const up of ["x", "y", "z", "-x", "-y", "-z"]) {
    for (const sight of [[0.5, 0.5, 0.1], [-0.2, 0.9, -0.3], [0, 0.1, 1], [1, 0, 0.01]]) {
      const camera = orbit(100, 100);
      camera.up = up;
      camera.look(sight);
      const back = camera.axes()[2];
      const length = Math.hypot(...sight);
      const steep = Math.abs(camera.rise) > 1.4;
      assert.ok(steep || back.every((x, axis) => Math.abs(x + sight[axis] / length) < 1e-9), `${up} ${sight} ${back}`);
    }
  }
});

test("a single point has a camera, too", () => {
  const camera = orbit(640, 480);
  camera.frame([[5, 5, 5]], 0);
  assert.ok(camera.eye().every(Number.isFinite) && camera.distance > 0);
});

test("a canvas of another size shows all of it, until somebody moves the camera", () => {
  const camera = orbit(900, 600);
  const points = [[0, 0, 0], [3, 0.1, 0.2], [0.3, 4, -0.4]];
  camera.fit();
  camera.frame(points, 3);
  const before = camera.distance;
  camera.canvas.clientWidth = 200;
  camera.fit();
  assert.ok(camera.distance > before);
  assert.ok(Math.max(...seen(camera, points, [200, 600], 0).flat().map(Math.abs)) < 0.93);
});
