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
use crate::ring::{NO_FACE, RingView};
use arrangement::{APEX, Arrangement, CROSSINGS, Cell};
pub(crate) use cells::CellPoint;
use nalgebra::{Point3, Vector3};
use robust::{Coord, Coord3D, orient2d, orient3d};
use seen::{Projected, ROOM, Seen};
use std::ops::Range;

/// Rounding error of a projected area, relative to the squared size of the one-ring: coordinates lose at most 3 * 2^-53 of the size, and
/// a cross product of two of their differences less than 2^-46 of its square.
const AREA_LOSS: f64 = 1.0 / (1u64 << 46) as f64;
/// Areas below this share count as none; what passes has its sign for certain.
const AREA_SHARE: f64 = 1.0 / (1u64 << 36) as f64;
/// Rounding error of a height, relative to the size of the one-ring, with room.
const HEIGHT_LOSS: f64 = 1.0 / (1u64 << 48) as f64;

/// Where an old and a new edge cross, as shares of them.
struct Crossing {
    on_old: f64,
    on_new: f64,
    /// Divisor of the weights.
    area: f64,
    /// One over that; zero for zero.
    per_area: f64,
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
#[derive(Debug, Default)]
pub(crate) struct Overlay {
    /// The loop relative to where u is, once it is on the line that its boundary edges become.
    old: Seen,
    /// Relative to v.
    new: Seen,
    /// By corner of the arrangement, the least displacement and, with its sign turned, the largest: of both, the lesser counts.
    corners: Vec<[f64; 2]>,
    /// By old face, its box after the slide.
    slid: Vec<Reach>,
    /// None before a bound, and where it failed.
    laid: Option<Laid>,
}

impl Overlay {
    /// Forgets the last bound.
    pub(crate) fn clear(&mut self) {
        self.laid = None;
    }

    /// Appends to `out` every new face with its displacements after the collapse; false if neither of two normals shows both one-rings
    /// one-to-one, and then `out` is as it was.
    pub(crate) fn bound(
        &mut self,
        ring: RingView<'_>,
        of: &[Displacement],
        out: &mut Vec<Displaced>,
    ) -> bool {
        self.laid = None;
        if ring.len() < 3 {
            return false;
        }
        let areas = sum_from_last(ring.areas(), |area| area);
        if self.bound_along(areas, ring, of, out) {
            return true;
        }
        fn unit(area: Vector3<f64>) -> Vector3<f64> {
            area.try_normalize(0.0).unwrap_or_default()
        }
        let both = sum_from_last(ring.areas(), unit) + unit_areas_about_v(ring, unit);
        self.bound_along(both, ring, of, out)
    }

    fn bound_along(
        &mut self,
        normal: Vector3<f64>,
        ring: RingView<'_>,
        of: &[Displacement],
        out: &mut Vec<Displaced>,
    ) -> bool {
        let Some(normal) = normal.try_normalize(0.0) else { return false };
        let (len, faces) = (ring.len(), ring.faces());
        let last = len - 1;
        let size = ring.reach().sqrt();
        let least_area = AREA_SHARE * size * size;

        // Old and new faces are seen along the normal, as loops in a plane.
        self.project(normal, ring);
        let v = self.old.at(0);
        let (low, high) = self.old.heights(len);
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
        self.new.relative_to(v, &self.old, len);
        if boundary.is_some() {
            self.old.move_to(foot);
        }

        // Both loops have to be one to one, or a point would have several images.
        if !self.is_one_to_one(boundary, last, least_area) {
            return false;
        }
        let edge = self.old.at(0);
        self.old.find_beside(edge, len);
        self.new.find_beside(edge, len);
        let Some(sectors) = self.find_sectors(ring, boundary, size) else { return false };

        // What rounding may have lost. Where the one-ring is flat, heights are within that, and only displacements matter.
        let loss = Loss {
            height: HEIGHT_LOSS * size,
            // A place on an edge is off by the share of the area that it was divided by; twice, for the two edges.
            slope: 4.0 * AREA_LOSS * size * size * (high - low),
        };
        let flat = high - low <= 256.0 * loss.height && is_flat(ring, sectors[0]);
        let still = flat && slide.is_still();
        if !still {
            self.slid.clear();
            self.slid.extend(faces.iter().map(|old| {
                if *old == NO_FACE { Reach::EMPTY } else { Reach::of(&of[*old as usize], &slide) }
            }));
        }

        // Each new face gets what the old faces displace that it lies on, in the cells that both have in common.
        let along = Along::new(normal);
        let first = out.len();
        // Whichever sector it is, its cells are among those that are taken.
        for sector in sectors[0]..=sectors[1] {
            let arrangement = Arrangement::of(len, sector);
            let heights = [v.height, foot.height];
            let on_face = boundary.is_none().then_some(sector);
            if flat {
                self.corners.clear();
                self.corners.resize(usize::from(CROSSINGS) + arrangement.crossings.len(), [0.0; 2]);
            } else if !self.find_corners(arrangement, on_face, heights, least_area, &loss) {
                out.truncate(first);
                return false;
            }
            for new in 1..last {
                let cells = arrangement.cells(new);
                let after = if still { merged(cells, faces, of) } else { self.displaced(cells, &along) };
                match out.get_mut(first + new - 1) {
                    Some((_, all)) => all.merge(&after),
                    None => out.push((faces[new], after)),
                }
            }
        }
        self.laid = Some(Laid { share: boundary.map(|_| slide.share), sectors, size });
        true
    }

