// Clusters that come go from their base meshes, where they look like what was drawn before, to the mesh that is wanted: by a pixel of error in the time of a
// frame, a sixtieth of a second; by more where frames take longer, so that slow machines are done as soon.

/** From so many pixels on, by a share of them. */
const MANY = 8;
/** Time of a frame, ms. */
const FRAME = 1000 / 60;

export class Glide {
  constructor() {
    /** The bound that each group is drawn with. */
    this.bounds = new Map();
    this.isGliding = false;
    this.before = 0;
  }

  /** A cut with the bounds of this frame; `pixels` is what the whole cut allows. Bounds are of groups, so that their clusters go alike. */
  ease(file, cut, pixels, now = performance.now()) {
    const known = this.bounds;
    // After a rest, what comes begins where it was, too.
    const frames = this.isGliding ? Math.max(1, (now - this.before) / FRAME) : 1;
    this.before = now;
    this.bounds = new Map();
    this.isGliding = false;
    return cut.map((member) => {
      const { group, maxError } = file.cluster(member.cluster);
      if (member.bound === Infinity || !(pixels > 0)) return member;
      let bound = this.bounds.get(group);
      if (bound === undefined) {
        const from = known.get(group) ?? file.group(group)?.maxError ?? maxError;
        const step = Math.max((frames * member.bound) / pixels, from * (1 - (1 - 1 / MANY) ** frames));
        bound = Math.max(member.bound, from - step);
        this.bounds.set(group, bound);
      }
      if (bound > member.bound) this.isGliding = true;
      return { ...member, bound };
    });
  }
}
