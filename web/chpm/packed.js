// From a packed page to the page itself: the section "Packed page" of the file format, with its names.

import { expect, pageLength, viewOf } from "./records.js";

export const HEAD_LEN = 48;
/** Bytes of the page's header that are kept. */
export const KEPT = 36;
const NONE = 0xffff;
const NEIGHBORS = 8;
const ELSEWHERE = 33;
/** Distances below are symbols of their own. */
const EDGES = 16;
const VERTICES = 32;
const [NEW, AFTER, BEFORE, MET] = [0, 1, 2, 3];
export const LATTICE = 8;

/** Open bits, the lowest of a byte first; behind the end there are zeros. */
export class Bits {
  constructor(bytes) {
    this.length = bytes.byteLength;
    this.words = new Int32Array(((this.length + 3) >>> 2) + 2);
    new Uint8Array(this.words.buffer).set(bytes);
    this.last = this.words.length - 2;
    this.at = 0;
  }

  /** The next `length` bits, at most 31. */
  take(length) {
    const { words, at } = this;
    const word = Math.min(at >>> 5, this.last);
    this.at = at + length;
    // In two steps, since no shift is by 32.
    const bits = (words[word] >>> (at & 31)) | ((words[word + 1] << 1) << (31 - (at & 31)));
    return bits & ((1 << length) - 1);
  }

  /** The difference of a symbol, modulo 2^32. */
  difference(symbol) {
    if (symbol === 0) return 0;
    const open = (symbol - 1) & 31;
    const folded = this.take(open) | (1 << open);
    return (folded >>> 1) ^ -(folded & 1);
  }

  /** The differences of symbols, modulo 2^32. */
  differences(symbols) {
    const { words, last } = this;
    const all = new Int32Array(symbols.length);
    let { at } = this;
    for (let i = 0; i < symbols.length; i++) {
      const symbol = symbols[i];
      if (symbol === 0) continue;
      const open = (symbol - 1) & 31;
      const high = 1 << open;
      const word = Math.min(at >>> 5, last);
      const bits = (words[word] >>> (at & 31)) | ((words[word + 1] << 1) << (31 - (at & 31)));
      const folded = (bits & (high - 1)) | high;
      all[i] = (folded >>> 1) ^ -(folded & 1);
      at += open;
    }
    this.at = at;
    return all;
  }

  /** The distance of a symbol. */
  distance(symbol, near) {
    if (symbol < near) return symbol;
    const length = symbol - near;
    return length < 31 ? near + this.take(length) + (1 << length) - 1 : Infinity;
  }

  /** Whether all bits were read, and what is left of the last byte is zero. */
  isDone() {
    const rest = 8 * this.length - this.at;
    return rest >= 0 && rest < 8 && this.take(rest) === 0;
  }
}

/** The bits of the float of a number: those of what is no number stay as they are. */
export function viewOfBits(kind, places, expectIt) {
  if (kind === 0 && places === 0) return (number) => number ^ ((number >> 31) >>> 1);
  const view = viewOfFloats(kind, places, expectIt);
  const float = new Float32Array(1);
  const bits = new Int32Array(float.buffer);
  return (number) => {
    float[0] = view(number);
    return bits[0];
  };
}

/** The float of a number, and none where a decimal view ends. */
export function viewOfFloats(kind, places, expectIt) {
  if (kind === 0 && places === 0) {
    const bits = new Int32Array(1);
    const float = new Float32Array(bits.buffer);
    return (number) => {
      bits[0] = number ^ ((number >> 31) >>> 1);
      return float[0];
    };
  }
  if (kind === LATTICE) {
    const step = 2 ** (places - 149);
    return (number) => number * step;
  }
  expectIt(kind >= 1 && kind <= 7 && places <= 22, "a view of its positions that is not known");
  const all = 10 ** kind;
  const step = (all / 10) * 9;
  return (number) => {
    const size = number < 0 ? ~number : number;
    const decade = size < all ? 0 : Math.floor((size - all) / step) + 1;
    const mantissa = size - decade * step;
    expectIt(decade - places <= 22, "a decimal number out of bounds");
    const float = decade <= places ? mantissa / TENS[places - decade] : mantissa * TENS[decade - places];
    return number < 0 ? -float : float;
  };
}

