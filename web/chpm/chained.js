// From a chained page and the one above to the page itself: the section "Chained page" of the file format, with its names.

import { HEAD_LEN, KEPT, LATTICE, TENS, emptyPage, putSteps, streamsOf, sums, viewOfBits, viewOfFloats, widthsOf } from "./packed.js";
import { expect, viewOf } from "./records.js";

const NONE = 0xffff;
/** Lengths of runs below are symbols of their own. */
const RUNS = 16;
const MOST_SPOKES = 62;
const MOST_WALKED = 16;
const ODD = 0;
const [CLOSED, OPEN, LOOSE] = [0, 1, 2];

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

/** A mesh that grows by vertex splits. A corner is four times its triangle and its place there. */
class Rings {
  constructor(vertexCount, triangleCount, expectIt) {
    Object.assign(this, { expectIt, most: triangleCount, count: 0, head: -1, left: MOST_WALKED * triangleCount });
    this.corners = new Uint16Array(4 * triangleCount);
    this.next = new Int32Array(4 * triangleCount);
    this.first = new Int32Array(vertexCount).fill(-1);
    /** By triangle, the one behind it in the page. */
    this.behind = new Int32Array(triangleCount);
    this.seconds = new Uint8Array(vertexCount);
    this.thirds = new Uint8Array(vertexCount);
    /** Triangles about a vertex as they are found: a corner, and the two behind it. */
    this.found = [];
    this.foundA = [];
    this.foundB = [];
    /** Their places in the order around the vertex. */
    this.ring = [];
    this.links = new Uint16Array(1024);
    this.linkCount = 0;
  }

  link(vertex) {
    if (this.linkCount === this.links.length) {
      const longer = new Uint16Array(2 * this.links.length);
      longer.set(this.links);
      this.links = longer;
    }
    this.links[this.linkCount++] = vertex;
  }

  /** Adds a triangle behind another one, or in front of all. */
  add(a, b, c, behind) {
    const triangle = this.count;
    this.expectIt(triangle < this.most, "more triangles than it has");
    if (behind < 0) {
      this.behind[triangle] = this.head;
      this.head = triangle;
    } else {
      this.behind[triangle] = this.behind[behind];
      this.behind[behind] = triangle;
    }
    this.count++;
    const { corners, next, first } = this;
    const at = 4 * triangle;
    corners[at] = a;
    corners[at + 1] = b;
    corners[at + 2] = c;
    next[at] = first[a];
    first[a] = at;
    next[at + 1] = first[b];
    first[b] = at + 1;
    next[at + 2] = first[c];
    first[c] = at + 2;
  }

  /** Looks at the triangles about a vertex. */
  look(vertex) {
    const { corners, next, found, foundA, foundB, ring, seconds, thirds } = this;
    let count = 0;
    for (let corner = this.first[vertex]; corner >= 0; corner = next[corner], count++) {
      const own = corner & ~3;
      const place = corner & 3;
      const a = corners[own + (place === 2 ? 0 : place + 1)];
      const b = corners[own + (place === 0 ? 2 : place - 1)];
      seconds[a] = count;
      found[count] = corner;
      foundA[count] = a;
      foundB[count] = b;
    }
    this.size = count;
    this.left -= count;
    this.expectIt(this.left >= 0, "rings that are too many");
    if (count === 0) return OPEN;
    if (count <= MOST_SPOKES) {
      const after = (i) => {
        const next = seconds[foundB[i]];
        return next < count && foundA[next] === foundB[i] ? next : -1;
      };
      // Only the last with some second corner is found again: what comes back to the first after all has each once.
      let length = 0;
      let at = 0;
      do {
        ring[length++] = at;
        at = after(at);
      } while (at > 0 && length < count);
      if (at === 0 && length === count) return CLOSED;
      for (let i = 0; i < count; i++) thirds[foundB[i]] = i;
      let isOnce = true;
      for (let i = 0; i < count && isOnce; i++) isOnce = seconds[foundA[i]] === i && thirds[foundB[i]] === i;
      if (isOnce) {
        // Where the first is in a circle that is not all, going back does not end by itself.
        let start = 0;
        for (let i = 0; i < count; i++) {
          const last = thirds[foundA[start]];
          if (last >= count || foundB[last] !== foundA[start]) break;
          start = last;
        }
        length = 0;
        for (at = start; at >= 0 && length < count; at = after(at)) ring[length++] = at;
        if (length === count && at < 0) return OPEN;
      }
    }
    for (let i = 0; i < count; i++) ring[i] = i;
    return LOOSE;
  }

