// Sheets of what is drawn: which are wanted, fetched and decoded. They come behind the pages, whose vertices have mean colours until then.

import { ChpmError } from "../chpm/index.js";
import { bytesOf } from "./texture.js";

/** Bytes of a request, about, and bytes that nobody wants that cost less than another one. */
const LONGEST = 512 << 10;
const NEAR = 64 << 10;
/** The share of the memory that images may take before they are halved. */
const SHARE = 0.6;

export class Painter {
  /**
   * @param line reaches the host
   * @param hear.damaged a sheet cannot be used: told of the first alone, since each keeps the colours of vertices
   * @param memory bytes of the graphics card for all
   */
  constructor(file, renderer, place, line, hear, memory) {
    Object.assign(this, { file, renderer, place, line, hear, memory, requests: 0 });
    Object.assign(this, { coming: new Set(), failed: new Set(), isDamaged: false });
  }

  /** Fetches the records of clusters; of damaged ones, no sheets are drawn. */
  async need(ids) {
    try {
      await this.line.reach((signal) => this.file.sheets.need(ids, signal));
    } catch (error) {
      if (this.line.signal.aborted) return;
      ids.forEach((id) => this.failed.add(id));
      this.#tell(error);
    }
  }

  #tell(error) {
    if (!this.isDamaged) this.hear.damaged(new ChpmError(`${error.message}; colours of vertices stand for it`, { cause: error }));
    this.isDamaged = true;
  }

  /**
   * Asks for the sheets that drawn clusters lack, in so many requests at most.
   * @returns whether anything is still to come
   */
  fetch(ids, free) {
    const { sheets } = this.file;
    const usable = ids.filter((id) => !this.failed.has(id));
    const unknown = usable.filter((id) => !sheets.record(id));
    if (unknown.length > 0) {
      if (free > 0) this.#bring(unknown, () => this.need(unknown));
      return true;
    }
    const all = usable.reduce((sum, id) => sum + bytesOf(sheets.record(id).size), 0);
    const least = this.#halvings(all);
    // Larger ones come again once they would take half of what there is.
    const most = this.#halvings(2 * all);
    const isWanting = (id) => !(this.renderer.halvings(id) >= least && this.renderer.halvings(id) <= most);
    const absent = usable.filter(isWanting);
    const due = absent.filter((id) => !this.coming.has(id));
    for (const run of sheets.runs(due, LONGEST, NEAR).slice(0, Math.max(free, 0))) this.#bring(run, () => this.#paint(run, isWanting, least));
    return absent.length > 0;
  }

  /** How often images of so many bytes are halved, so that they fit. */
  #halvings(bytes) {
    return Math.max(0, Math.ceil(Math.log2(bytes / (SHARE * this.memory)) / 2));
  }

  async #bring(ids, work) {
    const asked = ids.filter((id) => !this.coming.has(id));
    if (asked.length === 0) return;
    this.requests += 1;
    asked.forEach((id) => this.coming.add(id));
    await work();
    asked.forEach((id) => this.coming.delete(id));
    this.requests -= 1;
    if (!this.line.signal.aborted) this.hear.changed();
  }

  /** Fetches sheets that lie side by side. What is wrong is of one of them: then each comes alone. */
  async #paint(run, isWanting, halvings) {
    for (const part of [run, ...(run.length > 1 ? run.map((id) => [id]) : [])]) {
      try {
        const absent = () => part.filter(isWanting).map((id) => this.file.cluster(id));
        await this.line.reach((signal) => this.file.sheets.each(absent(), (sheet) => this.#put(sheet, halvings, signal), signal));
        if (part === run) return;
      } catch (error) {
        if (this.line.signal.aborted) return;
        if (part.length > 1) continue;
        this.failed.add(part[0]);
        this.#tell(error);
      }
    }
  }

  async #put(sheet, halvings, signal) {
    const { size, cluster } = sheet;
    const most = Math.ceil(Math.log2(Math.max(...size) / this.renderer.textures.most));
    const bitmap = await sheet.decode(Math.max(halvings, most, 0));
    // What was opened may be closed, or its page gone, by now.
    if (!signal.aborted && this.renderer.has(cluster.id)) this.renderer.paint(sheet, bitmap, halvings, this.place);
    bitmap.close();
  }
}