    /// The box of all old faces of some cells, after the slide and what the cells' corners move by.
    #[inline]
    fn displaced(&self, cells: &[Cell], along: &Along) -> Displacement {
        let mut reach = Reach::EMPTY;
        for cell in cells {
            let mut ends = [f64::INFINITY; 2];
            for corner in cell.corners {
                let at = self.corners[usize::from(corner)];
                for end in 0..2 {
                    ends[end] = if at[end] < ends[end] { at[end] } else { ends[end] };
                }
            }
            // No face has an empty box, which stays empty.
            reach.add(&self.slid[usize::from(cell.old)], along, ends[0], -ends[1]);
        }
        reach.outward()
    }

    /// Projects the loop.
    fn project(&mut self, normal: Vector3<f64>, ring: RingView<'_>) {
        let axis = Vector3::ith(normal.iamin(), 1.0);
        let across = normal.cross(&axis).normalize();
        let up = normal.cross(&across);
        let [x, y, z] = ring.arms();
        let old = &mut self.old;
        for (i, ((x, y), z)) in x.iter().zip(y).zip(z).enumerate().take(ROOM) {
            old.x[i] = across.x * x + across.y * y + across.z * z;
            old.y[i] = up.x * x + up.y * y + up.z * z;
            old.height[i] = normal.x * x + normal.y * y + normal.z * z;
        }
    }

    /// Whether both one-rings lie one-to-one over the plane: all faces turn the same way, and the old ones go about their apex once.
    fn is_one_to_one(&self, boundary: Option<usize>, last: usize, least_area: f64) -> bool {
        let old = &self.old;
        if !self.new.are_larger(1..last, least_area) {
            return false;
        }
        match boundary {
            None => old.are_larger(0..last + 1, least_area) && old.rises(last + 1) == 1,
            // A half turn from one boundary edge to the other.
            Some(1) => old.are_larger(1..last + 1, least_area) && half_turn(1, 2..last + 1, least_area, old),
            Some(_) => old.are_larger(0..last, least_area) && half_turn(0, 1..last, least_area, old),
        }
    }

    /// Where u slides on the segment from v to `l_other`, its neighbours on the mesh boundary: how far, and the place.
    fn foot(&self, ring: RingView<'_>, other: usize) -> (Sweep, Projected) {
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
    /// decides on which side of it.
    fn find_sectors(&self, ring: RingView<'_>, boundary: Option<usize>, size: f64) -> Option<[usize; 2]> {
        let last = ring.len() - 1;
        match boundary {
            Some(1) => return Some([1, 1]),
            Some(_) => return Some([last - 1, last - 1]),
            None => {}
        }
        let beside = &self.new.beside[..=last];
        let sector = (1..last).find(|&i| beside[i] >= 0.0 && beside[i + 1] < 0.0)?;
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
        let of_a = -self.new.beside[sector + 1] * per_area;
        ([of_a.clamp(0.0, 1.0), (self.new.beside[sector] * per_area).clamp(0.0, 1.0)], area)
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
        let mut corners = std::mem::take(&mut self.corners);
        corners.clear();
        corners.resize(usize::from(CROSSINGS), [0.0; 2]);
        let mut parallel = false;
        corners.extend(arrangement.crossings.iter().map(|&(a, b)| {
            let Crossing { on_old, on_new, area, per_area } = self.crossing(a, b);
            parallel |= area.abs() <= least_area;
            let [old, new] = [self.old.height[usize::from(a)], self.new.height[usize::from(b)]];
            loss.about((v + on_new * new) - (foot + on_old * old), per_area)
        }));
        if let Some(sector) = sector {
            // How far the new one-ring is above u.
            let ([of_a, of_b], area) = self.apex_shares(sector);
            let (a, b) = (self.new.height[sector], self.new.height[sector + 1]);
            corners[usize::from(APEX)] = loss.about(v + of_a * a + of_b * b, 1.0 / area);
        }
        self.corners = corners;
        !parallel
    }

    /// Where the old edge to l_a and the new one to l_b cross.
    #[inline]
    fn crossing(&self, a: u16, b: u16) -> Crossing {
        let (a, b) = (usize::from(a), usize::from(b));
        let area = self.old.at(a).cross(self.new.at(b));
        // Of parallel edges any place will do, but not one that is no number: their loss covers both edges.
        let per_area = if area == 0.0 { 0.0 } else { 1.0 / area };
        fn share(of: f64, per_area: f64) -> f64 {
            (of * per_area).clamp(0.0, 1.0)
        }
        Crossing {
            on_old: share(self.new.beside[b], per_area),
            on_new: share(self.old.beside[a], per_area),
            area,
            per_area,
        }
    }
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
fn is_flat(ring: RingView<'_>, sector: usize) -> bool {
    let [a, b, c] = [0, sector, sector + 1].map(|i| coord(ring.point(i)));
    let on_plane = |p: Point3<f64>| orient3d(a, b, c, coord(p)) == 0.0;
    on_plane(ring.apex()) && (0..ring.len()).all(|i| on_plane(ring.point(i)))
}

/// Sum of something of the areas of a loop, from that before v on.
#[inline]
fn sum_from_last([x, y, z]: [&[f64]; 3], of: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
    let len = x.len() - 1;
    let at = |i: usize| of(Vector3::new(x[i], y[i], z[i]));
    (0..len - 1).fold(at(len - 1), |sum, i| sum + at(i))
}

/// The same of the areas of the faces that v makes with the loop.
fn unit_areas_about_v(ring: RingView<'_>, of: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
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
    /// The interval that the true displacement is in, its end with the sign turned.
    fn about(&self, displacement: f64, per_area: f64) -> [f64; 2] {
        let loss = self.height + self.slope * per_area.abs();
        [displacement - loss, -(displacement + loss)]
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
            (seen.x[1], seen.y[1]) = (1.0, 2.0);
        }
        let Crossing { on_old, on_new, area, .. } = overlay.crossing(1, 1);
        assert_eq!((on_old, on_new, area), (0.0, 0.0, 0.0));
    }
}
