//! A bound on what one collapse moves: the map between the fans before and after it, along a common normal.
//!
//! The faces about u before a collapse u -> v and those about v after it fill one loop of edges. If both lie one-to-one over a plane, each
//! point of the old fan maps to the new one straight along the plane's normal. The map is linear on every cell that an old and a new
//! face have in common, so that its extremes are at the cells' corners: at the loop, where nothing moves; at u; and where an
//! old edge from u crosses a new edge from v. Their order is known from the loop alone, since both fans are star-shaped.

mod cells;

use crate::displacement::Displacement;
use crate::fan::MAX_VALENCE;
pub(crate) use cells::{Corner, Place};
use nalgebra::{Point3, Vector3};
use robust::{Coord, Coord3D, orient2d, orient3d};
use std::ops::Range;

/// Most vertices of a loop: a boundary vertex of the highest valence has one more than faces.
pub(crate) const MAX_LOOP: usize = MAX_VALENCE + 1;
/// What f64 can lose of a projected area, as a share of the fan's squared size: coordinates lose at most 3 * 2^-53 of the size, and
/// a cross product of two of their differences less than 2^-46 of its square.
const AREA_LOSS: f64 = 1.0 / (1u64 << 46) as f64;
/// Areas below this share count as none; what passes has its sign for certain.
const AREA_SHARE: f64 = 1.0 / (1u64 << 36) as f64;
/// What f64 can lose of a height, as a share of the fan's size, and more.
const HEIGHT_LOSS: f64 = 1.0 / (1u64 << 48) as f64;

/// "The loop's edge to or from v has no face": v is the next vertex on the mesh boundary.
pub(crate) const NO_FACE: u32 = u32::MAX;

/// A point relative to u, seen along the normal.
#[derive(Clone, Copy, Default, Debug)]
struct Projected {
    x: f64,
    y: f64,
    height: f64,
}

impl Projected {
    fn cross(self, other: Projected) -> f64 {
        self.x * other.y - self.y * other.x
    }

    fn minus(self, other: Projected) -> Projected {
        Projected { x: self.x - other.x, y: self.y - other.y, height: self.height - other.height }
    }
}

/// Where an old and a new edge cross, as shares of them.
struct Crossing {
    on_old: f64,
    on_new: f64,
    /// What was divided by.
    area: f64,
}

/// How the fans of the last bound lie over each other.
#[derive(Clone, Copy, Debug)]
struct Laid {
    /// Where u is, once it is on the line that its boundary edges become.
    foot: Projected,
    /// How far that is along the line; of a boundary vertex.
    share: Option<f64>,
    /// The new face that u lies over.
    sector: usize,
    size: f64,
}

/// The fans before and after a collapse u -> v. The loop is l_0 = v, l_1, ... in the faces' winding.
#[derive(Debug)]
pub(crate) struct Overlay {
    /// Where u is.
    pub(crate) apex: Point3<f64>,
    /// The loop.
    pub(crate) ring: Vec<Point3<f64>>,
    /// Old face i = (u, l_i, l_i+1), or [`NO_FACE`]; after the collapse face i in 1..=len-2 is (v, l_i, l_i+1).
    pub(crate) faces: Vec<u32>,
    /// The loop by vertices of the patch.
    vertices: Vec<u16>,
    projected: Vec<Projected>,
    /// Least and largest displacement where the old edge (u, l_a) crosses the new edge (v, l_b), at `a * MAX_LOOP + b`.
    crossings: Vec<[f64; 2]>,
    /// None before a bound, and where it failed.
    laid: Option<Laid>,
}

impl Default for Overlay {
    fn default() -> Self {
        let crossings = vec![[0.0; 2]; MAX_LOOP * MAX_LOOP];
        Overlay {
            apex: Point3::origin(),
            ring: vec![],
            faces: vec![],
            vertices: vec![],
            projected: vec![],
            crossings,
            laid: None,
        }
    }
}

impl Overlay {
    /// Begins with u's place.
    pub(crate) fn begin(&mut self, apex: Point3<f64>) {
        self.apex = apex;
        self.ring.clear();
        self.faces.clear();
        self.vertices.clear();
        self.laid = None;
    }

