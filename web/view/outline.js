// The outline of what the clipping plane cuts, over the picture: found when the picture rests, and drawn where it is with each frame.

import { crosses, dot, section } from "./section.js";

/** So long nothing has changed before a cut is looked at, ms: a slider that moves stops for a moment, too. */
const CALM = 120;
/** Pixels that points have to be apart to be told one by one. */
const APART = 0.4;
/** Pixels between the lines that fill a cut, and the widths of lines. */
const [HATCH, LINE, HALO] = [7, 1.6, 4];

export class Outline {
  /** @param hear told when there is another outline, or none */
  constructor(canvas, hear) {
    Object.assign(this, { canvas, hear, found: null, key: "", timer: 0 });
  }

  clear() {
    this.disturb();
    if (this.found) Object.assign(this, { found: null, key: "" }), this.hear(null);
  }

  /** Something changed: what was about to be looked at waits. */
  disturb() {
    clearTimeout(this.timer);
    this.timer = 0;
  }

  /**
   * Follows the plane, or none; an outline of another one goes at once.
   * @param drawn the drawn cut, each cluster with its page and its position, if it is at rest; else null
   */
  follow(plane, drawn) {
    if (String(this.found?.plane) !== String(plane ?? undefined)) this.clear();
    if (!plane || !drawn) return;
    const met = drawn.filter(({ page }) => crosses(page.cluster, plane));
    const key = met.map(({ page, position }) => `${page.cluster.id}:${position}`).join();
    if (this.timer || (this.found && key === this.key)) return;
    this.timer = setTimeout(() => {
      this.timer = 0;
      Object.assign(this, { found: section(met, plane), key });
      this.hear(this.found);
    }, CALM);
  }

  /** Draws it as a camera sees it. What is behind the plane is filled; from its other side, where the model is before it, there is a faint line. */
  draw(orbit, stretch) {
    const { canvas, found } = this;
    canvas.hidden = !found;
    if (!found) return;
    const ratio = Math.min(globalThis.devicePixelRatio || 1, 2);
    const [width, height] = [orbit.canvas.clientWidth, orbit.canvas.clientHeight];
    const sides = [width, height].map((x) => Math.max(1, Math.round(x * ratio)));
    [canvas.width, canvas.height] = sides;
    const context = canvas.getContext("2d");
    context.scale(sides[0] / Math.max(width, 1), sides[1] / Math.max(height, 1));
    const [closed, open] = this.#paths(orbit, stretch);
    const { fill, stroke, color } = getComputedStyle(canvas);
    const [normal, offset] = found.plane;
    const isBefore = dot(normal, orbit.eye().map((x, axis) => x / stretch[axis])) > offset;
    context.lineJoin = "round";
    if (isBefore) {
      context.fillStyle = fill;
      context.fill(closed, "evenodd");
      context.fillStyle = this.#hatch(context, stroke, ratio);
      context.fill(closed, "evenodd");
    }
    context.globalAlpha = isBefore ? 1 : 0.3;
    const lines = isBefore ? [[color, HALO], [stroke, LINE]] : [[stroke, LINE]];
    for (const [style, lineWidth] of lines) {
      Object.assign(context, { strokeStyle: style, lineWidth });
      context.stroke(closed);
      context.stroke(open);
    }
  }

  /** Closed lines and open ones on the canvas. What is nearer than the near plane is cut off: of a closed line, what is left is closed. */
  #paths(orbit, stretch) {
    const { eye, axes: [right, up, back], unit, middle } = orbit.lens();
    const [near] = orbit.range();
    const paths = [new Path2D(), new Path2D()];
    for (const { points, isClosed } of this.found.lines) {
      const path = paths[isClosed ? 0 : 1];
      let [isBegun, lastX, lastY] = [false, 0, 0];
      const go = (x, y, far, isNeeded) => {
        const [toX, toY] = [middle[0] + (x * unit) / far, middle[1] - (y * unit) / far];
        if (isBegun && !isNeeded && Math.abs(toX - lastX) + Math.abs(toY - lastY) < APART) return;
        if (isBegun) path.lineTo(toX, toY);
        else path.moveTo(toX, toY);
        [isBegun, lastX, lastY] = [true, toX, toY];
      };
      let [x, y, far] = [0, 0, 0];
      const end = points.length + (isClosed ? 3 : 0);
      for (let i = 0; i < end; i += 3) {
        const at = i % points.length;
        const way = [points[at] * stretch[0] - eye[0], points[at + 1] * stretch[1] - eye[1], points[at + 2] * stretch[2] - eye[2]];
        const [toX, toY, toFar] = [dot(way, right), dot(way, up), -dot(way, back)];
        if (i > 0 && far < near !== toFar < near) {
          const share = (near - far) / (toFar - far);
          // An open line goes on elsewhere.
          if (far < near && !isClosed) isBegun = false;
          go(x + share * (toX - x), y + share * (toY - y), near, true);
        }
        if (toFar >= near) go(toX, toY, toFar, i + 3 >= end);
        [x, y, far] = [toX, toY, toFar];
      }
      if (isClosed && isBegun) path.closePath();
    }
    return paths;
  }
  /** Lines at 45 degrees, as cuts are filled on drawings; made once for each style. */
  #hatch(context, style, ratio) {
    const name = `${style} ${ratio}`;
    if (this.hatched?.name === name) return this.hatched.pattern;
    const side = Math.round(HATCH * ratio);
    const tile = Object.assign(document.createElement("canvas"), { width: side, height: side });
    const lines = tile.getContext("2d");
    Object.assign(lines, { strokeStyle: style, lineWidth: 0.8 * ratio, globalAlpha: 0.55 });
    for (const shift of [-side, 0, side]) {
      lines.moveTo(shift - 1, side + 1);
      lines.lineTo(shift + side + 1, -1);
    }
    lines.stroke();
    const pattern = context.createPattern(tile, "repeat");
    pattern.setTransform(new DOMMatrix().scale(1 / ratio));
    this.hatched = { name, pattern };
    return pattern;
  }
}
