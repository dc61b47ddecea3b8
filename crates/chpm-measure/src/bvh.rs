//! Nearest distance from a point to a set of triangles, exact up to rounding.

use crate::box_tree::BoxTree;
use chpm_mesh::{Aabb, geom};
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
    /// Builds over `triangles`.
    ///
    /// # Panics
    /// If a triangle names a vertex that is not there.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let corners = |t: [u32; 3]| t.map(|v| positions[v as usize]);
        let boxes: Vec<Aabb> = triangles.iter().map(|t| Aabb::of_points(&corners(*t))).collect();
        let tree = BoxTree::new(&boxes);
        let corners = tree.order().iter().map(|&i| corners(triangles[i as usize])).collect();
        Bvh { tree, corners }
    }

    /// Bytes of memory.
    pub fn len_bytes(&self) -> usize {
        self.tree.len_bytes() + size_of_val(&self.corners[..])
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

    /// Lowers `best`, a squared distance, to that of the nearest triangle, and answers its place; none if no triangle is nearer.
    pub(crate) fn improve(&self, point: Point3<f64>, hint: Option<usize>, best: &mut f64) -> Option<usize> {
        let mut found = None;
        let mut visit = |place: usize, best: &mut f64| {
            let d = squared_distance(point, self.corners[place]);
            if d < *best {
                *best = d;
                found = Some(place);
            }
        };
        if let Some(hint) = hint.filter(|h| *h < self.corners.len()) {
            visit(hint, best);
        }
        self.tree.search(point, best, visit);
        found
    }

    /// Calls `visit` with the index of every triangle whose box may come within `radius` of `point`.
    pub fn for_each_near(&self, point: Point3<f64>, radius: f64, visit: &mut dyn FnMut(u32)) {
        self.tree.for_each_near(point, radius, &mut |place| visit(self.tree.order()[place]));
    }
}

/// Squared distance from a point to a triangle, which may have no area.
///
/// The nearest point is in the plane where the foot of the perpendicular is inside all three edges, and on an edge
/// otherwise; edges alone are right for a triangle without area. The plane is taken from the two shortest edges, which for
/// needles is as good as for any triangle; for a flat cap it is off by its aspect ratio times the rounding of f64.
pub fn squared_distance(point: Point3<f64>, corners: [[f32; 3]; 3]) -> f64 {
    let corners = corners.map(geom::to_f64);
    let edges = [0, 1, 2].map(|i| corners[(i + 1) % 3] - corners[i]);
    let [ab, bc, ca] = edges.map(|e| e.norm_squared());
    // The corner between the two shortest edges.
    let apex = if ab >= bc && ab >= ca { 2 } else { usize::from(ca >= bc) };
    let normal = edges[(apex + 2) % 3].cross(&edges[apex]);
    let inside = |i: usize| edges[i].cross(&(point - corners[i])).dot(&normal) >= 0.0;
    let area_squared = normal.norm_squared();
    if area_squared > 0.0 && (0..3).all(inside) {
        let height = normal.dot(&(point - corners[apex]));
        return height * height / area_squared;
    }
    (0..3)
        .map(|i| squared_distance_to_segment(point, corners[i], corners[(i + 1) % 3]))
        .fold(f64::INFINITY, f64::min)
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
    use chpm_mesh::synth::{Shape, Synth, hand};
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
        assert_eq!(Bvh::new(&mesh.positions, &many).distance([0.5, 0.25, 3.0].into()), 3.0);
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
            let mut near = Vec::new();
            bvh.for_each_near(point.into(), least + 0.1, &mut |id| near.push(id));
            for (id, triangle) in mesh.triangles.iter().enumerate() {
                let close = squared_distance(point.into(), mesh.corners(*triangle)).sqrt() < least + 0.1;
                prop_assert!(!close || near.contains(&(id as u32)));
            }
        }
    }
}
