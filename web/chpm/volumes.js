// A file whose pages are in files of their own beside it, read as if it were one.

import { expect, u64, viewOf } from "./records.js";
import { ChpmError, readExactly } from "./source.js";

/** Bytes in front of those that a volume holds. */
const HEAD = 4096;
const RECORD = 24;
const MAGIC = [0x89, 0x43, 0x48, 0x50, 0x56, 0x0d, 0x0a, 0x1a];

/** The table of volumes, which hold all from `first` on. */
export function readVolumes(bytes, first, fileLength) {
  const view = viewOf(bytes);
  const volumes = Array.from({ length: bytes.byteLength / RECORD }, (_, i) => ({
    offset: u64(view, RECORD * i),
    length: u64(view, RECORD * i + 8),
    record: bytes.slice(RECORD * i, RECORD * (i + 1)),
  }));
  let end = first;
  for (const [i, { offset, length }] of volumes.entries()) {
    expect(offset === end && length > 0, () => `volume ${i + 1} does not begin where the one before it ends`);
    end += length;
  }
  expect(volumes.length >= 1 && volumes.length <= 9999 && end === fileLength, () => "the volumes do not hold all pages");
  return volumes;
}

/** The first volume that ends behind a place. */
function firstBehind(volumes, place) {
  let [low, high] = [0, volumes.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    const { offset, length } = volumes[middle];
    if (offset + length <= place) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * @param source of the file itself, which has the sources of its volumes by their numbers
 * @param volumes as {@link readVolumes} has them
 */
export function volumesSource(source, volumes) {
  const sources = new Map();
  const of = (i) => {
    if (!source.volume) throw new ChpmError(`${source.name} has its pages in ${volumes.length} volumes, which are not here; give them with it, or join them: chpm relayout --volume-size one`);
    if (!sources.has(i)) sources.set(i, source.volume(i + 1));
    return sources.get(i);
  };

  /** What a volume of another build, or a short one, is told by. */
  async function check(i, signal, withHead) {
    const { length, record } = volumes[i];
    const volume = of(i);
    const size = await volume.size();
    const remedy = "put the files of one build there together";
    if (size !== undefined && size !== HEAD + length) throw new ChpmError(`${volume.name} has ${size} bytes, and should have ${HEAD + length}: ${remedy}`);
    if (!withHead) return;
    const head = await readExactly(volume, 0, 16 + RECORD, "its head", signal, true);
    const [number, count] = [8, 12].map((at) => viewOf(head).getUint32(at, true));
    const isOwn = MAGIC.every((byte, at) => head[at] === byte) && record.every((byte, at) => head[16 + at] === byte);
    if (!isOwn || number !== i + 1 || count !== volumes.length) throw new ChpmError(`${volume.name} is not volume ${i + 1} of ${source.name}: ${remedy}`);
  }

  /** Bytes of one volume, or as many as there are. Who reads again has found something wrong, and is told if it is the whole volume. */
  async function part(i, offset, length, signal, isFresh) {
    const bytes = await of(i).read(HEAD + offset - volumes[i].offset, length, signal, isFresh);
    await check(i, signal, isFresh || bytes.byteLength < length);
    return bytes;
  }

  return {
    ...source,
    /** What all have fetched together. */
    get statistics() {
      const all = [source, ...sources.values()].map(({ statistics }) => statistics ?? { requests: 0, bytes: 0 });
      return { requests: all.reduce((sum, { requests }) => sum + requests, 0), bytes: all.reduce((sum, { bytes }) => sum + bytes, 0) };
    },
    async read(offset, length, signal, isFresh = false) {
      const end = offset + length;
      const parts = [];
      if (offset < volumes[0].offset) parts.push(source.read(offset, Math.min(end, volumes[0].offset) - offset, signal, isFresh));
      for (let i = firstBehind(volumes, offset); i < volumes.length; i++) {
        const from = Math.max(offset, volumes[i].offset);
        const to = Math.min(end, volumes[i].offset + volumes[i].length);
        if (from >= to) break;
        parts.push(part(i, from, to - from, signal, isFresh));
      }
      const read = await Promise.all(parts);
      if (read.length === 1) return read[0];
      const bytes = new Uint8Array(read.reduce((sum, { byteLength }) => sum + byteLength, 0));
      let at = 0;
      for (const piece of read) {
        bytes.set(piece, at);
        at += piece.byteLength;
      }
      return bytes;
    },
  };
}
