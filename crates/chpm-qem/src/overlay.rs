//! A bound on what one collapse moves: the map between the fans before and after it, along a common normal.
//!
//! The faces about u before a collapse u -> v and those about v after it fill one loop of edges. If both lie one-to-one over a plane, each
//! point of the old fan maps to the new one straight along the plane's normal. The map is linear on every cell that an old and a new
//! face have in common, so that its extremes are at the cells' corners: at the loop, where nothing moves; at u; and where an
//! old edge from u crosses a new edge from v. Their order is known from the loop alone, since both fans are star-shaped.

mod arrangement;
mod cells;
#[cfg(test)]
mod exact;

use crate::displacement::{Along, Displacement, Reach};
use crate::fan::MAX_VALENCE;
use arrangement::{APEX, Arrangement, CROSSINGS, Cell};
pub(crate) use cells::Place;
use nalgebra::{Point3, Vector3};
use robust::{Coord, Coord3D, orient2d, orient3d};

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
    /// One over that; zero for zero.
    per_area: f64,
}

/// How the fans of the last bound lie over each other.
#[derive(Clone, Copy, Debug)]
struct Laid {
    /// Where u is, once it is on the line that its boundary edges become.
    foot: Projected,
    /// How far that is along the line; of a boundary vertex.
    share: Option<f64>,
    /// The new faces that u may lie over, first and last: several where rounding cannot tell them apart.
    sectors: [usize; 2],
    size: f64,
}

/// The fans before and after a collapse u -> v. The loop is l_0 = v, l_1, ... in the faces' winding.
#[derive(Debug)]
pub(crate) struct Overlay {
    /// Where u is.
    apex: Point3<f64>,
    /// The loop.
    ring: Vec<Point3<f64>>,
    /// The loop relative to u.
    arms: Vec<Vector3<f64>>,
    /// Old face i = (u, l_i, l_i+1), or [`NO_FACE`]; after the collapse face i in 1..=len-2 is (v, l_i, l_i+1).
    faces: Vec<u32>,
    /// The loop by vertices of the patch.
    vertices: Vec<u16>,
    projected: Vec<Projected>,
    /// By corner of the arrangement, the least displacement and, with its sign turned, the largest: of both, the lesser counts.
    corners: Vec<[f64; 2]>,
    /// By old face, its box after the slide.
    slid: Vec<Reach>,
    /// None before a bound, and where it failed.
    laid: Option<Laid>,
}

impl Default for Overlay {
    fn default() -> Self {
        Overlay {
            apex: Point3::origin(),
            ring: vec![],
            arms: vec![],
            faces: vec![],
            vertices: vec![],
            projected: vec![],
            corners: vec![],
            slid: vec![],
            laid: None,
        }
    }
}

impl Overlay {
    /// Begins a loop.
    pub(crate) fn begin(&mut self) {
        self.faces.clear();
        self.vertices.clear();
        self.laid = None;
    }

    /// Appends the next vertex of the loop, and the face that it leads.
    #[inline]
    pub(crate) fn push(&mut self, vertex: u16, face: u32) {
        self.vertices.push(vertex);
        self.faces.push(face);
    }

    /// Looks up where u and the vertices of the loop are.
    pub(crate) fn place(&mut self, u: u16, position: impl Fn(u16) -> Point3<f64>) {
        self.apex = position(u);
        self.ring.clear();
        self.ring.extend(self.vertices.iter().map(|v| position(*v)));
        self.arms.clear();
        self.arms.extend(self.ring.iter().map(|place| place - self.apex));
    }

    /// Appends to `out` every new face with its displacements after the collapse; false if neither of two normals shows both fans
    /// one-to-one, and then `out` is as it was.
    pub(crate) fn bound(&mut self, of: &[Displacement], out: &mut Vec<(u32, Displacement)>) -> bool {
        if !(3..=MAX_LOOP).contains(&self.ring.len()) {
            return false;
        }
        let areas = self.area_sum(Vector3::zeros(), |area| area);
        if self.bound_along(areas, of, out) {
            return true;
        }
        let unit = |area: Vector3<f64>| area.try_normalize(0.0).unwrap_or_default();
        let both = self.area_sum(Vector3::zeros(), unit) + self.area_sum(self.arms[0], unit);
        self.bound_along(both, of, out)
    }

