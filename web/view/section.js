// Where a plane cuts drawn clusters: lines, closed where the surface is. The same rules as those of `chpm section` (crates/chpm-section).

import { nest } from "./nest.js";

const NONE = -1;

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Directions to the right and upward in a plane, for whoever looks against its normal. Up is z, or y where the plane is level. */
export function axesOf(normal) {
  const up = Math.abs(normal[2]) > 0.9 ? [0, 1, 0] : [0, 0, 1];
  const along = dot(up, normal);
  const v = up.map((x, axis) => x - along * normal[axis]);
  const length = Math.hypot(...v);
  const [a, b, c] = v.map((x) => x / length);
  return [[b * normal[2] - c * normal[1], c * normal[0] - a * normal[2], a * normal[1] - b * normal[0]], [a, b, c]];
}

/** Whether a box is on both sides of a plane, which itself counts as above. */
export function crosses({ boxMin, boxMax }, [normal, offset]) {
  const end = (sign) => dot(normal, normal.map((x, axis) => (x * sign < 0 ? boxMin : boxMax)[axis]));
  return end(-1) < offset && offset <= end(1);
}

/** Segments of the triangles that a plane crosses. A vertex has one number in all clusters, an end is the edge that it is on: a vertex above, and one below. */
class Segments {
  constructor(normal, offset) {
    Object.assign(this, { normal, offset, shared: new Map(), count: 0 });
    /** By vertex: where it is, how high, and the last of the ends on edges that go down from it and wait for another. */
    Object.assign(this, { places: [], heights: [], waiting: [] });
    /** By end, the first of a segment before the second: its edge, the end that it is joined with, and the one that waited before it. */
    Object.assign(this, { above: [], below: [], partner: [], before: [] });
  }

  /** Adds the triangles of a cluster's mesh of so many vertices. */
  add(page, n) {
    const { positions } = page;
    const [x, y, z] = this.normal;
    const heights = new Float64Array(n);
    const isAbove = new Uint8Array(n);
    for (let i = 0; i < n; i++) {
      heights[i] = x * positions[3 * i] + y * positions[3 * i + 1] + z * positions[3 * i + 2];
      isAbove[i] = heights[i] >= this.offset ? 1 : 0;
    }
    const ids = page.ids();
    const numbers = new Int32Array(n).fill(NONE);
    const number = (vertex) => (numbers[vertex] === NONE ? (numbers[vertex] = this.#vertex(positions, vertex, ids[vertex], heights[vertex])) : numbers[vertex]);
    const corners = page.indices(n);
    for (let i = 0; i < corners.length; i += 3) {
      const many = isAbove[corners[i]] + isAbove[corners[i + 1]] + isAbove[corners[i + 2]];
      if (many === 0 || many === 3) continue;
      // From the corner that is alone on its side, in the order of the triangle.
      let alone = 0;
      while (isAbove[corners[i + alone]] !== (many === 1 ? 1 : 0)) alone++;
      const [a, b, c] = [0, 1, 2].map((step) => number(corners[i + ((alone + step) % 3)]));
      // From the edge that goes down to the one that goes up.
      if (many === 1) this.#segment(a, b, a, c);
      else this.#segment(c, a, b, a);
    }
  }

  #vertex(positions, vertex, id, height) {
    const known = id >= 0 ? this.shared.get(id) : undefined;
    if (known !== undefined) return known;
    const made = this.count++;
    if (id >= 0) this.shared.set(id, made);
    this.places.push(positions[3 * vertex], positions[3 * vertex + 1], positions[3 * vertex + 2]);
    this.heights.push(height);
    this.waiting.push(NONE);
    return made;
  }

  #segment(downAbove, downBelow, upAbove, upBelow) {
    this.#end(downAbove, downBelow);
    this.#end(upAbove, upBelow);
  }

