//! Cost of a collapse: first a guess, then its bound.

use crate::adjacency::Wing;
use crate::displacement::Displacement;
use crate::one_ring::{OneRing, OneRingKind};
use crate::patch::{Given, Patch};
use crate::quadric::{Quadric, QuadricPairs};
use chpm_mesh::Aabb;
use chpm_mesh::geom::area_vector;
use nalgebra::Vector3;
use wide::f64x2;

/// Weight of the squared edge length in the order of collapses, for a vertex of mean area. It decides between collapses that cost
/// the same, as in planes and along lines, in favour of the shorter edge and the smaller area; it is no part of an error. It stands for a distance of
/// a millionth of the edge, about what single precision rounds a plane by: with 1e-5 here, halves of mechanical parts had ten to
/// a hundred times the deviation.
const LENGTH_TERM: f64 = 1e-12;

/// Weight of the squared bound in the order of collapses. The bound holds what all collapses so far have done; the quadric only
/// the last ones, but it averages. With 0.3, 0.6 and 1, the stored errors of the first level of a scan were 1.55, 1.28 and 1.10 times the
/// measured ones, and the build took 1.1 and 1.2 times as long.
const BOUND_TERM: f64 = 1.0;

/// Factor of a guess: a vertex costs this multiple of its quadric's cost and the squared displacement about it together,
/// until its bound is known, which is seldom less. When this was chosen, a CT scan took 3.1 bounds for each collapse without a guess (by the quadric's
/// cost alone), and with 1, 1.25 and 1.5 here 2.6, 2.1 and 1.7; the measured RMS of a level was larger by up to 0, 2 and 4 %.
const GUESS: f32 = 1.0;
const HASTY_GUESS: f32 = 1.25;

/// The costs of a patch.
#[derive(Debug, Default)]
pub(crate) struct Prices {
    /// By vertex.
    quadrics: Vec<Quadric>,
    /// By face, the squared length of its longest displacement.
    displaced: Vec<f64>,
    /// Factor of every guess.
    factor: f32,
    /// Factor that makes costs fit an f32 for a model of any size.
    scale: f64,
    /// One over the area of the patch that falls to a vertex.
    per_mean_area: f64,
}

impl Prices {
    /// Starts with the quadrics of a patch's faces.
    pub(crate) fn begin(&mut self, patch: &Patch<'_>, hasty: bool) {
        self.factor = if hasty { HASTY_GUESS } else { GUESS };
        self.scale = scale(patch.positions);
        self.renew(patch, patch.triangles.iter().copied());
    }

    /// Gives the vertices the quadrics of these faces.
    pub(crate) fn renew(&mut self, patch: &Patch<'_>, faces: impl Iterator<Item = [u16; 3]>) {
        self.quadrics.clear();
        self.quadrics.resize(patch.positions.len(), Quadric::default());
        for corners in faces {
            let [a, b, c] = corners.map(|v| patch.positions[usize::from(v)]);
            let of_face = Quadric::of_face(area_vector(a, b, c));
            for v in corners {
                self.quadrics[usize::from(v)].add_planes(&of_face);
            }
        }
        let area: f64 = self.quadrics.iter().map(|q| q.area).sum();
        self.per_mean_area = if area > 0.0 { patch.positions.len() as f64 / area } else { 0.0 };
    }

    /// Gives the edges at the ends of an open fan their planes.
    pub(crate) fn add_boundary(&mut self, given: &Given<'_>, one_ring: &OneRing) {
        let OneRingKind::Open(first, last) = one_ring.kind() else { return };
        let vertex = one_ring.vertex();
        fn position(v: u16, given_patch_positions: &[[f32; 3]]) -> [f32; 3] {
            given_patch_positions[usize::from(v)]
        }
        for wing in &one_ring.wings {
            let normal = area_vector(
                position(vertex, given.patch.positions),
                position(wing.a, given.patch.positions),
                position(wing.b, given.patch.positions),
            );
            let ends = [(wing.a == first).then_some(wing.a), (wing.b == last).then_some(wing.b)];
            for end in ends.into_iter().flatten() {
                self.quadrics[usize::from(vertex)].add_boundary(given.offset(vertex, end), normal);
            }
        }
    }

    /// Takes in all displacements.
    pub(crate) fn set_displacements(&mut self, displacements: &[Displacement]) {
        self.displaced.clear();
        self.displaced.extend(displacements.iter().map(Displacement::norm_squared));
    }

    /// Takes in the displacement of a face.
    pub(crate) fn set_displacement(&mut self, face: u32, displacement: &Displacement) {
        self.displaced[face as usize] = displacement.norm_squared();
    }