    /// Sum over the faces that the loop makes with a point, which is given relative to u.
    fn area_sum(&self, from: Vector3<f64>, of: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        let mut a = self.arms[self.arms.len() - 1] - from;
        for arm in &self.arms {
            let b = arm - from;
            sum += of(a.cross(&b));
            a = b;
        }
        sum
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
        // u on the mesh boundary first slides to the straight line that its two boundary edges become.
        let on_boundary = [self.faces[0] == NO_FACE, self.faces[last] == NO_FACE];
        let (slide, foot) = match on_boundary {
            [false, false] => (Sweep::default(), Projected::default()),
            [true, _] => self.foot(1),
            [_, true] => self.foot(last),
        };
        if !self.is_one_to_one(foot, on_boundary, least_area) {
            return false;
        }
        let Some(sectors) = self.find_sectors(foot, on_boundary, size) else { return false };

        let heights = self.projected.iter().map(|p| p.height);
        let (low, high) = heights.fold((0f64, 0f64), |(l, h), p| (l.min(p), h.max(p)));
        let loss = Loss {
            height: HEIGHT_LOSS * size,
            // A place on an edge is off by the share of the area that it was divided by; twice, for the two edges.
            slope: 4.0 * AREA_LOSS * size * size * (high - low),
        };
        let flat = high - low <= 256.0 * loss.height && self.is_flat(sectors[0]);
        let still = flat && slide.is_still();
        if !still {
            let slid = |old: &u32| {
                if *old == NO_FACE { Reach::EMPTY } else { Reach::of(&of[*old as usize], &slide) }
            };
            self.slid.clear();
            self.slid.extend(self.faces.iter().map(slid));
        }
        let along = Along::new(normal);
        let first = out.len();
        // Whichever sector it is, its cells are among those that are taken.
        for sector in sectors[0]..=sectors[1] {
            if !self.find_corners(foot, sector, flat, on_boundary, least_area, &loss) {
                out.truncate(first);
                return false;
            }
            let arrangement = Arrangement::of(last + 1, sector);
            for new in 1..last {
                let cells = arrangement.cells(new);
                let after = if still { self.merged(cells, of) } else { self.displaced(cells, &along) };
                match out.get_mut(first + new - 1) {
                    Some((_, all)) => all.merge(&after),
                    None => out.push((self.faces[new], after)),
                }
            }
        }
        let share = (on_boundary != [false, false]).then_some(slide.share);
        self.laid = Some(Laid { foot, share, sectors, size });
        true
    }

    /// The box of all old faces of some cells, of which no point moves.
    fn merged(&self, cells: &[Cell], of: &[Displacement]) -> Displacement {
        let old = cells.iter().map(|cell| self.faces[usize::from(cell.old)]).filter(|old| *old != NO_FACE);
        old.fold(Displacement::EMPTY, |mut all, old| {
            all.merge(&of[old as usize]);
            all
        })
    }

    /// The box of all old faces of some cells, after the slide and what the cells' corners move by.
    #[inline]
    fn displaced(&self, cells: &[Cell], along: &Along) -> Displacement {
        let mut reach = Reach::EMPTY;
        for cell in cells {
            let (mut least, mut most) = (f64::INFINITY, f64::INFINITY);
            for corner in cell.corners() {
                let [low, high] = self.corners[usize::from(*corner)];
                least = if low < least { low } else { least };
                most = if high < most { high } else { most };
            }
            // No face has an empty box, which stays empty.
            reach.add(&self.slid[usize::from(cell.old)], along, least, -most);
        }
        reach.outward()
    }

    /// Projects the loop; answers the fan's size.
    fn project(&mut self, normal: Vector3<f64>) -> f64 {
        let axis = Vector3::ith(normal.iamin(), 1.0);
        let x = normal.cross(&axis).normalize();
        let y = normal.cross(&x);
        self.projected.clear();
        let mut size: f64 = 0.0;
        self.projected.extend(self.arms.iter().map(|d| {
            let squared = d.norm_squared();
            size = if squared > size { squared } else { size };
            Projected { x: x.dot(d), y: y.dot(d), height: normal.dot(d) }
        }));
        size.sqrt()
    }