  /** One more end: joined with one on the same edge, a first end with a second one, or else it waits. */
  #end(above, below) {
    const { waiting, before, partner } = this;
    const end = this.above.push(above) - 1;
    this.below.push(below);
    before.push(NONE);
    partner.push(NONE);
    for (let other = waiting[above], after = NONE; other !== NONE; after = other, other = before[other]) {
      if (this.below[other] !== below || ((other ^ end) & 1) === 0) continue;
      this.#join(end, other);
      if (after === NONE) waiting[above] = before[other];
      else before[after] = before[other];
      return;
    }
    before[end] = waiting[above];
    waiting[above] = end;
  }

  #join(a, b) {
    this.partner[a] = b;
    this.partner[b] = a;
  }

  /** Joins ends that still wait, which are first ones or second ones only: where triangles beside one another go around differently. */
  #settle() {
    for (let vertex = 0; vertex < this.count; vertex++) {
      for (let end = this.waiting[vertex]; end !== NONE; end = this.before[end]) {
        let other = this.partner[end] === NONE ? this.before[end] : NONE;
        while (other !== NONE && (this.below[other] !== this.below[end] || this.partner[other] !== NONE)) other = this.before[other];
        if (other !== NONE) this.#join(end, other);
      }
    }
  }

  /** Where an end is: always reckoned from above to below, so that all triangles of an edge find the same bits. */
  #point(end, points) {
    const [a, b] = [this.above[end], this.below[end]];
    const t = (this.heights[a] - this.offset) / (this.heights[a] - this.heights[b]);
    const at = points.length;
    for (let axis = 0; axis < 3; axis++) points.push(this.places[3 * a + axis] + t * (this.places[3 * b + axis] - this.places[3 * a + axis]));
    const isSame = at > 0 && points[at] === points[at - 3] && points[at + 1] === points[at - 2] && points[at + 2] === points[at - 1];
    if (isSame) points.length = at;
  }

  /** Lines: open ones from where they begin, then rings. What is a single point is left out. */
  lines() {
    this.#settle();
    const { partner } = this;
    const isDone = new Uint8Array(partner.length / 2);
    const lines = [];
    const follow = (start) => {
      const points = [];
      let [end, isClosed] = [start, false];
      this.#point(start, points);
      for (;;) {
        isDone[end >> 1] = 1;
        this.#point(end ^ 1, points);
        const next = partner[end ^ 1];
        isClosed = next === start;
        if (next === NONE || isClosed) break;
        end = next;
      }
      const last = points.length - 3;
      if (isClosed && last > 0 && [0, 1, 2].every((axis) => points[axis] === points[last + axis])) points.length = last;
      if (points.length >= 6) lines.push({ points: Float64Array.from(points), isClosed, length: lengthOf(points, isClosed) });
    };
    for (let end = 0; end < partner.length; end++) if (partner[end] === NONE && !isDone[end >> 1]) follow(end);
    for (let end = 0; end < partner.length; end += 2) if (!isDone[end >> 1]) follow(end);
    return lines;
  }
}

function lengthOf(points, isClosed) {
  let length = 0;
  for (let i = isClosed ? 0 : 3; i < points.length; i += 3) {
    const from = i === 0 ? points.length - 3 : i - 3;
    length += Math.hypot(points[i] - points[from], points[i + 1] - points[from + 1], points[i + 2] - points[from + 2]);
  }
  return length;
}

/**
 * What a plane cuts out of clusters.
 * @param {{ page: Page, position: number }[]} drawn
 * @param {[number[], number]} plane a normal of length 1 and an offset, for points of pages
 * @returns lines of points relative to the file's origin, with `length`, and where they are closed `area` and `depth`; what they come to, with no area where closed lines cross, as those of solids do that overlap; the largest error of the clusters whose boxes
 *   are crossed, and the corners of those boxes along the plane's axes, or null
 */
export function section(drawn, plane) {
  const [normal, offset] = plane;
  const axes = axesOf(normal);
  const segments = new Segments(normal, offset);
  let [error, bounds] = [0, null];
  for (const { page, position } of drawn) {
    if (!crosses(page.cluster, plane)) continue;
    segments.add(page, position);
    error = Math.max(error, page.errorAt(position));
    bounds = widened(bounds, page.cluster, axes);
  }
  const lines = segments.lines();
  nest(lines, axes);
  const sum = (of) => lines.reduce((all, line) => all + of(line), 0);
  const closed = lines.filter(({ isClosed }) => isClosed).length;
  const crossing = lines.filter(({ crosses }) => crosses).length;
  return {
    plane,
    axes,
    lines,
    bounds,
    error,
    closed,
    openEnds: 2 * (lines.length - closed),
    length: sum(({ length }) => length),
    crossing,
    area: crossing > 0 ? null : sum(({ area, depth }) => (depth % 2 === 0 ? area : -area)),
  };
}

function widened(bounds, { boxMin, boxMax }, axes) {
  for (let corner = 0; corner < 8; corner++) {
    const point = boxMin.map((low, axis) => ((corner >> axis) & 1 ? boxMax[axis] : low));
    const at = axes.map((axis) => dot(axis, point));
    bounds = bounds ? [bounds[0].map((x, i) => Math.min(x, at[i])), bounds[1].map((x, i) => Math.max(x, at[i]))] : [at, at];
  }
  return bounds;
}
