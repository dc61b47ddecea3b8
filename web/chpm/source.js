// Where bytes come from: a host that answers ranges, a file that somebody picked, memory.

/** What is wrong with a file or with the way to it, in words for people. */
export class ChpmError extends Error {
  /** @param options.isLost whether it is the way that failed: the same may succeed later */
  constructor(message, { isLost = false, ...options } = {}) {
    super(message, options);
    this.name = "ChpmError";
    this.isLost = isLost;
  }
}

/** The address or name of a volume, by its number from 1: scan.0001.pages for scan.chpm. */
export function volumeOf(model, number) {
  const [, name, rest] = /^([^?#]*)(.*)$/s.exec(String(model));
  return `${name.replace(/\.chpm$/, "")}.${String(number).padStart(4, "0")}.pages${rest}`;
}

/** Bytes that are in memory: an ArrayBuffer, or a view of one; and those of its volumes, if it has any. */
export function memorySource(bytes, volumes = []) {
  const all = bytes instanceof ArrayBuffer ? new Uint8Array(bytes) : new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  return {
    name: "memory",
    volume: volumes.length > 0 ? (number) => ({ ...memorySource(volumes[number - 1] ?? new Uint8Array()), name: `volume ${number}` }) : undefined,
    size: async () => all.byteLength,
    read: async (offset, length) => all.slice(offset, offset + length),
  };
}

/** A Blob or File, as a page gets it from a file input or by dropping; and files that came with it, where its volumes may be among them. */
export function blobSource(blob, files = []) {
  const volume = (number) => {
    const name = volumeOf(blob.name, number);
    const found = [...files].find((file) => file.name === name);
    if (!found) throw new ChpmError(`${name} is not here, and has pages of ${blob.name}: give all of its files together`);
    return blobSource(found);
  };
  return {
    name: blob.name ?? "blob",
    volume: files.length > 1 ? volume : undefined,
    size: async () => blob.size,
    read: async (offset, length) => new Uint8Array(await blob.slice(offset, offset + length).arrayBuffer()),
  };
}

/** Waits before a request is made again, ms. Who reads decides what comes after the last one. */
const WAITS = [200, 800];
/** So long without a byte, and a request is taken for lost, ms. */
const PATIENCE = 20000;
/** What a host answers that cannot answer now. */
const BUSY = [408, 425, 429, 500, 502, 503, 504];

/**
 * A file on a host that answers range requests, as most hosts of static files do.
 *
 * The first request asks the host which version of the file it has. What the browser's cache has of that version is not fetched again.
 * @param {string | URL} url
 * @param {{ fetch?: typeof fetch, headers?: Record<string, string>, waits?: number[], patience?: number, isWhole?: boolean }} [options] with `isWhole` it is always
 *   read in full, and no range is asked for
 */
export function httpSource(url, options = {}) {
  const { fetch: get = (...request) => fetch(...request), headers = {}, waits = WAITS, patience = PATIENCE, isWhole = false } = options;
  const name = String(url);
  let size;
  let version;
  const statistics = { requests: 0, bytes: 0 };

  /** One request. */
  async function ask(offset, length, cache, signal) {
    const range = `bytes=${offset}-${offset + length - 1}`;
    const own = new AbortController();
    const stop = () => own.abort(signal.reason);
    signal?.aborted ? stop() : signal?.addEventListener("abort", stop);
    let timer;
    const heard = () => {
      clearTimeout(timer);
      timer = setTimeout(() => own.abort(), patience);
    };
    const refuse = async (response, message, options) => {
      await response.body?.cancel();
      throw new ChpmError(message, options);
    };
    try {
      heard();
      const response = await get(url, { headers: isWhole ? headers : { ...headers, Range: range }, cache, signal: own.signal });
      statistics.requests += 1;
      const { status } = response;
      const tag = response.headers.get("ETag") ?? response.headers.get("Last-Modified");
      const changed = `${name} has changed since it was opened; open it again`;
      // Whoever answered a range before sends all of it where the range is of another version.
      if (status === 200 && version !== undefined && tag !== version) await refuse(response, changed);
      if (status === 200 && !isWhole) await refuse(response, `the host of ${name} sends whole files only; it has to answer range requests, or the file has to be in pieces (chpm share --split)`);
      if (status === 404 || status === 410) await refuse(response, `${name} is not there`);
      if (status !== (isWhole ? 200 : 206)) {
        await refuse(response, `${name}: the host answers ${status} ${response.statusText}`, { isLost: BUSY.includes(status) });
      }

      // All ranges have to be of one file.
      const told = /^bytes (\d+)-\d+\/(\d+|\*)$/.exec(response.headers.get("Content-Range")?.trim() ?? "");
      const total = Number(told?.[2]) || undefined;
      if (version !== undefined && (tag !== version || (total && total !== size))) await refuse(response, changed);
      if (told && Number(told[1]) !== offset) await refuse(response, `${name}: the host answers another range than it was asked for`);
      const bytes = await allOf(response, heard);
      version = tag;
      size = total ?? size;
      statistics.bytes += bytes.byteLength;
      return bytes;
    } catch (cause) {
      if (signal?.aborted) throw signal.reason;
      if (cause instanceof ChpmError) throw cause;
      const told = own.signal.aborted ? `nothing came for ${patience / 1000} s` : cause.message;
      throw new ChpmError(`${name} cannot be reached: ${told}`, { cause, isLost: true });
    } finally {
      clearTimeout(timer);
      signal?.removeEventListener("abort", stop);
    }
  }

  /** @param isFresh whether caches are to be left out: what they have is not what was written */
  async function read(offset, length, signal, isFresh = false) {
    // The first request has the cache compare its version with the host's; what it has is good then.
    let cache = isFresh ? "reload" : version === undefined ? "no-cache" : "force-cache";
    for (let attempt = 0; ; attempt++) {
      try {
        return await ask(offset, length, cache, signal);
      } catch (error) {
        if (!(error instanceof ChpmError)) throw error;
        // A cache may keep ranges of an old version.
        const isStale = !error.isLost && cache === "force-cache";
        if (!isStale && (!error.isLost || attempt >= waits.length)) throw error;
        if (isStale) cache = "reload";
        else await pause(waits[attempt], signal);
      }
    }
  }

  return {
    name,
    statistics,
    /** Bytes of the whole file: known once something was read from a host that tells it. */
    size: async () => size,
    /** The file of a volume, which is beside it. */
    volume: (number) => httpSource(volumeOf(name, number), options),
    read,
  };
}

/** The body of an answer; `heard` is told of each piece. */
async function allOf(response, heard) {
  const pieces = [];
  let length = 0;
  for (const reader = response.body.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    heard();
    pieces.push(value);
    length += value.byteLength;
  }
  const bytes = new Uint8Array(length);
  let at = 0;
  for (const piece of pieces) {
    bytes.set(piece, at);
    at += piece.byteLength;
  }
  return bytes;
}

/** Waits, unless it is called off. */
function pause(time, signal) {
  return new Promise((done, failed) => {
    const stop = () => {
      clearTimeout(timer);
      failed(signal.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", stop);
      done();
    }, time);
    signal?.addEventListener("abort", stop, { once: true });
  });
}

/** Reads a range that has to be there in full. */
export async function readExactly(source, offset, length, what, signal, isFresh) {
  const bytes = await source.read(offset, length, signal, isFresh);
  if (bytes.byteLength !== length) {
    throw new ChpmError(
      `${source.name} ends early: ${what} takes ${length} bytes from byte ${offset} on, and ${bytes.byteLength} are there`,
    );
  }
  return bytes;
}

/**
 * Reads a range that has to be there in full, and has it looked at. What is not as it should be may have been damaged on its way or by a cache, and is read
 * once more before it is told.
 */
export async function readSound(source, offset, length, what, signal, look) {
  const bytes = await readExactly(source, offset, length, what, signal);
  try {
    return look(bytes);
  } catch (error) {
    if (!(error instanceof ChpmError)) throw error;
    return look(await readExactly(source, offset, length, what, signal, true));
  }
}
