// What lies over the picture at points of the model: numbers with text, and the two ends of a measurement.

/** A length as people write it. */
const formats = (options) => [
  new Intl.NumberFormat("en", { maximumSignificantDigits: 4, ...options }),
  new Intl.NumberFormat("en", { notation: "scientific", maximumSignificantDigits: 3, ...options }),
];
const [nearest, above] = [formats({}), formats({ roundingMode: "ceil" })];
const written = ([numbers, powers], x) => (x === 0 || (x >= 1e-4 && x < 1e9) ? numbers : powers).format(x);
export const length = (x) => written(nearest, x);
/** A bound: what is told is never less than it. */
export const atMost = (x) => written(above, x);

export class Overlay {
  /**
   * @param element where labels are put
   * @param line an SVG line
   * @param told where a measurement is told
   */
  constructor(element, line, told) {
    Object.assign(this, { element, line, told });
    this.clear();
  }

  clear() {
    this.labels = [];
    this.marks = [];
    this.element.replaceChildren();
    this.#tell();
  }

  /** Puts texts at points of the file's coordinates: `{ at, title, text }`. */
  annotate(notes, show) {
    for (const [number, note] of notes.entries()) {
      const button = document.createElement("button");
      Object.assign(button, { type: "button", className: "note", textContent: number + 1, title: note.title });
      button.setAttribute("aria-label", `${number + 1}: ${note.title}`);
      button.addEventListener("click", () => show(note, button));
      this.#put(button, note.at);
    }
  }

  /** One more end of a measurement; a third one begins another. */
  mark(found) {
    if (this.marks.length === 2) this.unmark();
    const dot = document.createElement("span");
    dot.className = "mark";
    this.#put(dot, found.point);
    this.marks.push({ ...found, dot });
    this.#tell();
  }

  unmark() {
    for (const { dot } of this.marks) {
      dot.remove();
      this.labels = this.labels.filter(({ element }) => element !== dot);
    }
    this.marks = [];
    this.#tell();
  }

  #put(element, at) {
    this.labels.push({ element, at });
    this.element.append(element);
  }

  /** The distance, and by how much both ends together may be beside the source. */
  #tell() {
    const [a, b] = this.marks;
    if (!a) return void (this.told.textContent = "");
    if (!b) return void (this.told.textContent = `one end: within ${atMost(a.error)} of the source. Now the other.`);
    const away = Math.hypot(...a.point.map((x, axis) => x - b.point[axis]));
    const ends = a.error === b.error ? `${atMost(a.error)} each` : `${atMost(a.error)} and ${atMost(b.error)}`;
    this.told.textContent = `${length(away)} units, within ${atMost(a.error + b.error)} (the ends within ${ends} of the source)`;
  }

  /** Moves everything to where it is now. */
  place(orbit, stretch) {
    const placed = this.labels.map(({ element, at }) => {
      const point = orbit.project(at.map((x, axis) => x * stretch[axis]));
      element.hidden = !point;
      if (point) element.style.transform = `translate(${point[0].toFixed(1)}px, ${point[1].toFixed(1)}px)`;
      return [element, point];
    });
    const ends = this.marks.map(({ dot }) => placed.find(([element]) => element === dot)?.[1]);
    this.line.toggleAttribute("hidden", !(ends[0] && ends[1]));
    this.line.style.display = ends[0] && ends[1] ? "" : "none";
    if (ends[0] && ends[1]) ["x1", "y1", "x2", "y2"].forEach((name, i) => this.line.setAttribute(name, ends[i >> 1][i & 1].toFixed(1)));
  }
}

/** Notes as a JSON has them: a list of points with texts; what is none is left out. */
export function readNotes(list, origin) {
  const isPoint = (at) => Array.isArray(at) && at.length === 3 && at.every(Number.isFinite);
  const notes = Array.isArray(list) ? list.filter((note) => isPoint(note?.at)) : [];
  return notes.map(({ at, title, text }) => ({ at: at.map((x, axis) => x - origin[axis]), title: String(title ?? "note"), text: String(text ?? "") }));
}

/** A bar of a round length: 1, 2 or 5 of a power of ten, at most so many pixels long. */
export function scaleBar(pixelsOfUnit, most) {
  const power = 10 ** Math.floor(Math.log10(most / pixelsOfUnit));
  const round = [5, 2, 1].find((digit) => digit * power * pixelsOfUnit <= most) ?? 1;
  return { length: round * power, pixels: round * power * pixelsOfUnit };
}
