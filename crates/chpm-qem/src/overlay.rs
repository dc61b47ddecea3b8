//! A bound on what one collapse moves: the map between the one-rings before and after it, along a common normal.
//!
//! The faces about u before a collapse u -> v and those about v after it fill one loop of edges. If both lie one-to-one over a plane, each
//! point of the old one-ring maps to the new one straight along the plane's normal. The map is linear on every cell that an old and a new
//! face have in common, so that its extremes are at the cells' corners: at the loop, where nothing moves; at u; and where an
//! old edge from u crosses a new edge from v. Their order is known from the loop alone, since both one-rings are star-shaped.

mod arrangement;
mod cells;
#[cfg(test)]
mod exact;
mod seen;

use crate::displacement::{Along, Displaced, Displacement, Reach};
use crate::ring::{NO_FACE, Pairs, Ring, bits, each};
use arrangement::{APEX, Arrangement, CORNERS, CROSSINGS, Cell};
pub(crate) use cells::CellPoint;
use nalgebra::{Point3, Vector3};
use robust::{Coord, Coord3D, orient2d, orient3d};
use seen::{Projected, Seen};
use std::ops::Range;
use wide::f64x2;

/// Rounding error of a projected area, relative to the squared size of the one-ring: coordinates lose at most 3 * 2^-53 of the size, and
/// a cross product of two of their differences less than 2^-46 of its square.
const AREA_LOSS: f64 = 1.0 / (1u64 << 46) as f64;
/// Areas below this share count as none; what passes has its sign for certain.
const AREA_SHARE: f64 = 1.0 / (1u64 << 36) as f64;
/// Rounding error of a height, relative to the size of the one-ring, with room.
const HEIGHT_LOSS: f64 = 1.0 / (1u64 << 48) as f64;

/// Where two old edges cross a new one each, as shares of them.
struct Crossing {
    on_old: f64x2,
    on_new: f64x2,
    /// Divisor of the weights.
    area: f64x2,
    /// One over that; zero for zero.
    per_area: f64x2,
}

/// How the one-rings of the last bound lie over each other.
#[derive(Clone, Copy, Debug)]
struct Laid {
    /// Of a boundary vertex, how far along the line that its boundary edges become it is, once it is there.
    share: Option<f64>,
    /// The new faces that u may lie over, first and last: several where rounding cannot tell them apart.
    sectors: [usize; 2],
    size: f64,
}

/// The one-rings before and after a collapse u -> v, seen along a normal.
#[derive(Debug)]
pub(crate) struct Overlay {
    /// The loop relative to where u is, once it is on the line that its boundary edges become.
    old: Seen,
    /// Relative to v.
    new: Seen,
    /// By corner of the arrangement, the least displacement and, with its sign turned, the largest: of both, the lesser counts. Those on the
    /// loop do not move.
    corners: Box<[f64x2; CORNERS]>,
    /// By old face, its box after the slide.
    slid: Vec<Reach>,
    /// None before a bound, and where it failed.
    laid: Option<Laid>,
}

impl Default for Overlay {
    fn default() -> Self {
        Overlay {
            old: Seen::default(),
            new: Seen::default(),
            corners: Box::new([f64x2::ZERO; CORNERS]),
            slid: Vec::new(),
            laid: None,
        }
    }
}

impl Overlay {
    /// Forgets the last bound.
    pub(crate) fn clear(&mut self) {
        self.laid = None;
    }

    /// Appends to `out` every new face with its displacements after the collapse; false if neither of two normals shows both one-rings
    /// one-to-one, and then `out` is as it was.
    pub(crate) fn bound(&mut self, ring: &Ring, of: &[Displacement], out: &mut Vec<Displaced>) -> bool {
        self.laid = None;
        if ring.len() < 3 {
            return false;
        }
        let areas = sum_from_last(ring, |area| area);
        if self.bound_along(areas, ring, of, out) {
            return true;
        }
        fn unit(area: Vector3<f64>) -> Vector3<f64> {
            area.try_normalize(0.0).unwrap_or_default()
        }
        let both = sum_from_last(ring, unit) + unit_areas_about_v(ring, unit);
        self.bound_along(both, ring, of, out)
    }