/** Puts the floats of numbers. A loop of its own for each view. */
export function putFloats(out, numbers, kind, places, expectIt) {
  if (kind === 0 && places === 0) {
    const bits = new Int32Array(out.buffer, out.byteOffset, out.length);
    for (let i = 0; i < numbers.length; i++) bits[i] = numbers[i] ^ ((numbers[i] >> 31) >>> 1);
  } else if (kind === LATTICE) {
    const step = 2 ** (places - 149);
    for (let i = 0; i < numbers.length; i++) out[i] = numbers[i] * step;
  } else {
    const float = viewOfFloats(kind, places, expectIt);
    for (let i = 0; i < numbers.length; i++) out[i] = float(numbers[i]);
  }
}

// As literals: a power that is computed need not be the nearest double.
export const TENS = [1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22];

/** How many triangles an edge leads to. */
function withEdge(edges) {
  let count = 0;
  for (let t = 0; t < edges.length; t++) if (edges[t] !== 0) count++;
  return count;
}

/** How many corners are told. */
function cornersOf(edges) {
  let count = 0;
  for (let t = 0; t < edges.length; t++) count += edges[t] === 0 ? 3 : (edges[t] & 3) === 0 ? 1 : 0;
  return count;
}

/** Triangles as they are told one after the other, what vertices are guessed from, and what lies around each. */
class Walk {
  constructor(order, edges, vertexCount, expectIt) {
    const apart = edges.length - withEdge(edges);
    Object.assign(this, { order, expectIt, vertices: 0, edgeCount: 0, metCount: 0 });
    this.edges = new Uint16Array(3 * (edges.length + 2 * apart + 4));
    this.met = new Uint16Array(vertexCount + edges.length + 2 * apart + 4);
    this.after = new Uint16Array(vertexCount).fill(NONE);
    this.before = new Uint16Array(vertexCount).fill(NONE);
    /** By rank: a vertex, and three that it is guessed from. */
    this.guesses = new Uint16Array(4 * vertexCount);
    this.around = new Uint16Array(NEIGHBORS * vertexCount).fill(NONE);
    this.counts = new Uint8Array(vertexCount);
  }

  read(edges, turns, corners, bits, out) {
    const { order, after, before, around, counts, guesses, met, edges: list, expectIt } = this;
    let turn = 0;
    let corner = 0;
    let edgeCount = 0;
    for (let t = 0; t < edges.length; t++) {
      const symbol = edges[t] - 1;
      if (symbol < 0) {
        this.edgeCount = edgeCount;
        this.#start(corners, corner, bits, out, 3 * t);
        edgeCount = this.edgeCount;
        corner += 3;
        continue;
      }
      const third = symbol & 3;
      const near = symbol >> 2;
      const place = edgeCount - 1 - (near < EDGES ? near : bits.distance(near, EDGES));
      if (place < 0) expectIt(false, "an edge that was not met");
      const a = list[3 * place];
      const b = list[3 * place + 1];
      const across = list[3 * place + 2];
      // The last edge takes its place.
      let end = 3 * --edgeCount;
      list[3 * place] = list[end];
      list[3 * place + 1] = list[end + 1];
      list[3 * place + 2] = list[end + 2];
      let vertex;
      if (third === NEW) {
        if (this.vertices >= order.length) expectIt(false, "more vertices than there are");
        const to = 4 * this.vertices;
        vertex = order[this.vertices++];
        guesses[to] = vertex;
        guesses[to + 1] = a;
        guesses[to + 2] = b;
        guesses[to + 3] = across;
        met[this.metCount++] = vertex;
      } else if (third === MET) vertex = this.#again(corners[corner++], bits);
      else vertex = third === AFTER ? after[b] : before[a];
      if (vertex === NONE) expectIt(false, "a border that is not there");
      if (third !== AFTER) {
        list[end] = vertex;
        list[end + 1] = b;
        list[end + 2] = a;
        end += 3;
        after[vertex] = b;
        before[b] = vertex;
        edgeCount++;
      }
      if (third !== BEFORE) {
        list[end] = a;
        list[end + 1] = vertex;
        list[end + 2] = b;
        after[a] = vertex;
        before[vertex] = a;
        edgeCount++;
      }
      around[NEIGHBORS * a + (counts[a]++ & (NEIGHBORS - 1))] = b;
      around[NEIGHBORS * b + (counts[b]++ & (NEIGHBORS - 1))] = vertex;
      around[NEIGHBORS * vertex + (counts[vertex]++ & (NEIGHBORS - 1))] = a;
      // Where nothing is told, the least corner comes first.
      const least = vertex < a && vertex < b ? 1 : b < a ? 2 : 0;
      const first = turns ? turns[turn++] % 3 : least;
      const to = 3 * t;
      out[to] = first === 0 ? a : first === 1 ? vertex : b;
      out[to + 1] = first === 0 ? b : first === 1 ? a : vertex;
      out[to + 2] = first === 0 ? vertex : first === 1 ? b : a;
    }
    while (this.vertices < this.order.length) {
      const last = this.order[Math.max(this.vertices - 1, 0)];
      this.#meet(last, last, last);
    }
  }

