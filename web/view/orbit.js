// A camera that goes around a point: drag to turn, shift or the right button to move, wheel or two fingers to come nearer.

const AXES = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };

export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const scaled = (a, s) => a.map((x) => x * s);
const added = (a, b) => a.map((x, axis) => x + b[axis]);
const normalized = (a) => scaled(a, 1 / Math.hypot(...a));

/** Of an image that is left free around a model, by side. */
const MARGIN = 0.04;

export class Orbit {
  /** `covered` tells how many pixels at the left of the canvas something else covers. */
  constructor(canvas, onChange, covered = () => 0) {
    Object.assign(this, { canvas, onChange, covered, fov: 45, turn: 0.6, rise: 0.35, up: "y" });
    /** Told when somebody takes the camera. */
    this.onTouch = () => {};
    this.target = [0, 0, 0];
    this.distance = 1;
    this.size = 1;
    this.#listen();
  }

  /** Looks along a direction, from where it is. */
  look(sight) {
    const { up, side, forth } = this.#level();
    this.turn = Math.atan2(-dot(sight, side), -dot(sight, forth));
    this.rise = Math.asin(Math.min(1, Math.max(-1, -dot(sight, up) / Math.hypot(...sight))));
  }

  /** Shows all of some points, from as near as it can; `radius` is that of the whole model. */
  frame(points, radius) {
    /** What is framed, as long as nobody moves the camera. */
    this.framed = [points, radius];
    this.size = radius || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const free = 1 - 2 * MARGIN;
    const rise = Math.tan((this.fov * Math.PI) / 360) * free;
    const run = (rise * Math.max(width - this.covered(), 1)) / Math.max(height, 1);
    const [right, up, back] = this.axes();
    const [low, high] = [Math.min, Math.max].map((end) => [0, 1, 2].map((axis) => end(...points.map((p) => p[axis]))));
    const center = low.map((x, axis) => 0.5 * x + 0.5 * high[axis]);
    const seen = points.map((p) => p.map((x, axis) => x - center[axis])).map((p) => [dot(p, right), dot(p, up), -dot(p, back)]);
    // A point is on the inner side of a border with slope s if x <= (z + distance) s: the largest x - z s decides.
    const most = (of) => Math.max(...seen.map(of));
    const borders = [run, rise].map((slope, axis) => [most((p) => p[axis] - p[2] * slope), most((p) => -p[axis] - p[2] * slope), slope]);
    const [near, far] = [-most((p) => -p[2]), most((p) => p[2])];
    // Never among the points, and not at the one point that there may be.
    const span = Math.max(far - near, ...[0, 1].map((axis) => most((p) => p[axis]) + most((p) => -p[axis]))) || 1;
    const away = Math.max(...borders.map(([over, under, slope]) => (over + under) / (2 * slope)), 0.1 * span - near);
    const [x, y] = borders.map(([over, under]) => 0.5 * (over - under));
    const depth = 0.5 * (near + far);
    this.target = added(center, added(added(scaled(right, x), scaled(up, y)), scaled(back, -depth)));
    this.distance = away + depth;
    this.onChange();
  }

  /** The canvas has another size: what was framed is framed again. */
  fit() {
    if (this.framed) this.frame(...this.framed);
  }

