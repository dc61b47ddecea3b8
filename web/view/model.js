// An open model: what of it is drawn for a camera, and what is fetched next.

import { camera as cameraRule, open, selectFromMemory } from "../chpm/index.js";
import { missesCluster } from "../chpm/frustum.js";
import { Borders } from "./facing.js";

/** Batches of splits that are under way at once, and clusters that the splits of one bring, about. */
const AT_ONCE = 2;
const BATCH = 48;
const GPU_BYTES = 512 << 20;
/** Waits for a host that cannot be reached, ms: twice as long each time, up to the longest. */
const SOON = 1000;
const LONGEST = 30000;

export class Model {
  /**
   * @param hear.changed something came, and the picture is another one
   * @param hear.damaged a part of the file cannot be used
   * @param hear.lost the host cannot be reached; it is asked again, and `hear.found` told when it answers
   */
  constructor(source, renderer, hear) {
    Object.assign(this, { source, renderer, hear, stopped: new AbortController(), coming: new Set(), failed: new Set(), isReady: false });
    this.relaxed = 1;
    this.batches = 0;
    /** How often in a row the host was not reached. */
    this.losses = 0;
    this.isWaiting = false;
  }

  /**
   * Opens the file and draws the roots; waits for the host as long as it takes. `seen` is how a model is looked at, if somebody knows: `points` that have
   * to be in the picture of all of it, and a factor for each axis by which everything is stretched.
   */
  async open(seen = {}) {
    for (;;) {
      try {
        await this.#begin(seen);
        return this.#found();
      } catch (error) {
        if (!error.isLost || this.stopped.signal.aborted) throw error;
        await this.#wait(error);
      }
    }
  }

