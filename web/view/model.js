// An open model: what of it is drawn for a camera, and what is fetched next.

import { Regions, camera as cameraRule, open, selectFromMemory } from "../chpm/index.js";
import { missesCluster } from "../chpm/frustum.js";
import { Borders } from "./facing.js";
import { Glide } from "./glide.js";
import { Line } from "./line.js";
import { Painter } from "./painter.js";
import { Sight } from "./sight.js";
import { decoderOfPage } from "./worker.js";

/** Requests that are under way at once; they share the line, and none waits for the answer of another. */
const AT_ONCE = 3;
/** Bytes of a request, about: what comes is drawn when the request is done. */
const LONGEST = 512 << 10;
/** So many bytes that nobody wants cost less than another request. */
const NEAR = 64 << 10;
/** Tables up to this are fetched whole, bytes. Of larger ones comes what a view needs, and boxes are not known. */
const TABLES = 4 << 20;
/** A view is fetched in steps, the first with 2^6 times the error of the last. */
const STEPS = 6;

export class Model {
  /**
   * @param hear.changed something came, and the picture is another one
   * @param hear.answered it is known what is hidden in the last picture
   * @param hear.damaged a part of the file cannot be used
   * @param hear.lost the host cannot be reached; it is asked again, and `hear.found` told when it answers
   * @param memory bytes of the graphics card for pages
   */
  constructor(source, renderer, hear, memory) {
    Object.assign(this, { source, renderer, hear, memory, line: new Line(hear), isReady: false, regions: null });
    this.relaxed = 1;
    this.requests = 0;
    /** Pages, and groups whose records, are under way, and those that cannot be had. */
    Object.assign(this, { coming: new Set(), records: new Set(), failed: new Set(), lacking: new Set() });
    this.glide = new Glide();
  }

  /**
   * Opens the file and draws the roots; waits for the host as long as it takes. `seen` is how a model is looked at, if somebody knows: `points` that have
   * to be in the picture of all of it, and a factor for each axis by which everything is stretched.
   */
  async open(seen = {}) {
    await this.line.reach((signal) => this.#begin(seen, signal));
    this.#need();
  }

  async #begin({ points, stretch = [1, 1, 1] }, signal) {
    this.decoder = decoderOfPage();
    this.file = await open(this.source, { signal, decoder: this.decoder });
    this.roots = await this.file.roots(signal);
    const { boxMin, boxMax } = this.file.header;
    const [low, high] = [boxMin, boxMax].map((corner) => corner.map((x, axis) => x * stretch[axis]));
    this.center = low.map((x, axis) => (x + high[axis]) / 2);
    this.radius = Math.hypot(...low.map((x, axis) => high[axis] - x)) / 2;
    this.points = points ?? Array.from({ length: 8 }, (_, n) => low.map((x, axis) => ((n >> axis) & 1 ? high : low)[axis]));
    this.place = { center: this.center, stretch, scale: 2 ** Math.round(Math.log2(this.radius || 1)) };
    await this.#take(this.roots, signal);
    this.painter = this.file.sheets && new Painter(this.file, this.renderer, this.place, this.line, this.hear, this.memory);
    this.sight = new Sight(this.file, this.place, this.renderer, this.hear.answered);
    this.borders = new Borders(this.file, this.roots, (id) => this.renderer.page(id));
    /** Before, there is nothing to draw, whatever changes. */
    this.isReady = true;
  }

