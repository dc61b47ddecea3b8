// What of a drawn cut a ray meets first.

/** The nearer and the farther end of a ray in a box, or null beside it. */
function within({ boxMin, boxMax }, eye, way) {
  let [near, far] = [0, Infinity];
  for (let axis = 0; axis < 3; axis++) {
    const ends = [boxMin[axis], boxMax[axis]].map((x) => (x - eye[axis]) / way[axis]);
    if (ends.some(Number.isNaN)) continue;
    near = Math.max(near, Math.min(...ends));
    far = Math.min(far, Math.max(...ends));
  }
  return near <= far ? near : null;
}

/** How far along a ray a triangle is, or infinite beside it (Moller and Trumbore). */
function meets(p, a, b, c, eye, way) {
  const [e1x, e1y, e1z] = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
  const [e2x, e2y, e2z] = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
  const [hx, hy, hz] = [way[1] * e2z - way[2] * e2y, way[2] * e2x - way[0] * e2z, way[0] * e2y - way[1] * e2x];
  const size = e1x * hx + e1y * hy + e1z * hz;
  if (size === 0) return Infinity;
  const [sx, sy, sz] = [eye[0] - p[a], eye[1] - p[a + 1], eye[2] - p[a + 2]];
  const u = (sx * hx + sy * hy + sz * hz) / size;
  if (u < 0 || u > 1) return Infinity;
  const [qx, qy, qz] = [sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x];
  const v = (way[0] * qx + way[1] * qy + way[2] * qz) / size;
  if (v < 0 || u + v > 1) return Infinity;
  const at = (e2x * qx + e2y * qy + e2z * qz) / size;
  return at > 0 ? at : Infinity;
}

/**
 * The first point of a cut on a ray that `isKept`, in the file's coordinates, and the error of the mesh there; null where there is none.
 * @param {{ page: Page, position: number }[]} drawn
 */
export function pick(drawn, eye, way, isKept = () => true) {
  const found = { at: Infinity, error: 0 };
  const near = drawn.map((block) => [within(block.page.cluster, eye, way), block]).filter(([at]) => at !== null);
  for (const [from, { page, position }] of near.sort((a, b) => a[0] - b[0])) {
    if (from > found.at) break;
    const corners = page.indices(position);
    for (let i = 0; i < corners.length; i += 3) {
      const at = meets(page.positions, 3 * corners[i], 3 * corners[i + 1], 3 * corners[i + 2], eye, way);
      if (at < found.at && isKept(eye.map((x, axis) => x + at * way[axis]))) Object.assign(found, { at, error: page.errorAt(position) });
    }
  }
  if (found.at === Infinity) return null;
  return { point: eye.map((x, axis) => x + found.at * way[axis]), error: found.error };
}
