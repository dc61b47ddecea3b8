// A .chpm file that is somewhere else: tables come chunk by chunk and pages run by run, each checked before it is used.

import { partsAbove, placeAbove } from "./chained.js";
import { decode } from "./decoder.js";
import { CHUNKS, CLUSTERS, GROUPS, MEMBERS, NONE, PAGES, SCALARS, TEXELS, TEXTURES, VOLUMES, expect, readCluster, readGroup, readHeader, readScalars, readSections, viewOf } from "./records.js";
import { Sheets } from "./sheets.js";
import { ChpmError, readExactly, readSound } from "./source.js";
import { readVolumes, volumesSource } from "./volumes.js";
import { xxh3 } from "./xxh3.js";
import { expand } from "./zstd.js";

/** What is fetched first: with the chunks that writers make, all that leads to the roots. */
const FIRST = 32768;
/** Pages that are next to each other come in one request, up to this. */
const LONGEST_RUN = 4 << 20;
/** So many bytes between two pages cost less than another request. */
const NEAR = 65536;
/** Bytes of pages that are kept for those that rest on them. */
const MOST_KEPT = 32 << 20;

/** One table of records, of which chunks are there. */
class Table {
  constructor(source, section, chunkLength, sums) {
    Object.assign(this, { source, section, chunkLength, sums });
    this.chunks = new Array(sums.length).fill(null);
    this.coming = new Map();
  }

  /** The chunks of records `first` to `first + count` that are not there. */
  missing(first, count) {
    const { recordLength } = this.section;
    if (count === 0) return [];
    const last = Math.floor(((first + count) * recordLength - 1) / this.chunkLength);
    const missing = [];
    for (let k = Math.floor((first * recordLength) / this.chunkLength); k <= last; k++) {
      if (!this.chunks[k]) missing.push(k);
    }
    return missing;
  }

  take(k, bytes) {
    expect(xxh3(bytes) === this.sums[k], () => `section kind ${this.section.kind} is damaged at chunk ${k}: its checksum is another one`);
    this.chunks[k] = viewOf(bytes);
  }

  lengthOf(k) {
    return Math.min(this.chunkLength, this.section.length - k * this.chunkLength);
  }

  /** Fetches chunks, neighbours in one request. */
  async fetch(wanted, signal) {
    const absent = [...new Set(wanted)].filter((k) => !this.chunks[k] && !this.coming.has(k)).sort((a, b) => a - b);
    while (absent.length > 0) {
      let count = 1;
      while (absent[count] === absent[0] + count) count++;
      const run = absent.splice(0, count);
      const end = run[count - 1] * this.chunkLength + this.lengthOf(run[count - 1]);
      const start = run[0] * this.chunkLength;
      const what = `section kind ${this.section.kind}`;
      const all = readSound(this.source, this.section.offset + start, end - start, what, signal, (bytes) => {
        for (const k of run) {
          const at = k * this.chunkLength - start;
          this.take(k, bytes.slice(at, at + this.lengthOf(k)));
        }
      });
      const done = all.finally(() => run.forEach((k) => this.coming.delete(k)));
      // Whoever waits for a chunk gets the error; nobody may be waiting.
      done.catch(() => {});
      run.forEach((k) => this.coming.set(k, done));
    }
    await Promise.all(wanted.map((k) => this.coming.get(k)));
  }

  /** A record as a view, or null if its chunk is not there. */
  record(index) {
    const { recordLength } = this.section;
    const at = index * recordLength;
    const chunk = this.chunks[Math.floor(at / this.chunkLength)];
    return chunk && new DataView(chunk.buffer, chunk.byteOffset + (at % this.chunkLength), recordLength);
  }
}

/** An open file. Make one with {@link open}. */
export class ChpmFile {
  #source;
  #tables;
  #pages;
  #clusters = new Map();
  #groups = new Map();
  #texels = new Map();
  #zstd;
  #decoder;
  /** Pages that others rest on. */
  #parents = new Map();