    /// Whether both fans lie one-to-one over the plane: all faces turn the same way, and the old ones go about their apex once.
    fn is_one_to_one(&self, foot: Projected, on_boundary: [bool; 2], least_area: f64) -> bool {
        let p = &self.projected[..];
        let last = p.len() - 1;
        let v = p[0];
        let mut turns = true;
        let mut rises = 0;
        let mut a = p[last].minus(foot);
        for (i, b) in p.iter().enumerate() {
            let b = b.minus(foot);
            let leads = if i == 0 { last } else { i - 1 };
            turns &= (a.cross(b) > least_area) | (self.faces[leads] == NO_FACE);
            rises += u32::from((a.y < 0.0) & (b.y >= 0.0));
            a = b;
        }
        for pair in p[1..].windows(2) {
            turns &= pair[0].minus(v).cross(pair[1].minus(v)) > least_area;
        }
        turns
            && match on_boundary {
                [false, false] => rises == 1,
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

    /// Where u slides on the segment from v to `l_other`, its neighbours on the mesh boundary: how far, and the place.
    fn foot(&self, other: usize) -> (Sweep, Projected) {
        let slide = Sweep::to_segment(self.apex, self.ring[0], self.ring[other]);
        let (a, b) = (self.projected[0], self.projected[other]);
        let between = |a: f64, b: f64| a + slide.share * (b - a);
        let foot =
            Projected { x: between(a.x, b.x), y: between(a.y, b.y), height: between(a.height, b.height) };
        (slide, foot)
    }

    /// The new faces that u may lie over, first and last. More than one only where u is so close to an edge from v that rounding
    /// decides on which side of it.
    fn find_sectors(&self, foot: Projected, on_boundary: [bool; 2], size: f64) -> Option<[usize; 2]> {
        let p = &self.projected;
        let last = p.len() - 1;
        match on_boundary {
            [true, _] => return Some([1, 1]),
            [_, true] => return Some([last - 1, last - 1]),
            [false, false] => {}
        }
        let apex = foot.minus(p[0]);
        let beside = |i: usize| p[i].minus(p[0]).cross(apex);
        let sector = (1..last).find(|&i| beside(i) >= 0.0 && beside(i + 1) < 0.0)?;
        let least = AREA_LOSS * size * size;
        // On the edge itself the cells of either side are right: what is between them has no area.
        let may_pass =
            |i: usize| beside(i).abs() <= least && !is_straight(self.ring[0], self.apex, self.ring[i]);
        let (mut low, mut high) = (sector, sector);
        while low > 1 && may_pass(low) {
            low -= 1;
        }
        while high + 1 < last && may_pass(high + 1) {
            high += 1;
        }
        Some([low, high])
    }

    /// Whether u and the loop are in one plane, exactly.
    fn is_flat(&self, sector: usize) -> bool {
        let [a, b, c] = [0, sector, sector + 1].map(|i| coord(self.ring[i]));
        let on_plane = |p: &Point3<f64>| orient3d(a, b, c, coord(*p)) == 0.0;
        on_plane(&self.apex) && self.ring.iter().all(on_plane)
    }

    /// What the two vertices of the loop that u lies between have of it, in the new face there, and what was divided by.
    fn apex_shares(&self, sector: usize) -> ([f64; 2], f64) {
        let p = &self.projected;
        let (a, b) = (p[sector].minus(p[0]), p[sector + 1].minus(p[0]));
        let apex = Projected::default().minus(p[0]);
        let area = a.cross(b);
        let per_area = 1.0 / area;
        ([(apex.cross(b) * per_area).clamp(0.0, 1.0), (a.cross(apex) * per_area).clamp(0.0, 1.0)], area)
    }

    /// The displacements at the corners of all cells. False if two edges that cross are too close to parallel.
    fn find_corners(
        &mut self,
        foot: Projected,
        sector: usize,
        flat: bool,
        on_boundary: [bool; 2],
        least_area: f64,
        loss: &Loss,
    ) -> bool {
        let crossings = &Arrangement::of(self.ring.len(), sector).crossings;
        self.corners.clear();
        self.corners.resize(usize::from(CROSSINGS) + crossings.len(), [0.0; 2]);
        if flat {
            return true;
        }
        let p = &self.projected[..];
        let v = p[0];
        let from_foot = v.minus(foot);
        let mut parallel = false;
        for (&(a, b), at) in crossings.iter().zip(&mut self.corners[usize::from(CROSSINGS)..]) {
            let (old, new) = (p[usize::from(a)].minus(foot), p[usize::from(b)].minus(v));
            let Crossing { on_old, on_new, area, per_area } = crossing(old, new, from_foot);
            parallel |= area.abs() <= least_area;
            let displacement = (v.height + on_new * new.height) - (foot.height + on_old * old.height);
            *at = loss.about(displacement, per_area);
        }
        if on_boundary == [false, false] {
            // How far the new fan is above u.
            let ([of_a, of_b], area) = self.apex_shares(sector);
            let (a, b) = (p[sector].minus(v), p[sector + 1].minus(v));
            let displacement = v.height + of_a * a.height + of_b * b.height;
            self.corners[usize::from(APEX)] = loss.about(displacement, 1.0 / area);
        }
        !parallel
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
    /// The interval that the true displacement is in, its end with the sign turned.
    fn about(&self, displacement: f64, per_area: f64) -> [f64; 2] {
        let loss = self.height + self.slope * per_area.abs();
        [displacement - loss, -(displacement + loss)]
    }
}

/// Of the edge `old` from u's place and the edge `new` from v, which is at `from` from there.
#[inline]
fn crossing(old: Projected, new: Projected, from: Projected) -> Crossing {
    let area = old.cross(new);
    // Of parallel edges any place will do, but not one that is no number: their loss covers both edges.
    let per_area = if area == 0.0 { 0.0 } else { 1.0 / area };
    let share = |of: f64| (of * per_area).clamp(0.0, 1.0);
    Crossing { on_old: share(from.cross(new)), on_new: share(from.cross(old)), area, per_area }
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
        let Crossing { on_old, on_new, area, .. } = crossing(edge, edge, edge);
        assert_eq!((on_old, on_new, area), (0.0, 0.0, 0.0));
    }
}
