// Which clusters are drawn, and how finely: the selection of the file format. Any cut that it gives has no cracks.

import { SLACK, missesGroup } from "./frustum.js";
import { NONE, expect } from "./records.js";

/**
 * A cut: clusters, and the error that each is drawn with.
 * @typedef {{ cluster: number, bound: number }} Member
 */

/** The largest single that is not above a number. */
function roundDown(x) {
  const nearest = Math.fround(x);
  if (!(nearest > x)) return nearest;
  const float = new Float32Array([nearest]);
  new Uint32Array(float.buffer)[0] -= 1;
  return float[0];
}

/** The single before another one that is above zero. */
function before(x) {
  const float = new Float32Array([x]);
  if (float[0] > 0) new Uint32Array(float.buffer)[0] -= 1;
  return float[0];
}

/** The same error everywhere. For pictures: components that lie apart may have vanished. */
export function uniform(error) {
  const bound = roundDown(error);
  return { wants: (group) => bound < group.minError, bound: () => bound };
}

/** Every point of the source is within `distance` of what is drawn, and the other way round. */
export function distance(most) {
  const allowed = roundDown(most);
  const bound = ({ fineGap, baseGap, gapError }) => {
    if (allowed >= baseGap) return allowed;
    return allowed >= fineGap ? Math.min(allowed, before(gapError)) : 0;
  };
  return { wants: (group) => group.fineGap > allowed || group.minError > bound(group), bound };
}

/** The clusters of a level at their finest; 0 is the source. */
export function level(number) {
  return { wants: (group) => group.level > number, bound: () => 0 };
}

/**
 * At most `pixels` of error in an image of `height` rows.
 * @param {{ eye: number[], fov: number, near?: number, height: number, pixels: number, origin?: number[], planes?: number[][], regions?: Regions, texel?: (group) => number, hides?: (group) => boolean }} view `eye` in
 *   the model's coordinates, or relative to `origin` if that is given; `fov` is the vertical angle in degrees. Beyond one of the `planes` (inner normal of
 *   length 1, offset; for points relative to the eye) any error is allowed, and in groups that something `hides` with all that is below. With `regions` boxes count, too: the same cut as that of the viewer. A group with
 *   a larger `texel` than the error that is allowed is split for its sheets
 */
export function camera({ eye, fov, near = 0, height, pixels, origin = [0, 0, 0], planes = [], regions = null, texel = null, hides = null }) {
  const at = eye.map((x, axis) => x - origin[axis]);
  const scale = pixels * ((2 * Math.tan((fov * Math.PI) / 360)) / height);
  const bound = (group) => {
    if (missesGroup(planes, at, group, regions) || hides?.(group)) return Infinity;
    const { center } = group.sphere;
    const radius = regions ? regions.radius[group.id] : group.sphere.radius;
    const away = norm(center[0] - at[0], center[1] - at[1], center[2] - at[2]);
    // What rounding may have added to the distance is taken off.
    const slack = SLACK * (regions ? group.level + 1 : 1);
    const reach = away - radius - slack * (away + radius);
    return roundDown(scale * Math.max(reach, regions ? toBox(regions, group.id, at) : 0, near, 0));
  };
  const least = (group) => Math.max(regions ? regions.splitError[group.id] : group.minError, texel?.(group) ?? 0);
  return { wants: (group) => bound(group) < least(group), bound };
}

const norm = (x, y, z) => Math.sqrt(x * x + y * y + z * z);

/** The distance of a point to the box of a group, never too large. */
function toBox({ low, high }, id, at) {
  const outside = (axis) => Math.max(low[3 * id + axis] - at[axis], at[axis] - high[3 * id + axis], 0);
  return norm(outside(0), outside(1), outside(2)) * (1 - SLACK);
}

/**
 * The cut that a rule gives. Tables are fetched as far as it goes.
 * @param file an open file
 * @param rule {@link uniform}, {@link distance}, {@link level}, {@link camera}, or one of your own that allows no more in a group
 *   than in any above it
 * @returns {Promise<Member[]>}
 */
export async function select(file, rule, { signal } = {}) {
  const roots = await file.roots(signal);
  const walk = new Walk(file, rule, roots);
  for (;;) {
    const wanted = walk.next();
    if (!wanted) return walk.cut();
    await file.needClusters(wanted.clusters, signal);
    await file.needGroups(wanted.groups, signal);
    await file.needMembers(wanted.members, signal);
  }
}

