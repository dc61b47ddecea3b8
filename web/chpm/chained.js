// From a chained page and the one above to the page itself: the section "Chained page" of the file format, with its names.

import { HEAD_LEN, KEPT, LATTICE, TENS, emptyPage, putSteps, streamsOf, sums, viewOfBits, viewOfFloats, widthsOf } from "./packed.js";
import { expect, viewOf } from "./records.js";

const NONE = 0xffff;
/** Lengths of runs below are symbols of their own. */
const RUNS = 16;
/** Triangles of a page at most, and those of all rings together for each of them. */
const MOST_TRIANGLES = 0xffff;
const MOST_WALKED = 8;
/** Triangles of a ring that are told at once where they go. */
const TOLD_AT_ONCE = 31;
/** Triangles that each ring has room for at first. */
const ROOM = 16;
const ODD = 0;
/** Parts that make a mean are of so many. */
const SHARE = 1 << 20;

/** The place of the page above among the coarse clusters of its group; null where bytes are no chained page. */
export function placeAbove(bytes) {
  if (bytes.byteLength < HEAD_LEN) return null;
  const head = viewOf(bytes);
  return head.getUint32(0, true) === 0x43475043 ? head.getUint16(38, true) : null;
}

/** What is needed of a page by those below. */
export function partsAbove({ cluster, positions, normals, octahedral, colors, words, sharedIds, sharedBits, triangles }) {
  return { vertexCount: cluster.vertexCount, positions, normals: octahedral ? null : normals, octahedral, colors, words, sharedIds, sharedBits, triangles };
}

/** The number of a float. */
function numberOf(kind, places, expectIt) {
  if (kind === 0 && places === 0) {
    const float = new Float32Array(1);
    const bits = new Int32Array(float.buffer);
    return (value) => {
      float[0] = value;
      return bits[0] ^ ((bits[0] >> 31) >>> 1);
    };
  }
  if (kind === LATTICE) {
    const step = 2 ** (places - 149);
    return (value) => {
      const number = value / step;
      expectIt(Number.isInteger(number) && Math.abs(number) <= 1 << 24, "a number above that is not of its view");
      return number;
    };
  }
  expectIt(kind >= 1 && kind <= 7 && places <= 22, "a view that is not known");
  const all = 10 ** kind;
  const step = (all / 10) * 9;
  return (value) => {
    let size = Math.abs(value) * TENS[places];
    let decade = 0;
    while (Math.round(size) >= all) {
      expectIt(decade < 22, "a number above that is not of its view");
      size = (Math.abs(value) * TENS[places]) / TENS[++decade];
    }
    const number = Math.round(size) + decade * step;
    expectIt(number <= 0x7fffffff, "a number above that is not of its view");
    return value < 0 || Object.is(value, -0) ? ~number : number;
  };
}

/** A mesh that grows by vertex splits, and the triangles at each vertex. */
class Rings {
  constructor(vertexCount, triangleCount, expectIt) {
    expectIt(triangleCount <= MOST_TRIANGLES, "more than 65535 triangles");
    Object.assign(this, { expectIt, most: triangleCount, count: 0, head: NONE, left: MOST_WALKED * triangleCount, used: ROOM * vertexCount });
    /** Three corners for each triangle. */
    this.corners = new Uint16Array(3 * triangleCount);
    /** By triangle, the one behind it in the page. */
    this.behind = new Uint16Array(triangleCount);
    /** The triangles of all rings; by vertex, where they start, how many they are, and for how many there is room. */
    this.pool = new Uint16Array(this.used);
    this.starts = Uint32Array.from({ length: vertexCount }, (_, vertex) => ROOM * vertex);
    this.sizes = new Uint32Array(vertexCount);
    this.rooms = new Uint32Array(vertexCount).fill(ROOM);
    /** Of the triangles that went to the new vertex of a split: how many, the corners behind it, sums over these, and one beside which others come. */
    this.seconds = new Uint16Array(triangleCount);
    this.thirds = new Uint16Array(triangleCount);
    Object.assign(this, { gone: 0, apart: 0, squares: 0, beside: NONE });
    this.links = new Uint16Array(3 * vertexCount + triangleCount);
    this.linkCount = 0;
  }

