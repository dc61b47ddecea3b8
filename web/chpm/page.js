// One cluster's page: a progressive mesh in typed arrays that are views of the bytes that came.

import { expect, viewOf } from "./records.js";
import { ChpmError } from "./source.js";

const FLOAT = new Float32Array(1);
const BITS = new Uint32Array(FLOAT.buffer);

function bitsOf(x) {
  FLOAT[0] = x;
  return BITS[0];
}

const LEAST = bitsOf(2 ** -31);
const LARGEST_CODE = 63489;

function decoded(code, scale) {
  if (code === 0) return 0;
  BITS[0] = LEAST + (code - 1) * 4096;
  return Math.fround(scale * FLOAT[0]);
}

/** A cluster's progressive mesh. */
export class Page {
  /** @private */
  constructor(parts) {
    Object.assign(this, parts);
  }

  /** The error of the mesh of `n` vertices, in units of the model. */
  errorAt(n) {
    const { baseVertexCount: b, vertexCount: v, minError } = this.cluster;
    return n >= v ? minError : decoded(this.errorCodes[n - b], this.errorScale);
  }

  /** The fewest vertices with an error of at most `bound`. */
  position(bound) {
    let [low, high] = [this.cluster.baseVertexCount, this.cluster.vertexCount];
    // Errors fall as vertices are added.
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.errorAt(middle) <= bound) high = middle;
      else low = middle + 1;
    }
    return low;
  }

  /** Three corners for each triangle of the mesh of `n` vertices, all of them below `n`. */
  indices(n) {
    const { baseVertexCount: b, vertexCount: v, triangleCount } = this.cluster;
    if (n >= v) return this.triangles;
    const map = new Uint16Array(v);
    for (let i = 0; i < v; i++) map[i] = i < n ? i : map[this.targets[i - b]];
    const indices = new Uint16Array(3 * triangleCount);
    let length = 0;
    for (let i = 0; i < 3 * triangleCount; i += 3) {
      const x = map[this.triangles[i]];
      const y = map[this.triangles[i + 1]];
      const z = map[this.triangles[i + 2]];
      if (x === y || y === z || z === x) continue;
      indices[length] = x;
      indices[length + 1] = y;
      indices[length + 2] = z;
      length += 3;
    }
    return indices.subarray(0, length);
  }

  /** The values of a named scalar, one of `header.scalars`, by vertex. */
  scalar({ word, words }) {
    const { vertexCount: v } = this.cluster;
    const each = this.words.length / v;
    const own = new Uint32Array(words * v);
    for (let i = 0; i < own.length; i++) own[i] = this.words[Math.floor(i / words) * each + word + (i % words)];
    return words === 2 ? new Float64Array(own.buffer) : new Float32Array(own.buffer);
  }

  /** The ids of shared vertices, by vertex, and -1 for the others. */
  ids() {
    const ids = new Float64Array(this.cluster.vertexCount).fill(-1);
    let next = 0;
    for (let i = 0; i < ids.length; i++) {
      if ((this.sharedBits[i >> 3] >> (i & 7)) & 1) ids[i] = this.sharedIds[next++];
    }
    return ids;
  }
}

/** Normals of three bytes each as singles; one without a direction is zero. */
function unfolded(bytes) {
  const normals = new Float32Array(bytes.length);
  for (let at = 0; at < bytes.length; at += 3) {
    const number = bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16);
    if (number === 0) continue;
    let u = (Math.max(number & 0xfff, 1) - 2048) / 2047;
    let v = (Math.max(number >> 12, 1) - 2048) / 2047;
    const z = 1 - Math.abs(u) - Math.abs(v);
    if (z < 0) {
      u += u >= 0 ? z : -z;
      v += v >= 0 ? z : -z;
    }
    const length = Math.hypot(u, v, z);
    normals[at] = u / length;
    normals[at + 1] = v / length;
    normals[at + 2] = z / length;
  }
  return normals;
}

