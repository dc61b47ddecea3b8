// A cut as one mesh, without cracks: vertices that clusters share are one.

/**
 * The mesh of a cut.
 * @param file an open file
 * @param {{ cluster: number, bound: number }[]} cut
 * @returns positions in the model's coordinates (doubles, origin included), corners of triangles, normals and colours where the file has
 *   them, an array of values for each named scalar by its name, and the largest error that is drawn
 */
export async function extract(file, cut, { signal } = {}) {
  const { origin, hasNormals, hasColors, scalars } = file.header;
  const values = scalars.map(() => []);
  const bounds = new Map(cut.map(({ cluster, bound }) => [cluster, bound]));
  const [positions, normals, colors, triangles] = [[], [], [], []];
  const byId = new Map();
  let error = 0;
  await file.eachPage(
    bounds.keys(),
    (page) => {
      const n = page.position(bounds.get(page.cluster.id));
      error = Math.max(error, page.errorAt(n));
      const ids = page.ids();
      const own = scalars.map((scalar) => page.scalar(scalar));
      const numbers = new Float64Array(n).fill(-1);
      const number = (vertex) => {
        if (numbers[vertex] >= 0) return numbers[vertex];
        const id = ids[vertex];
        let known = id >= 0 ? byId.get(id) : undefined;
        if (known === undefined) {
          known = positions.length / 3;
          if (id >= 0) byId.set(id, known);
          for (let axis = 0; axis < 3; axis++) positions.push(page.positions[3 * vertex + axis] + origin[axis]);
          if (hasNormals) normals.push(...page.normals.subarray(3 * vertex, 3 * vertex + 3));
          own.forEach((of, at) => values[at].push(of[vertex]));
          if (hasColors) colors.push(...page.colors.subarray(4 * vertex, 4 * vertex + 4));
        }
        numbers[vertex] = known;
        return known;
      };
      for (const corner of page.indices(n)) triangles.push(number(corner));
    },
    signal,
  );
  return {
    positions: Float64Array.from(positions),
    triangles: Uint32Array.from(triangles),
    normals: hasNormals ? Float32Array.from(normals) : null,
    colors: hasColors ? Uint8Array.from(colors) : null,
    scalars: new Map(scalars.map(({ name, words }, at) => [name, (words === 2 ? Float64Array : Float32Array).from(values[at])])),
    error,
  };
}
