//! Nearest distance from a point to a set of triangles, exact up to rounding.

use crate::box_tree::BoxTree;
use crate::parting::Parting;
use crate::proof::{Corners, Face};
use chpm_mesh::geom;
use nalgebra::Point3;

/// A hierarchy of boxes over triangles, with its own copy of their corners.
#[derive(Clone, Debug)]
pub struct Bvh {
    tree: BoxTree,
    /// Corners, in the order of the leaves.
    corners: Vec<[[f32; 3]; 3]>,
}

/// The nearest triangle that a search has found.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Nearest {
    /// Distance; infinite where the set is empty or the point is not a number.
    pub distance: f64,
    /// Place of the triangle in the leaves: a hint for a nearby search.
    pub(crate) place: usize,
}

impl Bvh {
    /// Builds over `triangles`; those with the same three corners are one.
    ///
    /// # Panics
    /// If a triangle names a vertex that is not there.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let different = different(triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect());
        let tree = BoxTree::of_triangles(&different);
        let corners = tree.order().iter().map(|&i| different[i as usize]).collect();
        Bvh { tree, corners }
    }

    /// Bytes of memory.
    pub fn len_bytes(&self) -> usize {
        self.tree.len_bytes() + size_of_val(&self.corners[..])
    }

    /// What tells its two halves apart where their boxes do not.
    pub(crate) fn halves(&self) -> Option<Parting> {
        self.tree.halves()
    }

    /// Distance from `point` to the nearest triangle; infinite where there is none.
    pub fn distance(&self, point: Point3<f64>) -> f64 {
        self.nearest(point, None).distance
    }

    /// The nearest triangle. A `hint` from a nearby point changes the time only.
    pub fn nearest(&self, point: Point3<f64>, hint: Option<Nearest>) -> Nearest {
        let mut best = f64::INFINITY;
        let place = self.improve(point, hint.map(|h| h.place), &mut best).unwrap_or(0);
        Nearest { distance: best.sqrt(), place }
    }

    /// Lowers `best`, a squared distance, to what the triangles are away at least, with rounding on the safe side.
    pub(crate) fn at_least(&self, point: Point3<f64>, best: &mut f64) {
        self.tree.search_triangles(point, best, |place, best| {
            *best = best.min(Face::new(self.corners[place]).at_least(point).powi(2));
        });
    }

    /// The triangle at a place.
    pub(crate) fn corners(&self, place: usize) -> Corners {
        self.corners[place]
    }

    /// Lowers `best`, a squared distance, to that of the nearest triangle, and answers its place; none if no triangle is nearer.
    pub(crate) fn improve(&self, point: Point3<f64>, hint: Option<usize>, best: &mut f64) -> Option<usize> {
        let mut found = None;
        // What is on the surface up to rounding is on it: nothing nearer is looked for among triangles that all come there.
        let rounding = ROUNDING * point.coords.amax();
        let mut visit = |place: usize, best: &mut f64| {
            let d = squared_distance(point, self.corners[place]);
            if d < *best {
                *best = if d <= rounding * rounding { 0.0 } else { d };
                found = Some(place);
            }
        };
        if let Some(hint) = hint.filter(|h| *h < self.corners.len()) {
            visit(hint, best);
        }
        self.tree.search_triangles(point, best, visit);
        found
    }
}

/// Distances below this share of a point's largest coordinate are taken for none; 32 times what f64 rounds it by.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Each triangle once, whatever the order of its corners.
fn different(mut triangles: Vec<[[f32; 3]; 3]>) -> Vec<[[f32; 3]; 3]> {
    let key = |corners: &[[f32; 3]; 3]| {
        let mut bits = corners.map(|corner| corner.map(f32::to_bits));
        bits.sort_unstable();
        bits
    };
    // Equal triangles have equal sums, which are quicker to sort than triangles; those of few others are equal.
    let sum = |corners: &[[f32; 3]; 3]| {
        let mixed = corners.map(|corner| {
            let word = |hash: u64, x: f32| {
                (hash ^ u64::from(x.to_bits())).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
            };
            corner.into_iter().fold(0, word)
        });
        mixed.into_iter().fold(0, u64::wrapping_add)
    };
    let mut order: Vec<(u64, u32)> = triangles.iter().map(sum).zip(0..).collect();
    order.sort_unstable();
    let mut twin = Vec::new();
    for same in order.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
        let mut keys: Vec<_> = same.iter().map(|(_, i)| (key(&triangles[*i as usize]), *i)).collect();
        keys.sort_unstable();
        twin.extend(keys.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1));
    }
    if !twin.is_empty() {
        let mut is_twin = vec![false; triangles.len()];
        twin.iter().for_each(|i| is_twin[*i as usize] = true);
        let mut is_twin = is_twin.into_iter();
        triangles.retain(|_| !is_twin.next().unwrap_or(false));
    }
    triangles
}