    /// Hands the planes of u on to v, which is so far from it.
    pub(crate) fn hand_on(&mut self, u: u16, v: u16, offset: Vector3<f64>) {
        let quadric = self.quadrics[usize::from(u)];
        self.quadrics[usize::from(v)].add_moved(&quadric, offset);
    }

    /// Finds the costs of the half-edges from `u` by its quadric; answers the least. For a vertex `on_boundary` the inner
    /// edges are among them, so that the answer is a lower bound; the legality test sorts them out.
    pub(crate) fn half_edges(
        &self,
        given: &Given<'_>,
        u: u16,
        wings: &[Wing],
        on_boundary: bool,
        out: &mut Vec<(f32, u16)>,
    ) -> f32 {
        out.clear();
        out.extend(wings.iter().map(|wing| (0.0, wing.a)));
        if on_boundary {
            // The fan is open: its last vertex follows in a wing but leads none.
            let mut ends =
                wings.iter().map(|wing| wing.b).filter(|end| wings.iter().all(|other| other.a != *end));
            out.extend(ends.next().map(|end| (0.0, end)));
        }

        let cost = self.of_edges(given, u);
        let positions = given.patch.positions;
        let (mut least, mut last) = (f32::INFINITY, f32::INFINITY);
        let (twos, odd) = out.as_chunks_mut::<2>();
        for [(first, a), (second, b)] in twos {
            [*first, *second] = cost.of(positions, [*a, *b]);
            least = if *first < least { *first } else { least };
            last = if *second < last { *second } else { last };
        }
        for (cost_of, a) in odd {
            [*cost_of, _] = cost.of(positions, [*a; 2]);
            least = if *cost_of < least { *cost_of } else { least };
        }
        least = if last < least { last } else { least };

        // Across a group border it goes only where all members can follow.
        if !given.sides.is_empty() {
            out.retain(|(_, v)| given.is_known_with(u, *v));
            return out.iter().fold(f32::INFINITY, |least, (cost, _)| least.min(*cost));
        }
        least
    }

    /// Of the half-edges from a vertex.
    fn of_edges(&self, given: &Given<'_>, u: u16) -> EdgeCosts {
        let quadric = &self.quadrics[usize::from(u)];
        // Without area there is nothing to be far from.
        let per_area = if quadric.area > 0.0 { 1.0 / quadric.area } else { 0.0 };
        EdgeCosts {
            quadric: quadric.in_pairs(),
            origin: given.patch.positions[usize::from(u)].map(|x| f64x2::splat(x.into())),
            per_area: f64x2::splat(per_area * self.scale),
            length_term: f64x2::splat(LENGTH_TERM * quadric.area * self.per_mean_area * self.scale),
        }
    }

    /// Squared length of the longest displacement of some faces.
    #[inline]
    pub(crate) fn displaced(&self, wings: &[Wing]) -> f64 {
        let squares = wings.iter().map(|wing| self.displaced[wing.face as usize]);
        squares.fold(0.0, |most: f64, square| if square > most { square } else { most })
    }

    /// Guess for a vertex whose cheapest half-edge cost is given: its faces keep the displacement that they have.
    #[inline]
    pub(crate) fn guess(&self, displaced: f64, least: f32) -> f32 {
        self.factor * (least + (BOUND_TERM * displaced * self.scale) as f32)
    }

    /// Cost of a collapse whose displacements stay below a bound.
    pub(crate) fn of_bound(&self, bound: f64) -> f32 {
        (BOUND_TERM * bound * bound * self.scale) as f32
    }
}

/// Costs of the half-edges from one vertex, by its quadric. Each number is there twice, for two at a time.
struct EdgeCosts {
    quadric: QuadricPairs,
    origin: [f64x2; 3],
    /// One over the quadric's area, scaled.
    per_area: f64x2,
    /// Scaled, too.
    length_term: f64x2,
}

impl EdgeCosts {
    /// Of the half-edges to two vertices.
    #[inline]
    fn of(&self, positions: &[[f32; 3]], vertices: [u16; 2]) -> [f32; 2] {
        let [a, b] = vertices.map(|vertex| positions[usize::from(vertex)]);
        let [x, y, z] =
            [0, 1, 2].map(|axis| f64x2::new([f64::from(a[axis]), f64::from(b[axis])]) - self.origin[axis]);
        let squared = x * x + y * y + z * z;
        let costs = self.quadric.at([x, y, z]) * self.per_area + self.length_term * squared;
        costs.to_array().map(|cost| cost as f32)
    }
}

/// A power of two, so that scaling loses nothing: costs grow with the square of a length.
fn scale(positions: &[[f32; 3]]) -> f64 {
    let size = Aabb::of_points(positions).diagonal().clamp(f64::exp2(-150.0), f64::exp2(130.0));
    libm::exp2(-2.0 * libm::log2(size).floor())
}
