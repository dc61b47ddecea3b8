// A file in pieces: files of one length each, for hosts that send whole files only.

import { ChpmError, httpSource } from "./source.js";

/** Pieces that are kept in memory, those that were used last. */
const KEPT = 32;

/**
 * A file that `chpm share --split` cut into pieces.
 * @param {string | URL} folder where the pieces are
 * @param {{ length: number, size: number }} pieces bytes of a piece, and of all
 * @param options as those of {@link httpSource}
 */
export function piecesSource(folder, { length: piece, size }, options = {}) {
  const name = String(folder);
  const statistics = { requests: 0, bytes: 0 };
  const kept = new Map();

  /** One piece, in full. Whoever asks for one that is under way gets the same. */
  function get(number, isFresh) {
    const known = isFresh ? undefined : kept.get(number);
    kept.delete(number);
    const coming = known ?? fetchPiece(number, isFresh);
    kept.set(number, coming);
    coming.catch(() => kept.get(number) === coming && kept.delete(number));
    if (kept.size > KEPT) kept.delete(kept.keys().next().value);
    return coming;
  }

  async function fetchPiece(number, isFresh) {
    const url = `${name.replace(/\/$/, "")}/${String(number).padStart(5, "0")}.bin`;
    const source = httpSource(url, { ...options, isWhole: true });
    const bytes = await source.read(0, Math.min(piece, size - number * piece), undefined, isFresh);
    statistics.requests += source.statistics.requests;
    statistics.bytes += source.statistics.bytes;
    const expected = Math.min(piece, size - number * piece);
    if (bytes.byteLength !== expected) throw new ChpmError(`${url} has ${bytes.byteLength} bytes, and should have ${expected}`);
    return bytes;
  }

  return {
    name,
    statistics,
    size: async () => size,
    async read(offset, length, signal, isFresh = false) {
      const end = Math.min(offset + length, size);
      const bytes = new Uint8Array(Math.max(end - offset, 0));
      const numbers = [];
      for (let number = Math.floor(offset / piece); number * piece < end; number++) numbers.push(number);
      const parts = await Promise.all(numbers.map((number) => get(number, isFresh)));
      signal?.throwIfAborted();
      numbers.forEach((number, i) => {
        const from = Math.max(offset - number * piece, 0);
        bytes.set(parts[i].subarray(from, Math.min(end - number * piece, piece)), number * piece + from - offset);
      });
      return bytes;
    },
  };
}