  /** @private */
  constructor(source, header, sections, tables, zstd, decoder) {
    this.#zstd = zstd;
    this.#decoder = decoder;
    this.#source = source;
    this.#tables = tables;
    this.#pages = sections.get(PAGES);
    this.header = header;
    /** The sheets, where clusters have some; else null. */
    this.sheets = header.hasSheets ? new Sheets(source, sections.get(TEXTURES), sections.get(TEXELS), zstd) : null;
  }

  get source() {
    return this.#source;
  }

  /** Fetches what is missing of these clusters' records. */
  async needClusters(ids, signal) {
    const table = this.#tables.clusters;
    await table.fetch([...ids].flatMap((id) => table.missing(id, 1)), signal);
  }

  /** Fetches what is missing of these groups' records. */
  async needGroups(ids, signal) {
    const table = this.#tables.groups;
    await table.fetch([...ids].flatMap((id) => table.missing(id, 1)), signal);
  }

  /** Fetches the lists of these groups' coarse and fine clusters. */
  async needMembers(groups, signal) {
    const table = this.#tables.members;
    const chunks = ({ coarseFirst, coarseCount, fineFirst, fineCount }) => [
      ...table.missing(coarseFirst, coarseCount),
      ...table.missing(fineFirst, fineCount),
    ];
    await table.fetch([...groups].flatMap(chunks), signal);
  }

