// The vertices of a page, one for each chart that a vertex is drawn in: so each has one place in the sheet, at every position.

/** The charts of each vertex: lists, of which 0 is the end. */
class Lists {
  constructor(count) {
    this.first = new Int32Array(count);
    this.lengths = new Uint32Array(count);
    this.next = [0];
    this.chart = [0];
  }

  add(vertex, chart) {
    for (let at = this.first[vertex]; at > 0; at = this.next[at]) if (this.chart[at] === chart) return;
    this.next.push(this.first[vertex]);
    this.first[vertex] = this.chart.push(chart) - 1;
    this.lengths[vertex] += 1;
  }

  /** Adds all of one vertex to another. */
  join(vertex, to) {
    for (let at = this.first[vertex]; at > 0; at = this.next[at]) this.add(to, this.chart[at]);
  }
}

/**
 * `vertexOf` each copy, in the order of the vertices, and `places`, two shares of the sheet's width and height for each.
 */
export class Copies {
  #corners;
  #targets;

  constructor(page, sheet) {
    const { vertexCount: v, baseVertexCount: b } = page.cluster;
    const { triangles, targets } = page;
    const { chartOf } = sheet;
    const lists = new Lists(v);
    for (let corner = 0; corner < triangles.length; corner++) lists.add(triangles[corner], chartOf[Math.floor(corner / 3)]);
    // Where a vertex collapses to, its triangles stay in their charts.
    for (let vertex = v - 1; vertex >= b; vertex--) lists.join(vertex, targets[vertex - b]);

    const starts = new Uint32Array(v + 1);
    for (let vertex = 0; vertex < v; vertex++) starts[vertex + 1] = starts[vertex] + lists.lengths[vertex];
    const count = starts[v];
    const charts = new Uint16Array(count);
    this.vertexOf = new Uint16Array(count);
    this.places = new Float32Array(2 * count);
    for (let vertex = 0, copy = 0; vertex < v; vertex++) {
      for (let at = lists.first[vertex]; at > 0; at = lists.next[at], copy++) {
        charts[copy] = lists.chart[at];
        this.vertexOf[copy] = vertex;
        sheet.place(charts[copy], page.positions, vertex, this.places, 2 * copy);
      }
    }
    const find = (vertex, chart) => {
      let copy = starts[vertex];
      while (charts[copy] !== chart) copy += 1;
      return copy;
    };
    this.#corners = Uint32Array.from(triangles, (vertex, corner) => find(vertex, chartOf[Math.floor(corner / 3)]));
    this.#targets = Uint32Array.from(charts, (chart, copy) => (this.vertexOf[copy] < b ? copy : find(targets[this.vertexOf[copy] - b], chart)));
  }

  get count() {
    return this.vertexOf.length;
  }

  /** What vertices have, `size` values each, for their copies. */
  of(values, size) {
    const all = new values.constructor(size * this.count);
    for (let copy = 0, at = 0; copy < this.count; copy++) {
      for (let i = 0; i < size; i++) all[at++] = values[size * this.vertexOf[copy] + i];
    }
    return all;
  }

  /** Three copies for each triangle of the mesh of `n` vertices, in the order of {@link Page.indices}. */
  indices(n) {
    const map = new Uint32Array(this.count);
    // A target is a vertex before its own, so its copies are there already.
    for (let copy = 0; copy < map.length; copy++) map[copy] = this.vertexOf[copy] < n ? copy : map[this.#targets[copy]];
    const all = this.count > 0x10000 ? new Uint32Array(this.#corners.length) : new Uint16Array(this.#corners.length);
    let length = 0;
    for (let i = 0; i < all.length; i += 3) {
      const [a, b, c] = [map[this.#corners[i]], map[this.#corners[i + 1]], map[this.#corners[i + 2]]];
      if (a === b || b === c || c === a) continue;
      all[length] = a;
      all[length + 1] = b;
      all[length + 2] = c;
      length += 3;
    }
    return all.subarray(0, length);
  }
}
