//! Nearest distance from a point to a set of triangles, exact up to rounding.

use chpm_mesh::{Aabb, geom};
use nalgebra::Point3;

/// A hierarchy of boxes over triangles, with its own copy of their corners.
#[derive(Clone, Debug)]
pub struct Bvh {
    nodes: Vec<Node>,
    /// Corners, in the order of the leaves.
    corners: Vec<[[f32; 3]; 3]>,
    /// Where each triangle of the input went.
    ids: Vec<u32>,
}

/// A leaf has triangles `first..first + count`; an inner node has none, its children are the next node and `first`.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    first: u32,
    count: u32,
}

/// The nearest triangle that a search has found.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Nearest {
    /// Distance; infinite where the set is empty or the point is not a number.
    pub distance: f64,
    /// Place of the triangle in the leaves: a hint for a nearby search.
    place: usize,
}

const LEAF: usize = 4;

impl Bvh {
    /// Builds over `triangles`; medians along the longest axis, ties by index.
    ///
    /// # Panics
    /// If a triangle names a vertex that is not there.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let all: Vec<[[f32; 3]; 3]> = triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
        let middles: Vec<[f64; 3]> = all.iter().map(|t| Aabb::of_points(t).center().coords.into()).collect();
        let mut ids: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut bvh = Bvh { nodes: Vec::new(), corners: Vec::with_capacity(all.len()), ids: Vec::new() };
        if !ids.is_empty() {
            bvh.build(&all, &middles, &mut ids, 0);
        }
        bvh.corners.extend(ids.iter().map(|&i| all[i as usize]));
        bvh.ids = ids;
        bvh
    }

    fn build(&mut self, all: &[[[f32; 3]; 3]], middles: &[[f64; 3]], ids: &mut [u32], first: usize) {
        let bounds = Aabb::of_points(ids.iter().flat_map(|&i| &all[i as usize]));
        let node = self.nodes.len();
        self.nodes.push(Node { bounds, first: first as u32, count: ids.len() as u32 });
        if ids.len() <= LEAF {
            return;
        }
        let mut extent = [(f64::INFINITY, f64::NEG_INFINITY); 3];
        for middle in ids.iter().map(|&i| middles[i as usize]) {
            for (range, c) in extent.iter_mut().zip(middle) {
                *range = (range.0.min(c), range.1.max(c));
            }
        }
        let width = |a: &usize| extent[*a].1 - extent[*a].0;
        let axis = (0..3).max_by(|a, b| width(a).total_cmp(&width(b))).unwrap_or(0);
        let half = ids.len() / 2;
        ids.select_nth_unstable_by(half, |&a, &b| {
            let [x, y] = [a, b].map(|i| middles[i as usize][axis]);
            x.total_cmp(&y).then(a.cmp(&b))
        });
        let (low, high) = ids.split_at_mut(half);
        self.build(all, middles, low, first);
        let right = self.nodes.len() as u32;
        self.build(all, middles, high, first + half);
        self.nodes[node] = Node { bounds, first: right, count: 0 };
    }

    /// Distance from `point` to the nearest triangle; infinite where there is none.
    pub fn distance(&self, point: Point3<f64>) -> f64 {
        self.nearest(point, None).distance
    }

    /// The nearest triangle. A `hint` from a nearby point changes the time only.
    pub fn nearest(&self, point: Point3<f64>, hint: Option<Nearest>) -> Nearest {
        let mut best = Nearest { distance: f64::INFINITY, place: 0 };
        let mut best_squared = f64::INFINITY;
        let mut visit = |place: usize, best_squared: &mut f64| {
            let d = squared_distance(point, self.corners[place]);
            if d < *best_squared {
                *best_squared = d;
                best.place = place;
            }
        };
        if let Some(hint) = hint.filter(|h| h.place < self.corners.len()) {
            visit(hint.place, &mut best_squared);
        }
        // Medians halve, so the depth is at most 32; a node leaves one entry behind.
        let mut stack = [(0.0, 0); 64];
        let mut len = usize::from(!self.nodes.is_empty());
        while len > 0 {
            len -= 1;
            let (bound, index) = stack[len];
            if bound >= best_squared {
                continue;
            }
            let node = self.nodes[index];
            if node.count > 0 {
                for place in node.first..node.first + node.count {
                    visit(place as usize, &mut best_squared);
                }
                continue;
            }
            let children = [index + 1, node.first as usize];
            let [near, far] = children.map(|c| (box_squared_distance(point, &self.nodes[c].bounds), c));
            let (near, far) = if far.0 < near.0 { (far, near) } else { (near, far) };
            stack[len] = far;
            stack[len + 1] = near;
            len += 2;
        }
        best.distance = best_squared.sqrt();
        best
    }

    /// Calls `visit` with the index of every triangle whose box comes within `radius` of `point`.
    pub fn for_each_near(&self, point: Point3<f64>, radius: f64, visit: &mut dyn FnMut(u32)) {
        let mut stack = vec![0];
        while let Some(node) = stack.pop().and_then(|index: usize| Some((index, self.nodes.get(index)?))) {
            let (index, node) = node;
            if box_squared_distance(point, &node.bounds) > radius * radius {
                continue;
            }
            if node.count > 0 {
                let leaf = node.first as usize..(node.first + node.count) as usize;
                self.ids[leaf].iter().for_each(|&id| visit(id));
            } else {
                stack.extend([node.first as usize, index + 1]);
            }
        }
    }
}

fn box_squared_distance(point: Point3<f64>, bounds: &Aabb) -> f64 {
    let excess = |a: usize| {
        let (low, high) = (f64::from(bounds.min[a]), f64::from(bounds.max[a]));
        (low - point[a]).max(point[a] - high).max(0.0)
    };
    let [x, y, z] = [0, 1, 2].map(excess);
    x * x + y * y + z * z
}

/// Squared distance from a point to a triangle, which may have no area.
///
/// The nearest point is in the plane where the foot of the perpendicular is inside all three edges, and on an edge
/// otherwise; edges alone are right for a triangle without area.
pub fn squared_distance(point: Point3<f64>, corners: [[f32; 3]; 3]) -> f64 {
    let corners = corners.map(geom::to_f64);
    let [a, b, c] = corners;
    let normal = (b - a).cross(&(c - a));
    let inside = |i: usize| {
        let (p, q) = (corners[i], corners[(i + 1) % 3]);
        (q - p).cross(&(point - p)).dot(&normal) >= 0.0
    };
    let area_squared = normal.norm_squared();
    if area_squared > 0.0 && (0..3).all(inside) {
        let height = normal.dot(&(point - a));
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