  link(vertex) {
    if (this.linkCount === this.links.length) this.links = longer(this.links, 2 * this.linkCount + 1);
    this.links[this.linkCount++] = vertex;
  }

  /** Moves a ring to where there is room for so many triangles. */
  #grow(vertex, room) {
    const to = this.used;
    this.used += room;
    if (this.used > this.pool.length) this.pool = longer(this.pool, 2 * this.used);
    this.pool.copyWithin(to, this.starts[vertex], this.starts[vertex] + this.sizes[vertex]);
    this.starts[vertex] = to;
    this.rooms[vertex] = room;
  }

  #push(vertex, triangle) {
    const size = this.sizes[vertex];
    if (size === this.rooms[vertex]) this.#grow(vertex, 2 * size);
    this.pool[this.starts[vertex] + size] = triangle;
    this.sizes[vertex] = size + 1;
  }

  /** Adds a triangle behind another one of the page, or in front of all. */
  add(a, b, c, behind) {
    const triangle = this.count++;
    this.expectIt(triangle < this.most, "more triangles than it has");
    const at = 3 * triangle;
    this.corners[at] = a;
    this.corners[at + 1] = b;
    this.corners[at + 2] = c;
    this.#push(a, triangle);
    this.#push(b, triangle);
    this.#push(c, triangle);
    if (behind === NONE) {
      this.behind[triangle] = this.head;
      this.head = triangle;
    } else {
      this.behind[triangle] = this.behind[behind];
      this.behind[behind] = triangle;
    }
  }

  /** Hands those triangles at the middle over to the new vertex that bits tell, from the last on. The last that is left takes the place of each. */
  split(middle, fresh, bits) {
    const size = this.sizes[middle];
    this.left -= size;
    this.expectIt(this.left >= 0, "rings that are too many");
    if (size > this.rooms[fresh]) this.#grow(fresh, size);
    const { pool, corners, seconds, thirds } = this;
    const start = this.starts[middle];
    const own = this.starts[fresh];
    let [gone, apart, squares] = [0, 0, 0];
    for (let passed = 0; passed < size; passed += TOLD_AT_ONCE) {
      let told = bits.take(Math.min(size - passed, TOLD_AT_ONCE));
      while (told !== 0) {
        const at = start + size - 1 - passed - (31 - Math.clz32(told & -told));
        told &= told - 1;
        const triangle = pool[at];
        pool[at] = pool[start + size - 1 - gone];
        pool[own + gone] = triangle;
        const [x, y, z] = [3 * triangle, 3 * triangle + 1, 3 * triangle + 2];
        let [a, b] = [corners[x], corners[y]];
        if (a === middle) {
          a = b;
          b = corners[z];
          corners[x] = fresh;
        } else if (b === middle) {
          b = a;
          a = corners[z];
          corners[y] = fresh;
        } else {
          corners[z] = fresh;
        }
        seconds[gone] = a;
        thirds[gone] = b;
        gone++;
        apart += a - b;
        squares += (a - b) * (a + b);
      }
    }
    this.sizes[middle] = size - gone;
    this.sizes[fresh] = gone;
    this.gone = gone;
    this.apart = apart;
    this.squares = squares;
    this.beside = gone > 0 ? pool[own + gone - 1] : size > 0 ? pool[start] : NONE;
    for (let i = 0; i < gone; i++) this.link(seconds[i]);
  }

  /** Adds triangles between those that went and those that stayed. */
  fill(middle, fresh, isInFront, isBehind) {
    const { gone, apart, seconds, thirds, expectIt } = this;
    if (apart === 0) {
      expectIt(!isInFront && !isBehind, "triangles beside others that are not there");
      return;
    }
    // The one second corner that is no third, and the one third that is no second: all others are in both sums with either sign.
    const first = (this.squares / apart + apart) / 2;
    const last = first - apart;
    let [ofFirst, ofLast] = [-1, -1];
    for (let i = 0; i < gone; i++) {
      if (seconds[i] === first) ofFirst = i;
      if (thirds[i] === last) ofLast = i;
    }
    expectIt(ofFirst >= 0 && ofLast >= 0, "triangles that are not side by side");
    this.link(thirds[ofLast]);
    const own = this.starts[fresh];
    const [besideFirst, besideLast] = [this.pool[own + ofFirst], this.pool[own + ofLast]];
    if (isInFront) this.add(middle, seconds[ofFirst], fresh, besideFirst);
    if (isBehind) this.add(middle, fresh, thirds[ofLast], besideLast);
  }

  /** Adds the triangles of a split that are told by themselves. */
  fillOdd(middle, fresh, bits, length) {
    for (let behind = this.beside; bits.take(1) !== 0; behind = this.count - 1) {
      const third = bits.take(length);
      const isFront = bits.take(1) === 0;
      this.expectIt(third < fresh && third !== middle, "a triangle of equal corners");
      if (isFront) this.add(middle, third, fresh, behind);
      else this.add(middle, fresh, third, behind);
      this.link(third);
    }
  }

  /** The triangles in the page's order, each from its least corner on. */
  putTriangles(out) {
    const { corners, behind } = this;
    for (let triangle = this.head, to = 0; triangle !== NONE; triangle = behind[triangle], to += 3) {
      const a = corners[3 * triangle];
      const b = corners[3 * triangle + 1];
      const c = corners[3 * triangle + 2];
      const first = b < a && b < c ? 1 : c < a ? 2 : 0;
      out[to] = first === 0 ? a : first === 1 ? b : c;
      out[to + 1] = first === 0 ? b : first === 1 ? c : a;
      out[to + 2] = first === 0 ? c : first === 1 ? a : b;
    }
  }
}