/// Squared distance from a point to a triangle, which may have no area.
///
/// The nearest point is in the plane where the foot of the perpendicular is inside all three edges, and on an edge
/// otherwise; edges alone are right for a triangle without area. The plane is taken from the two shortest edges, which for
/// needles is as good as for any triangle; for a flat cap it is off by its aspect ratio times the rounding of f64.
pub fn squared_distance(point: Point3<f64>, corners: [[f32; 3]; 3]) -> f64 {
    // Written out: a map over an array is a call in here.
    let corners = [geom::to_f64(corners[0]), geom::to_f64(corners[1]), geom::to_f64(corners[2])];
    let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
    let (ab, bc, ca) = (edges[0].norm_squared(), edges[1].norm_squared(), edges[2].norm_squared());
    // The corner between the two shortest edges.
    let apex = if ab >= bc && ab >= ca { 2 } else { usize::from(ca >= bc) };
    let normal = edges[(apex + 2) % 3].cross(&edges[apex]);
    let inside = |i: usize| edges[i].cross(&(point - corners[i])).dot(&normal) >= 0.0;
    let area_squared = normal.norm_squared();
    if area_squared > 0.0 && inside(0) && inside(1) && inside(2) {
        let height = normal.dot(&(point - corners[apex]));
        return height * height / area_squared;
    }
    let segment = |i: usize| squared_distance_to_segment(point, corners[i], corners[(i + 1) % 3]);
    segment(0).min(segment(1)).min(segment(2))
}

