// A source of which some ranges are asked for at once, before anybody knows that they will be needed.

/**
 * @param source another source
 * @param {[number, number][]} ranges offsets and lengths; whatever lies in one of them is answered from it
 */
export function prefetched(source, ranges) {
  const coming = ranges.map(([offset, length]) => {
    const bytes = source.read(offset, length);
    // Whoever needs it will ask again.
    bytes.catch(() => {});
    return { offset, length, bytes };
  });
  return {
    ...source,
    async read(offset, length, signal, isFresh = false) {
      const found = coming.find((range) => range.offset <= offset && offset + length <= range.offset + range.length);
      const bytes = found && !isFresh ? await found.bytes.catch(() => null) : null;
      signal?.throwIfAborted();
      if (!bytes) return source.read(offset, length, signal, isFresh);
      return bytes.slice(offset - found.offset, offset - found.offset + length);
    },
  };
}