    /// Appends the next vertex of the loop, and the face that it leads.
    pub(crate) fn push(&mut self, vertex: u16, place: Point3<f64>, face: u32) {
        self.vertices.push(vertex);
        self.ring.push(place);
        self.faces.push(face);
    }

    /// Appends to `out` every new face with its displacements after the collapse; false if neither of two normals shows both fans
    /// one-to-one, and then `out` is as it was.
    pub(crate) fn bound(&mut self, of: &[Displacement], out: &mut Vec<(u32, Displacement)>) -> bool {
        let count = self.ring.len();
        if !(3..=MAX_LOOP).contains(&count) {
            return false;
        }
        let areas = self.area_sum(self.apex, |area| area);
        if self.bound_along(areas, of, out) {
            return true;
        }
        let unit = |area: Vector3<f64>| area.try_normalize(0.0).unwrap_or_default();
        let both = self.area_sum(self.apex, unit) + self.area_sum(self.ring[0], unit);
        self.bound_along(both, of, out)
    }

    /// Sum over the faces that the loop makes with `apex`.
    fn area_sum(&self, apex: Point3<f64>, of: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
        let next = self.ring.iter().cycle().skip(1);
        self.ring.iter().zip(next).map(|(a, b)| of((a - apex).cross(&(b - apex)))).sum()
    }

    fn bound_along(
        &mut self,
        normal: Vector3<f64>,
        of: &[Displacement],
        out: &mut Vec<(u32, Displacement)>,
    ) -> bool {
        let Some(normal) = normal.try_normalize(0.0) else { return false };
        let last = self.ring.len() - 1;
        let size = self.project(normal);
        let least_area = AREA_SHARE * size * size;
        let p = &self.projected;
        // u on the mesh boundary first slides to the straight line that its two boundary edges become.
        let on_boundary = [self.faces[0] == NO_FACE, self.faces[last] == NO_FACE];
        let (slide, foot) = match on_boundary {
            [false, false] => (Sweep::default(), Projected::default()),
            [true, _] => self.foot(1),
            [_, true] => self.foot(last),
        };
        let star = |center: Projected, i: usize| {
            p[i].minus(center).cross(p[(i + 1) % (last + 1)].minus(center)) > least_area
        };
        let old_fan = (0..=last).all(|i| self.faces[i] == NO_FACE || star(foot, i));
        if !old_fan || !(1..last).all(|i| star(p[0], i)) || !self.winds_once(foot, on_boundary, least_area) {
            return false;
        }
        let Some(sector) = self.sector(foot, on_boundary) else { return false };

        let (low, high) = p.iter().fold((0f64, 0f64), |(l, h), p| (l.min(p.height), h.max(p.height)));
        let loss = Loss {
            height: HEIGHT_LOSS * size,
            // A place on an edge is off by the share of the area that it was divided by; twice, for the two edges.
            slope: 4.0 * AREA_LOSS * size * size * (high - low),
        };
        let flat = high - low <= 256.0 * loss.height && self.is_flat(sector);
        let at_apex = if flat || on_boundary != [false, false] {
            [0.0; 2]
        } else {
            self.apex_displacement(sector, &loss)
        };
        if !self.cross(foot, sector, flat, least_area, &loss) {
            return false;
        }
        let still = flat && slide.is_still();
        for new in 1..last {
            let mut exact = Displacement::EMPTY;
            let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
            for old in 0..=last {
                if !self.meet(old, new, sector) {
                    continue;
                }
                let before = &of[self.faces[old] as usize];
                if still {
                    exact.merge(before);
                } else {
                    let (least, most) = self.interval(old, new, sector, at_apex);
                    let (a, b) = (normal * least, normal * most);
                    low = low.inf(&(before.low() + slide.lo + a.inf(&b)));
                    high = high.sup(&(before.high() + slide.hi + a.sup(&b)));
                }
            }
            let after = if still { exact } else { Displacement::outward(low, high) };
            out.push((self.faces[new], after));
        }
        let share = (on_boundary != [false, false]).then_some(slide.share);
        self.laid = Some(Laid { foot, share, sector, size });
        true
    }