function longer(array, length) {
  const all = new Uint16Array(length);
  all.set(array);
  return all;
}

/** Adds to the numbers of vertices, `width` each: all from `used` on, as differences from a guess. `ends` has where the links of each end, `middles` what they are seen from. */
function follow(all, width, used, middles, ends, links, symbols, bits) {
  const shares = Float64Array.from({ length: 64 }, (_, count) => Math.floor(SHARE / Math.max(count, 1)) / SHARE);
  for (let vertex = used, s = 0, first = 0; s < symbols.length; vertex++) {
    const last = ends[vertex - used];
    const count = last - first + 1;
    const share = count < 64 ? shares[count] : Math.floor(SHARE / count) / SHARE;
    const middle = width * middles[vertex - used];
    for (let k = 0; k < width; k++, s++) {
      const value = all[middle + k];
      let sum = 0;
      for (let link = first; link < last; link++) sum = (sum + all[width * links[link] + k] - value) | 0;
      all[width * vertex + k] = value + Math.floor(sum * share) + bits.difference(symbols[s]);
    }
    first = last;
  }
}

/** As {@link follow}, of three numbers. */
function followThree(all, used, middles, ends, links, symbols, bits) {
  const shares = Float64Array.from({ length: 64 }, (_, count) => Math.floor(SHARE / Math.max(count, 1)) / SHARE);
  for (let to = 3 * used, i = 0, first = 0; 3 * i < symbols.length; i++, to += 3) {
    const last = ends[i];
    const count = last - first + 1;
    const share = count < 64 ? shares[count] : Math.floor(SHARE / count) / SHARE;
    const middle = 3 * middles[i];
    const x = all[middle];
    const y = all[middle + 1];
    const z = all[middle + 2];
    let dx = 0;
    let dy = 0;
    let dz = 0;
    for (let link = first; link < last; link++) {
      const at = 3 * links[link];
      dx = (dx + all[at] - x) | 0;
      dy = (dy + all[at + 1] - y) | 0;
      dz = (dz + all[at + 2] - z) | 0;
    }
    all[to] = x + Math.floor(dx * share) + bits.difference(symbols[3 * i]);
    all[to + 1] = y + Math.floor(dy * share) + bits.difference(symbols[3 * i + 1]);
    all[to + 2] = z + Math.floor(dz * share) + bits.difference(symbols[3 * i + 2]);
    first = last;
  }
}