    fn bound_along(
        &mut self,
        normal: Vector3<f64>,
        ring: &Ring,
        of: &[Displacement],
        out: &mut Vec<Displaced>,
    ) -> bool {
        let Some(normal) = normal.try_normalize(0.0) else { return false };
        let (len, faces) = (ring.len(), ring.faces());
        let last = len - 1;
        let size = ring.reach().sqrt();
        let least_area = AREA_SHARE * size * size;

        // Old and new faces are seen along the normal, as loops in a plane.
        let axis = Vector3::ith(normal.iamin(), 1.0);
        let across = normal.cross(&axis).normalize();
        let (low, high) = self.old.project(ring, [across, normal.cross(&across), normal]);
        let v = self.old.at(0);
        // u on the mesh boundary first slides to the straight line that its two boundary edges become.
        let boundary = match [faces[0] == NO_FACE, faces[last] == NO_FACE] {
            [false, false] => None,
            [true, _] => Some(1),
            [_, true] => Some(last),
        };
        let (mut slide, mut foot) = (Sweep::default(), Projected::default());
        if let Some(other) = boundary {
            (slide, foot) = self.foot(ring, other);
        }
        let pairs = ring.pairs();
        self.new.relative_to(v, &self.old, pairs);
        if boundary.is_some() {
            self.old.move_to(foot, pairs);
        }

        // Both loops have to be one to one, or a point would have several images.
        if !self.is_one_to_one(boundary, ring, least_area) {
            return false;
        }
        let edge = self.old.at(0);
        self.old.find_beside(edge, pairs);
        let negative = self.new.find_beside(edge, pairs);
        let Some(sectors) = self.find_sectors(ring, boundary, negative, size) else { return false };

        // What rounding may have lost. Where the one-ring is flat, heights are within that, and only displacements matter.
        let loss = Loss {
            height: HEIGHT_LOSS * size,
            // A place on an edge is off by the share of the area that it was divided by; twice, for the two edges.
            slope: 4.0 * AREA_LOSS * size * size * (high - low),
        };
        let flat = high - low <= 256.0 * loss.height && is_flat(ring, sectors[0]);
        let still = flat && slide.is_still();
        let along = Along::new(normal);
        if !still {
            let slide = Reach::of_slide(&slide, &along);
            let slid = |old: &u32| match *old {
                NO_FACE => Reach::EMPTY,
                old => Reach::of(&of[old as usize], &slide, &along),
            };
            self.slid.clear();
            self.slid.extend(faces.iter().map(slid));
        }

        // Each new face gets what the old faces displace that it lies on, in the cells that both have in common.
        let first = out.len();
        // Whichever sector it is, its cells are among those that are taken.
        for sector in sectors[0]..=sectors[1] {
            let arrangement = Arrangement::of(len, sector);
            let heights = [v.height, foot.height];
            let on_face = boundary.is_none().then_some(sector);
            if flat {
                self.corners[..usize::from(CROSSINGS) + arrangement.crossings.len()].fill(f64x2::ZERO);
            } else if !self.find_corners(arrangement, on_face, heights, least_area, &loss) {
                out.truncate(first);
                return false;
            }
            let is_first = out.len() == first;
            for (new, cells) in arrangement.faces().enumerate() {
                let after = if still { merged(cells, faces, of) } else { self.displaced(cells, &along) };
                if is_first {
                    out.push((faces[new + 1], after));
                } else {
                    out[first + new].1.merge(&after);
                }
            }
        }
        self.laid = Some(Laid { share: boundary.map(|_| slide.share), sectors, size });
        true
    }

