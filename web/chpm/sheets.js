// Sheets: images of clusters, of which a page's triangles show parts. Their records come in blocks, and each sheet is checked before it is used.

import { expect, viewOf } from "./records.js";
import { ChpmError, readExactly, readSound } from "./source.js";
import { xxh3 } from "./xxh3.js";

const RECORD = 64;
/** Records of TEXTURES that come in one request; of most files these are all. */
const BLOCK = 1024;
/** Sheets that are next to each other come in one request, up to this; and what may lie between them. */
const LONGEST_RUN = 4 << 20;
const NEAR = 65536;
const MAX_SIDE = 8192;
const TYPES = [null, "image/jpeg", "image/png"];
/** Bytes of a layout before its charts, and of a chart. */
const HEAD = 16;
const CHART = 40;

/** Where a cluster's triangles are in its image, and that image as it is stored. */
export class Sheet {
  /** @private */
  constructor(parts) {
    Object.assign(this, parts);
  }

  /** The image, its sides halved so often: straight alpha, and no colours but those of the file. Browsers only. */
  async decode(halvings = 0) {
    const [resizeWidth, resizeHeight] = this.size.map((side) => Math.max(side >> halvings, 1));
    const smaller = halvings > 0 ? { resizeWidth, resizeHeight, resizeQuality: "medium" } : {};
    try {
      return await createImageBitmap(new Blob([this.image], { type: this.type }), { colorSpaceConversion: "none", premultiplyAlpha: "none", ...smaller });
    } catch (cause) {
      throw new ChpmError(`the image of the sheet of cluster ${this.cluster.id} cannot be decoded: ${cause?.message ?? cause}`, { cause });
    }
  }

  /** Column and row of a point of a triangle in chart `chart`, as shares of width and height; put into `to` at `at`. */
  place(chart, positions, vertex, to, at) {
    const { axes, origin, size } = this;
    for (let way = 0; way < 2; way++) {
      const first = 8 * chart + 3 * way;
      let texel = axes[8 * chart + 6 + way];
      for (let axis = 0; axis < 3; axis++) texel += axes[first + axis] * (positions[3 * vertex + axis] - origin[axis]);
      to[at + way] = texel / size[way];
    }
  }
}

/** The sheets of a file. */
export class Sheets {
  #source;
  #records;
  #texels;
  #zstd;
  #known = new Map();

  /** @private */
  constructor(source, records, texels, zstd) {
    this.#source = source;
    this.#records = records;
    this.#texels = texels;
    this.#zstd = zstd;
  }

