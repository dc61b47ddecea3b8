// Which closed lines of a plane cross each other, as `crossing.rs` of the library has it: signs are exact, and lines that touch, along whatever of them, do
// not cross where each stays on its side of the other. A ring is points, two numbers for each.

/** Segments in a cell from which on it is divided, if they are fewer than half of all. */
const MANY = 64;
/** Cells by which a segment reaches farther than it is, since where it passes is rounded. */
const SLACK = 1e-3;
/** What a determinant may be off by, relative to its two products (Shewchuk 1997). */
const ROUNDING = (3 + 16 * 2 ** -53) * 2 ** -53;

/** Whether each ring crosses another one. */
export function crossing(rings) {
  const crosses = rings.map(() => false);
  const all = rings.length > 1 ? rings.flatMap((ring, number) => Array.from({ length: ring.length / 2 }, (_, start) => new Segment(ring, number, start))) : [];
  look(all, crosses);
  return crosses;
}

function look(segments, crosses) {
  const grid = gridOf(segments);
  if (!grid) return;
  const cells = new Map();
  for (const segment of segments) {
    eachCell(grid, segment, (cell) => {
      const inside = cells.get(cell);
      if (!inside) cells.set(cell, [segment]);
      else if (inside.at(-1) !== segment) inside.push(segment);
    });
  }
  for (const inside of cells.values()) {
    if (inside.length > MANY && 2 * inside.length < segments.length) {
      look(inside, crosses);
      continue;
    }
    for (let i = 0; i < inside.length; i++) {
      for (let j = i + 1; j < inside.length; j++) {
        const [a, b] = [inside[i], inside[j]];
        if (a.number === b.number || (crosses[a.number] && crosses[b.number])) continue;
        if (cross(a, b)) crosses[a.number] = crosses[b.number] = true;
      }
    }
  }
}

const pointOf = (ring, place) => [ring[2 * place], ring[2 * place + 1]];
const isEqual = (a, b) => a[0] === b[0] && a[1] === b[1];

/** From a point of a ring to the next one. */
class Segment {
  constructor(ring, number, start) {
    const count = ring.length / 2;
    Object.assign(this, { ring, number, start, from: pointOf(ring, start), to: pointOf(ring, (start + 1) % count) });
  }
}

/** Square cells, about as many as there are segments; none of segments that are all in one point. */
function gridOf(segments) {
  let [low, high, length] = [[Infinity, Infinity], [-Infinity, -Infinity], 0];
  for (const { from, to } of segments) {
    low = low.map((x, axis) => Math.min(x, from[axis], to[axis]));
    high = high.map((x, axis) => Math.max(x, from[axis], to[axis]));
    length += Math.max(Math.abs(to[0] - from[0]), Math.abs(to[1] - from[1]));
  }
  const [width, height] = [high[0] - low[0], high[1] - low[1]];
  const count = segments.length;
  const cell = Math.max(length / count, Math.sqrt((width * height) / count), Math.max(width, height) / 32768);
  return cell > 0 && cell < Infinity ? { low, scale: 1 / cell, columns: Math.trunc(width / cell) + 3 } : null;
}

/** Tells each cell that a segment passes, some more than once. */
function eachCell({ low, scale, columns }, { from, to }, tell) {
  const place = (x) => Math.floor(x + 1);
  const ends = [from, to].map((point) => point.map((x, axis) => scale * (x - low[axis])));
  const [[x, y], [toX, toY]] = ends[0][1] <= ends[1][1] ? ends : [ends[1], ends[0]];
  const slope = (toX - x) / (toY - y);
  for (let row = place(y - SLACK); row <= place(toY + SLACK); row++) {
    const at = (edge) => x + slope * (Math.min(Math.max(edge, y), toY) - y);
    const [start, end] = toY > y ? [at(row - 1 - SLACK), at(row + SLACK)] : [x, toX];
    for (let column = place(Math.min(start, end) - SLACK); column <= place(Math.max(start, end) + SLACK); column++) tell(row * columns + column);
  }
}

/** Positive where a point is on the left of a way, negative on the right, 0 on its line: exact. */
export function side(a, b, c) {
  const [left, right] = [(a[0] - c[0]) * (b[1] - c[1]), (a[1] - c[1]) * (b[0] - c[0])];
  const found = left - right;
  return Math.abs(found) > ROUNDING * (Math.abs(left) + Math.abs(right)) ? Math.sign(found) : exactSide(a, b, c);
}

/** The same in whole numbers. */
function exactSide(...points) {
  const parts = points.flat().map(partsOf);
  const least = Math.min(...parts.map(({ exponent }) => exponent));
  const [ax, ay, bx, by, cx, cy] = parts.map(({ digits, exponent }) => digits << BigInt(exponent - least));
  const found = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx);
  return found > 0n ? 1 : found < 0n ? -1 : 0;
}