    /// The box of all old faces of some cells, after the slide and what the cells' corners move by.
    #[inline(always)]
    fn displaced(&self, cells: &[Cell], along: &Along) -> Displacement {
        let mut reach = Reach::EMPTY;
        for cell in cells {
            let [a, b, c, d] = cell.corners.map(|corner| self.corners[usize::from(corner) % CORNERS]);
            let length = a.fast_min(b).fast_min(c.fast_min(d));
            // No face has an empty box, which stays empty.
            reach.add(&self.slid[usize::from(cell.old)], along, length);
        }
        reach.outward(along)
    }

    /// Whether both one-rings lie one-to-one over the plane: all faces turn the same way, and the old ones go about their apex once.
    fn is_one_to_one(&self, boundary: Option<usize>, ring: &Ring, least_area: f64) -> bool {
        let (old, last, pairs) = (&self.old, ring.len() - 1, ring.pairs());
        let inner = bits(1..last);
        if self.new.larger(least_area, pairs) & inner != inner {
            return false;
        }
        let turned = match boundary {
            None => bits(0..last + 1),
            Some(1) => bits(1..last + 1),
            Some(_) => bits(0..last),
        };
        if old.larger(least_area, pairs) & turned != turned {
            return false;
        }
        match boundary {
            None => {
                // The places where the loop goes up across the axis.
                let below = old.below(pairs);
                (below & !(below >> 1) & turned).is_power_of_two()
            }
            // A half turn from one boundary edge to the other.
            Some(1) => half_turn(1, 2..last + 1, least_area, old),
            Some(_) => half_turn(0, 1..last, least_area, old),
        }
    }

    /// Where u slides on the segment from v to `l_other`, its neighbours on the mesh boundary: how far, and the place.
    fn foot(&self, ring: &Ring, other: usize) -> (Sweep, Projected) {
        let slide = Sweep::to_segment(ring.apex(), ring.point(0), ring.point(other));
        let (a, b) = (self.old.at(0), self.old.at(other));
        fn between(a: f64, b: f64, slide_share: f64) -> f64 {
            a + slide_share * (b - a)
        }
        let foot = Projected {
            x: between(a.x, b.x, slide.share),
            y: between(a.y, b.y, slide.share),
            height: between(a.height, b.height, slide.share),
        };
        (slide, foot)
    }

    /// The new faces that u may lie over, first and last. More than one only where u is so close to an edge from v that rounding
    /// decides on which side of it. The new edges that u lies to the left of have a bit in `negative`.
    fn find_sectors(
        &self,
        ring: &Ring,
        boundary: Option<usize>,
        negative: u64,
        size: f64,
    ) -> Option<[usize; 2]> {
        let last = ring.len() - 1;
        match boundary {
            Some(1) => return Some([1, 1]),
            Some(_) => return Some([last - 1, last - 1]),
            None => {}
        }
        let found = !negative & negative >> 1 & bits(1..last);
        if found == 0 {
            return None;
        }
        let (sector, beside) = (found.trailing_zeros() as usize, each(&self.new.beside));
        let least = AREA_LOSS * size * size;
        // On the edge itself the cells of either side are right: what is between them has no area.
        let may_pass =
            |i: usize| beside[i].abs() <= least && !is_straight(ring.point(0), ring.apex(), ring.point(i));
        let (mut low, mut high) = (sector, sector);
        while low > 1 && may_pass(low) {
            low -= 1;
        }
        while high + 1 < last && may_pass(high + 1) {
            high += 1;
        }
        Some([low, high])
    }

    /// Weights of u for the two loop vertices that it lies between in the new face there, and their divisor.
    fn apex_shares(&self, sector: usize) -> ([f64; 2], f64) {
        let area = self.new.at(sector).cross(self.new.at(sector + 1));
        let per_area = 1.0 / area;
        let beside = each(&self.new.beside);
        let of_a = -beside[sector + 1] * per_area;
        ([of_a.clamp(0.0, 1.0), (beside[sector] * per_area).clamp(0.0, 1.0)], area)
    }

