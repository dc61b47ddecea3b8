// What groups hold, with all that is below: spheres and boxes that nest, and errors that never grow downward. The library has the same as its
// `Hierarchy`. For this, all tables have to be there.

/** What a sum of distances may lose to rounding. */
const ROUNDING = 1 + 4 * Number.EPSILON;

export class Regions {
  /** @param file an open file with all of its tables: {@link ChpmFile.needTables} */
  constructor(file) {
    const { groupCount } = file.header;
    /** Smallest corners and largest ones, relative to the file's origin. */
    this.low = new Float64Array(3 * groupCount).fill(Infinity);
    this.high = new Float64Array(3 * groupCount).fill(-Infinity);
    this.radius = new Float64Array(groupCount);
    /** Below this bound a group is split; negative where there is nothing below. */
    this.splitError = new Float64Array(groupCount);
    const groups = Array.from({ length: groupCount }, (_, id) => file.group(id));
    for (const group of groups.sort((a, b) => a.level - b.level)) this.#add(file, group);
  }

  /** A group of which all that are below have been added. */
  #add(file, group) {
    const { id, sphere, fineCount, minError } = group;
    this.radius[id] = sphere.radius;
    this.splitError[id] = fineCount === 0 ? -1 : minError;
    for (const coarse of file.coarse(group)) {
      const { boxMin, boxMax } = file.cluster(coarse);
      this.#widen(id, boxMin, boxMax, 0);
    }
    for (const fine of file.fine(group)) {
      const below = file.group(file.cluster(fine).group);
      const [x, y, z] = sphere.center.map((from, axis) => from - below.sphere.center[axis]);
      const reach = (Math.sqrt(x * x + y * y + z * z) + this.radius[below.id]) * ROUNDING;
      this.radius[id] = Math.max(this.radius[id], reach);
      this.splitError[id] = Math.max(this.splitError[id], this.splitError[below.id]);
      this.#widen(id, this.low, this.high, 3 * below.id);
    }
  }

  #widen(id, low, high, from) {
    for (let axis = 0; axis < 3; axis++) {
      this.low[3 * id + axis] = Math.min(this.low[3 * id + axis], low[from + axis]);
      this.high[3 * id + axis] = Math.max(this.high[3 * id + axis], high[from + axis]);
    }
  }
}