  /** A triangle that no edge leads to. */
  #start(corners, corner, bits, out, to) {
    let last = this.order[Math.max(this.vertices - 1, 0)];
    for (let i = 0; i < 3; i++) {
      const symbol = corners[corner + i];
      last = symbol === 0 ? this.#meet(last, last, last) : this.#again(symbol - 1, bits);
      out[to + i] = last;
    }
    const [a, b, c] = [out[to], out[to + 1], out[to + 2]];
    this.#surround(a, b, c);
    this.#add(b, a, c);
    this.#add(c, b, a);
    this.#add(a, c, b);
  }

  /** The next vertex, guessed from three. */
  #meet(a, b, c) {
    this.expectIt(this.vertices < this.order.length, "more vertices than there are");
    const vertex = this.order[this.vertices];
    const at = 4 * this.vertices++;
    this.guesses[at] = vertex;
    this.guesses[at + 1] = a;
    this.guesses[at + 2] = b;
    this.guesses[at + 3] = c;
    this.met[this.metCount++] = vertex;
    return vertex;
  }

  /** A vertex that was met before. */
  #again(symbol, bits) {
    const place = this.metCount - 1 - bits.distance(symbol, VERTICES);
    this.expectIt(place >= 0, "a vertex that was not met");
    if (symbol >= VERTICES) this.met[this.metCount++] = this.met[place];
    return this.met[place];
  }

  #add(from, to, across) {
    const at = 3 * this.edgeCount++;
    this.edges[at] = from;
    this.edges[at + 1] = to;
    this.edges[at + 2] = across;
    this.after[from] = to;
    this.before[to] = from;
  }

  #surround(a, b, c) {
    const { around, counts } = this;
    around[NEIGHBORS * a + (counts[a]++ % NEIGHBORS)] = b;
    around[NEIGHBORS * b + (counts[b]++ % NEIGHBORS)] = c;
    around[NEIGHBORS * c + (counts[c]++ % NEIGHBORS)] = a;
  }
}

/** `width` numbers of each vertex, as differences from the middle of two. */
function numbers(walk, symbols, width, bits) {
  const differences = bits.differences(symbols);
  const all = new Int32Array(symbols.length);
  const { guesses } = walk;
  for (let rank = 0, s = 0; s < differences.length; rank += 4) {
    const vertex = width * guesses[rank];
    const a = width * guesses[rank + 1];
    const b = width * guesses[rank + 2];
    for (let i = 0; i < width; i++, s++) {
      all[vertex + i] = Math.floor((all[a + i] + all[b + i]) / 2) + differences[s];
    }
  }
  return all;
}