  /** The vertex in front of a triangle of the ring, or behind the last; -1 where there is none. */
  linkAt(at) {
    if (at < this.size) return this.foundA[this.ring[at]];
    return at === 0 ? -1 : this.foundB[this.ring[at - 1]];
  }

  splitArc(kind, middle, fresh, start, count, inFront, atEnd) {
    const { ring, found, foundA, corners, next, size } = this;
    const isClosed = kind === CLOSED;
    const isThere = isClosed ? start < size && count <= size : start + count <= size;
    this.expectIt(kind !== LOOSE && isThere && (size > 0 || !(inFront || atEnd)), "a part of a ring that is not there");
    let [ofFresh, ofMiddle] = [-1, -1];
    for (let turn = 0, at = start; turn < size; turn++, at++) {
      if (at >= size) at = 0;
      const corner = found[ring[at]];
      if (turn < count) {
        this.link(foundA[ring[at]]);
        corners[corner] = fresh;
        next[corner] = ofFresh;
        ofFresh = corner;
      } else {
        next[corner] = ofMiddle;
        ofMiddle = corner;
      }
    }
    this.first[middle] = ofMiddle;
    this.first[fresh] = ofFresh;
    let end = start + count;
    if (isClosed && end >= size) end -= size;
    const last = this.linkAt(end);
    if (last < 0) return;
    if (count > 0 || inFront || atEnd) this.link(last);
    if (inFront) this.add(middle, this.linkAt(start), fresh, found[ring[Math.min(start, size - 1)]] >> 2);
    if (atEnd) this.add(middle, fresh, last, found[ring[end === 0 ? size - 1 : end - 1]] >> 2);
  }

  splitOdd(middle, fresh, bits) {
    const { ring, found, foundA, corners, next, size } = this;
    let [ofFresh, ofMiddle] = [-1, -1];
    for (let at = 0; at < size; at++) {
      const corner = found[ring[at]];
      if (bits.take(1) !== 0) {
        this.link(foundA[ring[at]]);
        corners[corner] = fresh;
        next[corner] = ofFresh;
        ofFresh = corner;
      } else {
        next[corner] = ofMiddle;
        ofMiddle = corner;
      }
    }
    this.first[middle] = ofMiddle;
    this.first[fresh] = ofFresh;
  }

