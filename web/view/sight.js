// What of a model is hidden, from picture to picture. While the camera moves, what is hidden is only not made finer: what comes into sight is there. At rest
// it is not drawn either.

/** So long what was seen is taken for seen while the camera moves, ms. */
const LONG = 500;
/** So often what was hidden comes into sight at rest, and then stays there: two that hide each other in turn would never settle. */
const OFTEN = 2;
/** Pictures of a camera that moves, of which one is fetched for: of one that stands, it is known by then what is hidden. */
const MOVING = 4;

export class Sight {
  /**
   * @param file an open file
   * @param place how it is stretched and moved to where it is drawn
   * @param renderer draws it, and knows the depths of its last picture
   * @param hear told when there is an answer
   */
  constructor(file, place, renderer, hear) {
    Object.assign(this, { file, place, renderer, hear });
    /** The last answer: depths, and the view that they are of. */
    this.answer = null;
    /** What was asked about last: a view, and the cut that was drawn. */
    this.asked = null;
    /** By group: the last view that it was seen in, when, and how often it had been hidden there. */
    this.seen = new Map();
    /** Pictures since one that was fetched for. */
    this.waited = 0;
    this.isBlind = false;
    /** By group, what the last answer says. */
    this.told = new Map();
  }

  /**
   * Begins a picture of a camera.
   * @param sheets whether sheets are shown: some hide less than what is behind them
   * @param regions those of the file, if they are known
   * @param isOn if not, nothing is hidden
   */
  begin(orbit, sheets, regions, isOn, now = performance.now()) {
    const [width, height] = this.renderer.size();
    const matrix = orbit.matrix(this.place, width / height);
    const camera = `${width} ${height} ${matrix.join(" ")}`;
    const view = `${camera} ${sheets ? this.renderer.painted : "bare"}`;
    const [isSame, isThere] = [this.answer?.view === view, this.answer?.camera === camera];
    if (isSame !== this.isSame || isThere !== this.isThere || regions !== this.regions) this.told.clear();
    Object.assign(this, { matrix, camera, view, isSame, isThere, regions, isOn: isOn && !this.isBlind, now });
  }

  /** Whether all that is below a group is hidden, as far as anybody knows. */
  hides(group) {
    if (!this.isOn || !this.answer) return false;
    let told = this.told.get(group.id);
    if (told === undefined) this.told.set(group.id, (told = this.#hides(group)));
    return told;
  }

  #hides({ id, sphere }) {
    const { regions, answer, isSame, seen, now } = this;
    const corner = (of, sign) => [0, 1, 2].map((axis) => (regions ? of[3 * id + axis] : sphere.center[axis] + sign * sphere.radius));
    const known = seen.get(id);
    const isOfView = known?.view === answer.view;
    if (!this.#isBehind(corner(regions?.low, -1), corner(regions?.high, 1))) {
      const often = isOfView ? known.often + (known.isHidden ? 1 : 0) : 0;
      seen.set(id, { view: answer.view, when: now, often, isHidden: false });
      return false;
    }
    const stays = known && (isSame ? isOfView && known.often >= OFTEN : now - known.when < LONG);
    if (known && !stays) known.isHidden = true;
    return !stays;
  }

  /** Whether a box is hidden in the picture of the last answer. */
  #isBehind(low, high) {
    const { center, stretch, scale } = this.place;
    const placed = (corner) => corner.map((x, axis) => (x * stretch[axis] - center[axis]) / scale);
    return this.answer.depths.hides(placed(low), placed(high), this.isThere);
  }

  /** Whether pages are to be fetched for this picture: not before it is known what of it is hidden, unless the camera goes on. */
  isReady() {
    const isReady = !this.isOn || this.isSame || this.waited + 1 >= MOVING;
    this.waited = isReady ? 0 : this.waited + 1;
    return isReady;
  }

  /** Whether a cluster is hidden, if the last answer is of this view. */
  hidesCluster({ boxMin, boxMax }) {
    return this.isOn && this.isSame && this.#isBehind(boxMin, boxMax);
  }

  /** Whether the last answer is of a cut in this view. */
  knows(cut) {
    return !this.isOn || (this.isSame && this.asked !== null && isSameCut(this.asked.cut, cut) && !this.renderer.occlusion.isAsking);
  }

  /** The picture of a cut has been drawn: asks about it where the view is another one, or nothing is still to come. One question at a time. */
  end(cut, isComplete) {
    const { camera, view, matrix, renderer } = this;
    if (renderer.occlusion.isAsking || (this.isSame && !isComplete) || this.knows(cut)) return;
    this.asked = { view, cut };
    renderer.ask(matrix, (depths) => {
      // A graphics card that does not answer is not asked again.
      this.isBlind = depths === null;
      this.answer = depths && { depths, camera, view };
      this.told.clear();
      this.hear();
    });
  }
}

function isSameCut(a, b) {
  return a.length === b.length && a.every(({ cluster, bound }, i) => cluster === b[i].cluster && bound === b[i].bound);
}
