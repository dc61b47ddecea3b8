// From a chained page and the one above to the page itself: the section "Chained page" of the file format, with its names.

import { HEAD_LEN, KEPT, LATTICE, TENS, emptyPage, putFloats, putSteps, streamsOf, sums, viewOfBits, widthsOf } from "./packed.js";
import { expect, viewOf } from "./records.js";

const NONE = 0xffff;
/** Lengths of runs below are symbols of their own. */
const RUNS = 16;
/** Triangles of a page at most, and those of all rings together for each of them. */
const MOST_TRIANGLES = 0xffff;
const MOST_WALKED = 8;
/** Triangles of a ring that are told at once where they go. */
const TOLD_AT_ONCE = 31;
/** Triangles that each ring has room for at first; room is a multiple of it. */
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

/** Puts the numbers of some vertices' three floats side by side. A loop of its own for each view. */
function putNumbers(all, vertices, floats, kind, places, expectIt) {
  if (kind === 0 && places === 0) {
    const bits = new Int32Array(floats.buffer, floats.byteOffset, floats.length);
    for (let i = 0, to = 0; i < vertices.length; i++) {
      for (let at = 3 * vertices[i], end = at + 3; at < end; at++, to++) all[to] = bits[at] ^ ((bits[at] >> 31) >>> 1);
    }
  } else if (kind === LATTICE) {
    const steps = 2 ** (149 - places);
    for (let i = 0, to = 0; i < vertices.length; i++) {
      for (let at = 3 * vertices[i], end = at + 3; at < end; at++, to++) {
        const number = floats[at] * steps;
        const whole = number | 0;
        if (whole !== number || Math.abs(whole) > 1 << 24) expectIt(false, "a number above that is not of its view");
        all[to] = whole;
      }
    }
  } else {
    const toNumber = numberOf(kind, places, expectIt);
    for (let i = 0; i < 3 * vertices.length; i++) all[i] = toNumber(floats[3 * vertices[Math.floor(i / 3)] + (i % 3)]);
  }
}

