//! Whether a reference lies over all of a face, and how far above or below it then is at most.
//!
//! Both are projected along the face's normal. Take triangles of the reference so that each of their edges that may pass over the face has an even number of
//! them: then the number of triangles over a point of the face is even at all of its points or odd at all of them. If it is odd at one point, there is no point of
//! the face without one.

use super::reference::{NO_EDGE, Reference};
use super::target::Target;
use chpm_mesh::geom::to_f64;
use nalgebra::{Point3, Vector3};
use robust::{Coord, orient2d};

/// Weights of points of the face at which triangles are counted, until one lies on no edge.
const PROBES: [[f64; 3]; 3] = [[0.34, 0.35, 0.31], [0.47, 0.22, 0.31], [0.19, 0.37, 0.44]];

/// Share of an edge that may be taken off at either end.
const MOST_OFF: f64 = 0.45;

/// A face without its corners.
type Outline = [Coord<f64>; 6];

/// A place in the plane, and the height above it.
type Placed = [f64; 3];

/// Scratch for one face after another.
#[derive(Debug, Default)]
pub(crate) struct Overhead {
    placed: Vec<Placed>,
    /// Per point of the reference, the face for which it was placed; per edge, likewise, where the number of triangles is odd.
    placed_for: Vec<u32>,
    odd_for: Vec<u32>,
    turn: u32,
    over: Vec<Over>,
    polygon: Vec<Placed>,
    clipped: Vec<Placed>,
}

/// A triangle of the reference that has some part over the face.
#[derive(Debug)]
struct Over {
    /// How far what it stands for is from the face, at most.
    height: f64,
    triangle: u32,
    /// Its edges that may touch the face.
    edges: [bool; 3],
    /// Whether it has the probes inside; none where one lies on an edge.
    probes: [Option<bool>; PROBES.len()],
}

/// A face in its own plane.
struct Plane {
    origin: Point3<f64>,
    axes: [Vector3<f64>; 3],
    corners: Outline,
    /// Whether all of them are on one side of the line from a corner to the next, exactly.
    holds: [bool; 6],
    loss: f64,
}

impl Plane {
    /// `off` is how much of each corner is taken off.
    fn new(face: &Target, off: [f64; 3], loss: f64) -> Option<Self> {
        let [a, b, c] = face.corners;
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
        let along = (b - a).try_normalize(0.0)?;
        let axes = [along, normal.cross(&along), normal];
        let mut plane =
            Plane { origin: a, axes, corners: [Coord { x: 0.0, y: 0.0 }; 6], holds: [true; 6], loss };
        let whole = face.corners.map(|corner| flat(&plane.place(&corner)));
        if orient2d(whole[0], whole[1], whole[2]) <= 0.0 {
            return None;
        }

        for i in 0..3 {
            for (k, to) in [(i + 2) % 3, (i + 1) % 3].into_iter().enumerate() {
                let (x, y) = (whole[to].x - whole[i].x, whole[to].y - whole[i].y);
                let share = (off[i] / (x * x + y * y).sqrt()).min(MOST_OFF);
                plane.corners[2 * i + k] = Coord { x: whole[i].x + share * x, y: whole[i].y + share * y };
            }
        }
        let outline = plane.corners;
        for i in 0..6 {
            plane.holds[i] = outline.iter().all(|p| orient2d(outline[i], outline[(i + 1) % 6], *p) >= 0.0);
        }
        Some(plane)
    }

    fn place(&self, point: &Point3<f64>) -> Placed {
        let way = point - self.origin;
        self.axes.map(|axis| axis.dot(&way))
    }
}

fn flat([x, y, _]: &Placed) -> Coord<f64> {
    Coord { x: *x, y: *y }
}

/// A triangle of the reference beside the face: on which side of each other's lines the corners are, as exact signs.
struct Beside {
    /// By corner of the triangle, whether it is outside a line of the face.
    outside: [[bool; 6]; 3],
    /// By line of the triangle, the side on which all corners of the face are, if they are.
    sides: [f64; 3],
    area: f64,
}