fn squared_distance_to_segment(point: Point3<f64>, a: Point3<f64>, b: Point3<f64>) -> f64 {
    let along = b - a;
    let length_squared = along.norm_squared();
    let t =
        if length_squared > 0.0 { (along.dot(&(point - a)) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    (point - (a + t * along)).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_synth::{Shape, Synth, hand};
    use proptest::prelude::*;

    #[test]
    fn distances_to_one_triangle() {
        let triangle = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        for (point, expected) in [
            ([1.0, 1.0, 2.0], 4.0),
            ([1.0, 1.0, 0.0], 0.0),
            ([2.0, -1.0, 0.0], 1.0),
            ([-3.0, -4.0, 0.0], 25.0),
            ([6.0, 0.0, 0.0], 4.0),
            ([4.0, 3.0, 0.0], 5.76),
        ] {
            let d = squared_distance(point.into(), triangle);
            assert!((d - expected).abs() < 1e-12, "{point:?}: {d}");
        }
        let needle = [[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        assert_eq!(squared_distance([1.5, 2.0, 0.0].into(), needle), 4.0);
        assert_eq!(squared_distance([0.0, 3.0, 4.0].into(), [[0.0; 3]; 3]), 25.0);
        // A needle with its short side anywhere, and a point above it.
        let (a, b, c) = ([0.0, 1e-6, 0.0], [0.0, -1e-6, 0.0], [1.0, 0.0, 0.0]);
        for needle in [[a, b, c], [b, c, a], [c, a, b], [a, c, b]] {
            let d = squared_distance([0.3, 0.0, 2.0].into(), needle);
            assert!((d - 4.0).abs() < 1e-14, "{d}");
        }
    }

    #[test]
    fn an_empty_set_is_infinitely_far() {
        assert_eq!(Bvh::new(&[], &[]).distance(Point3::origin()), f64::INFINITY);
        let cube = hand::cube();
        let bvh = Bvh::new(&cube.positions, &cube.triangles);
        assert_eq!(bvh.distance([f64::NAN, 0.0, 0.0].into()), f64::INFINITY);
        assert_eq!(bvh.distance([0.5, 0.5, 0.4].into()), 0.4);
    }

    #[test]
    fn equal_triangles_do_not_upset_the_build() {
        let mesh = hand::grid(1, 1);
        let many = vec![mesh.triangles[0]; 1000];
        let bvh = Bvh::new(&mesh.positions, &many);
        assert_eq!(bvh.distance([0.5, 0.25, 3.0].into()), 3.0);
        assert_eq!(bvh.corners.len(), 1);
    }

    #[test]
    fn equal_triangles_are_one_whatever_their_corners_order() {
        let [a, b, c] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let all =
            vec![[a, b, c], [b, a, c], [c, a, b], [a, b, b], [b, b, a], [a, a, b], [a, c, [-0.0, 1.0, 1.0]]];
        assert_eq!(different(all), [[a, b, c], [a, b, b], [a, a, b], [a, c, [-0.0, 1.0, 1.0]]]);
    }

    #[test]
    fn a_point_on_many_triangles_asks_few() {
        // All have the origin's neighbourhood in common, and no two are equal.
        let turned = |i: u32| {
            let angle = f64::from(i) * 1e-3;
            let far = |angle: f64| [(100.0 * angle.cos()) as f32, (100.0 * angle.sin()) as f32, 0.3];
            [far(angle), far(angle + 2.0), far(angle + 4.0)]
        };
        let corners: Vec<[[f32; 3]; 3]> = (0..2000).map(turned).collect();
        let triangles: Vec<[u32; 3]> = (0..2000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let bvh = Bvh::new(corners.as_flattened(), &triangles);
        for point in [[1.0, 2.0, f64::from(0.3_f32)], [-3.0, 0.7, f64::from(0.3_f32)]] {
            let (mut visits, mut best) = (0, f64::INFINITY);
            bvh.tree.search_triangles(point.into(), &mut best, |place, best| {
                visits += 1;
                bvh.improve(point.into(), Some(place), best);
            });
            assert!(best == 0.0 && visits <= 8, "{visits} visits, {best}");
        }
    }

    #[test]
    fn long_triangles_askew_ask_few() {
        let ring = |i: u32, height: f32| {
            let angle = 0.2 + 1.2 * f64::from(i) / 2000.0;
            [angle.cos() as f32, angle.sin() as f32, height]
        };
        let blades: Vec<[[f32; 3]; 3]> =
            (0..2000).map(|i| [[0.0, 0.0, 1.0], ring(i, 0.0), ring(i + 1, 0.0)]).collect();
        let pages: Vec<[[f32; 3]; 3]> =
            (0..2000).map(|i| [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], ring(i, 0.1)]).collect();
        // Two fans of different size on one another, one of them upside down.
        let below = blades[..1900].iter().map(|t| t.map(|[x, y, z]| [x, y, -z]));
        let fans: Vec<[[f32; 3]; 3]> = blades.iter().copied().chain(below).collect();
        for (corners, point) in
            [(blades, [0.4, 0.3, 0.5]), (fans, [0.4, 0.3, -0.5]), (pages, [0.3, 0.2, 0.1])]
        {
            let triangles: Vec<[u32; 3]> =
                (0..corners.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let bvh = Bvh::new(corners.as_flattened(), &triangles);
            let (mut visits, mut best) = (0, f64::INFINITY);
            bvh.tree.search_triangles(point.into(), &mut best, |place, best| {
                visits += 1;
                bvh.improve(point.into(), Some(place), best);
            });
            let all = corners.iter().map(|t| squared_distance(point.into(), *t));
            assert_eq!(best, all.fold(f64::INFINITY, f64::min));
            assert!(visits <= 16, "{visits} visits");
        }
    }

    proptest! {
        #[test]
        fn agrees_with_looking_at_every_triangle(
            seed in 0u64..1000,
            point in prop::array::uniform3(-0.5f64..1.5),
            other in prop::array::uniform3(-0.5f64..1.5),
        ) {
            let shape = Shape::ALL[seed as usize % 5];
            let mesh = Synth::new(shape, 600, seed).to_mesh();
            let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
            let all = mesh.triangles.iter().map(|t| squared_distance(point.into(), mesh.corners(*t)));
            let least = all.fold(f64::INFINITY, f64::min).sqrt();
            prop_assert!((bvh.distance(point.into()) - least).abs() <= 1e-12);
            let hint = bvh.nearest(other.into(), None);
            let hinted = bvh.nearest(point.into(), Some(hint));
            prop_assert!((hinted.distance - least).abs() <= 1e-12);
        }
    }
}
