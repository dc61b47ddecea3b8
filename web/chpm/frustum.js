// What is outside an image. A plane is its inner normal, of length 1, and an offset, for points relative to the eye.

/** Some 40 times the rounding of a distance. */
const SLACK = 1e-14;

/**
 * Whether a group's sphere, and so all that is below, is beyond one of the planes. A group below has a smaller slack: it is never inside
 * where one above it is outside, in spite of rounding.
 */
export function missesGroup(planes, eye, { sphere: { center, radius }, level }) {
  const way = center.map((x, axis) => x - eye[axis]);
  const margin = radius + (level + 1) * SLACK * (Math.hypot(...way) + radius);
  return planes.some(([x, y, z, offset]) => x * way[0] + y * way[1] + z * way[2] + offset + margin < 0);
}

/** Whether a cluster's box is beyond one of the planes. */
export function missesCluster(planes, eye, { boxMin, boxMax }) {
  return planes.some(([x, y, z, offset]) => {
    const way = [x, y, z].map((part, axis) => (part > 0 ? boxMax : boxMin)[axis] - eye[axis]);
    return x * way[0] + y * way[1] + z * way[2] + offset + SLACK * Math.hypot(...way) < 0;
  });
}