/**
 * The same from what has been fetched, at once. Where a record is missing, or `mayDraw` says that a cluster cannot be drawn yet, coarser
 * clusters stay; so the cut is whole and without cracks all the same.
 * @returns {{ cut: Member[], waiting: { group: object, fine: number[] | null }[], met: Set<number> }} the cut, the splits that could not be made, and the
 *   clusters of the cut with all that are above them
 */
export function selectFromMemory(file, roots, rule, mayDraw = () => true) {
  const walk = new Walk(file, rule, roots, mayDraw);
  walk.next();
  return { cut: walk.cut(), waiting: walk.waiting, met: walk.met };
}

/** Splits groups from the top down. A group is split when all its coarse clusters are in the cut. */
class Walk {
  constructor(file, rule, roots, mayDraw = null) {
    Object.assign(this, { file, rule, mayDraw, waiting: [] });
    this.active = new Set();
    /** All that is in the cut, or was before it was split. */
    this.met = new Set();
    /** How many coarse clusters of a group are in the cut. */
    this.present = new Map();
    /** Groups to look at, by level: those above are done before. */
    this.due = Array.from({ length: file.header.levelCount }, () => new Set());
    this.level = file.header.levelCount - 1;
    this.arrived = roots.map((id) => ({ id, parent: NONE }));
  }

  /** Goes on as far as records are there. What is wanted to go on, or null at the end. */
  next() {
    for (;;) {
      const wanted = this.admit();
      if (wanted) return wanted;
      while (this.level >= 0 && this.arrived.length === 0) {
        const wanted = this.splitLevel();
        if (wanted) return wanted;
      }
      if (this.arrived.length === 0) return null;
    }
  }

  /** Takes what has arrived into the cut. */
  admit() {
    const { file } = this;
    const clusters = this.arrived.map(({ id }) => id).filter((id) => !file.cluster(id));
    if (clusters.length > 0) return { clusters, groups: [], members: [] };
    const groups = this.arrived.map(({ id }) => file.cluster(id).group).filter((id) => !file.group(id));
    if (groups.length > 0 && !this.mayDraw) return { clusters: [], groups, members: [] };

    for (const { id, parent } of this.arrived) {
      const cluster = file.cluster(id);
      expect(cluster.parentGroup === parent && cluster.level <= this.level, () => `cluster ${id} is not what group ${parent} names as fine`);
      this.active.add(id);
      this.met.add(id);
      this.present.set(cluster.group, (this.present.get(cluster.group) ?? 0) + 1);
      const group = file.group(cluster.group);
      if (!group) {
        this.waiting.push({ group: { id: cluster.group }, fine: null });
        continue;
      }
      expect(group.level === cluster.level, () => `cluster ${id} has level ${cluster.level}, its group ${group.level}`);
      this.due[group.level].add(group);
    }
    this.arrived = [];
    return null;
  }

  /** Splits what wants to be split on the level that comes next. */
  splitLevel() {
    const { file } = this;
    // Where one above was not split, a group is there in part: it stays, at its base meshes.
    const isWhole = (group) => this.present.get(group.id) === group.coarseCount;
    const wanting = [...this.due[this.level]].filter((group) => group.fineCount > 0 && isWhole(group) && this.rule.wants(group));
    const members = wanting.filter((group) => !file.hasMembers(group));
    if (members.length > 0 && !this.mayDraw) return { clusters: [], groups: [], members };

    this.level -= 1;
    for (const group of wanting) {
      const fine = file.hasMembers(group) ? file.fine(group) : null;
      if (this.mayDraw && !fine?.every((id) => file.cluster(id) && this.mayDraw(id))) {
        this.waiting.push({ group, fine });
        continue;
      }
      for (const id of file.coarse(group)) {
        expect(this.active.delete(id), () => `group ${group.id} names cluster ${id}, which is of another group`);
      }
      this.present.delete(group.id);
      this.arrived.push(...fine.map((id) => ({ id, parent: group.id })));
    }
    return null;
  }

  cut() {
    return [...this.active].map((id) => {
      const group = this.file.group(this.file.cluster(id).group);
      const isWhole = group && this.present.get(group.id) === group.coarseCount;
      return { cluster: id, bound: isWhole ? this.rule.bound(group) : Infinity };
    });
  }
}