    /// Whether an old and a new face have a cell in common.
    fn meet(&self, old: usize, new: usize, sector: usize) -> bool {
        let meet = match old {
            0 => new <= sector,
            _ if old + 1 == self.ring.len() => new >= sector,
            _ => new >= old.min(sector) && new <= old.max(sector),
        };
        meet && self.faces[old] != NO_FACE
    }

    /// The loop's vertices whose new edges the old edge (u, l_a) crosses.
    fn crossed(a: usize, sector: usize) -> Range<usize> {
        if a > sector { sector + 1..a } else { a + 1..sector + 1 }
    }

    /// Projects the loop; answers the fan's size.
    fn project(&mut self, normal: Vector3<f64>) -> f64 {
        let axis = Vector3::ith(normal.iamin(), 1.0);
        let x = normal.cross(&axis).normalize();
        let y = normal.cross(&x);
        self.projected.clear();
        let mut size: f64 = 0.0;
        for point in &self.ring {
            let d = point - self.apex;
            size = size.max(d.norm_squared());
            self.projected.push(Projected { x: x.dot(&d), y: y.dot(&d), height: normal.dot(&d) });
        }
        size.sqrt()
    }

    /// Where u slides on the segment from v to `l_other`, its neighbours on the mesh boundary: how far, and the place.
    fn foot(&self, other: usize) -> (Sweep, Projected) {
        let slide = Sweep::to_segment(self.apex, self.ring[0], self.ring[other]);
        let (a, b) = (self.projected[0], self.projected[other]);
        let between = |a: f64, b: f64| a + slide.share * (b - a);
        let foot =
            Projected { x: between(a.x, b.x), y: between(a.y, b.y), height: between(a.height, b.height) };
        (slide, foot)
    }

    /// Whether the old faces, all of them turning the same way, go about their apex once and not more.
    fn winds_once(&self, foot: Projected, on_boundary: [bool; 2], least_area: f64) -> bool {
        let p = &self.projected;
        let last = p.len() - 1;
        match on_boundary {
            [false, false] => {
                let rises = (0..=last).filter(|&i| p[i].y < 0.0 && p[(i + 1) % (last + 1)].y >= 0.0);
                rises.count() == 1
            }
            // A half turn from one boundary edge to the other.
            [true, _] => {
                let start = p[1].minus(foot);
                (2..=last).all(|i| start.cross(p[i].minus(foot)) > least_area)
            }
            [_, true] => {
                let start = p[0].minus(foot);
                (1..last).all(|i| start.cross(p[i].minus(foot)) > least_area)
            }
        }
    }

    /// The new face that u lies over.
    fn sector(&self, foot: Projected, on_boundary: [bool; 2]) -> Option<usize> {
        let p = &self.projected;
        let last = p.len() - 1;
        match on_boundary {
            [true, _] => Some(1),
            [_, true] => Some(last - 1),
            [false, false] => {
                let apex = foot.minus(p[0]);
                let beside = |i: usize| p[i].minus(p[0]).cross(apex);
                (1..last).find(|&i| beside(i) >= 0.0 && beside(i + 1) < 0.0)
            }
        }
    }

    /// Whether u and the loop are in one plane, exactly.
    fn is_flat(&self, sector: usize) -> bool {
        let [a, b, c] = [0, sector, sector + 1].map(|i| coord(self.ring[i]));
        let on_plane = |p: &Point3<f64>| orient3d(a, b, c, coord(*p)) == 0.0;
        on_plane(&self.apex) && self.ring.iter().all(on_plane)
    }

    /// How far the new fan is above u.
    fn apex_displacement(&self, sector: usize, loss: &Loss) -> [f64; 2] {
        let p = &self.projected;
        let (a, b) = (p[sector].minus(p[0]), p[sector + 1].minus(p[0]));
        let ([of_a, of_b], area) = self.apex_shares(sector);
        loss.about(p[0].height + of_a * a.height + of_b * b.height, area)
    }

    /// What the two vertices of the loop that u lies between have of it, in the new face there, and what was divided by.
    fn apex_shares(&self, sector: usize) -> ([f64; 2], f64) {
        let p = &self.projected;
        let (a, b) = (p[sector].minus(p[0]), p[sector + 1].minus(p[0]));
        let apex = Projected::default().minus(p[0]);
        let area = a.cross(b);
        ([(apex.cross(b) / area).clamp(0.0, 1.0), (a.cross(apex) / area).clamp(0.0, 1.0)], area)
    }

