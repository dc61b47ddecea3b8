// Which way a smooth surface faces at a vertex, of models without normals: as `gpu/facing.rs` and `scene/borders.rs` of the viewer have it, where
// it says why.

/** Cosine of the crease angle, 40 degrees, and of half of it. */
const CREASE = Math.cos((40 * Math.PI) / 180);
const HALF = Math.cos((20 * Math.PI) / 180);
const [SHEET, ALONG, NEEDLE, MANY] = [0.34, 0.17, 0.04, 128];
const [FLAT, TOWARD, ALONG_IT] = [0, 1, -1];

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const sum = (all) => all.reduce((a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]], [0, 0, 0]);

function unit(v) {
  const longest = Math.max(Math.abs(v[0]), Math.abs(v[1]), Math.abs(v[2]));
  if (!(longest > 0 && longest < Infinity)) return null;
  const even = v.map((x) => x / longest);
  const length = Math.hypot(...even);
  return even.map((x) => x / length);
}

/** Four numbers from -1 to 1: a direction, and what it is; of no direction, none. */
function packed(direction, kind) {
  return direction ? [...direction, kind] : [0, 0, 0, FLAT];
}

/**
 * What a pixel makes of its face's plane at a vertex, by the normals of the faces about it, each as long as its area: a smooth surface has
 * its mean, a crease its line, a corner nothing.
 */
export function ofFaces(areas) {
  const whole = sum(areas);
  const mean = unit(whole);
  const faces = areas.map((area) => ({ area, normal: unit(area) })).filter(({ normal }) => normal);
  if (mean && faces.every(({ normal }) => dot(normal, mean) > HALF)) return packed(mean, TOWARD);
  if (areas.length > MANY) {
    const isSmooth = mean && faces.every(({ normal }) => dot(normal, mean) > CREASE);
    return packed(isSmooth ? mean : null, TOWARD);
  }
  const sums = groups(faces);
  if (sums.length < 2) return packed(unit(sum(sums)), TOWARD);
  const means = sums.map(unit);
  if (means.some((mean) => !mean)) return packed(null);

  let [sine, line] = [0, null];
  means.forEach((a, i) => {
    for (const b of means.slice(i + 1)) {
      const across = cross(a, b);
      if (Math.hypot(...across) >= sine) [sine, line] = [Math.hypot(...across), unit(across)];
    }
  });
  // Both sides of a sheet, or faces that go around either way.
  if (!(sine > SHEET)) return packed(unit(means[0].map((x, axis) => x - means.at(-1)[axis])), TOWARD);
  return packed(means.every((mean) => Math.abs(dot(mean, line)) < ALONG) ? line : null, ALONG_IT);
}

/** Sums of the areas of faces that are smooth with one another, by one after the other, without needles. */
function groups(faces) {
  const of = faces.map((_, face) => face);
  for (let face = 0; face < faces.length; face++) {
    for (let before = 0; before < face; before++) {
      const [low, high] = [Math.min(of[face], of[before]), Math.max(of[face], of[before])];
      if (low === high || dot(faces[face].normal, faces[before].normal) <= CREASE) continue;
      of.forEach((group, i) => group === high && (of[i] = low));
    }
  }
  const size = (areas) => areas.reduce((all, area) => all + Math.hypot(...area), 0);
  const all = size(faces.map(({ area }) => area));
  const members = [...new Set(of)].map((first) => faces.filter((_, i) => of[i] === first).map(({ area }) => area));
  return members.filter((areas) => areas.length > 2 || size(areas) >= NEEDLE * all).map(sum);
}

/** The normal of a triangle, as long as twice its area. */
function areaOf({ positions, triangles }, corner) {
  const [a, b, c] = [0, 1, 2].map((i) => 3 * triangles[corner + i]);
  const way = (to) => [0, 1, 2].map((axis) => positions[to + axis] - positions[a + axis]);
  return cross(way(b), way(c));
}

/** For each vertex that `slots` gives a number, the faces about it. */
function facesOf(page, slots, faces) {
  const { triangles } = page;
  for (let corner = 0; corner < triangles.length; corner += 3) {
    let area = null;
    for (let i = corner; i < corner + 3; i++) {
      const slot = slots[triangles[i]];
      if (slot >= 0) (faces[slot] ??= []).push((area ??= areaOf(page, corner)));
    }
  }
}

const pack = (array, vertex, values) => array.set(values.map((x) => Math.round(32767 * x)), 4 * vertex);

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
    const array = new Int16Array(4 * vertexCount);
    if (page.normals) {
      for (let vertex = 0; vertex < vertexCount; vertex++) pack(array, vertex, packed(unit([...page.normals.subarray(3 * vertex, 3 * vertex + 3)]), TOWARD));
      return { array, turned: vertexCount };
    }
    this.#learn(this.#above(page.cluster));
    const ids = page.ids();
    if (ids.subarray(baseVertexCount).some((id) => id >= 0)) this.#learn({ groupBorders: group });
    const faces = [];
    const slots = ids.map((id, vertex) => (this.known.has(id) ? -1 : vertex));
    facesOf(page, slots, faces);
    let turned = vertexCount;
    for (let vertex = 0; vertex < vertexCount; vertex++) {
      const known = this.known.get(ids[vertex]);
      if (!known && ids[vertex] >= 0) turned = Math.min(turned, vertex);
      pack(array, vertex, known ?? ofFaces(faces[vertex] ?? []));
    }
    return { array, turned };
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
    if (together.below !== undefined) {
      // What has collapsed in the group is there below it.
      const before = [...file.coarse(group).map((id) => this.#above(file.cluster(id))), { groupBorders: group.id }];
      if (!before.every((above) => this.#learn(above))) return false;
    }
    const clusters = together.roots ? this.roots : together.groupBorders === undefined ? file.fine(group) : file.coarse(group);
    const pages = clusters.map((id) => this.pageOf(id));
    if (pages.some((page) => !page)) return false;
    const [faces, found] = [[], new Map()];
    for (const page of pages) {
      const slots = page.ids().map((id, vertex) => {
        const collapses = vertex >= page.cluster.baseVertexCount;
        if (id < 0 || this.known.has(id) || collapses !== (together.groupBorders !== undefined)) return -1;
        if (!found.has(id)) found.set(id, found.size);
        return found.get(id);
      });
      facesOf(page, slots, faces);
    }
    for (const [id, slot] of found) this.known.set(id, ofFaces(faces[slot] ?? []));
    this.done.add(name);
    return true;
  }
}
