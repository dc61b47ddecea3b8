// Which way a smooth surface faces at a vertex, of models without normals: as `gpu/facing.rs` and `scene/borders.rs` of the viewer have it, where
// it says why.

/** Cosine of the crease angle, 40 degrees, and of half of it. */
const CREASE = Math.cos((40 * Math.PI) / 180);
const HALF = Math.cos((20 * Math.PI) / 180);
const [SHEET, ALONG, NEEDLE, MANY] = [0.34, 0.17, 0.04, 128];
const [TOWARD, ALONG_IT] = [1, -1];

/** Three numbers made a vector of length 1, and how long it was beside its largest number; 0 where it has no direction. */
function normalized(from, at, to, place) {
  const longest = Math.max(Math.abs(from[at]), Math.abs(from[at + 1]), Math.abs(from[at + 2]));
  if (!(longest > 0 && longest < Infinity)) return 0;
  const [x, y, z] = [from[at] / longest, from[at + 1] / longest, from[at + 2] / longest];
  const length = Math.sqrt(x * x + y * y + z * z);
  to[place] = x / length;
  to[place + 1] = y / length;
  to[place + 2] = z / length;
  return length;
}

const dot = (a, i, b, j) => a[i] * b[j] + a[i + 1] * b[j + 1] + a[i + 2] * b[j + 2];
const lengthAt = (a, i) => Math.sqrt(dot(a, i, a, i));

function addAt(to, i, from, j) {
  to[i] += from[j];
  to[i + 1] += from[j + 1];
  to[i + 2] += from[j + 2];
}

// What is looked at for one vertex: normals of its faces, the group of each, sums and means of groups, and what it comes to.
const NORMALS = new Float64Array(3 * MANY);
const PLACES = new Int32Array(MANY);
const GROUP = new Int32Array(MANY);
const SUMS = new Float64Array(3 * MANY);
const MEANS = new Float64Array(3 * MANY);
const FOUND = new Float64Array(4);
const SCRATCH = new Float64Array(3);

/** Answers four numbers from -1 to 1: a direction that is in `FOUND`, and what it is; of no direction, none. */
function found(is, kind) {
  if (is) FOUND[3] = kind;
  else FOUND.fill(0);
  return FOUND;
}

/**
 * What a pixel makes of its face's plane at a vertex, by the normals of the faces about it, each as long as its area: a smooth surface has
 * its mean, a crease its line, a corner nothing.
 */
export function ofFaces(areas) {
  return [...ofAreas(Float64Array.from(areas.flat()), areas.length)];
}

function ofAreas(areas, count) {
  SUMS.fill(0, 0, 3);
  for (let face = 0; face < count; face++) addAt(SUMS, 0, areas, 3 * face);
  const hasMean = normalized(SUMS, 0, FOUND, 0) > 0;
  if (count > MANY) return found(hasMean && areWithin(areas, count, CREASE), TOWARD);
  if (hasMean && areWithin(areas, count, HALF)) return found(true, TOWARD);
  const faces = grouped(areas, count);
  const kept = summed(areas, count, faces);
  if (kept < 2) return found(kept > 0 && normalized(SUMS, 0, FOUND, 0) > 0, TOWARD);
  for (let i = 0; i < kept; i++) {
    if (!(normalized(SUMS, 3 * i, MEANS, 3 * i) > 0)) return found(false);
  }
  const sine = sharpest(kept);
  // Both sides of a sheet, or faces that go around either way.
  if (!(sine > SHEET)) {
    for (let axis = 0; axis < 3; axis++) SCRATCH[axis] = MEANS[axis] - MEANS[3 * (kept - 1) + axis];
    return found(normalized(SCRATCH, 0, FOUND, 0) > 0, TOWARD);
  }
  for (let i = 0; i < kept; i++) {
    if (!(Math.abs(dot(MEANS, 3 * i, FOUND, 0)) < ALONG)) return found(false);
  }
  return found(true, ALONG_IT);
}