  /** Fetches the tables, once there is a picture, unless they are large. */
  async #need() {
    this.isWhole = this.file.tablesLength <= TABLES;
    // Which texels are seen decides what is split.
    const sheets = this.isWhole && this.painter?.need(Array.from({ length: this.file.header.clusterCount }, (_, id) => id));
    try {
      if (this.isWhole) await this.line.reach((signal) => this.file.needTables(signal));
      await sheets;
      if (this.isWhole) this.regions = new Regions(this.file);
    } catch (error) {
      if (this.line.signal.aborted) return;
      this.isWhole = false;
      this.hear.damaged(error);
    }
    this.hear.changed();
  }

  close() {
    this.line.close();
    this.renderer.clear();
  }

  /** What the graphics context had is gone, and so is this model. */
  forget() {
    this.isReady = false;
    this.line.close();
    this.renderer.blocks.clear();
  }

  /**
   * Draws what is there, and fetches what the view wants beside it.
   * @returns what was drawn, whether nothing is still to come (`isComplete`), and whether it is known, too, what of that is hidden (`settled`)
   */
  draw(orbit, { pixels, budget, colorOf, shading, scalar, clip, studio, rest, sheets, culls }) {
    const { file, renderer, sight } = this;
    const { clientWidth: width, clientHeight: height } = renderer.canvas;
    const { stretch } = this.place;
    const eye = orbit.eye().map((x, axis) => x / stretch[axis]);
    const planes = orbit.planes(Math.max(width, 1) / Math.max(height, 1), stretch);
    const cutting = this.clipOf(clip);
    if (cutting) planes.push(beyond(cutting, eye));
    // Errors know nothing of a stretch, and say little of such a picture: it is nearly as fine as the file.
    const fine = stretch.every((factor) => factor === 1) ? 1 : 1e-6;
    const painter = sheets ? this.painter : null;
    const texel = painter && ((group) => file.texel(group));
    // Of a cut by a plane all is told, also what is hidden.
    sight.begin(orbit, Boolean(painter), this.regions, culls && !cutting);
    const hides = (group) => sight.hides(group);
    const camera = { eye, fov: orbit.fov, near: orbit.range()[0], height: Math.max(height, 1), planes, regions: this.regions, texel, hides };
    const rule = (times) => cameraRule({ ...camera, pixels: pixels * fine * this.relaxed * times });
    const before = this.relaxed;
    const wanted = this.#wanted(rule, budget);
    const { cut } = selectFromMemory(file, this.roots, rule(1), (id) => renderer.has(id));
    const eased = this.glide.ease(file, cut, pixels * fine * this.relaxed);
    const inside = eased.filter(({ cluster }) => !missesCluster(planes, eye, file.cluster(cluster)));
    const seen = rest && sight.knows(eased) ? inside.filter(({ cluster }) => !sight.hidesCluster(file.cluster(cluster))) : inside;
    // A plane across an axis is at its place times the factor of that axis.
    const across = cutting && [cutting[0], cutting[1] * stretch[clip.axis]];
    const borders = shading === "flat" ? null : this.borders;
    const drawn = renderer.draw(seen, orbit, this.place, { colorOf, scalar, borders, sheets, clip: across, studio, rest });

    // Where a view asks for more triangles than are allowed, all of it gets coarser until it fits.
    const { isGliding } = this.glide;
    if (drawn.triangles > budget) this.relaxed = Math.min(this.relaxed * 1.25, 1e6);
    else if (this.relaxed > 1 && !isGliding && wanted.count < 0.7 * budget) this.relaxed = Math.max(1, this.relaxed / 1.1);
    const settling = this.relaxed !== before || isGliding;
    const isComing = !sight.isReady() || this.#fetch(rule, wanted);
    const isPainting = Boolean(painter) && this.#paint(painter, seen, wanted);
    renderer.shrink(this.memory, new Set([...this.roots, ...wanted.pages]));
    const isComplete = !isComing && !isPainting && !settling;
    sight.end(eased, isComplete);
    return { ...drawn, clusters: seen.length, cut, isComplete, settled: isComplete && sight.knows(eased), relaxed: this.relaxed, settling };
  }

  /** A plane across an axis of the file, beyond which nothing is drawn: its outer normal and offset. */
  clipOf(clip) {
    if (!clip) return null;
    const { axis, share, isFlipped } = clip;
    const { boxMin, boxMax } = this.file.header;
    const at = boxMin[axis] + share * (boxMax[axis] - boxMin[axis]);
    const sign = isFlipped ? -1 : 1;
    return [[0, 1, 2].map((x) => (x === axis ? sign : 0)), sign * at];
  }

  /** What a view asks for, as far as records are there, of pages that can be had. */
  #select(rule) {
    return selectFromMemory(this.file, this.roots, rule, (id) => !this.failed.has(id));
  }

  /** The pages of a view as far as they can be had, and about how many triangles they draw: more than are allowed are not fetched. */
  #wanted(rule, budget) {
    for (;;) {
      const { cut, waiting, met } = this.#select(rule(1));
      const count = cut.reduce((sum, { cluster, bound }) => sum + trianglesAt(this.file.cluster(cluster), bound), 0);
      if (count <= 1.5 * budget || this.relaxed >= 1e6) return { pages: [...met], cut: new Set(cut.map(({ cluster }) => cluster)), waiting, count };
      this.relaxed = Math.min(this.relaxed * 1.25, 1e6);
    }
  }

  /** Fetches what a view lacks, the coarsest first; whether anything is still to come. */
  #fetch(rule, { pages, waiting }) {
    if (this.isWhole && !this.regions) return true;
    const needsRecords = ({ fine }) => !fine?.every((id) => this.file.cluster(id));
    const groups = waiting.filter(needsRecords).map(({ group }) => group.id).filter((id) => !this.lacking.has(id));
    const asked = groups.filter((id) => !this.records.has(id));
    if (asked.length > 0) this.#bringRecords(asked);
    const isAbsent = (id) => !this.renderer.has(id) && !this.failed.has(id);
    if (!pages.some(isAbsent)) return groups.length > 0;
    for (let step = STEPS; step >= 0 && this.requests < AT_ONCE; step--) {
      const due = (step > 0 ? [...this.#select(rule(2 ** step)).met] : pages).filter((id) => isAbsent(id) && !this.coming.has(id));
      for (const run of this.file.runs(due, LONGEST, NEAR).slice(0, AT_ONCE - this.requests)) this.#bring(run);
    }
    return true;
  }

  /** Asks for the sheets of what is drawn and stays so, once nothing else is left to ask for; whether any is still to come. */
  #paint(painter, seen, { cut, waiting }) {
    if (this.isWhole !== Boolean(this.regions) || (waiting.length > 0 && this.records.size > 0)) return true;
    const ids = seen.map(({ cluster }) => cluster).filter((id) => cut.has(id) && !this.sight.hidesCluster(this.file.cluster(id)));
    return painter.fetch(ids, AT_ONCE - this.requests - painter.requests);
  }

  /** Fetches pages that lie side by side. */
  async #bring(run) {
    const { signal } = this.line;
    this.requests += 1;
    run.forEach((id) => this.coming.add(id));
    // What is wrong is of one page; the others, and the rest of the model, stay as they are.
    for (const part of [run, ...(run.length > 1 ? run.map((id) => [id]) : [])]) {
      try {
        await this.line.reach((signal) => this.#take(part, signal));
        if (part === run) break;
      } catch (error) {
        if (signal.aborted) return;
        if (part.length > 1) continue;
        this.failed.add(part[0]);
        this.hear.damaged(error);
      }
    }
    run.forEach((id) => this.coming.delete(id));
    this.requests -= 1;
    this.hear.changed();
  }

  /** Fetches those of some pages that are not there. */
  async #take(ids, signal) {
    const absent = ids.filter((id) => !this.renderer.has(id));
    await this.file.eachPage(absent, (page) => this.renderer.has(page.cluster.id) || this.renderer.add(page, this.place), signal);
  }

  /** Fetches the records that the splits of some groups need. */
  async #bringRecords(ids) {
    const { signal } = this.line;
    ids.forEach((id) => this.records.add(id));
    try {
      await this.line.reach((signal) => this.#takeRecords(ids, signal));
    } catch (error) {
      if (signal.aborted) return;
      ids.forEach((id) => this.lacking.add(id));
      this.hear.damaged(error);
    }
    ids.forEach((id) => this.records.delete(id));
    this.hear.changed();
  }

  async #takeRecords(ids, signal) {
    const { file } = this;
    await file.needGroups(ids, signal);
    const groups = ids.map((id) => file.group(id));
    await file.needMembers(groups, signal);
    const fine = [...new Set(groups.flatMap((group) => file.fine(group)))];
    await file.needClusters(fine, signal);
    await file.needGroups(fine.map((cluster) => file.cluster(cluster).group), signal);
  }
}

/** The plane that a cut is, as those of the image: an inner normal, and an offset for points relative to the eye. */
function beyond([normal, offset], eye) {
  return [...normal.map((x) => -x), offset - normal.reduce((sum, x, axis) => sum + x * eye[axis], 0)];
}

/** Triangles that a cluster has at a bound, about: between those of its two ends as errors are on a surface. */
function trianglesAt({ baseTriangleCount, triangleCount, minError, maxError }, bound) {
  if (bound >= maxError) return baseTriangleCount;
  if (bound <= minError || minError === 0) return triangleCount;
  return baseTriangleCount + (triangleCount - baseTriangleCount) * (Math.log(maxError / bound) / Math.log(maxError / minError));
}