/** Bytes of the page of a chained one. `above` has the {@link partsAbove} of the page that it rests on. */
export function unchain(header, cluster, chained, zstd, above) {
  const what = `the chained page of cluster ${cluster.id}`;
  const expectIt = (is, problem) => expect(is, () => `${what} has ${problem}`);
  expectIt(placeAbove(chained) !== null, "another beginning");
  const head = viewOf(chained);
  const { vertexCount: v, baseVertexCount: b, triangleCount: t, sharedCount: s } = cluster;
  const told = [8, 12, 16, 20, 24].map((at) => head.getUint32(at, true));
  expectIt([v, b, t, cluster.baseTriangleCount, s].every((count, i) => count === told[i]), "other counts than its record");
  const [kind, places] = chained.subarray(KEPT, KEPT + 2);
  const triangleCountAbove = above.triangles.length / 3;
  const most = triangleCountAbove + 2 + header.scalarWords * (2 + v) + v * (3 + widthsOf(header)) + 2 * (v - b) + 2 * s;
  const { walkBits, bits, one, take, finish } = streamsOf(chained, most, zstd, expectIt);
  const { page, positions, normals, colors, words, ids, triangles, targets, codes, shared, octahedral } = emptyPage(header, cluster, chained);

  // The base mesh: triangles above in their order, and their vertices as they come.
  const rings = new Rings(v, t, expectIt);
  const own = new Uint16Array(above.vertexCount).fill(NONE);
  const known = new Uint16Array(b);
  const cornersAbove = above.triangles;
  const corners = new Uint16Array(3);
  let used = 0;
  for (let triangle = 0, isTaken = false; ; isTaken = !isTaken) {
    const end = triangle + walkBits.distance(one(), RUNS);
    expectIt(end <= triangleCountAbove, "a run that goes beyond the page above");
    if (!isTaken) triangle = end;
    for (; triangle < end; triangle++) {
      for (let i = 0; i < 3; i++) {
        const vertex = cornersAbove[3 * triangle + i];
        if (own[vertex] === NONE) {
          expectIt(used < b, "more base vertices than it has");
          known[used] = vertex;
          own[vertex] = used++;
        }
        corners[i] = own[vertex];
      }
      rings.add(corners[0], corners[1], corners[2], rings.count > 0 ? rings.count - 1 : NONE);
    }
    if (triangle === triangleCountAbove) break;
  }
  expectIt(rings.count === cluster.baseTriangleCount, "another base mesh than its record");

  const lengthOf = (fresh) => 32 - Math.clz32(fresh - 1);
  for (let i = 0; i < v - b; i++) {
    targets[i] = walkBits.take(b + i > 0 ? lengthOf(b + i) : 0);
    expectIt(targets[i] < b + i, "a split of a vertex that is not there");
  }
  const splits = take(v - b);
  const ends = new Uint32Array(v - used);
  const middles = new Uint16Array(v - used);
  for (let vertex = used; vertex < b; vertex++) middles[vertex - used] = Math.max(vertex - 1, 0);
  for (let i = 0; i < splits.length; i++) {
    const fresh = b + i;
    const middle = targets[i];
    rings.split(middle, fresh, walkBits);
    const told = splits[i] - 1;
    expectIt(told < 4, "a split that is not known");
    if (told < 0) rings.fillOdd(middle, fresh, walkBits, lengthOf(fresh));
    else rings.fill(middle, fresh, (told & 2) === 0, (told & 1) === 0);
    middles[fresh - used] = middle;
    ends[fresh - used] = rings.linkCount;
  }
  expectIt(walkBits.isDone(), "more or fewer open bits than symbols need");
  expectIt(rings.count === t, "fewer triangles than its record");
  rings.putTriangles(triangles);

  /** `width` numbers of each vertex: those above as `of` has them, all others as differences from a guess. */
  const numbers = (width, of) => {
    const all = new Int32Array(width * v);
    for (let i = 0; i < used; i++) {
      for (let k = 0; k < width; k++) all[width * i + k] = of(known[i], k);
    }
    const symbols = take(width * (v - used));
    if (width === 3) followThree(all, used, middles, ends, rings.links, symbols, bits);
    else follow(all, width, used, middles, ends, rings.links, symbols, bits);
    return all;
  };
  const floats = (out, kind, places, of) => {
    const toNumber = numberOf(kind, places, expectIt);
    const float = viewOfFloats(kind, places, expectIt);
    const whole = numbers(3, (vertex, k) => toNumber(of[3 * vertex + k]));
    for (let i = 0; i < whole.length; i++) out[i] = float(whole[i]);
  };
  floats(positions, kind, places, above.positions);
  if (header.hasFloatNormals) floats(normals, 0, 0, above.normals);
  if (header.hasOctahedralNormals) {
    const bytes = above.octahedral;
    const steps = numbers(2, (vertex, k) => {
      const both = bytes[3 * vertex] | (bytes[3 * vertex + 1] << 8) | (bytes[3 * vertex + 2] << 16);
      return k === 0 ? both & 0xfff : both >> 12;
    });
    putSteps(octahedral, steps);
  }
  if (header.hasColors) colors.set(numbers(4, (vertex, k) => above.colors[4 * vertex + k]));
  const bitsAbove = new Int32Array(1);
  const floatAbove = new Float32Array(bitsAbove.buffer);
  for (let word = 0; word < header.scalarWords; word++) {
    const [kind, places] = take(2);
    const isBinary = kind === 0 && places === 0;
    const toNumber = isBinary ? null : numberOf(kind, places, expectIt);
    const bitsOf = viewOfBits(kind, places, expectIt);
    const all = numbers(1, (vertex) => {
      bitsAbove[0] = above.words[header.scalarWords * vertex + word];
      return isBinary ? bitsAbove[0] ^ ((bitsAbove[0] >> 31) >>> 1) : toNumber(floatAbove[0]);
    });
    all.forEach((number, i) => (words[header.scalarWords * i + word] = bitsOf(number)));
  }

  codes.set(sums(take(v - b), bits).reverse());

  // Shared vertices: those above with their ids, and those that are told.
  const idOf = new Float64Array(v).fill(-1);
  let inherited = 0;
  for (let vertex = 0, next = 0; vertex < above.vertexCount; vertex++) {
    if (!((above.sharedBits[vertex >> 3] >> (vertex & 7)) & 1)) continue;
    const id = above.sharedIds[next++];
    if (own[vertex] === NONE) continue;
    idOf[own[vertex]] = id;
    inherited++;
  }
  expectIt(inherited <= s, "more shared vertices than its record");
  const toldAt = [];
  let vertex = 0;
  take(s - inherited).forEach((symbol) => {
    for (let gap = bits.distance(symbol, RUNS); ; vertex++) {
      expectIt(vertex < v, "a shared vertex that is not there");
      if (idOf[vertex] >= 0) continue;
      if (gap-- === 0) break;
    }
    toldAt.push(vertex++);
  });
  sums(take(toldAt.length), bits).forEach((id, i) => (idOf[toldAt[i]] = id >>> 0));
  for (let i = 0, next = 0; i < v; i++) {
    if (idOf[i] < 0) continue;
    shared[i >> 3] |= 1 << (i & 7);
    ids[next++] = idOf[i];
  }
  finish();
  return page;
}
