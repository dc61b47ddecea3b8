// An open model: what of it is drawn for a camera, and what is fetched next.

import { camera as cameraRule, open, selectFromMemory } from "../chpm/index.js";

/** Batches of splits that are under way at once, and clusters that the splits of one bring, about. */
const AT_ONCE = 2;
const BATCH = 48;
const GPU_BYTES = 512 << 20;

export class Model {
  constructor(source, renderer, onChange, onError) {
    Object.assign(this, { source, renderer, onChange, onError, stopped: new AbortController(), coming: new Set(), failed: new Set(), isReady: false });
    this.relaxed = 1;
    this.batches = 0;
  }

  /** Opens the file and draws the roots. */
  async open() {
    const { signal } = this.stopped;
    this.file = await open(this.source, { signal });
    this.roots = await this.file.roots(signal);
    await this.file.needGroups(this.roots.map((id) => this.file.cluster(id).group), signal);
    const { boxMin, boxMax } = this.file.header;
    this.center = boxMin.map((x, axis) => (x + boxMax[axis]) / 2);
    this.radius = Math.hypot(...boxMin.map((x, axis) => boxMax[axis] - x)) / 2;
    this.place = { center: this.center, scale: 2 ** Math.round(Math.log2(this.radius || 1)) };
    await this.file.eachPage(this.roots, (page) => this.renderer.add(page, this.place), signal);
    this.kept = new Set(this.roots);
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
  draw(orbit, { pixels, budget, colorOf }) {
    const { file, renderer } = this;
    const height = renderer.canvas.clientHeight;
    const view = (pixels) => cameraRule({ eye: orbit.eye(), fov: orbit.fov, near: orbit.range()[0], height, pixels });
    const rule = view(pixels * this.relaxed);
    const { cut, waiting } = selectFromMemory(file, this.roots, rule, (id) => renderer.has(id));
    const drawn = renderer.draw(cut, orbit, this.place, colorOf);

    // Where a view asks for more triangles than are allowed, all of it gets coarser until it fits.
    const before = this.relaxed;
    if (drawn.triangles > budget) this.relaxed = Math.min(this.relaxed * 1.25, 1e6);
    else if (this.relaxed > 1 && drawn.triangles < 0.7 * budget) this.relaxed = Math.max(1, this.relaxed / 1.1);
    const settling = this.relaxed !== before;

    const wanted = waiting.filter(({ group }) => !this.failed.has(group.id));
    wanted.sort((a, b) => this.#urgency(b.group, rule) - this.#urgency(a.group, rule));
    const due = wanted.filter(({ group }) => !this.coming.has(group.id));
    while (due.length > 0 && this.batches < AT_ONCE) {
      const batch = [];
      for (let brings = 0; due.length > 0 && brings < BATCH; ) {
        const { group } = due.shift();
        brings += group.fineCount ?? 2;
        batch.push(group.id);
      }
      this.#fetch(batch);
    }
    renderer.shrink(GPU_BYTES, this.kept);
    return { ...drawn, clusters: cut.length, cut, settled: wanted.length === 0 && !settling, relaxed: this.relaxed, settling };
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
    } catch (error) {
      if (signal.aborted) return;
      // What is wrong is of one group; the others, and the rest of the model, stay as they are.
      for (const id of ids) {
        try {
          if (ids.length > 1) await this.#bring([id], signal);
          else throw error;
        } catch (own) {
          if (signal.aborted) return;
          this.failed.add(id);
          this.onError(own);
        }
      }
    } finally {
      ids.forEach((id) => this.coming.delete(id));
      this.batches -= 1;
    }
    if (!signal.aborted) this.onChange();
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
