// A section as a drawing to scale, in millimetres of paper: the same sheet as that of `chpm section -o plan.svg`.

import { dot } from "./section.js";

/** Margin about the lines, what the scale bar has below them, and the width of a sheet at least, mm. */
const [MARGIN, FOOT, WIDTH] = [8, 14, 80];
/** Sides of a drawing on a sheet of A4, mm. */
const [LONG, SHORT] = [270, 180];

/** The largest 1, 2 or 5 times a power of ten that is no more. */
function roundBelow(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  // The logarithm is rounded.
  return ([10, 5, 2, 1, 0.5].find((digit) => digit * power <= x * (1 + 1e-9)) ?? 1) * power;
}

/** A round number without what arithmetic has left behind its digits. */
const digits = (x) => String(Number(x.toPrecision(7)));
const escaped = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");

/** A number without zeros at its end. */
function trimmed(x, decimals = 3) {
  const text = x.toFixed(decimals);
  const short = text.includes(".") ? text.replace(/\.?0+$/, "") : text;
  return short === "-0" ? "0" : short;
}

/** A plane as `--plane` takes it, in the model's own coordinates. */
export function planeName([normal, offset], origin) {
  return `${normal.map((x) => trimmed(x, 4))}:${Number((offset + dot(normal, origin)).toPrecision(15))}`;
}

/**
 * The drawing of a section of a model as the text of an SVG.
 * @param title what is written below it, beside the scale
 * @param origin what the lines are relative to
 */
export function svg({ lines, axes, bounds, plane: [normal, offset] }, title, origin) {
  const [low, high] = bounds ?? [[0, 0], [0, 0]];
  const extent = low.map((x, i) => high[i] - x);
  const fits = Math.min(LONG / Math.max(...extent), SHORT / Math.min(...extent));
  // Without an extent, any scale will do.
  const scale = roundBelow(Number.isFinite(fits) ? fits : 1);
  const width = Math.max(extent[0] * scale + 2 * MARGIN, WIDTH);
  const height = extent[1] * scale + 2 * MARGIN + FOOT;
  const path = ({ points, isClosed }) => {
    let [text, last] = ["", ""];
    for (let i = 0; i < points.length; i += 3) {
      const [x, y] = axes.map((axis, at) => (dot(axis, points.subarray(i, i + 3)) - low[at]) * scale + MARGIN);
      const told = `${trimmed(x)} ${trimmed(height - FOOT - y)}`;
      if (told !== last) text += (last ? "L" : "M") + told;
      last = told;
    }
    return text + (isClosed ? "Z" : "");
  };
  const paths = (is) => lines.filter(({ isClosed }) => isClosed === is).map(path).join("");
  const [closed, open] = [paths(true), paths(false)];
  // Where the corner of the lines' box is in the model, so that the paper's coordinates lead back to it.
  const corner = [0, 1, 2].map((axis) => origin[axis] + offset * normal[axis] + low[0] * axes[0][axis] + low[1] * axes[1][axis]);
  const [w, h] = [width, height].map((x) => trimmed(x));
  const length = roundBelow(Math.min(width - 2 * MARGIN, 200) / 4 / scale);
  const [bar, half] = [length * scale, (length * scale) / 2].map((x) => trimmed(x));
  const words = escaped(title);
  const unit = `1 unit = ${digits(scale)} mm`;
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${w}mm" height="${h}mm" viewBox="0 0 ${w} ${h}" font-family="sans-serif">
<title>${words}</title>
<desc>${unit}; ${MARGIN} ${trimmed(height - FOOT)} of the paper is ${corner.join(" ")} of the model</desc>
<rect width="${w}" height="${h}" fill="#fff"/>
<g fill="none" stroke="#000" stroke-width="0.25" stroke-linejoin="round" stroke-linecap="round">
${closed && `<path fill="#d9d9d9" fill-rule="evenodd" d="${closed}"/>\n`}${open && `<path d="${open}"/>\n`}</g>
<g transform="translate(${MARGIN} ${trimmed(height - 11)})" font-size="2.5">
<rect width="${bar}" height="1.2" fill="#fff" stroke="#000" stroke-width="0.2"/><rect width="${half}" height="1.2"/>
<text y="4.4">0</text><text x="${bar}" y="4.4" text-anchor="middle">${digits(length)} units</text>
<text y="9">${words}; ${unit}</text>
</g>
</svg>
`;
}