  /** The triangles in the page's order, each from its least corner on. */
  putTriangles(out) {
    const { corners, behind } = this;
    for (let triangle = this.head, to = 0; triangle >= 0; triangle = behind[triangle], to += 3) {
      const at = 4 * triangle;
      const [a, b, c] = [corners[at], corners[at + 1], corners[at + 2]];
      const first = b < a && b < c ? 1 : c < a ? 2 : 0;
      out[to] = corners[at + first];
      out[to + 1] = corners[at + ((first + 1) % 3)];
      out[to + 2] = corners[at + ((first + 2) % 3)];
    }
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
  const most = triangleCountAbove + 2 + header.scalarWords * (2 + v) + v * (3 + widthsOf(header)) + 4 * (v - b) + 2 * s;
  const { walkBits, bits, one, take, finish } = streamsOf(chained, most, zstd, expectIt);
  const { page, positions, normals, colors, words, ids, triangles, targets, codes, shared, octahedral } = emptyPage(header, cluster, chained);

  // The base mesh: triangles above in their order, and their vertices as they come.
  const rings = new Rings(v, t, expectIt);
  const own = new Uint16Array(above.vertexCount).fill(NONE);
  const known = new Uint16Array(b);
  let used = 0;
  const number = (vertex) => {
    if (own[vertex] === NONE) {
      expectIt(used < b, "more base vertices than it has");
      known[used] = vertex;
      own[vertex] = used++;
    }
    return own[vertex];
  };
  for (let triangle = 0, isTaken = false; ; isTaken = !isTaken) {
    const end = triangle + walkBits.distance(one(), RUNS);
    expectIt(end <= triangleCountAbove, "a run that goes beyond the page above");
    for (; triangle < end; triangle++) {
      if (!isTaken) continue;
      const corners = [0, 1, 2].map((i) => number(above.triangles[3 * triangle + i]));
      rings.add(...corners, rings.count - 1);
    }
    if (triangle === triangleCountAbove) break;
  }
  expectIt(rings.count === cluster.baseTriangleCount, "another base mesh than its record");

  const arcs = take(v - b);
  let regular = 0;
  for (let i = 0; i < arcs.length; i++) if (arcs[i] !== ODD) regular++;
  const starts = take(regular);
  const ends = new Uint32Array(v - used);
  const middles = new Uint16Array(v - used);
  for (let vertex = used; vertex < b; vertex++) middles[vertex - used] = Math.max(vertex - 1, 0);
  for (let i = 0, next = 0; i < arcs.length; i++) {
    const fresh = b + i;
    const length = 32 - Math.clz32(Math.max(fresh - 1, 0));
    const middle = walkBits.take(length);
    expectIt(middle < fresh, "a split of a vertex that is not there");
    targets[i] = middle;
    const ring = rings.look(middle);
    if (arcs[i] !== ODD) {
      const told = arcs[i] - 1;
      rings.splitArc(ring, middle, fresh, starts[next++], told >> 2, (told & 2) === 0, (told & 1) === 0);
    } else {
      const beside = rings.size > 0 ? rings.found[rings.ring[0]] >> 2 : -1;
      rings.splitOdd(middle, fresh, walkBits);
      const count = walkBits.distance(one(), RUNS);
      for (let k = 0; k < count; k++) {
        const third = walkBits.take(length);
        const isFront = walkBits.take(1) === 0;
        expectIt(third < fresh && third !== middle, "a triangle of equal corners");
        const behind = k === 0 ? beside : rings.count - 1;
        if (isFront) rings.add(middle, third, fresh, behind);
        else rings.add(middle, fresh, third, behind);
        rings.link(third);
      }
    }
    middles[b - used + i] = middle;
    ends[b - used + i] = rings.linkCount;
  }
  expectIt(walkBits.isDone(), "more or fewer open bits than symbols need");
  expectIt(rings.count === t, "fewer triangles than its record");
  rings.putTriangles(triangles);

  const { links } = rings;
  const shares = Float64Array.from({ length: 64 }, (_, count) => 1 / Math.max(count, 1));
  /** `width` numbers of each vertex: those above as `of` has them, all others as differences from a guess. */
  const numbers = (width, of) => {
    const all = new Int32Array(width * v);
    for (let i = 0; i < used; i++) {
      for (let k = 0; k < width; k++) all[width * i + k] = of(known[i], k);
    }
    const symbols = take(width * (v - used));
    for (let i = used, s = 0; i < v; i++) {
      const middle = width * middles[i - used];
      const first = i === used ? 0 : ends[i - used - 1];
      const last = ends[i - used];
      const count = last - first + 1;
      const share = count < 64 ? shares[count] : 1 / count;
      for (let k = 0; k < width; k++, s++) {
        const value = all[middle + k];
        let sum = 0;
        for (let link = first; link < last; link++) sum += (all[width * links[link] + k] - value) | 0;
        all[width * i + k] = value + ((sum * share) | 0) + bits.difference(symbols[s]);
      }
    }
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
