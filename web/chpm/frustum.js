// What is outside an image. A plane is its inner normal, of length 1, and an offset, for points relative to the eye.

/** Some 40 times the rounding of a distance. */
export const SLACK = 1e-14;

/**
 * Whether a group's sphere, and so all that is below, is beyond one of the planes; its box, too, where `regions` are known. A group below has a smaller
 * slack: it is never inside where one above it is outside, in spite of rounding.
 */
export function missesGroup(planes, eye, { id, sphere, level }, regions = null) {
  const way = sphere.center.map((x, axis) => x - eye[axis]);
  const radius = regions ? regions.radius[id] : sphere.radius;
  const margin = radius + (level + 1) * SLACK * (Math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]) + radius);
  return planes.some((plane) => {
    const [x, y, z, offset] = plane;
    return x * way[0] + y * way[1] + z * way[2] + offset + margin < 0 || (regions !== null && misses(plane, eye, regions, id));
  });
}

/** Whether the box of a group is beyond a plane. Each step is monotone in the box, so that one inside it is, too. */
function misses(plane, eye, { low, high }, id) {
  let [farthest, reach] = [plane[3], 0];
  for (let axis = 0; axis < 3; axis++) {
    const [near, far] = [low[3 * id + axis] - eye[axis], high[3 * id + axis] - eye[axis]];
    farthest += plane[axis] * (plane[axis] > 0 ? far : near);
    reach += Math.abs(plane[axis]) * Math.max(Math.abs(near), Math.abs(far));
  }
  return farthest + SLACK * reach < 0;
}

/** Whether a cluster's box is beyond one of the planes. */
export function missesCluster(planes, eye, { boxMin, boxMax }) {
  return planes.some(([x, y, z, offset]) => {
    const way = [x, y, z].map((part, axis) => (part > 0 ? boxMax : boxMin)[axis] - eye[axis]);
    return x * way[0] + y * way[1] + z * way[2] + offset + SLACK * Math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]) < 0;
  });
}
