// Which closed lines of a section lie in which, and what they enclose. Lines of a surface that does not cross itself do not cross, so a point of each decides.

/** Tells each line its `area`, 0 where it is open, and its `depth`: how many closed lines it lies in. */
export function nest(lines, [u, v]) {
  const sides = { low: [], high: [], across: [], slope: [], line: [] };
  const probes = [];
  lines.forEach((line, number) => {
    Object.assign(line, { area: 0, depth: 0 });
    if (line.isClosed) probes.push(outlined(line, number, flattened(line.points, u, v), sides));
  });
  const order = Uint32Array.from(sides.line, (_, side) => side).sort((a, b) => sides.low[a] - sides.low[b]);
  probes.sort((a, b) => a.at[1] - b.at[1]);
  // No two lie in each other, as copies might: only what is larger, or came before, is around.
  const isAround = (other, line) => lines[other].area > lines[line].area || (lines[other].area === lines[line].area && other < line);
  let [next, active] = [0, []];
  for (const { at: [x, y], line } of probes) {
    while (next < order.length && sides.low[order[next]] <= y) active.push(order[next++]);
    active = active.filter((side) => sides.high[side] > y);
    // A ray to the right leaves what it began in: it crosses it an odd number of times.
    const odd = new Set();
    for (const side of active) {
      const other = sides.line[side];
      if (other === line || !(sides.across[side] + (y - sides.low[side]) * sides.slope[side] > x)) continue;
      if (!odd.delete(other)) odd.add(other);
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

/** Adds the sides of a closed line, and tells it its area; answers the middle of its longest side. */
function outlined(line, number, flat, { low, high, across, slope, line: of }) {
  // About the first point, so that what is far from the zero point loses nothing.
  const [x0, y0] = flat;
  let [twice, longest, at] = [0, -1, null];
  for (let i = 0; i < flat.length; i += 2) {
    const j = i + 2 < flat.length ? i + 2 : 0;
    const [x, y, toX, toY] = [flat[i], flat[i + 1], flat[j], flat[j + 1]];
    twice += (x - x0) * (toY - y0) - (toX - x0) * (y - y0);
    const length = (toX - x) ** 2 + (toY - y) ** 2;
    if (length > longest) [longest, at] = [length, [(x + toX) / 2, (y + toY) / 2]];
    if (y === toY) continue;
    low.push(Math.min(y, toY));
    high.push(Math.max(y, toY));
    across.push(y < toY ? x : toX);
    slope.push((toX - x) / (toY - y));
    of.push(number);
  }
  line.area = Math.abs(twice) / 2;
  return { at, line: number };
}