/** Three numbers of each vertex, as differences from the fourth corner of a parallelogram. */
function numbersOfThree(walk, symbols, bits) {
  const differences = bits.differences(symbols);
  const all = new Int32Array(symbols.length);
  const { guesses } = walk;
  for (let rank = 0, s = 0; s < differences.length; rank += 4, s += 3) {
    const vertex = 3 * guesses[rank];
    const a = 3 * guesses[rank + 1];
    const b = 3 * guesses[rank + 2];
    const c = 3 * guesses[rank + 3];
    all[vertex] = all[a] + all[b] - all[c] + differences[s];
    all[vertex + 1] = all[a + 1] + all[b + 1] - all[c + 1] + differences[s + 1];
    all[vertex + 2] = all[a + 2] + all[b + 2] - all[c + 2] + differences[s + 2];
  }
  return all;
}

/** The vertex of each rank. */
function readOrder(symbols, base, bits, expectIt) {
  const order = new Uint16Array(symbols.length);
  const seen = new Uint8Array(symbols.length);
  const length = 32 - Math.clz32(Math.max(symbols.length - base - 1, 0));
  let next = 0;
  for (let rank = 0; rank < symbols.length; rank++) {
    const symbol = symbols[rank];
    let vertex;
    if (symbol === ELSEWHERE) {
      vertex = base + bits.take(length);
    } else {
      vertex = (next + bits.difference(symbol)) >>> 0;
      next = vertex + 1;
    }
    expectIt(vertex < seen.length && !seen[vertex], "a vertex that comes twice or not at all");
    seen[vertex] = 1;
    order[rank] = vertex;
  }
  return order;
}

/** The open bits and symbols behind the head of a packed or chained page. `most` symbols are the most that there may be. */
export function streamsOf(packed, most, zstd, expectIt) {
  const head = viewOf(packed);
  const walk = HEAD_LEN + head.getUint32(40, true);
  const rest = walk + head.getUint32(44, true);
  expectIt(rest <= packed.byteLength, "open bits that are not all there");
  let symbols;
  try {
    symbols = zstd(packed.subarray(rest), most);
  } catch (error) {
    expectIt(false, `symbols that cannot be expanded: ${error?.message ?? error}`);
  }
  expectIt(symbols.byteLength <= most, "more symbols than numbers");
  let from = 0;
  const take = (count) => {
    expectIt(from + count <= symbols.byteLength, "fewer symbols than numbers");
    from += count;
    return symbols.subarray(from - count, from);
  };
  const one = () => {
    expectIt(from < symbols.byteLength, "fewer symbols than numbers");
    return symbols[from++];
  };
  const bits = new Bits(packed.subarray(walk, rest));
  const finish = () => {
    expectIt(from === symbols.byteLength, "more symbols than numbers");
    expectIt(bits.isDone(), "more or fewer open bits than symbols need");
  };
  return { walkBits: new Bits(packed.subarray(HEAD_LEN, walk)), bits, one, take, finish };
}

/** Numbers of a vertex's attributes together, without its words. */
export function widthsOf(header) {
  return (header.hasFloatNormals ? 3 : 0) + (header.hasOctahedralNormals ? 2 : 0) + (header.hasColors ? 4 : 0);
}

/** A page with the head of its packed form, and the arrays in it, which are to be filled. */
export function emptyPage(header, cluster, packed) {
  const { vertexCount: v, baseVertexCount: b, triangleCount: t, sharedCount: s } = cluster;
  const page = new Uint8Array(pageLength(header, cluster));
  page.set(packed.subarray(0, KEPT));
  viewOf(page).setUint32(0, 0x45475043, true);
  let at = 64;
  const place = (Type, count) => {
    const array = new Type(page.buffer, at, count);
    at += array.byteLength;
    return array;
  };
  return {
    page,
    positions: place(Float32Array, 3 * v),
    normals: place(Float32Array, header.hasFloatNormals ? 3 * v : 0),
    colors: place(Uint8Array, header.hasColors ? 4 * v : 0),
    words: place(Int32Array, header.scalarWords * v),
    ids: place(Uint32Array, s),
    triangles: place(Uint16Array, 3 * t),
    targets: place(Uint16Array, v - b),
    codes: place(Uint16Array, v - b),
    shared: place(Uint8Array, Math.ceil(v / 8)),
    octahedral: place(Uint8Array, header.hasOctahedralNormals ? 3 * v : 0),
  };
}