const NUMBER = new DataView(new ArrayBuffer(8));

/** A number as `digits` times 2 to the `exponent`. */
function partsOf(x) {
  NUMBER.setFloat64(0, x);
  const bits = NUMBER.getBigUint64(0);
  const power = Number((bits >> 52n) & 0x7ffn);
  const digits = (bits & ((1n << 52n) - 1n)) | (power > 0 ? 1n << 52n : 0n);
  return { digits: x < 0 ? -digits : digits, exponent: Math.max(power, 1) - 1075 };
}

/** Whether a point on the line of a segment is on it, its ends included. */
const isBetween = (a, b, point) => [0, 1].every((axis) => Math.min(a[axis], b[axis]) <= point[axis] && point[axis] <= Math.max(a[axis], b[axis]));

/** Whether two segments of different rings cross, or their rings do where they touch or from there on. */
function cross(a, b) {
  const [p, q, r, s] = [a.from, a.to, b.from, b.to];
  const isApart = (axis) => Math.max(p[axis], q[axis]) < Math.min(r[axis], s[axis]) || Math.max(r[axis], s[axis]) < Math.min(p[axis], q[axis]);
  if (isApart(0) || isApart(1)) return false;
  const ends = [side(r, s, p), side(r, s, q), side(p, q, r), side(p, q, s)];
  if (ends.every((end) => end !== 0)) return ends[0] !== ends[1] && ends[2] !== ends[3];
  // Each point where a ring begins a segment is looked at once.
  const isOn = ends[0] === 0 && !isEqual(p, s) && isBetween(r, s, p);
  const otherIsOn = ends[2] === 0 && !isEqual(r, p) && !isEqual(r, q) && isBetween(p, q, r);
  return (isOn && passes(a, b, p)) || (otherIsOn && passes(a, b, r));
}

/** The points before and behind a point of a segment, which may be its first and is not its last. */
function around({ ring, start }, at) {
  const count = ring.length / 2;
  const before = isEqual(pointOf(ring, start), at) ? (start + count - 1) % count : start;
  return [pointOf(ring, before), pointOf(ring, (start + 1) % count)];
}

const [LEFT, RIGHT, AHEAD, BACK] = [1, -1, 2, 3];
const isSide = (found) => found === LEFT || found === RIGHT;

/** Whether the ring of `other` changes sides of another one's at a point. One that goes along it for a while is looked at where that begins. */
function passes(way, other, at) {
  const [before, behind] = around(way, at);
  const [from, to] = around(other, at);
  const start = beside(before, at, behind, from);
  if (!isSide(start)) return false;
  let end = beside(before, at, behind, to);
  if (end === AHEAD || end === BACK) end = leaves(other, pointsFrom(way, at, end === AHEAD), at, end === AHEAD);
  return isSide(end) && end !== start;
}

/** The points that follow one of a segment, or that come before, once around. */
function pointsFrom({ ring, start }, at, isAhead) {
  const count = ring.length / 2;
  const begins = isEqual(pointOf(ring, start), at) ? 1 : 0;
  const first = isAhead ? start + 1 : start + count - begins;
  return Array.from({ length: count }, (_, step) => pointOf(ring, (isAhead ? first + step : first + count - step) % count));
}

/** The side of a way, with its own direction, on which a ring leaves it that goes along it from a point on; none if it never does. */
function leaves(segment, way, at, isAhead) {
  const own = pointsFrom(segment, at, true);
  let [i, j] = [0, 0];
  while (i < own.length && j < way.length) {
    // Both are in one direction from here: to the nearer of them.
    const before = at;
    at = isBetween(at, way[j], own[i]) ? own[i] : way[j];
    if (isEqual(own[i], at)) i += 1;
    if (isEqual(way[j], at)) j += 1;
    if (i === own.length || j === way.length) return null;
    const found = beside(before, at, way[j], own[i]);
    if (found === AHEAD) continue;
    return isSide(found) ? (isAhead ? found : -found) : null;
  }
  return null;
}

/** Where a point leads beside a way of three points, as seen from the middle one; null where the way turns back on itself, and has no sides. */
function beside(before, at, behind, point) {
  const isSame = (a, b) => side(at, a, b) === 0 && [0, 1].every((axis) => (a[axis] - at[axis]) * (b[axis] - at[axis]) >= 0);
  if (isSame(before, behind)) return null;
  if (isSame(behind, point)) return AHEAD;
  if (isSame(before, point)) return BACK;
  const [ofFirst, ofSecond] = [side(before, at, point) > 0, side(at, behind, point) > 0];
  return (side(before, at, behind) >= 0 ? ofFirst && ofSecond : ofFirst || ofSecond) ? LEFT : RIGHT;
}