impl Beside {
    fn new(triangle: &[Coord<f64>; 3], plane: &Plane) -> Option<Self> {
        let face = &plane.corners;
        let outside = triangle.map(|point| {
            [0, 1, 2, 3, 4, 5].map(|i| plane.holds[i] && orient2d(face[i], face[(i + 1) % 6], point) < 0.0)
        });
        if (0..6).any(|i| outside.iter().all(|corner| corner[i])) {
            return None;
        }
        let sides = [0, 1, 2].map(|i| {
            let side = |p: &Coord<f64>| orient2d(triangle[i], triangle[(i + 1) % 3], *p);
            let first = side(&face[0]);
            if face[1..].iter().all(|p| side(p) * first > 0.0) { first } else { 0.0 }
        });
        let area = orient2d(triangle[0], triangle[1], triangle[2]);
        let is_apart = |side: &f64| area <= 0.0 && *side > 0.0 || area >= 0.0 && *side < 0.0;
        (!sides.iter().any(is_apart)).then_some(Beside { outside, sides, area })
    }

    /// Whether the edge from corner `i` to the next may touch the face.
    fn is_over(&self, i: usize) -> bool {
        let (a, b) = (&self.outside[i], &self.outside[(i + 1) % 3]);
        self.sides[i] == 0.0 && !(0..6).any(|line| a[line] && b[line])
    }
}

impl Overhead {
    pub(crate) fn new(reference: &Reference) -> Self {
        Overhead {
            placed: vec![[0.0; 3]; reference.points.len()],
            placed_for: vec![0; reference.points.len()],
            odd_for: vec![0; reference.edge_count],
            ..Overhead::default()
        }
    }

    /// How far no point of the face is from what the reference stands for, if that is at most `allowed`: the least for which the nearer of the candidates lie over all of it.
    /// What is within `enough` is not looked at more closely. `corners` are points of the reference at which the face has its.
    pub(crate) fn reach(
        &mut self,
        (face, corners): (&Target, [Option<u32>; 3]),
        candidates: &[u32],
        reference: &Reference,
        (enough, allowed): (f64, f64),
        loss: f64,
    ) -> Option<f64> {
        // What is near a corner is near a vertex of the source.
        let off = corners.map(|corner| {
            let error = corner.map_or(f64::INFINITY, |corner| f64::from(reference.least[corner as usize]));
            (enough - error - loss).max(0.0)
        });
        let plane = Plane::new(face, off, loss)?;
        let probes = PROBES.map(|weights| probe(&plane.corners, weights));
        self.turn += 1;
        self.over.clear();
        for &candidate in candidates {
            self.look(face, candidate, reference, &plane, &probes, (enough, allowed));
        }
        self.over.sort_unstable_by(|a, b| a.height.total_cmp(&b.height).then(a.triangle.cmp(&b.triangle)));

        // The nearest first, until no edge over the face has an odd number of them.
        let (mut odd, mut counts) = (0_i64, [0_u32; PROBES.len()]);
        for (index, over) in self.over.iter().enumerate() {
            for (i, edge) in reference.edges[over.triangle as usize].into_iter().enumerate() {
                if over.edges[i] {
                    let of = &mut self.odd_for[edge as usize];
                    let was_odd = *of == self.turn;
                    *of = if was_odd { 0 } else { self.turn };
                    odd += if was_odd { -1 } else { 1 };
                }
            }
            counts
                .iter_mut()
                .zip(over.probes)
                .for_each(|(count, holds)| *count += u32::from(holds == Some(true)));
            let is_next_far = self.over.get(index + 1).is_none_or(|next| next.height > over.height);
            if odd == 0 && is_next_far {
                // A probe counts if it is on no edge of those so far.
                let on_none = |i: &usize| self.over[..=index].iter().all(|over| over.probes[*i].is_some());
                let probe = (0..PROBES.len()).filter(|i| probes[*i].is_some()).find(on_none);
                if probe.is_some_and(|probe| counts[probe] % 2 == 1) {
                    let off = off.into_iter().fold(0.0, f64::max);
                    return Some(if off > 0.0 { over.height.max(enough) } else { over.height });
                }
            }
        }
        None
    }