  /** What is up, to the right and towards the eye where nothing is turned. */
  #level() {
    const up = scaled(AXES[this.up.at(-1)], this.up.startsWith("-") ? -1 : 1);
    const side = this.up.at(-1) === "x" ? AXES.y : AXES.x;
    return { up, side, forth: cross(side, up) };
  }

  /** Right, up and backwards, of unit length. */
  axes() {
    const { up, side, forth } = this.#level();
    const level = added(scaled(side, Math.sin(this.turn)), scaled(forth, Math.cos(this.turn)));
    const back = normalized(added(scaled(level, Math.cos(this.rise)), scaled(up, Math.sin(this.rise))));
    const right = normalized(cross(up, back));
    return [right, cross(back, right), back];
  }

  eye() {
    return added(this.target, scaled(this.axes()[2], this.distance));
  }

  /** Nearest and farthest distances that are drawn. */
  range() {
    const near = Math.max(this.distance - 2 * this.size, this.distance * 1e-3, this.size * 1e-5);
    return [near, this.distance + 4 * this.size];
  }

  /** From points relative to `center`, in units of `scale`, to the image, by columns. */
  matrix({ center, scale }, aspect) {
    const [right, up, back] = this.axes();
    const eye = this.eye().map((x, axis) => x - center[axis]);
    const [near, far] = this.range();
    const f = 1 / Math.tan((this.fov * Math.PI) / 360);
    const rows = [
      [...right, -dot(right, eye)].map((x) => (x * f) / aspect),
      [...up, -dot(up, eye)].map((x) => x * f),
      [...back, -dot(back, eye)].map((x) => (x * (far + near)) / (near - far)),
      [...back, -dot(back, eye)].map((x) => -x),
    ];
    rows[2][3] += (2 * far * near) / (near - far);
    // What is looked at is in the middle of what is left of the image.
    const aside = this.aside();
    rows[0].forEach((x, column) => (rows[0][column] = x + aside * rows[3][column]));
    rows.forEach((row) => (row[3] /= scale));
    return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
  }

  /** The sides of the image and the near plane, as `frustum.js` takes them, for a model that is stretched. */
  planes(aspect, stretch) {
    const [right, up, back] = this.axes();
    const rise = Math.tan((this.fov * Math.PI) / 360);
    const run = rise * aspect;
    const aside = this.aside();
    const side = (across, slope) => added(across, scaled(back, -slope));
    const sides = [side(right, run * (1 + aside)), side(scaled(right, -1), run * (1 - aside)), side(up, rise), side(scaled(up, -1), rise), scaled(back, -1)];
    return sides.map((normal, i) => {
      const inner = normal.map((x, axis) => x * stretch[axis]);
      const length = Math.hypot(...inner);
      return [...scaled(inner, 1 / length), i < 4 ? 0 : -this.range()[0] / length];
    });
  }

  /** By how much what is looked at is to the right of the middle, in halves of the image. */
  aside() {
    return this.covered() / Math.max(this.canvas.clientWidth, 1);
  }

  /** What the picture is taken with: the eye and its axes, pixels of CSS at distance 1, and the pixel that is straight ahead. */
  lens() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const unit = height / 2 / Math.tan((this.fov * Math.PI) / 360);
    return { eye: this.eye(), axes: this.axes(), unit, middle: [(width / 2) * (1 + this.aside()), height / 2] };
  }

  /** Where a point of the picture's coordinates is on the canvas, in pixels of CSS, and how far away; null behind the eye. */
  project(point) {
    const { eye, axes: [right, up, back], unit, middle } = this.lens();
    const way = point.map((x, axis) => x - eye[axis]);
    const far = -dot(way, back);
    if (!(far > 0)) return null;
    return [middle[0] + (dot(way, right) * unit) / far, middle[1] - (dot(way, up) * unit) / far, far];
  }

  /** The direction of the ray through a point of the canvas. */
  ray(x, y) {
    const [right, up, back] = this.axes();
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const unit = (2 * Math.tan((this.fov * Math.PI) / 360)) / Math.max(height, 1);
    const [across, along] = [(x - (width / 2) * (1 + this.aside())) * unit, (height / 2 - y) * unit];
    return normalized(added(added(scaled(right, across), scaled(up, along)), scaled(back, -1)));
  }

  /** Goes around by an angle, as a turntable does. */
  spin(angle) {
    this.turn += angle;
    this.onChange();
  }

  #turn(dx, dy) {
    this.framed = null;
    this.turn -= dx * 0.008;
    this.rise = Math.min(1.55, Math.max(-1.55, this.rise + dy * 0.008));
    this.onChange();
  }

  #move(dx, dy) {
    this.framed = null;
    const [right, up] = this.axes();
    const unit = (2 * this.distance * Math.tan((this.fov * Math.PI) / 360)) / this.canvas.clientHeight;
    this.target = added(this.target, added(scaled(right, -dx * unit), scaled(up, dy * unit)));
    this.onChange();
  }

  #zoom(factor) {
    this.framed = null;
    this.distance = Math.min(50 * this.size, Math.max(1e-4 * this.size, this.distance * factor));
    this.onChange();
  }

  #listen() {
    const { canvas } = this;
    const fingers = new Map();
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      this.onTouch();
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    const up = (event) => fingers.delete(event.pointerId);
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
      fingers.set(event.pointerId, now);
      if (other) {
        const away = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]) || 1;
        this.#zoom(away(before) / away(now));
        this.#move(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons & 2) {
        this.#move(dx, dy);
      } else {
        this.#turn(dx, dy);
      }
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.onTouch();
      this.#zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 100) * 0.0015));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] };
      const zooms = { "+": 0.9, "=": 0.9, "-": 1.1 };
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (turns[event.key] || zooms[event.key]) this.onTouch();
      if (turns[event.key] && event.shiftKey) this.#move(...turns[event.key].map((x) => -x));
      else if (turns[event.key]) this.#turn(...turns[event.key]);
      else if (zooms[event.key]) this.#zoom(zooms[event.key]);
      else return;
      event.preventDefault();
    });
  }
}