/** Reads and checks a page that is not packed. */
export function readPage(header, cluster, bytes) {
  const what = `the page of cluster ${cluster.id}`;
  // Views of typed arrays begin at multiples of four.
  if (bytes.byteOffset % 4 !== 0) bytes = bytes.slice();
  const view = viewOf(bytes);
  const u32 = (at) => view.getUint32(at, true);
  expect(u32(0) === 0x45475043 && view.getUint16(4, true) === 1, () => `${what} does not begin like one`);
  const attributes = (header.hasFloatNormals ? 1 : 0) | (header.hasColors ? 2 : 0) | (header.hasOctahedralNormals ? 4 : 0) | (header.scalarWords << 8);
  expect(view.getUint16(6, true) === attributes, () => `${what} has other attributes than the file`);
  const counts = [cluster.vertexCount, cluster.baseVertexCount, cluster.triangleCount, cluster.baseTriangleCount, cluster.sharedCount];
  expect(counts.every((count, i) => u32(8 + 4 * i) === count), () => `${what} has other counts than its record`);
  const errorScale = view.getFloat32(32, true);
  expect(view.getFloat32(28, true) === cluster.minError && errorScale >= cluster.minError, () => `${what} has other errors than its record`);

  const [v, b, t, , s] = counts;
  let at = bytes.byteOffset + 64;
  const take = (Type, count) => {
    const array = new Type(bytes.buffer, at, count);
    at += array.byteLength;
    return array;
  };
  const page = new Page({
    cluster,
    errorScale,
    positions: take(Float32Array, 3 * v),
    normals: header.hasFloatNormals ? take(Float32Array, 3 * v) : null,
    colors: header.hasColors ? take(Uint8Array, 4 * v) : null,
    /** The words of the named scalars, vertex by vertex. */
    words: take(Uint32Array, header.scalarWords * v),
    sharedIds: take(Uint32Array, s),
    triangles: take(Uint16Array, 3 * t),
    targets: take(Uint16Array, v - b),
    errorCodes: take(Uint16Array, v - b),
    sharedBits: take(Uint8Array, Math.ceil(v / 8)),
  });
  /** Normals as the file has them, where they are of three bytes. */
  page.octahedral = header.hasOctahedralNormals ? take(Uint8Array, 3 * v) : null;
  if (header.hasOctahedralNormals) page.normals = unfolded(page.octahedral);
  check(header, page, what);
  return page;
}

/** Whether all numbers are finite: zero times any other is none. */
function areFinite(numbers) {
  let sum = 0;
  for (let i = 0; i < numbers.length; i++) sum += 0 * numbers[i];
  return sum === 0;
}

function check(header, page, what) {
  const { sharedCount, minError, maxError } = page.cluster;
  const { targets, errorCodes, sharedIds } = page;
  expect(areFinite(page.positions), () => `${what}: a coordinate is not finite`);
  expect(page.normals === null || areFinite(page.normals), () => `${what}: a normal is not finite`);
  checkTriangles(page, what);
  checkCollapses(page, what);
  if (targets.length > 0) {
    expect(decoded(errorCodes[targets.length - 1], page.errorScale) >= minError, () => `${what}: errors below that of its finest mesh`);
  }
  const ofBase = page.errorAt(page.cluster.baseVertexCount);
  expect(ofBase === maxError, () => `${what}: an error of ${ofBase} at its base mesh, not ${maxError}`);

  const shared = countShared(page, what);
  expect(shared === sharedCount, () => `${what}: ${shared} shared vertices, not ${sharedCount}`);
  let largest = -1;
  for (let i = 0; i < sharedIds.length; i++) largest = Math.max(largest, sharedIds[i]);
  expect(largest < header.sharedVertexCount, () => `${what}: an id of a shared vertex is out of range`);
  expect(areDifferent(sharedIds), () => `${what}: two vertices have one id`);
}

// The loops below make no function for each number that they look at: a page has many thousands.

function checkTriangles({ cluster, triangles }, what) {
  const v = cluster.vertexCount;
  for (let i = 0; i < triangles.length; i += 3) {
    const x = triangles[i];
    const y = triangles[i + 1];
    const z = triangles[i + 2];
    if (x >= v || y >= v || z >= v || x === y || y === z || z === x) {
      throw new ChpmError(`${what}: triangle ${i / 3} has corners ${x}, ${y}, ${z} of ${v} vertices`);
    }
  }
}

function checkCollapses({ cluster, targets, errorCodes }, what) {
  const b = cluster.baseVertexCount;
  let last = LARGEST_CODE;
  for (let j = 0; j < targets.length; j++) {
    if (targets[j] >= b + j) throw new ChpmError(`${what}: vertex ${b + j} collapses to ${targets[j]}`);
    if (errorCodes[j] > last) throw new ChpmError(`${what}: errors do not fall with more vertices`);
    last = errorCodes[j];
  }
}

function countShared({ cluster, sharedBits }, what) {
  let shared = 0;
  for (let i = 0; i < sharedBits.length; i++) {
    for (let bits = sharedBits[i]; bits !== 0; bits &= bits - 1) shared += 1;
  }
  const behind = cluster.vertexCount & 7;
  if (behind !== 0 && sharedBits[sharedBits.length - 1] >> behind) throw new ChpmError(`${what}: bits behind the last vertex`);
  return shared;
}

function areDifferent(ids) {
  const sorted = ids.slice().sort();
  for (let i = 1; i < sorted.length; i++) if (sorted[i] === sorted[i - 1]) return false;
  return true;
}