    /// The displacements where old edges cross new ones. False if two of them are too close to parallel.
    fn cross(&mut self, foot: Projected, sector: usize, flat: bool, least_area: f64, loss: &Loss) -> bool {
        let p = &self.projected;
        for a in 1..p.len() {
            let old = p[a].minus(foot);
            for b in Self::crossed(a, sector) {
                let at = &mut self.crossings[a * MAX_LOOP + b];
                *at = [0.0; 2];
                if flat {
                    continue;
                }
                let new = p[b].minus(p[0]);
                let Crossing { on_old, on_new, area } = crossing(old, new, p[0].minus(foot));
                if area.abs() <= least_area {
                    return false;
                }
                let displacement = (p[0].height + on_new * new.height) - (foot.height + on_old * old.height);
                *at = loss.about(displacement, area);
            }
        }
        true
    }

    /// The least and largest displacement on the cell of an old and a new face.
    fn interval(&self, old: usize, new: usize, sector: usize, at_apex: [f64; 2]) -> (f64, f64) {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        self.corners(old, new, sector, |corner| {
            let at = match corner {
                Corner::Loop => [0.0; 2],
                Corner::Apex => at_apex,
                Corner::Crossing(a, b) => self.crossings[a * MAX_LOOP + b],
            };
            (low, high) = (low.min(at[0]), high.max(at[1]));
        });
        (low, high)
    }

    /// The corners of the cell of an old and a new face, some of them more than once.
    #[inline]
    fn corners(&self, old: usize, new: usize, sector: usize, mut visit: impl FnMut(Corner)) {
        let last = self.ring.len() - 1;
        if old == 0 || old == last {
            visit(Corner::Loop);
        }
        if new == sector {
            visit(Corner::Apex);
        }
        for a in [old, (old + 1) % (last + 1)] {
            for b in [new, new + 1] {
                if a == b {
                    visit(Corner::Loop);
                } else if a != 0 && ((sector < b && b < a) || (a < b && b <= sector)) {
                    visit(Corner::Crossing(a, b));
                }
            }
        }
    }
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

/// What rounding can do to a displacement.
struct Loss {
    /// To a height.
    height: f64,
    /// To a height that is interpolated at a place on two edges, times the area that gave the place.
    slope: f64,
}

impl Loss {
    /// The interval that the true displacement is in.
    fn about(&self, displacement: f64, area: f64) -> [f64; 2] {
        let loss = self.height + self.slope / area.abs();
        [displacement - loss, displacement + loss]
    }
}

/// Of the edge `old` from u's place and the edge `new` from v, which is at `from` from there.
fn crossing(old: Projected, new: Projected, from: Projected) -> Crossing {
    let area = old.cross(new);
    // Of parallel edges any place will do, but not one that is no number: their loss covers both edges.
    let share = |of: f64| if area == 0.0 { 0.0 } else { (of / area).clamp(0.0, 1.0) };
    Crossing { on_old: share(from.cross(new)), on_new: share(from.cross(old)), area }
}

fn coord(p: Point3<f64>) -> Coord3D<f64> {
    Coord3D { x: p.x, y: p.y, z: p.z }
}

/// Whether `b` lies on the line through `a` and `c`, between them, exactly.
fn is_straight(a: Point3<f64>, b: Point3<f64>, c: Point3<f64>) -> bool {
    let straight = |i: usize, j: usize| {
        let [a, b, c] = [a, b, c].map(|p| Coord { x: p[i], y: p[j] });
        orient2d(a, b, c) == 0.0
    };
    (a - b).dot(&(c - b)) <= 0.0 && straight(0, 1) && straight(1, 2) && straight(2, 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_edges_cross_at_a_number() {
        let edge = Projected { x: 1.0, y: 2.0, height: 0.0 };
        let Crossing { on_old, on_new, area } = crossing(edge, edge, edge);
        assert_eq!((on_old, on_new, area), (0.0, 0.0, 0.0));
    }
}