/** Whether all faces that have a direction are within an angle of the mean, which is in `FOUND`. */
function areWithin(areas, count, cosine) {
  for (let face = 0; face < count; face++) {
    if (normalized(areas, 3 * face, SCRATCH, 0) > 0 && !(dot(SCRATCH, 0, FOUND, 0) > cosine)) return false;
  }
  return true;
}

/** Puts faces that are smooth with one another, by one after the other, into one group, that of the first; how many have a direction. */
function grouped(areas, count) {
  let faces = 0;
  for (let face = 0; face < count; face++) {
    if (!(normalized(areas, 3 * face, NORMALS, 3 * faces) > 0)) continue;
    GROUP[faces] = faces;
    PLACES[faces++] = 3 * face;
  }
  for (let face = 0; face < faces; face++) {
    for (let before = 0; before < face; before++) {
      const [low, high] = [Math.min(GROUP[face], GROUP[before]), Math.max(GROUP[face], GROUP[before])];
      if (low === high || dot(NORMALS, 3 * face, NORMALS, 3 * before) <= CREASE) continue;
      for (let i = 0; i < faces; i++) if (GROUP[i] === high) GROUP[i] = low;
    }
  }
  return faces;
}

/** Sums of the areas of groups, without needles, one after the other; how many there are. */
function summed(areas, count, faces) {
  let all = 0;
  for (let i = 0; i < faces; i++) all += lengthAt(areas, PLACES[i]);
  let kept = 0;
  for (let first = 0; first < faces; first++) {
    if (GROUP[first] !== first) continue;
    let [members, size] = [0, 0];
    SUMS.fill(0, 3 * kept, 3 * kept + 3);
    for (let i = first; i < faces; i++) {
      if (GROUP[i] !== first) continue;
      members += 1;
      size += lengthAt(areas, PLACES[i]);
      addAt(SUMS, 3 * kept, areas, PLACES[i]);
    }
    if (members > 2 || size >= NEEDLE * all) kept += 1;
  }
  return kept;
}

/** The largest sine between two means; the line across both is left in `FOUND`. */
function sharpest(kept) {
  let sine = 0;
  for (let i = 0; i < kept; i++) {
    for (let j = i + 1; j < kept; j++) {
      const [a, b] = [3 * i, 3 * j];
      SCRATCH[0] = MEANS[a + 1] * MEANS[b + 2] - MEANS[a + 2] * MEANS[b + 1];
      SCRATCH[1] = MEANS[a + 2] * MEANS[b] - MEANS[a] * MEANS[b + 2];
      SCRATCH[2] = MEANS[a] * MEANS[b + 1] - MEANS[a + 1] * MEANS[b];
      const size = lengthAt(SCRATCH, 0);
      if (size < sine) continue;
      sine = size;
      normalized(SCRATCH, 0, FOUND, 0);
    }
  }
  return sine;
}

/** The faces about some vertices, each of which has a number, and what that makes of them. Most are smooth, and are told without lists of faces. */
class Around {
  constructor(count) {
    this.sums = new Float64Array(3 * count);
    this.parts = [];
  }

