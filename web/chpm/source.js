// Where bytes come from: a host that answers ranges, a file that somebody picked, memory.

/** What is wrong with a file or with the way to it, in words for people. */
export class ChpmError extends Error {
  constructor(message, options) {
    super(message, options);
    this.name = "ChpmError";
  }
}

/** Bytes that are in memory: an ArrayBuffer, or a view of one. */
export function memorySource(bytes) {
  const all = bytes instanceof ArrayBuffer ? new Uint8Array(bytes) : new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  return {
    name: "memory",
    size: async () => all.byteLength,
    read: async (offset, length) => all.slice(offset, offset + length),
  };
}

/** A Blob or File, as a page gets it from a file input or by dropping. */
export function blobSource(blob) {
  return {
    name: blob.name ?? "blob",
    size: async () => blob.size,
    read: async (offset, length) => new Uint8Array(await blob.slice(offset, offset + length).arrayBuffer()),
  };
}

/**
 * A file on a host that answers range requests, as most hosts of static files do.
 * @param {string | URL} url
 * @param {{ fetch?: typeof fetch, headers?: Record<string, string> }} [options]
 */
export function httpSource(url, { fetch: get = (...request) => fetch(...request), headers = {} } = {}) {
  const name = String(url);
  let size;
  let version;
  const statistics = { requests: 0, bytes: 0 };

  async function read(offset, length, signal) {
    const range = `bytes=${offset}-${offset + length - 1}`;
    let response;
    try {
      // A cache would have to hold every range on its own, and some answer a range of an old file.
      response = await get(url, { headers: { ...headers, Range: range }, cache: "no-store", signal });
    } catch (cause) {
      if (signal?.aborted) throw cause;
      throw new ChpmError(`${name} cannot be reached: ${cause.message}`, { cause });
    }
    statistics.requests += 1;
    if (response.status === 200) {
      await response.body?.cancel();
      throw new ChpmError(`the host of ${name} sends whole files only; it has to answer range requests`);
    }
    if (response.status !== 206) {
      await response.body?.cancel();
      const gone = response.status === 404 || response.status === 410;
      throw new ChpmError(gone ? `${name} is not there` : `${name}: the host answers ${response.status} ${response.statusText}`);
    }

    // All ranges have to be of one file.
    const total = Number(/\/(\d+)\s*$/.exec(response.headers.get("Content-Range") ?? "")?.[1] ?? NaN);
    const tag = response.headers.get("ETag") ?? response.headers.get("Last-Modified");
    if (version !== undefined && (tag !== version || (total && total !== size))) {
      await response.body?.cancel();
      throw new ChpmError(`${name} has changed since it was opened; open it again`);
    }
    version = tag;
    size = total || size;
    let bytes;
    try {
      bytes = new Uint8Array(await response.arrayBuffer());
    } catch (cause) {
      if (signal?.aborted) throw cause;
      throw new ChpmError(`${name}: the connection ended early`, { cause });
    }
    statistics.bytes += bytes.byteLength;
    return bytes;
  }

  return {
    name,
    statistics,
    /** Bytes of the whole file: known once something was read from a host that tells it. */
    size: async () => size,
    read,
  };
}

/** Reads a range that has to be there in full. */
export async function readExactly(source, offset, length, what, signal) {
  const bytes = await source.read(offset, length, signal);
  if (bytes.byteLength !== length) {
    throw new ChpmError(
      `${source.name} ends early: ${what} takes ${length} bytes from byte ${offset} on, and ${bytes.byteLength} are there`,
    );
  }
  return bytes;
}