    /// The displacements at the corners of all cells, given the heights of v and of u, and the new face that u is over; none on the
    /// mesh boundary. False if two edges that cross are too close to parallel.
    fn find_corners(
        &mut self,
        arrangement: &Arrangement,
        sector: Option<usize>,
        [v, foot]: [f64; 2],
        least_area: f64,
        loss: &Loss,
    ) -> bool {
        let mut parallel = false;
        let mut place = usize::from(CROSSINGS);
        let (twos, rest) = arrangement.crossings.as_chunks();
        // An odd one out is done twice.
        let last = rest.iter().map(|last| [*last; 2]);
        for [first, second] in twos.iter().copied().chain(last) {
            let Crossing { on_old, on_new, area, per_area } = self.crossings([first, second]);
            parallel |= area.abs().simd_le(f64x2::splat(least_area)).any();
            let old = pick(&self.old.height, [first.0, second.0]);
            let new = pick(&self.new.height, [first.1, second.1]);
            let displacement = (f64x2::splat(v) + on_new * new) - (f64x2::splat(foot) + on_old * old);
            for corner in loss.about(displacement, per_area) {
                self.corners[place % CORNERS] = corner;
                place += 1;
            }
        }
        self.corners[usize::from(APEX)] = f64x2::ZERO;
        if let Some(sector) = sector {
            // How far the new one-ring is above u.
            let ([of_a, of_b], area) = self.apex_shares(sector);
            let (a, b) = (each(&self.new.height)[sector], each(&self.new.height)[sector + 1]);
            let displacement = f64x2::splat(v + of_a * a + of_b * b);
            self.corners[usize::from(APEX)] = loss.about(displacement, f64x2::splat(1.0 / area))[0];
        }
        !parallel
    }

    /// Where the old edge to l_a and the new one to l_b cross, of two such pairs.
    #[inline]
    fn crossings(&self, [(a, b), (c, d)]: [(u16, u16); 2]) -> Crossing {
        let (old, new) = ([a, c], [b, d]);
        let area =
            pick(&self.old.x, old) * pick(&self.new.y, new) - pick(&self.old.y, old) * pick(&self.new.x, new);
        // Of parallel edges any place will do, but not one that is no number: their loss covers both edges.
        let per_area = (f64x2::ONE / area) & area.simd_ne(f64x2::ZERO);
        fn share(of: f64x2, per_area: f64x2) -> f64x2 {
            f64x2::ONE.fast_min(f64x2::ZERO.fast_max(of * per_area))
        }
        let (on_old, on_new) = (pick(&self.new.beside, new), pick(&self.old.beside, old));
        Crossing { on_old: share(on_old, per_area), on_new: share(on_new, per_area), area, per_area }
    }
}

/// Two of the numbers.
#[inline]
fn pick(pairs: &Pairs, places: [u16; 2]) -> f64x2 {
    f64x2::new(places.map(|place| each(pairs)[usize::from(place)]))
}

fn half_turn(start: usize, others: Range<usize>, least_area: f64, old: &Seen) -> bool {
    let start = old.at(start);
    others.into_iter().all(|i| start.cross(old.at(i)) > least_area)
}

/// The box of all old faces of some cells, of which no point moves.
fn merged(cells: &[Cell], faces: &[u32], of: &[Displacement]) -> Displacement {
    let old = cells.iter().map(|cell| faces[usize::from(cell.old)]).filter(|old| *old != NO_FACE);
    old.fold(Displacement::EMPTY, |mut all, old| {
        all.merge(&of[old as usize]);
        all
    })
}

/// Whether u and the loop are in one plane, exactly.
fn is_flat(ring: &Ring, sector: usize) -> bool {
    let [a, b, c] = [0, sector, sector + 1].map(|i| coord(ring.point(i)));
    let on_plane = |p: Point3<f64>| orient3d(a, b, c, coord(p)) == 0.0;
    on_plane(ring.apex()) && (0..ring.len()).all(|i| on_plane(ring.point(i)))
}