  /** Adds the faces of a page; `slots` are the numbers of its vertices, -1 for those that nobody asks about. */
  add({ positions, triangles }, slots) {
    const areas = new Float64Array(triangles.length);
    const { sums } = this;
    for (let corner = 0; corner < triangles.length; corner += 3) {
      const [i, j, k] = [triangles[corner], triangles[corner + 1], triangles[corner + 2]];
      if (slots[i] < 0 && slots[j] < 0 && slots[k] < 0) continue;
      const [x, y, z] = [positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]];
      const [bx, by, bz] = [positions[3 * j] - x, positions[3 * j + 1] - y, positions[3 * j + 2] - z];
      const [cx, cy, cz] = [positions[3 * k] - x, positions[3 * k + 1] - y, positions[3 * k + 2] - z];
      areas[corner] = by * cz - bz * cy;
      areas[corner + 1] = bz * cx - bx * cz;
      areas[corner + 2] = bx * cy - by * cx;
      for (let n = corner; n < corner + 3; n++) {
        const slot = 3 * slots[triangles[n]];
        if (slot < 0) continue;
        sums[slot] += areas[corner];
        sums[slot + 1] += areas[corner + 1];
        sums[slot + 2] += areas[corner + 2];
      }
    }
    this.parts.push({ triangles, slots, areas });
  }

  /** What becomes of each number: four numbers, as {@link ofFaces} has them. */
  facing() {
    const { sums } = this;
    const count = sums.length / 3;
    const out = new Float64Array(4 * count);
    const isOdd = new Uint8Array(count);
    for (let slot = 0; slot < count; slot++) {
      const size = normalized(sums, 3 * slot, out, 4 * slot);
      if (size > 0) out[4 * slot + 3] = TOWARD;
      else isOdd[slot] = 1;
    }
    const normal = new Float64Array(3);
    for (const { triangles, slots, areas } of this.parts) {
      for (let corner = 0; corner < triangles.length; corner += 3) {
        if (!(normalized(areas, corner, normal, 0) > 0)) continue;
        for (let n = corner; n < corner + 3; n++) {
          const slot = slots[triangles[n]];
          const at = 4 * slot;
          if (slot >= 0 && !(normal[0] * out[at] + normal[1] * out[at + 1] + normal[2] * out[at + 2] > HALF)) isOdd[slot] = 1;
        }
      }
    }
    this.#turnOdd(isOdd, out);
    return out;
  }

  /** Those whose faces are not all near their mean, by lists of faces. */
  #turnOdd(isOdd, out) {
    const ends = new Int32Array(isOdd.length + 1);
    const each = (take) => {
      for (const { triangles, slots, areas } of this.parts) {
        for (let n = 0; n < triangles.length; n++) {
          const slot = slots[triangles[n]];
          if (slot >= 0 && isOdd[slot]) take(slot, areas, n - (n % 3));
        }
      }
    };
    each((slot) => (ends[slot + 1] += 1));
    for (let slot = 0; slot < isOdd.length; slot++) ends[slot + 1] += ends[slot];
    const lists = new Float64Array(3 * ends[isOdd.length]);
    const next = ends.slice();
    each((slot, areas, at) => addAt(lists, 3 * next[slot]++, areas, at));
    for (let slot = 0; slot < isOdd.length; slot++) {
      if (isOdd[slot]) out.set(ofAreas(lists.subarray(3 * ends[slot], 3 * ends[slot + 1]), ends[slot + 1] - ends[slot]), 4 * slot);
    }
  }
}

/** Puts on a page, as `facing`, which way its vertices face by its own normals or triangles. What clusters share needs more: see {@link Borders}. */
export function faceAlone(page) {
  const { vertexCount } = page.cluster;
  page.facing = new Int16Array(4 * vertexCount);
  if (!page.normals) {
    const around = new Around(vertexCount);
    around.add(page, Int32Array.from({ length: vertexCount }, (_, vertex) => vertex));
    around.facing().forEach((x, i) => (page.facing[i] = Math.round(32767 * x)));
    return;
  }
  for (let vertex = 0; vertex < vertexCount; vertex++) {
    const facing = found(normalized(page.normals, 3 * vertex, FOUND, 0) > 0, TOWARD);
    for (let i = 0; i < 4; i++) page.facing[4 * vertex + i] = Math.round(32767 * facing[i]);
  }
}

/** By base vertex of a page, whether a triangle of the base mesh has it. */
export function leftOf(page) {
  if (page.left) return page.left;
  const { vertexCount, baseVertexCount } = page.cluster;
  const { targets, triangles } = page;
  const to = Uint16Array.from({ length: vertexCount }, (_, vertex) => vertex);
  for (let vertex = baseVertexCount; vertex < vertexCount; vertex++) to[vertex] = to[targets[vertex - baseVertexCount]];
  page.left = new Uint8Array(baseVertexCount);
  for (let i = 0; i < triangles.length; i += 3) {
    const [a, b, c] = [to[triangles[i]], to[triangles[i + 1]], to[triangles[i + 2]]];
    if (a !== b && b !== c && c !== a) page.left[a] = page.left[b] = page.left[c] = 1;
  }
  return page.left;
}