/** The number of a float that has no binary view. */
function numberOf(kind, places, expectIt) {
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

/** A mesh that grows by vertex splits, and the triangles at each vertex. Its arrays are used for one page after the other. */
class Rings {
  constructor() {
    /** Four numbers for each triangle: its corners, and the one behind it in the page. */
    this.triangles = new Uint16Array(0);
    /** The triangles of all rings; by vertex, where they start, how many they are, and for how many there is room. */
    this.pool = new Uint16Array(0);
    this.starts = new Uint32Array(0);
    this.sizes = new Uint16Array(0);
    this.rooms = new Uint32Array(0);
    /** Of the triangles that went to the new vertex of a split: the corners behind it, the first of which are links as well. */
    this.thirds = new Uint16Array(0);
    this.links = new Uint16Array(0);
  }

  /** Forgets all, and makes room for so many vertices and triangles. */
  clear(vertexCount, triangleCount, expectIt) {
    expectIt(triangleCount <= MOST_TRIANGLES, "more than 65535 triangles");
    if (this.thirds.length < triangleCount) {
      this.triangles = new Uint16Array(4 * triangleCount);
      this.thirds = new Uint16Array(triangleCount);
    }
    if (this.starts.length < vertexCount) {
      this.starts = Uint32Array.from({ length: vertexCount }, (_, vertex) => ROOM * vertex);
      this.sizes = new Uint16Array(vertexCount);
      this.rooms = new Uint32Array(vertexCount).fill(ROOM);
    }
    if (this.pool.length < ROOM * vertexCount) this.pool = new Uint16Array(2 * ROOM * vertexCount);
    for (const vertex of this.moved ?? []) {
      this.starts[vertex] = ROOM * vertex;
      this.rooms[vertex] = ROOM;
    }
    /** Vertices whose rings are not at their first places. */
    this.moved = [];
    this.sizes.fill(0, 0, vertexCount);
    Object.assign(this, { expectIt, most: triangleCount, count: 0, head: NONE, left: MOST_WALKED * triangleCount, used: ROOM * vertexCount, linkCount: 0 });
    /** Of a split: how many triangles went, where their links begin, sums over their corners, and a triangle beside which others come. */
    Object.assign(this, { gone: 0, first: 0, apart: 0, squares: 0, beside: NONE });
  }

  /** Makes room for more links. */
  #reserve(count) {
    if (this.linkCount + count > this.links.length) this.links = longer(this.links, 2 * (this.linkCount + count));
  }

  /** Moves a ring to where there is room for so many triangles, as many as in some first places. */
  #grow(vertex, size) {
    const room = ROOM * Math.ceil(size / ROOM);
    const to = this.used;
    this.used += room;
    if (this.used > this.pool.length) this.pool = longer(this.pool, 2 * this.used);
    this.pool.copyWithin(to, this.starts[vertex], this.starts[vertex] + this.sizes[vertex]);
    this.starts[vertex] = to;
    this.rooms[vertex] = room;
    this.moved.push(vertex);
  }

  #push(vertex, triangle) {
    const size = this.sizes[vertex];
    if (size % ROOM === 0 && size === this.rooms[vertex]) this.#grow(vertex, 2 * size);
    this.pool[this.starts[vertex] + size] = triangle;
    this.sizes[vertex] = size + 1;
  }

  /** Adds a triangle behind another one of the page, or in front of all. */
  add(a, b, c, behind) {
    const triangle = this.count++;
    if (triangle >= this.most) this.expectIt(false, "more triangles than it has");
    const { triangles } = this;
    const at = 4 * triangle;
    triangles[at] = a;
    triangles[at + 1] = b;
    triangles[at + 2] = c;
    this.#push(a, triangle);
    this.#push(b, triangle);
    this.#push(c, triangle);
    if (behind === NONE) {
      triangles[at + 3] = this.head;
      this.head = triangle;
    } else {
      triangles[at + 3] = triangles[4 * behind + 3];
      triangles[4 * behind + 3] = triangle;
    }
  }

  /** Hands those triangles at the middle over to the new vertex that bits tell, from the last on. The last that is left takes the place of each. */
  split(middle, fresh, bits) {
    const size = this.sizes[middle];
    this.left -= size;
    if (this.left < 0) this.expectIt(false, "rings that are too many");
    if (size > ROOM && size > this.rooms[fresh]) this.#grow(fresh, size);
    this.#reserve(size);
    const { pool, triangles, links, thirds, linkCount } = this;
    const start = this.starts[middle];
    const own = this.starts[fresh];
    let gone = 0;
    let apart = 0;
    let squares = 0;
    for (let passed = 0; passed < size; passed += TOLD_AT_ONCE) {
      let told = bits.take(Math.min(size - passed, TOLD_AT_ONCE));
      const last = start + size - 1 - passed;
      while (told !== 0) {
        const at = last - (31 - Math.clz32(told & -told));
        told &= told - 1;
        const triangle = pool[at];
        pool[at] = pool[start + size - 1 - gone];
        pool[own + gone] = triangle;
        const corner = 4 * triangle;
        let a = triangles[corner];
        let b = triangles[corner + 1];
        if (a === middle) {
          a = b;
          b = triangles[corner + 2];
          triangles[corner] = fresh;
        } else if (b === middle) {
          b = a;
          a = triangles[corner + 2];
          triangles[corner + 1] = fresh;
        } else {
          triangles[corner + 2] = fresh;
        }
        links[linkCount + gone] = a;
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
    this.first = linkCount;
    this.linkCount = linkCount + gone;
  }

  /** Adds triangles between those that went and those that stayed. */
  fill(middle, fresh, isInFront, isBehind) {
    const { gone, apart, first: from, thirds, expectIt } = this;
    if (apart === 0) {
      expectIt(!isInFront && !isBehind, "triangles beside others that are not there");
      return;
    }
    // The one second corner that is no third, and the one third that is no second: all others are in both sums with either sign.
    const first = (this.squares / apart + apart) / 2;
    const last = first - apart;
    this.#reserve(1);
    const { links } = this;
    let ofFirst = -1;
    let ofLast = -1;
    for (let i = 0; i < gone; i++) {
      if (links[from + i] === first) ofFirst = i;
      if (thirds[i] === last) ofLast = i;
    }
    if (ofFirst < 0 || ofLast < 0) expectIt(false, "triangles that are not side by side");
    links[this.linkCount++] = last;
    const own = this.starts[fresh];
    const besideFirst = this.pool[own + ofFirst];
    const besideLast = this.pool[own + ofLast];
    if (isInFront) this.add(middle, first, fresh, besideFirst);
    if (isBehind) this.add(middle, fresh, last, besideLast);
  }

  /** Adds the triangles of a split that are told by themselves. */
  fillOdd(middle, fresh, bits, length) {
    for (let behind = this.beside; bits.take(1) !== 0; behind = this.count - 1) {
      const third = bits.take(length);
      const isFront = bits.take(1) === 0;
      this.expectIt(third < fresh && third !== middle, "a triangle of equal corners");
      if (isFront) this.add(middle, third, fresh, behind);
      else this.add(middle, fresh, third, behind);
      this.#reserve(1);
      this.links[this.linkCount++] = third;
    }
  }

  /** The triangles in the page's order, each from its least corner on. */
  putTriangles(out) {
    const { triangles } = this;
    for (let triangle = this.head, to = 0; triangle !== NONE; to += 3) {
      const a = triangles[4 * triangle];
      const b = triangles[4 * triangle + 1];
      const c = triangles[4 * triangle + 2];
      triangle = triangles[4 * triangle + 3];
      const first = b < a && b < c ? 1 : c < a ? 2 : 0;
      out[to] = first === 0 ? a : first === 1 ? b : c;
      out[to + 1] = first === 0 ? b : first === 1 ? c : a;
      out[to + 2] = first === 0 ? c : first === 1 ? a : b;
    }
  }
}

const rings = new Rings();

function longer(array, length) {
  const all = new Uint16Array(length);
  all.set(array);
  return all;
}

/** Factors that make a mean of a sum, by how many it is of. */
const SHARES = Float64Array.from({ length: 64 }, (_, count) => shareOf(Math.max(count, 1)));

function shareOf(count) {
  return Math.floor(SHARE / count) / SHARE;
}

/** Adds to the numbers of vertices, `width` each: all from `used` on, as differences from a guess. `ends` has where the links of each end, `middles` what they are seen from. */
function follow(all, width, used, middles, ends, links, differences) {
  for (let vertex = used, s = 0, first = 0; s < differences.length; vertex++) {
    const last = ends[vertex - used];
    const count = last - first + 1;
    const share = count < 64 ? SHARES[count] : shareOf(count);
    const middle = width * middles[vertex - used];
    for (let k = 0; k < width; k++, s++) {
      const value = all[middle + k];
      let sum = 0;
      for (let link = first; link < last; link++) sum = (sum + all[width * links[link] + k] - value) | 0;
      all[width * vertex + k] = value + Math.floor(sum * share) + differences[s];
    }
    first = last;
  }
}

/** As {@link follow}, of three numbers. */
function followThree(all, used, middles, ends, links, differences) {
  for (let to = 3 * used, s = 0, i = 0, first = 0; s < differences.length; i++, to += 3, s += 3) {
    const last = ends[i];
    const count = last - first + 1;
    const share = count < 64 ? SHARES[count] : shareOf(count);
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
    all[to] = x + Math.floor(dx * share) + differences[s];
    all[to + 1] = y + Math.floor(dy * share) + differences[s + 1];
    all[to + 2] = z + Math.floor(dz * share) + differences[s + 2];
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
  rings.clear(v, t, expectIt);
  const own = new Uint16Array(above.vertexCount).fill(NONE);
  const known = new Uint16Array(b);
  const cornersAbove = above.triangles;
  let used = 0;
  const baseOf = (vertex) => {
    if (own[vertex] === NONE) {
      if (used >= b) expectIt(false, "more base vertices than it has");
      known[used] = vertex;
      own[vertex] = used++;
    }
    return own[vertex];
  };
  for (let triangle = 0, isTaken = false; ; isTaken = !isTaken) {
    const end = triangle + walkBits.distance(one(), RUNS);
    expectIt(end <= triangleCountAbove, "a run that goes beyond the page above");
    if (!isTaken) triangle = end;
    for (; triangle < end; triangle++) {
      const x = baseOf(cornersAbove[3 * triangle]);
      const y = baseOf(cornersAbove[3 * triangle + 1]);
      const z = baseOf(cornersAbove[3 * triangle + 2]);
      rings.add(x, y, z, rings.count > 0 ? rings.count - 1 : NONE);
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

  /** `width` numbers of each vertex: those above as `put` puts them there by their vertices, all others as differences from a guess. */
  const numbers = (width, put) => {
    const all = new Int32Array(width * v);
    put(all, known.subarray(0, used));
    const differences = bits.differences(take(width * (v - used)));
    if (width === 3) followThree(all, used, middles, ends, rings.links, differences);
    else follow(all, width, used, middles, ends, rings.links, differences);
    return all;
  };
  const floats = (out, kind, places, of) => putFloats(out, numbers(3, (all, known) => putNumbers(all, known, of, kind, places, expectIt)), kind, places, expectIt);
  floats(positions, kind, places, above.positions);
  if (header.hasFloatNormals) floats(normals, 0, 0, above.normals);
  if (header.hasOctahedralNormals) {
    const bytes = above.octahedral;
    const steps = numbers(2, (all, known) => {
      known.forEach((vertex, i) => {
        const both = bytes[3 * vertex] | (bytes[3 * vertex + 1] << 8) | (bytes[3 * vertex + 2] << 16);
        all[2 * i] = both & 0xfff;
        all[2 * i + 1] = both >> 12;
      });
    });
    putSteps(octahedral, steps);
  }
  if (header.hasColors) colors.set(numbers(4, (all, known) => known.forEach((vertex, i) => all.set(above.colors.subarray(4 * vertex, 4 * vertex + 4), 4 * i))));
  const bitsAbove = new Int32Array(1);
  const floatAbove = new Float32Array(bitsAbove.buffer);
  for (let word = 0; word < header.scalarWords; word++) {
    const [kind, places] = take(2);
    const isBinary = kind === 0 && places === 0;
    const toNumber = isBinary ? null : numberOf(kind, places, expectIt);
    const bitsOf = viewOfBits(kind, places, expectIt);
    const numberAbove = (vertex) => {
      bitsAbove[0] = above.words[header.scalarWords * vertex + word];
      return isBinary ? bitsAbove[0] ^ ((bitsAbove[0] >> 31) >>> 1) : toNumber(floatAbove[0]);
    };
    const all = numbers(1, (all, known) => known.forEach((vertex, i) => (all[i] = numberAbove(vertex))));
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