/** Two numbers of twelve bits for each vertex, in three bytes. */
export function putSteps(out, steps) {
  for (let i = 0; 3 * i < out.length; i++) {
    const both = (steps[2 * i] & 0xfff) | ((steps[2 * i + 1] & 0xfff) << 12);
    out.set([both & 255, (both >> 8) & 255, (both >> 16) & 255], 3 * i);
  }
}

/** Numbers that are told as the difference from the one before. */
export function sums(symbols, bits) {
  const all = bits.differences(symbols);
  for (let i = 1; i < all.length; i++) all[i] += all[i - 1];
  return all;
}

/** Bytes of the page of a packed one. `zstd` expands a frame of zstd to a number of bytes. */
export function unpack(header, cluster, packed, zstd) {
  const what = `the packed page of cluster ${cluster.id}`;
  const expectIt = (is, problem) => expect(is, () => `${what} has ${problem}`);
  expectIt(packed.byteLength >= HEAD_LEN, "less than a head");
  const head = viewOf(packed);
  expectIt(head.getUint32(0, true) === 0x50475043, "another beginning");
  const { vertexCount: v, baseVertexCount: b, triangleCount: t, sharedCount: s } = cluster;
  const told = [8, 12, 16, 24].map((at) => head.getUint32(at, true));
  expectIt([v, b, t, s].every((count, i) => count === told[i]), "other counts than its record");
  const [kind, places, turned, reserved] = packed.subarray(KEPT, KEPT + 4);
  expectIt((turned === 1 || turned === 2) && reserved === 0, "a way of telling corners that is not known");
  const most = header.scalarWords * (2 + v) + 4 * t + v * (4 + widthsOf(header)) + 2 * (v - b) + s + Math.ceil(v / 8);
  const { walkBits, bits, take, finish } = streamsOf(packed, most, zstd, expectIt);
  const { page, positions, normals, colors, words, ids, triangles, targets, codes, shared, octahedral } = emptyPage(header, cluster, packed);

  const order = readOrder(take(v), b, bits, expectIt);
  const edges = take(t);
  const turns = turned === 1 ? take(withEdge(edges)) : null;
  const corners = take(cornersOf(edges));
  const walk = new Walk(order, edges, v, expectIt);
  walk.read(edges, turns, corners, walkBits, triangles);
  expectIt(walkBits.isDone(), "more or fewer open bits than symbols need");

  putFloats(positions, numbersOfThree(walk, take(3 * v), bits), kind, places, expectIt);
  if (header.hasFloatNormals) putFloats(normals, numbers(walk, take(3 * v), 3, bits), 0, 0, expectIt);
  if (header.hasOctahedralNormals) putSteps(octahedral, numbers(walk, take(2 * v), 2, bits));
  if (header.hasColors) colors.set(numbers(walk, take(4 * v), 4, bits));
  for (let word = 0; word < header.scalarWords; word++) {
    const [kind, places] = take(2);
    const bitsOf = viewOfBits(kind, places, expectIt);
    numbers(walk, take(v), 1, bits).forEach((number, i) => (words[header.scalarWords * i + word] = bitsOf(number)));
  }

  const ranks = new Uint16Array(v);
  for (let rank = 0; rank < v; rank++) ranks[order[rank]] = rank;
  const ways = take(v - b);
  for (let i = 0; i < ways.length; i++) {
    if (ways[i] < NEIGHBORS) {
      targets[i] = walk.around[NEIGHBORS * (b + i) + ways[i]];
    } else {
      const rank = (ranks[b + i] + bits.difference(ways[i] - NEIGHBORS)) >>> 0;
      expectIt(rank < v, "a target that is not there");
      targets[i] = order[rank];
    }
  }
  codes.set(sums(take(v - b), bits).reverse());
  ids.set(sums(take(s), bits));
  shared.set(take(Math.ceil(v / 8)));
  finish();
  return page;
}