/// Sum of something of the areas of a loop, from that before v on.
#[inline]
fn sum_from_last(ring: &Ring, of: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
    let ([x, y, z], len) = (ring.areas().each_ref().map(each), ring.len());
    let at = |i: usize| of(Vector3::new(x[i], y[i], z[i]));
    (0..len - 1).fold(at(len - 1), |sum, i| sum + at(i))
}

/// The same of the areas of the faces that v makes with the loop.
fn unit_areas_about_v(ring: &Ring, of: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
    let (len, v) = (ring.len(), ring.arm(0));
    let mut sum = Vector3::zeros();
    let mut a = ring.arm(len - 1) - v;
    for i in 0..len {
        let b = ring.arm(i) - v;
        sum += of(a.cross(&b));
        a = b;
    }
    sum
}

/// How far points go when one vertex slides to a segment: between nothing and all of it.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Sweep {
    /// Componentwise least displacement.
    pub(crate) lo: Vector3<f64>,
    /// Componentwise largest displacement.
    pub(crate) hi: Vector3<f64>,
    /// Where on the segment it ends.
    pub(crate) share: f64,
}

impl Sweep {
    fn is_still(&self) -> bool {
        self.lo == self.hi
    }

    /// From `point` to the place nearest to it between `a` and `b`.
    pub(crate) fn to_segment(point: Point3<f64>, a: Point3<f64>, b: Point3<f64>) -> Self {
        let along = b - a;
        let squared = along.norm_squared();
        let share = if squared > 0.0 { ((point - a).dot(&along) / squared).clamp(0.0, 1.0) } else { 0.0 };
        if is_straight(a, point, b) {
            return Sweep { share, ..Sweep::default() };
        }
        let step = (a - point) + share * along;
        let slack = Vector3::repeat(HEIGHT_LOSS * (along.norm() + step.norm()));
        let zero = Vector3::zeros();
        Sweep { lo: step.inf(&zero) - slack, hi: step.sup(&zero) + slack, share }
    }
}

/// Rounding error of a displacement.
struct Loss {
    /// To a height.
    height: f64,
    /// To a height that is interpolated at a place on two edges, times the area that gave the place.
    slope: f64,
}

impl Loss {
    /// The intervals that two true displacements are in, their ends with the sign turned.
    #[inline]
    fn about(&self, displacement: f64x2, per_area: f64x2) -> [f64x2; 2] {
        let loss = self.height + self.slope * per_area.abs();
        f64x2::transpose([displacement - loss, -(displacement + loss)])
    }
}

fn coord(p: Point3<f64>) -> Coord3D<f64> {
    Coord3D { x: p.x, y: p.y, z: p.z }
}

/// Whether `b` lies on the line through `a` and `c`, between them, exactly.
fn is_straight(a: Point3<f64>, b: Point3<f64>, c: Point3<f64>) -> bool {
    (a - b).dot(&(c - b)) <= 0.0
        && straight(0, 1, &a, &b, &c)
        && straight(1, 2, &a, &b, &c)
        && straight(2, 0, &a, &b, &c)
}

fn straight(i: usize, j: usize, a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>) -> bool {
    let [a, b, c] = [*a, *b, *c].map(|p| Coord { x: p[i], y: p[j] });
    orient2d(a, b, c) == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_edges_cross_at_a_number() {
        let mut overlay = Overlay::default();
        for seen in [&mut overlay.old, &mut overlay.new] {
            (seen.x[0], seen.y[0]) = (f64x2::splat(1.0), f64x2::splat(2.0));
        }
        let Crossing { on_old, on_new, area, .. } = overlay.crossings([(1, 1); 2]);
        assert_eq!([on_old, on_new, area], [f64x2::ZERO; 3]);
    }
}
