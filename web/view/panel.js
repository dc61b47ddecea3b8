// What the page tells in its panel, and what is set there.

import { GRADIENT, distinct, viridis } from "./colors.js";
import { atMost, length } from "./overlay.js";

export const $ = (id) => document.getElementById(id);
const numbers = new Intl.NumberFormat("en", { maximumSignificantDigits: 3 });
const whole = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });

function bytes(count) {
  const unit = count >= 1 << 20 ? [1 << 20, "MiB"] : [1 << 10, "KiB"];
  return `${numbers.format(count / unit[0])} ${unit[1]}`;
}

const COLORS = {
  surface: () => null,
  vertices: () => null,
  level: ({ level }, _, { levelCount }) => viridis(level / Math.max(levelCount - 1, 1)),
  cluster: ({ id }) => distinct(id),
  error: (_, error, __, largest) => viridis(error / (largest || 1)),
};
const SCALAR = "scalar ";

/** Colours by the scalars that a file has can be chosen, too, and those of vertices where it has images. */
export function offer({ scalars, hasSheets }) {
  const isOther = (value) => value.startsWith(SCALAR) || value === "vertices";
  for (const option of [...$("colors").options]) if (isOther(option.value)) option.remove();
  if (hasSheets) $("colors").add(new Option("vertices, no images", "vertices"), 1);
  for (const { name } of scalars) $("colors").add(new Option(name, SCALAR + name));
}

/** How a picture is to look. `header` is that of the file, `largest` the largest error of the last picture. */
export function settings(header, largest) {
  const colors = $("colors").value;
  const scalar = header?.scalars.find(({ name }) => SCALAR + name === colors) ?? null;
  const colorOf = (cluster, error) => (COLORS[colors] ?? COLORS.surface)(cluster, error, header, largest);
  const axis = $("clip").value;
  const clip = axis === "" ? null : { axis: Number(axis), share: Number($("clip-at").value), isFlipped: $("clip-flip").checked };
  const [pixels, budget] = [2 ** Number($("pixels").value), 10 ** Number($("budget").value)];
  return { pixels, budget, colors, scalar, colorOf, clip, sheets: colors === "surface", shading: $("shading").value, studio: $("light").value === "studio" };
}

/** What the colours of numbers stand for. */
function legend(colors, scalar, header, last) {
  const [least, most] = scalar ? [length(scalar.low), length(scalar.high)] : ["0", { level: `level ${header.levelCount - 1}`, error: `${atMost(last.error)} units` }[colors]];
  $("legend").hidden = !most;
  $("legend-bar").style.background = GRADIENT;
  [$("legend-least").textContent, $("legend-most").textContent] = [least, most ?? ""];
}

/** Tells what is drawn. */
export function tellDrawn(model, last) {
  const { pixels, budget, colors, scalar } = settings(model?.file?.header, 0);
  $("pixels-told").value = `${numbers.format(pixels)} px`;
  $("budget-told").value = numbers.format(budget / 1e6) + " M";
  $("clip-more").hidden = $("clip").value === "";
  if (!last || !model?.file) return;
  const { header } = model.file;
  const { statistics: traffic } = model.source;
  legend(colors, scalar, header, last);
  list($("counters"), {
    clusters: `${last.clusters} of ${whole.format(header.clusterCount)}`,
    ...(traffic && { fetched: `${bytes(traffic.bytes)}, ${traffic.requests} requests` }),
    ...(header.hasSheets && { images: `${last.painted} of ${last.clusters}` }),
    file: bytes(header.fileLength),
    ...(model.note && { note: model.note }),
  });
  list($("statistics"), {
    source: `${whole.format(header.sourceTriangleCount)} triangles`,
    drawn: `${whole.format(last.triangles)} triangles`,
    error: `${atMost(last.error)} units`,
    ...(last.relaxed > 1 && { allowed: `${numbers.format(pixels * last.relaxed)} px, to keep the budget` }),
  });
}

/** Tells what the clipping plane cuts, and how far that is from the source. */
export function tellOutline(found) {
  $("save").disabled = !found;
  const of = found?.error > 0 ? `within ${atMost(found.error)} units of the source` : "on the source";
  list($("outline"), found ? { outline: `${length(found.length)} units`, area: areaOf(found), lines: linesOf(found), points: of } : {});
  $("outline-note").textContent = found?.error > 0 ? "The drawn mesh is cut. Nothing bounds how far the source's own outline is from this one; chpm section cuts the finest mesh." : "";
}

function areaOf({ area, crossing }) {
  return area === null ? `not told: ${whole.format(crossing)} lines cross` : `${length(area)} square units`;
}

function linesOf({ lines, closed, openEnds }) {
  if (lines.length === 0) return "none";
  return openEnds === 0 ? `${whole.format(closed)}, all closed` : `${whole.format(lines.length)}, ${whole.format(openEnds)} open ends`;
}

/** Names and what is told of them. */
function list(element, rows) {
  element.replaceChildren(
    ...Object.entries(rows).flatMap(([name, value]) => {
      const [term, told] = [document.createElement("dt"), document.createElement("dd")];
      [term.textContent, told.textContent] = [name, value];
      return [term, told];
    }),
  );
}
