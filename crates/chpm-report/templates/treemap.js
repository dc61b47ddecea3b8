"use strict";
// A map of the hierarchy: a rectangle for each cluster, as large as what it has of the source, the clusters below inside it.
(() => {
  const { nodes: rows, colors } = JSON.parse(document.getElementById("tree").textContent);
  const names = ["id", "parent", "level", "below", "triangles", "error", "shared", "kept", "acmr24", "edgeSpan", "bytes"];
  const all = new Map(rows.map((row) => [row[0], Object.assign({ children: [] }, Object.fromEntries(names.map((name, i) => [name, row[i]])))]));
  const roots = [];
  for (const node of all.values()) (all.get(node.parent)?.children ?? roots).push(node);
  for (const node of [...all.values(), { children: roots }]) node.children.sort((a, b) => b.below - a.below || a.id - b.id);
  const top = { id: -1, level: Infinity, below: roots.reduce((sum, node) => sum + node.below, 0), children: roots };

  const canvas = document.getElementById("map");
  const under = document.getElementById("under");
  const measure = document.getElementById("measure");
  const place = document.getElementById("place");
  const up = document.getElementById("up");
  const DEPTH = 6, PAD = 3, BAR = 15;
  let root = top, boxes = [], marked = null;

  // Squarified: rows are filled along the shorter side as long as that makes rectangles squarer.
  function lay(children, x, y, w, h, sink) {
    const total = children.reduce((sum, node) => sum + node.below, 0);
    if (!(total > 0) || w < 1 || h < 1) return;
    let rest = children.filter((node) => node.below > 0), scale = (w * h) / total;
    while (rest.length) {
      const side = Math.min(w, h);
      let row = [], sum = 0, worst = Infinity;
      for (const node of rest) {
        const next = sum + node.below * scale;
        const most = Math.max(...row.concat(node).map((n) => ratio(n.below * scale, next, side)));
        if (most > worst) break;
        row.push(node); sum = next; worst = most;
      }
      const thick = sum / side;
      let at = 0;
      for (const node of row) {
        const long = (node.below * scale) / thick;
        if (w >= h) sink(node, x, y + at, thick, long); else sink(node, x + at, y, long, thick);
        at += long;
      }
      if (w >= h) { x += thick; w -= thick; } else { y += thick; h -= thick; }
      rest = rest.slice(row.length);
    }
  }

  function ratio(area, sum, side) {
    const thick = sum / side, long = area / thick;
    return Math.max(thick / long, long / thick);
  }

  function range(key) {
    const values = [...all.values()].map((node) => node[key]).filter((value) => value > 0).sort((a, b) => a - b);
    return [values[0] ?? 0, values[values.length - 1] ?? 1];
  }

  function painter() {
    const key = measure.value, [low, high] = range(key);
    const logarithmic = key === "error" || key === "bytes";
    return (node) => {
      const value = node[key];
      if (!(high > low) || !(value > 0)) return color(0);
      return color(logarithmic ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
    };
  }

  // Evenly lighter to the eye; names are written dark on light and light on dark.
  const stops = colors.map((color) => [1, 3, 5].map((from) => parseInt(color.slice(from, from + 2), 16)));
  function color(at) {
    const place = Math.min(Math.max(at, 0), 1) * (stops.length - 1), first = Math.min(Math.floor(place), stops.length - 2);
    const mixed = stops[first].map((c, i) => Math.round(c + (stops[first + 1][i] - c) * (place - first)));
    const light = 0.3 * mixed[0] + 0.6 * mixed[1] + 0.1 * mixed[2];
    return { fill: `rgb(${mixed})`, ink: light > 128 ? "#000" : "#fff" };
  }

  function draw() {
    const scale = window.devicePixelRatio || 1, { width, height } = canvas.getBoundingClientRect();
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    const g = canvas.getContext("2d");
    g.scale(scale, scale);
    const paper = getComputedStyle(document.body).backgroundColor, paint = painter();
    g.font = "11px system-ui, sans-serif";
    boxes = [];
    const show = (node, x, y, w, h, depth) => {
      boxes.push({ node, x, y, w, h });
      const { fill, ink } = paint(node);
      g.fillStyle = fill;
      g.fillRect(x, y, w, h);
      g.strokeStyle = node === marked ? "#000" : paper;
      g.lineWidth = node === marked ? 3 : 1;
      g.strokeRect(x + 0.5, y + 0.5, Math.max(w - 1, 0), Math.max(h - 1, 0));
      if (w > 34 && h > BAR) { g.fillStyle = ink; g.fillText(String(node.id), x + 4, y + 12); }
      if (depth > 1 && w > 3 * PAD && h > BAR + 2 * PAD) {
        lay(node.children, x + PAD, y + BAR, w - 2 * PAD, h - BAR - PAD, (n, a, b, c, d) => show(n, a, b, c, d, depth - 1));
      }
    };
    if (root === top) lay(roots, 0, 0, width, height, (n, a, b, c, d) => show(n, a, b, c, d, DEPTH));
    else show(root, 0, 0, width, height, DEPTH);
    const way = [];
    for (let node = root; node && node !== top; node = all.get(node.parent)) way.unshift(node.id);
    place.textContent = way.length ? `cluster ${way.join(" › ")}` : "the whole model";
    up.disabled = root === top;
    canvas.dataset.boxes = boxes.length;
    canvas.dataset.root = root.id;
  }

  function at(event) {
    const { left, top } = canvas.getBoundingClientRect(), x = event.clientX - left, y = event.clientY - top;
    // The innermost comes last.
    return boxes.findLast((box) => x >= box.x && x < box.x + box.w && y >= box.y && y < box.y + box.h)?.node ?? null;
  }

  const percent = (value) => `${(100 * value).toFixed(1)} %`, count = (value) => value.toLocaleString("en");
  function tell(node) {
    under.textContent = node === null ? "Point at a cluster; click to look into it." :
      `cluster ${node.id}, level ${node.level}: ${count(node.triangles)} triangles, ${count(node.below)} of the source below; ` +
      `error ${Number(node.error).toPrecision(3)}; ${percent(node.kept)} kept; ${percent(node.shared)} of its vertices shared; ` +
      `ACMR ${node.acmr24}; edge span ${node.edgeSpan}; ${count(node.bytes)} bytes`;
  }

  canvas.addEventListener("pointermove", (event) => {
    const node = at(event);
    if (node !== marked) { marked = node; draw(); tell(node); }
  });
  canvas.addEventListener("pointerleave", () => { marked = null; draw(); tell(null); });
  canvas.addEventListener("click", (event) => {
    const node = at(event);
    if (node && node !== root) { root = node; draw(); }
  });
  const out = () => { root = all.get(root.parent) ?? top; draw(); };
  up.addEventListener("click", out);
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") out(); });
  measure.addEventListener("change", draw);
  window.addEventListener("resize", draw);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  tell(null);
  draw();
})();
