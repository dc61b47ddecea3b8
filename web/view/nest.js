// Which closed lines of a section lie in which, what they enclose, and which cross each other. Of lines that do not cross, a point of each decides.

import { crossing } from "./crossing.js";

/** Tells each line its `area`, 0 where it is open, its `depth`: how many closed lines it lies in, and whether it `crosses` another one. */
export function nest(lines, [u, v]) {
  const sides = { low: [], high: [], across: [], slope: [], line: [] };
  const [probes, rings] = [[], []];
  lines.forEach((line, number) => {
    Object.assign(line, { area: 0, depth: 0, crosses: false });
    if (!line.isClosed) return;
    rings.push(flattened(line.points, u, v));
    probes.push(outlined(line, number, rings.at(-1), sides));
  });
  crossing(rings).forEach((crosses, ring) => (lines[probes[ring].line].crosses = crosses));
  const order = Uint32Array.from(sides.line, (_, side) => side).sort((a, b) => sides.low[a] - sides.low[b]);
  probes.sort((a, b) => a.at[1] - b.at[1]);
  // No two lie in each other, as copies might: only what is larger, or came before, is around.
  const isAround = (other, line) => lines[other].area > lines[line].area || (lines[other].area === lines[line].area && other < line);
  let [next, active] = [0, []];
  for (const { at: [x, y], line, isInsideRight } of probes) {
    while (next < order.length && sides.low[order[next]] <= y) active.push(order[next++]);
    active = active.filter((side) => sides.high[side] > y);
    // A ray to the right leaves what it began in: it crosses it an odd number of times. A point on another line, as of solids side by side, is just inside of its own.
    const odd = new Set();
    for (const side of active) {
      const other = sides.line[side];
      if (other === line) continue;
      const [across, low, slope] = [sides.across[side], sides.low[side], sides.slope[side]];
      const hit = across + (y - low) * slope;
      // Both are rounded.
      const slack = 4 * Number.EPSILON * (Math.abs(across) + Math.abs(low * slope) + Math.abs(slope * y));
      const isHit = Math.abs(hit - x) <= slack ? !isInsideRight : hit > x;
      if (isHit && !odd.delete(other)) odd.add(other);
    }
    for (const other of odd) if (isAround(other, line)) lines[line].depth += 1;
  }
}

/** A line in its plane, two numbers for each point. */
function flattened(points, u, v) {
  const flat = new Float64Array((points.length / 3) * 2);
  for (let i = 0, at = 0; i < points.length; i += 3) {
    flat[at++] = u[0] * points[i] + u[1] * points[i + 1] + u[2] * points[i + 2];
    flat[at++] = v[0] * points[i] + v[1] * points[i + 1] + v[2] * points[i + 2];
  }
  return flat;
}

/** Adds the sides of a closed line, and tells it its area; answers the middle of the side that goes highest, and whether its inside is on the right of that. */
function outlined(line, number, flat, { low, high, across, slope, line: of }) {
  // About the first point, so that what is far from the zero point loses nothing.
  const [x0, y0] = flat;
  let [twice, highest, at, goesUp] = [0, -1, null, true];
  for (let i = 0; i < flat.length; i += 2) {
    const j = i + 2 < flat.length ? i + 2 : 0;
    const [x, y, toX, toY] = [flat[i], flat[i + 1], flat[j], flat[j + 1]];
    twice += (x - x0) * (toY - y0) - (toX - x0) * (y - y0);
    if (Math.abs(toY - y) > highest) [highest, at, goesUp] = [Math.abs(toY - y), [(x + toX) / 2, (y + toY) / 2], toY > y];
    if (y === toY) continue;
    low.push(Math.min(y, toY));
    high.push(Math.max(y, toY));
    across.push(y < toY ? x : toX);
    slope.push((toX - x) / (toY - y));
    of.push(number);
  }
  line.area = Math.abs(twice) / 2;
  // A line that turns left has its inside on the left of where it goes.
  return { at, line: number, isInsideRight: goesUp !== twice > 0 };
}