  /** Fetches what is missing of the records of clusters. */
  async need(ids, signal) {
    await Promise.all([...new Set([...ids].map((id) => Math.floor(id / BLOCK)))].map((block) => this.#block(block, signal)));
  }

  /** A block of records, checked. Where it is all of them, it has a checksum; else that of each sheet finds what is wrong with its record. */
  async #block(number, signal) {
    if (this.#known.has(number * BLOCK)) return;
    const { offset, length, checksum } = this.#records;
    const start = number * BLOCK * RECORD;
    const bytes = Math.min(BLOCK * RECORD, length - start);
    await readSound(this.#source, offset + start, bytes, "the table of sheets", signal, (all) => {
      const isSound = bytes < length || xxh3(all) === checksum;
      expect(isSound, () => "the table of sheets is damaged: its checksum is another one");
      const view = viewOf(all);
      const records = Array.from({ length: bytes / RECORD }, (_, i) => readRecord(view, RECORD * i, number * BLOCK + i, this.#texels));
      records.forEach((record) => this.#known.set(record.id, record));
    });
  }

  /** A cluster's record; null if it has not been fetched. */
  record(id) {
    return this.#known.get(id) ?? null;
  }

  /**
   * Clusters whose sheets come in one request, and those of the next, by their places in the file.
   * @param {Iterable<number>} ids whose records are there
   */
  runs(ids, longest = LONGEST_RUN, near = NEAR) {
    const runs = [];
    let [start, end] = [0, -Infinity];
    for (const id of [...ids].sort((a, b) => a - b)) {
      const { offset, length } = this.record(id);
      const goesOn = offset - end <= near && offset + length - start <= longest;
      if (!goesOn) [start] = [offset, runs.push([])];
      runs.at(-1).push(id);
      end = offset + length;
    }
    return runs;
  }

  /**
   * Fetches the sheets of clusters, neighbours in one request, and hands each to `take` as it comes.
   * @param {object[]} clusters records of clusters, of whose sheets the records are there, too
   */
  async each(clusters, take, signal) {
    const byId = new Map(clusters.map((cluster) => [cluster.id, cluster]));
    for (const run of this.runs(byId.keys())) {
      const records = run.map((id) => this.record(id));
      const start = records[0].offset;
      const last = records.at(-1);
      const bytes = await readExactly(this.#source, this.#texels.offset + start, last.offset + last.length - start, "a sheet", signal);
      for (const record of records) {
        const at = record.offset - start;
        await take(await this.#sound(record, byId.get(record.id), bytes.subarray(at, at + record.length), signal));
      }
    }
  }

  /** A sheet of bytes that came; those that are not what they should be are fetched once more. */
  async #sound(record, cluster, bytes, signal) {
    try {
      return this.#sheet(record, cluster, bytes);
    } catch (error) {
      if (!(error instanceof ChpmError)) throw error;
      const again = await readExactly(this.#source, this.#texels.offset + record.offset, record.length, "a sheet", signal, true);
      return this.#sheet(record, cluster, again);
    }
  }

  #sheet(record, cluster, bytes) {
    const what = `the sheet of cluster ${record.id}`;
    expect(xxh3(bytes) === record.checksum, () => `${what} is damaged: its checksum is another one`);
    const image = bytes.slice(record.layoutLength);
    const size = sizeOf(image, record.type);
    expect(size?.every((side, way) => side === record.size[way]), () => `${what} has an image of ${size?.join(" x ") ?? "another kind"}, not of ${record.size.join(" x ")}`);
    return new Sheet({ ...readLayout(record, cluster, bytes.subarray(0, record.layoutLength), this.#zstd, what), cluster, size, texel: record.texel, type: record.type, image });
  }
}

function readRecord(view, at, id, texels) {
  const what = `the sheet of cluster ${id}`;
  const [offset, layoutLength, imageLength] = [Number(view.getBigUint64(at + 8, true)), view.getUint32(at + 16, true), view.getUint32(at + 20, true)];
  const size = [view.getUint16(at + 24, true), view.getUint16(at + 26, true)];
  const [chartCount, codec, texel] = [view.getUint32(at + 4, true), view.getUint32(at + 28, true), view.getFloat32(at + 32, true)];
  expect(view.getUint32(at, true) === id, () => `${what} has a record of another cluster`);
  const length = layoutLength + imageLength;
  expect(offset % 8 === 0 && offset + length <= texels.length, () => `${what} is not where sheets are`);
  expect(size.every((side) => side >= 16 && side <= MAX_SIDE && side % 16 === 0), () => `${what} has ${size.join(" x ")} texels`);
  expect(chartCount >= 1 && chartCount <= 65535, () => `${what} has ${chartCount} charts`);
  expect(TYPES[codec], () => `${what} has an image of kind ${codec}`);
  expect(texel > 0 && texel < Infinity, () => `${what} has texels of ${texel} units`);
  return { id, offset, length, layoutLength, chartCount, size, texel, type: TYPES[codec], checksum: view.getBigUint64(at + 40, true) };
}

/** The charts of a layout: for each eight numbers, two axes and an offset; and the chart of each triangle. */
function readLayout({ chartCount, size }, { triangleCount }, packed, zstd, what) {
  const length = HEAD + CHART * chartCount + 2 * triangleCount;
  let bytes;
  try {
    bytes = zstd(packed, length);
  } catch (error) {
    expect(false, () => `${what} has a layout that cannot be expanded: ${error?.message ?? error}`);
  }
  expect(bytes.byteLength === length, () => `${what} has a layout of ${bytes.byteLength} bytes, not ${length}`);
  const view = viewOf(bytes);
  const origin = [0, 4, 8].map((at) => view.getFloat32(at, true));
  const axes = new Float32Array(8 * chartCount);
  for (let chart = 0; chart < chartCount; chart++) {
    const at = HEAD + CHART * chart;
    for (let i = 0; i < 8; i++) axes[8 * chart + i] = view.getFloat32(at + 4 * i, true);
    const [x, y, width, height] = [32, 34, 36, 38].map((more) => view.getUint16(at + more, true));
    const isInside = width > 0 && height > 0 && x + width <= size[0] && y + height <= size[1];
    expect(isInside, () => `${what} has chart ${chart} outside its image`);
  }
  expect(origin.every(Number.isFinite) && axes.every(Number.isFinite), () => `${what} has a number that is not finite`);
  const chartOf = Uint16Array.from({ length: triangleCount }, (_, t) => view.getUint16(HEAD + CHART * chartCount + 2 * t, true));
  expect(chartOf.every((chart) => chart < chartCount), () => `${what} has a triangle in a chart that is not there`);
  return { origin, axes, chartOf };
}

/** Width and height that an image says it has: whoever decodes it makes room for that. Null where it is of another kind. */
function sizeOf(bytes, type) {
  const view = viewOf(bytes);
  const length = bytes.byteLength;
  if (type === "image/png") {
    const isPng = length >= 24 && view.getUint32(0) === 0x89504e47 && view.getUint32(12) === 0x49484452;
    return isPng ? [view.getUint32(16), view.getUint32(20)] : null;
  }
  if (length < 2 || view.getUint16(0) !== 0xffd8) return null;
  // From marker to marker until the frame's.
  for (let at = 2; at + 9 <= length && bytes[at] === 0xff; at += 2 + view.getUint16(at + 2)) {
    if (bytes[at + 1] === 0xc0) return [view.getUint16(at + 7), view.getUint16(at + 5)];
  }
  return null;
}