    /// Notes a candidate if some of it is over the face and near enough.
    fn look(
        &mut self,
        face: &Target,
        candidate: u32,
        reference: &Reference,
        plane: &Plane,
        probes: &[Option<Coord<f64>>; PROBES.len()],
        (enough, allowed): (f64, f64),
    ) {
        let beyond = f64::from(reference.errors[candidate as usize]) + plane.loss;
        let corners = reference.triangles[candidate as usize];
        if beyond > allowed || is_far(face, corners.map(|v| reference.points[v as usize]), allowed - beyond) {
            return;
        }
        let placed = corners.map(|v| self.place(v, reference, plane));
        let triangle = [0, 1, 2].map(|i| flat(&placed[i]));
        let Some(beside) = Beside::new(&triangle, plane) else { return };
        let mut height = placed.iter().map(|p| p[2].abs()).fold(0.0, f64::max);
        if height + beyond > enough {
            height = self.height_over(plane, placed);
        }
        if height + beyond > allowed {
            return;
        }
        let edges = reference.edges[candidate as usize];
        self.over.push(Over {
            height: height + beyond,
            triangle: candidate,
            edges: [0, 1, 2].map(|i| edges[i] != NO_EDGE && beside.is_over(i)),
            probes: probes.map(|probe| probe.and_then(|probe| holds(&triangle, beside.area, probe))),
        });
    }

    fn place(&mut self, point: u32, reference: &Reference, plane: &Plane) -> Placed {
        let at = point as usize;
        if self.placed_for[at] != self.turn {
            self.placed_for[at] = self.turn;
            self.placed[at] = plane.place(&to_f64(reference.points[at]));
        }
        self.placed[at]
    }

    /// The greatest height of what of a triangle is over the face, and a little more than that.
    fn height_over(&mut self, plane: &Plane, triangle: [Placed; 3]) -> f64 {
        self.polygon.clear();
        self.polygon.extend(triangle);
        for i in 0..6 {
            let (from, to) = (plane.corners[i], plane.corners[(i + 1) % 6]);
            let (x, y) = (to.x - from.x, to.y - from.y);
            let length = (x * x + y * y).sqrt();
            if length == 0.0 {
                continue;
            }
            let inside = |p: &Placed| (x * (p[1] - from.y) - y * (p[0] - from.x)) / length + plane.loss;
            self.clipped.clear();
            for (k, b) in self.polygon.iter().enumerate() {
                let a = &self.polygon[(k + self.polygon.len() - 1) % self.polygon.len()];
                let (at_a, at_b) = (inside(a), inside(b));
                if (at_a >= 0.0) != (at_b >= 0.0) {
                    let share = at_a / (at_a - at_b);
                    self.clipped.push([0, 1, 2].map(|axis| a[axis] + share * (b[axis] - a[axis])));
                }
                if at_b >= 0.0 {
                    self.clipped.push(*b);
                }
            }
            std::mem::swap(&mut self.polygon, &mut self.clipped);
        }
        self.polygon.iter().map(|p| p[2].abs()).fold(0.0, f64::max)
    }
}

/// A point inside a face, for certain.
fn probe(face: &Outline, weights: [f64; 3]) -> Option<Coord<f64>> {
    let x = (0..3).map(|i| 0.5 * weights[i] * (face[2 * i].x + face[2 * i + 1].x)).sum();
    let y = (0..3).map(|i| 0.5 * weights[i] * (face[2 * i].y + face[2 * i + 1].y)).sum();
    let probe = Coord { x, y };
    (0..6).all(|i| orient2d(face[i], face[(i + 1) % 6], probe) >= 0.0).then_some(probe)
}

/// Whether a triangle has a point inside; none if that lies on one of its edges.
fn holds(triangle: &[Coord<f64>; 3], area: f64, point: Coord<f64>) -> Option<bool> {
    let sides = [0, 1, 2].map(|i| orient2d(triangle[i], triangle[(i + 1) % 3], point));
    if area == 0.0 {
        // On its line it may be on an edge.
        return sides.iter().any(|side| *side != 0.0).then_some(false);
    }
    if sides.iter().any(|side| *side != 0.0 && (*side < 0.0) != (area < 0.0)) {
        return Some(false);
    }
    sides.iter().all(|side| *side != 0.0).then_some(true)
}

/// Whether no point of a triangle is within `allowed` of the box around a face.
fn is_far(face: &Target, corners: [[f32; 3]; 3], allowed: f64) -> bool {
    (0..3).any(|axis| {
        let at = corners.map(|corner| f64::from(corner[axis]));
        let (low, high) = (at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2]));
        low > face.high[axis] + allowed || high < face.low[axis] - allowed
    })
}