  /** Bytes of all tables. */
  get tablesLength() {
    return Object.values(this.#tables).reduce((sum, { section }) => sum + (section?.length ?? 0), 0);
  }

  /** Fetches what is missing of all tables. */
  async needTables(signal) {
    const { clusters, groups, members } = this.#tables;
    await takeAll(this.#source, [clusters, groups, members], signal);
  }

  /** A cluster's record, checked; null if it has not been fetched. */
  cluster(id) {
    return this.#known(this.#clusters, this.#tables.clusters, id, (view) => readCluster(this.header, this.#pages, view, id));
  }

  /** A group's record, checked; null if it has not been fetched. */
  group(id) {
    const members = this.#tables.members.section;
    return this.#known(this.#groups, this.#tables.groups, id, (view) => readGroup(this.header, members, view, id));
  }

  #known(known, table, id, read) {
    let record = known.get(id);
    if (!record) {
      const view = table.record(id);
      if (!view) return null;
      record = read(view);
      known.set(id, record);
    }
    return record;
  }

  /** Whether the lists of a group's clusters have been fetched. */
  hasMembers({ coarseFirst, coarseCount, fineFirst, fineCount }) {
    const table = this.#tables.members;
    return table.missing(coarseFirst, coarseCount).length + table.missing(fineFirst, fineCount).length === 0;
  }

  /** The ids of a group's coarse clusters. */
  coarse(group) {
    return this.#members(group, group.coarseFirst, group.coarseCount);
  }

  /** The ids of a group's fine clusters. */
  fine(group) {
    return this.#members(group, group.fineFirst, group.fineCount);
  }

  #members(group, first, count) {
    const ids = Array.from({ length: count }, (_, i) => this.#tables.members.record(first + i).getUint32(0, true));
    const increase = ids.every((id, i) => id < this.header.clusterCount && (i === 0 || id > ids[i - 1]));
    expect(increase, () => `group ${group.id}: its clusters are ${ids.join(", ")}`);
    return ids;
  }

  /** The largest texels of the sheets of a group's coarse clusters, in units of the model; 0 where they are not known. */
  texel(group) {
    const known = this.#texels.get(group.id);
    if (known !== undefined || !this.sheets || !this.hasMembers(group)) return known ?? 0;
    const records = this.coarse(group).map((id) => this.sheets.record(id));
    if (records.includes(null)) return 0;
    const texel = Math.max(...records.map((record) => record.texel));
    this.#texels.set(group.id, texel);
    return texel;
  }

  /**
   * Clusters whose pages come in one request, and those of the next, by their places in the file.
   * @param {Iterable<number>} ids whose records are there
   */
  runs(ids, longest = LONGEST_RUN, near = NEAR) {
    const clusters = [...ids].map((id) => this.cluster(id)).sort((a, b) => a.pageOffset - b.pageOffset);
    const runs = [];
    let [start, end] = [0, -Infinity];
    for (const { id, pageOffset, pageLength } of clusters) {
      const goesOn = pageOffset - end <= near && pageOffset + pageLength - start <= longest;
      if (!goesOn) [start] = [pageOffset, runs.push([])];
      runs.at(-1).push(id);
      end = pageOffset + pageLength;
    }
    return runs;
  }

  /**
   * Fetches the pages of clusters, neighbours in one request, and hands each to `take` as it comes.
   * @param {Iterable<number>} ids whose records are there
   */
  async eachPage(ids, take, signal) {
    for (const run of this.#turns([...ids])) {
      const clusters = run.map((id) => this.cluster(id));
      const start = clusters[0].pageOffset;
      const end = clusters.at(-1).pageOffset + clusters.at(-1).pageLength;
      const bytes = await readExactly(this.#source, start, end - start, "a page", signal);
      const own = (cluster) => bytes.subarray(cluster.pageOffset - start, cluster.pageOffset - start + cluster.pageLength);
      const above = await this.#allAbove(clusters, clusters.map(own), signal);
      const here = (cluster, i) => () => decode(this.header, cluster, own(cluster), this.#zstd, above[i] && partsAbove(above[i]));
      const pages = this.#decoder?.isReady ? this.#decoder.pages(this.header, clusters, start, bytes, above) : null;
      for (const [i, cluster] of clusters.entries()) {
        const page = await this.#soundPage(cluster, pages ? () => pages[i] : here(cluster, i), signal);
        // A worker takes its time.
        signal?.throwIfAborted();
        if (this.header.isChained && cluster.level > 0) this.#keep(page);
        take(page);
      }
    }
  }

  /** The pages of clusters, by id. */
  async pages(ids, signal) {
    const pages = new Map();
    await this.eachPage(ids, (page) => pages.set(page.cluster.id, page), signal);
    return pages;
  }

  /** A page of bytes that came; as {@link readSound} does, where they are not what they should be. */
  async #soundPage(cluster, look, signal) {
    try {
      return await look();
    } catch (error) {
      if (!(error instanceof ChpmError)) throw error;
      const bytes = await readExactly(this.#source, cluster.pageOffset, cluster.pageLength, "a page", signal, true);
      const above = await this.#above(cluster, bytes, signal);
      return decode(this.header, cluster, bytes, this.#zstd, above && partsAbove(above));
    }
  }

  /** Runs of pages, of which chained ones come behind those above them. */
  #turns(ids) {
    if (!this.header.isChained) return this.runs(ids);
    const level = (id) => this.cluster(id).level;
    const levels = [...new Set(ids.map(level))].sort((a, b) => b - a);
    return levels.flatMap((one) => this.runs(ids.filter((id) => level(id) === one)));
  }

  /** For each cluster of a run the page that it rests on, or null; what is not here comes at once. */
  async #allAbove(clusters, bytes, signal) {
    // What is damaged is told by the page, once it was read again.
    const orNone = (none) => (error) => {
      if (!(error instanceof ChpmError)) throw error;
      return none;
    };
    const parents = [];
    for (const [i, cluster] of clusters.entries()) parents.push(await this.#parent(cluster, bytes[i], signal).catch(orNone(null)));
    const missing = new Set(parents.filter((id) => id !== null && !this.#parents.has(id)));
    const fetched = await this.pages(missing, signal).catch(orNone(new Map()));
    const above = [];
    for (const [i, id] of parents.entries()) {
      const page = this.#parents.get(id) ?? fetched.get(id);
      if (page) this.#keep(page);
      above.push(page ?? (id === null ? null : await this.#above(clusters[i], bytes[i], signal).catch(orNone(null))));
    }
    return above;
  }

  /** The cluster whose page a chained one rests on, its record fetched; null for any other. */
  async #parent(cluster, bytes, signal) {
    const place = this.header.isChained && cluster.isPacked ? placeAbove(bytes) : null;
    // What is damaged is found later, and read once more.
    if (place === null || cluster.parentGroup === NONE) return null;
    await this.needGroups([cluster.parentGroup], signal);
    const group = this.group(cluster.parentGroup);
    await this.needMembers([group], signal);
    const id = this.coarse(group)[place];
    if (id === undefined) return null;
    await this.needClusters([id], signal);
    const { level } = this.cluster(id);
    expect(level > cluster.level, () => `the page of cluster ${cluster.id} rests on one of its own level or below`);
    return id;
  }

  /** The page that a chained one rests on, fetched if it is not here; null for any other. */
  async #above(cluster, bytes, signal) {
    const id = await this.#parent(cluster, bytes, signal);
    return id === null ? null : (this.#parents.get(id) ?? (await this.pages([id], signal)).get(id));
  }

  /** Keeps a page for those below; those that were used last stay. */
  #keep(page) {
    const { id } = page.cluster;
    this.#parents.delete(id);
    this.#parents.set(id, page);
    let bytes = 0;
    for (const [other, { positions, triangles }] of [...this.#parents].reverse()) {
      bytes += 2 * (positions.byteLength + triangles.byteLength);
      if (bytes > MOST_KEPT && other !== id) this.#parents.delete(other);
    }
  }

  /** Ids of the clusters that nothing coarser stands for. */
  async roots(signal) {
    const { rootCount, clusterCount } = this.header;
    const roots = [];
    if (this.#tables.isOrdered) {
      for (let id = 0; id < rootCount; id++) roots.push(id);
      await this.needClusters(roots, signal);
    } else {
      for (let id = 0; id < clusterCount; id++) {
        if (this.cluster(id).parentGroup === 0xffffffff) roots.push(id);
      }
    }
    const are = roots.length === rootCount && roots.every((id) => this.cluster(id).parentGroup === 0xffffffff);
    expect(are, () => `the header says that ${rootCount} clusters are roots, and they are not`);
    return roots;
  }
}

/**
 * Opens a file: its header, and what leads to its tables.
 * @param source {@link httpSource}, {@link blobSource}, {@link memorySource} or anything alike
 * @param options.zstd expands a frame of zstd to at most so many bytes, where something is at hand that is faster than the reader's own
 * @param options.decoder has pages expanded and checked by a worker
 */
export async function open(source, { signal, first = FIRST, zstd = expand, decoder = null } = {}) {
  try {
    return await begin(source, signal, Math.max(first, 4096), zstd, decoder);
  } catch (error) {
    if (error instanceof ChpmError && !error.message.startsWith(source.name)) {
      throw new ChpmError(`${source.name}: ${error.message}`, { cause: error, isLost: error.isLost });
    }
    throw error;
  }
}

async function begin(main, signal, first, zstd, decoder) {
  const bytes = await main.read(0, first, signal);
  const header = readHeader(bytes, xxh3);
  const size = await main.size();
  const sections = readSections(header, bytes, xxh3);
  const length = header.hasVolumes ? sections.get(header.hasSheets ? TEXELS : PAGES).offset : header.fileLength;
  const complete = size === undefined || size === length;
  expect(complete, () => `the file has ${size} bytes, and should have ${length}: it is cut short or has something behind it`);
  const source = header.hasVolumes ? await withVolumes(main, header, sections.get(VOLUMES), length, bytes, signal) : main;

  header.scalars = await scalarsOf(source, header, sections.get(SCALARS), bytes, signal);
  const chunks = sections.get(CHUNKS);
  const tables = { isOrdered: Boolean(chunks) };
  const kinds = [["clusters", CLUSTERS], ["groups", GROUPS], ["members", MEMBERS]];
  if (chunks) {
    const { chunkLength, sums } = await readChunks(source, chunks, kinds.map(([, kind]) => sections.get(kind)), bytes, signal);
    for (const [name, kind] of kinds) {
      const section = sections.get(kind);
      tables[name] = new Table(source, section, chunkLength, sums.splice(0, Math.ceil(section.length / chunkLength)));
    }
  } else {
    for (const [name, kind] of kinds) {
      const section = sections.get(kind);
      tables[name] = new Table(source, section, Math.max(section.length, 1), section.length > 0 ? [section.checksum] : []);
    }
  }
  for (const [name] of kinds) takeWhatCame(tables[name], 0, bytes);
  if (!chunks) await takeAll(source, kinds.map(([name]) => tables[name]), signal);
  return new ChpmFile(source, header, sections, tables, zstd, decoder);
}

/** Chunks that are among some bytes of the file. */
function takeWhatCame(table, offset, bytes) {
  for (let k = 0; k < table.chunks.length; k++) {
    const start = table.section.offset + k * table.chunkLength - offset;
    const end = start + table.lengthOf(k);
    if (!table.chunks[k] && start >= 0 && end <= bytes.byteLength) table.take(k, bytes.slice(start, end));
  }
}

/** What is missing of tables, in one request if they lie side by side. */
async function takeAll(source, tables, signal) {
  const absent = tables.filter((table) => table.chunks.includes(null));
  if (absent.length === 0) return;
  const start = Math.min(...absent.map(({ section }) => section.offset));
  const end = Math.max(...absent.map(({ section }) => section.offset + section.length));
  const bytes = absent.reduce((sum, { section }) => sum + section.length, 0);
  if (end - start > bytes + NEAR) {
    await Promise.all(absent.map((table) => table.fetch(table.missing(0, table.section.count), signal)));
    return;
  }
  await readSound(source, start, end - start, "the tables", signal, (all) => absent.forEach((table) => takeWhatCame(table, start, all)));
}

/** The file with its volumes, as one. */
async function withVolumes(main, header, section, end, bytes, signal) {
  const list = await listOf(main, section, "the list of volumes", bytes, signal);
  return volumesSource(main, readVolumes(list, end, header.fileLength));
}

/** The named scalars of the vertices. */
async function scalarsOf(source, header, section, bytes, signal) {
  return section ? readScalars(header, section, await listOf(source, section, "the list of scalars", bytes, signal)) : [];
}

/** All of a small section, which may be among the first bytes. */
async function listOf(source, { offset, length, checksum }, what, bytes, signal) {
  expect(length <= 1 << 20, () => `${what} has ${length} bytes`);
  const there = offset + length <= bytes.byteLength;
  const list = there ? bytes.slice(offset, offset + length) : await readExactly(source, offset, length, what, signal);
  expect(xxh3(list) === checksum, () => `${what} is damaged: its checksum is another one`);
  return list;
}

async function readChunks(source, section, of, bytes, signal) {
  const { offset, length, count } = section;
  expect(count >= 1 && length === 8 * count && length <= 64 << 20, () => `a list of chunks of ${length} bytes`);
  const there = offset + length <= bytes.byteLength;
  const list = there ? bytes.slice(offset, offset + length) : await readExactly(source, offset, length, "the list of chunks", signal);
  expect(xxh3(list) === section.checksum, () => "the list of chunks is damaged: its checksum is another one");
  const numbers = new BigUint64Array(list.buffer, list.byteOffset, count);
  const chunkLength = Number(numbers[0]);
  const isPower = Number.isInteger(Math.log2(chunkLength)) && chunkLength >= 4096 && chunkLength <= 1 << 20;
  expect(isPower, () => `chunks of ${numbers[0]} bytes`);
  const expected = of.reduce((sum, { length }) => sum + Math.ceil(length / chunkLength), 1);
  expect(count === expected, () => `${count - 1} chunks where the tables have ${expected - 1}`);
  return { chunkLength, sums: Array.from(numbers.subarray(1)) };
}