/** What is known of the vertices that clusters share; the same for all of them, whichever are drawn. */
export class Borders {
  /** `pageOf` answers the page of a cluster that is there. */
  constructor(file, roots, pageOf) {
    Object.assign(this, { file, roots, pageOf, known: new Map(), done: new Set() });
  }

  /**
   * Which way the vertices of a page face: four 16-bit numbers each, and the first vertex of which that is not known yet, since it needs more
   * of its group.
   */
  of(page) {
    const { vertexCount, baseVertexCount, group } = page.cluster;
    if (!page.facing) faceAlone(page);
    const array = page.facing;
    if (page.normals) return { array, turned: vertexCount };
    this.#learn(this.#above(page.cluster));
    const ids = page.ids();
    const left = leftOf(page);
    if (ids.some((id, vertex) => id >= 0 && !left[vertex])) this.#learn({ groupBorders: group });
    let turned = vertexCount;
    for (let vertex = 0; vertex < vertexCount; vertex++) {
      if (ids[vertex] < 0) continue;
      const goesOn = vertex >= baseVertexCount || left[vertex] === 1 || this.#goesOn(group, ids[vertex]);
      // The cluster's own faces tell.
      if (goesOn === false) continue;
      const known = goesOn && this.known.get(ids[vertex]);
      if (!known) turned = Math.min(turned, vertex);
      else for (let i = 0; i < 4; i++) array[4 * vertex + i] = Math.round(32767 * known[i]);
    }
    return { array, turned };
  }

  /** Whether a vertex of a group goes on to the clusters above it; undefined if a page is missing. */
  #goesOn(id, shared) {
    const group = this.file.group(id);
    if (!group || !this.file.hasMembers(group)) return undefined;
    const pages = this.file.coarse(group).map((coarse) => this.pageOf(coarse));
    if (pages.some((page) => !page)) return undefined;
    return pages.some((page) => leftOf(page)[page.ids().indexOf(shared)] === 1);
  }

  /** Those that a cluster comes with. */
  #above({ parentGroup }) {
    return this.file.group(parentGroup) ? { below: parentGroup } : { roots: true };
  }

  /** Looks at clusters, if all of their pages are there, and at those above them before. Answers whether that is done. */
  #learn(together) {
    const name = JSON.stringify(together);
    if (this.done.has(name)) return true;
    const { file } = this;
    const group = file.group(together.below ?? together.groupBorders);
    if (group && !file.hasMembers(group)) return false;
    if (group) {
      const before = file.coarse(group).map((id) => this.#above(file.cluster(id)));
      // What has collapsed in the group is there below it.
      if (together.below !== undefined) before.push({ groupBorders: group.id });
      if (!before.every((above) => this.#learn(above))) return false;
    }
    const clusters = together.roots ? this.roots : together.groupBorders === undefined ? file.fine(group) : file.coarse(group);
    const pages = clusters.map((id) => this.pageOf(id));
    if (pages.some((page) => !page)) return false;
    const found = new Map();
    // Where a cluster has lost all faces about a vertex that others go on with, it says nothing about it.
    const goingOn = new Set();
    const parts = pages.map((page) => {
      const { baseVertexCount } = page.cluster;
      const left = leftOf(page);
      const slots = Int32Array.from(page.ids(), (id, vertex) => {
        const collapses = vertex >= baseVertexCount;
        if (id < 0 || this.known.has(id) || collapses !== (together.groupBorders !== undefined)) return -1;
        if (collapses || left[vertex]) goingOn.add(id);
        if (!found.has(id)) found.set(id, found.size);
        return found.get(id);
      });
      return [page, slots];
    });
    const around = new Around(found.size);
    for (const [page, slots] of parts) around.add(page, slots);
    const facing = around.facing();
    for (const [id, slot] of found) if (goingOn.has(id)) this.known.set(id, facing.slice(4 * slot, 4 * slot + 4));
    this.done.add(name);
    return true;
  }
}