  async #begin({ points, stretch = [1, 1, 1] }) {
    const { signal } = this.stopped;
    this.file = await open(this.source, { signal });
    this.roots = await this.file.roots(signal);
    await this.file.needGroups(this.roots.map((id) => this.file.cluster(id).group), signal);
    const { boxMin, boxMax } = this.file.header;
    const [low, high] = [boxMin, boxMax].map((corner) => corner.map((x, axis) => x * stretch[axis]));
    this.center = low.map((x, axis) => (x + high[axis]) / 2);
    this.radius = Math.hypot(...low.map((x, axis) => high[axis] - x)) / 2;
    this.points = points ?? Array.from({ length: 8 }, (_, n) => low.map((x, axis) => ((n >> axis) & 1 ? high : low)[axis]));
    this.place = { center: this.center, stretch, scale: 2 ** Math.round(Math.log2(this.radius || 1)) };
    // Some are there where the host was lost between them.
    const absent = this.roots.filter((id) => !this.renderer.has(id));
    await this.file.eachPage(absent, (page) => this.renderer.add(page, this.place), signal);
    this.kept = new Set(this.roots);
    this.borders = new Borders(this.file, this.roots, (id) => this.renderer.page(id));
    /** Before, there is nothing to draw, whatever changes. */
    this.isReady = true;
  }

  close() {
    this.stopped.abort();
    this.renderer.clear();
  }

  /**
   * Draws what is there, and fetches what the view wants beside it.
   * @returns what was drawn, and whether anything is still to come
   */
  draw(orbit, { pixels, budget, colorOf, shading }) {
    const { file, renderer } = this;
    const { clientWidth: width, clientHeight: height } = renderer.canvas;
    const { stretch } = this.place;
    const eye = orbit.eye().map((x, axis) => x / stretch[axis]);
    const planes = orbit.planes(Math.max(width, 1) / Math.max(height, 1), stretch);
    // Errors know nothing of a stretch, and say little of such a picture: it is nearly as fine as the file.
    const fine = stretch.every((factor) => factor === 1) ? 1 : 1e-6;
    const rule = cameraRule({ eye, fov: orbit.fov, near: orbit.range()[0], height, pixels: pixels * fine * this.relaxed, planes });
    const { cut, waiting } = selectFromMemory(file, this.roots, rule, (id) => renderer.has(id));
    const seen = cut.filter(({ cluster }) => !missesCluster(planes, eye, file.cluster(cluster)));
    const drawn = renderer.draw(seen, orbit, this.place, colorOf, shading === "flat" ? null : this.borders);

    // Where a view asks for more triangles than are allowed, all of it gets coarser until it fits.
    const before = this.relaxed;
    if (drawn.triangles > budget) this.relaxed = Math.min(this.relaxed * 1.25, 1e6);
    else if (this.relaxed > 1 && drawn.triangles < 0.7 * budget) this.relaxed = Math.max(1, this.relaxed / 1.1);
    const settling = this.relaxed !== before;

    const wanted = waiting.filter(({ group }) => !this.failed.has(group.id));
    wanted.sort((a, b) => this.#urgency(b.group, rule) - this.#urgency(a.group, rule));
    const due = wanted.filter(({ group }) => !this.coming.has(group.id));
    while (due.length > 0 && this.batches < AT_ONCE && !this.isWaiting) {
      const batch = [];
      for (let brings = 0; due.length > 0 && brings < BATCH; ) {
        const { group } = due.shift();
        brings += group.fineCount ?? 2;
        batch.push(group.id);
      }
      this.#fetch(batch);
    }
    renderer.shrink(GPU_BYTES, this.kept);
    return { ...drawn, clusters: seen.length, cut, settled: wanted.length === 0 && !settling, relaxed: this.relaxed, settling };
  }

  #urgency(group, rule) {
    if (group.minError === undefined) return Infinity;
    const bound = rule.bound(group);
    return bound > 0 ? group.minError / bound : Infinity;
  }

  /** Fetches what the splits of some groups bring, together: pages of splits alike are next to each other. */
  async #fetch(ids) {
    const { signal } = this.stopped;
    this.batches += 1;
    ids.forEach((id) => this.coming.add(id));
    try {
      await this.#bring(ids, signal);
      this.#found();
    } catch (error) {
      if (signal.aborted) return;
      if (error.isLost) return void this.#wait(error);
      // What is wrong is of one group; the others, and the rest of the model, stay as they are.
      for (const id of ids) {
        try {
          if (ids.length > 1) await this.#bring([id], signal);
          else throw error;
        } catch (own) {
          if (signal.aborted) return;
          if (own.isLost) return void this.#wait(own);
          this.failed.add(id);
          this.hear.damaged(own);
        }
      }
    } finally {
      ids.forEach((id) => this.coming.delete(id));
      this.batches -= 1;
    }
    if (!signal.aborted) this.hear.changed();
  }

  /** The host cannot be reached: until it is asked again, nothing is. */
  async #wait(error) {
    if (this.isWaiting) return;
    this.isWaiting = true;
    this.hear.lost(error);
    const wait = Math.min(SOON * 2 ** this.losses++, LONGEST);
    await new Promise((done) => {
      const { signal } = this.stopped;
      const go = () => {
        clearTimeout(timer);
        removeEventListener("online", go);
        signal.removeEventListener("abort", go);
        done();
      };
      const timer = setTimeout(go, wait);
      addEventListener("online", go);
      signal.addEventListener("abort", go);
    });
    this.isWaiting = false;
    if (!this.stopped.signal.aborted) this.hear.changed();
  }

  #found() {
    if (this.losses > 0) this.hear.found();
    this.losses = 0;
  }

  async #bring(ids, signal) {
    const { file, renderer } = this;
    await file.needGroups(ids, signal);
    const groups = ids.map((id) => file.group(id));
    await file.needMembers(groups, signal);
    const fine = [...new Set(groups.flatMap((group) => file.fine(group)))];
    await file.needClusters(fine, signal);
    await file.needGroups(fine.map((cluster) => file.cluster(cluster).group), signal);
    const absent = fine.filter((cluster) => !renderer.has(cluster));
    await file.eachPage(absent, (page) => renderer.has(page.cluster.id) || renderer.add(page, this.place), signal);
  }
}
