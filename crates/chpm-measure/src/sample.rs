//! Dense deterministic samples of a mesh: its vertices, its edges, its triangles.

use chpm_mesh::{TriMesh, geom};
use nalgebra::Point3;
use std::ops::Range;

/// How many samples go on edges and triangles; vertices are always all sampled.
///
/// Every triangle gets `per_triangle`. Where a mesh is coarse those are far apart, so a mesh may be given a `budget` as
/// well, shared by area: a triangle then gets the larger of the two. Edges go by the square root of both, by length.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Density {
    /// Least samples inside each triangle.
    pub per_triangle: usize,
    /// Samples inside all triangles together, by area.
    pub budget: usize,
    /// Moves the samples about.
    pub seed: u64,
}

/// A mesh with the number of samples on each of its parts.
pub struct Sampler<'a> {
    mesh: &'a TriMesh,
    density: Density,
    vertices: Vec<u32>,
    edges: Vec<[u32; 2]>,
    /// By triangle.
    areas: Vec<f64>,
    total_area: f64,
    total_length: f64,
}

impl<'a> Sampler<'a> {
    /// Lists the vertices and edges that triangles use.
    ///
    /// # Panics
    /// If a triangle names a vertex that is not there.
    pub fn new(mesh: &'a TriMesh, density: Density) -> Self {
        let mut is_used = vec![false; mesh.positions.len()];
        mesh.triangles.as_flattened().iter().for_each(|v| is_used[*v as usize] = true);
        let vertices = (0..).zip(is_used).filter(|(_, used)| *used).map(|(v, _)| v).collect();
        fn edge((u, v): (u32, u32)) -> u64 {
            u64::from(u.min(v)) << 32 | u64::from(u.max(v))
        }
        let mut edges: Vec<u64> =
            mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).map(edge).collect();
        edges.sort_unstable();
        edges.dedup();
        let edges = edges.into_iter().map(|edge| [(edge >> 32) as u32, edge as u32]).collect();
        let areas: Vec<f64> = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = mesh.corners(*t);
                0.5 * geom::area_vector(a, b, c).norm()
            })
            .collect();
        let total_area = areas.iter().sum();
        let mut sampler = Sampler { mesh, density, vertices, edges, areas, total_area, total_length: 0.0 };
        sampler.total_length = (0..sampler.edges.len()).map(|e| sampler.length(e)).sum();
        sampler
    }

    /// Vertices, edges and triangles together: what [`Sampler::samples_of`] counts.
    pub fn part_count(&self) -> usize {
        self.vertices.len() + self.edges.len() + self.mesh.triangles.len()
    }

    /// Hands the samples of parts to `visit`, each with the area that it stands for, which is 0 on vertices and edges. Parts
    /// are the vertices, then the edges, then the triangles.
    pub fn samples_of(&self, parts: Range<usize>, mut visit: impl FnMut(Point3<f64>, f64)) {
        let (edges, triangles) = (self.vertices.len(), self.vertices.len() + self.edges.len());
        for part in parts {
            if part < edges {
                visit(self.vertex(part), 0.0);
            } else if part < triangles {
                self.on_edge(part - edges).for_each(|p| visit(p, 0.0));
            } else {
                let samples = self.in_triangle(part - triangles);
                let share = self.area(part - triangles) / samples.len().max(1) as f64;
                samples.for_each(|p| visit(p, share));
            }
        }
    }

    /// Whether any triangle has an area.
    pub fn has_area(&self) -> bool {
        self.total_area > 0.0
    }

    /// Vertices to sample.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    /// Edges to sample.
    pub fn edge_count(&self) -> usize {
        self.edges.len()
    }

    /// Triangles to sample.
    pub fn triangle_count(&self) -> usize {
        self.mesh.triangles.len()
    }

    /// Area of a triangle.
    pub fn area(&self, triangle: usize) -> f64 {
        self.areas[triangle]
    }

    fn length(&self, edge: usize) -> f64 {
        let [a, b] = self.edges[edge].map(|v| self.mesh.positions[v as usize]);
        geom::distance(a, b)
    }

    /// The one sample of a vertex.
    pub fn vertex(&self, index: usize) -> Point3<f64> {
        geom::to_f64(self.mesh.positions[self.vertices[index] as usize])
    }

    /// Samples strictly inside an edge, at equal steps.
    pub fn on_edge(&self, edge: usize) -> impl Iterator<Item = Point3<f64>> {
        fn root(n: usize) -> f64 {
            (n as f64).sqrt().ceil()
        }
        let share =
            root(self.density.budget) * root(self.edges.len()) * self.length(edge) / self.total_length;
        let count = (share as usize).max(root(self.density.per_triangle) as usize);
        let [a, b] = self.edges[edge].map(|v| geom::to_f64(self.mesh.positions[v as usize]));
        (0..count).map(move |i| a + (b - a) * ((i as f64 + 0.5) / count as f64))
    }

    /// Samples inside a triangle: one in each of equal strips of area, spread along the strips by the golden ratio.
    pub fn in_triangle(&self, triangle: usize) -> impl ExactSizeIterator<Item = Point3<f64>> {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let share = self.density.budget as f64 * self.area(triangle) / self.total_area;
        let count = (share as usize).max(self.density.per_triangle);
        let [a, b, c] = self.mesh.corners(self.mesh.triangles[triangle]).map(geom::to_f64);
        let shift = scramble(self.density.seed, triangle as u64);
        (0..count).map(move |i| {
            let reach = ((i as f64 + 0.5) / count as f64).sqrt();
            let across = (shift + i as f64 * GOLDEN).fract();
            a + ((b - a) * (1.0 - across) + (c - a) * across) * reach
        })
    }
}

/// A number in [0, 1) that has nothing to do with its neighbours'.
fn scramble(seed: u64, index: u64) -> f64 {
    let mut x = seed.rotate_left(32) ^ index.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for _ in 0..2 {
        x = (x ^ (x >> 31)).wrapping_mul(0x7fb5_d329_728e_a185);
    }
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::squared_distance;
    use chpm_synth::hand;

    #[test]
    fn every_part_is_sampled_once() {
        let cube = hand::cube();
        let sampler = Sampler::new(&cube, Density { per_triangle: 9, budget: 0, seed: 0 });
        let counts = (sampler.vertex_count(), sampler.edge_count(), sampler.triangle_count());
        assert_eq!(counts, (8, 18, 12));
        assert_eq!(sampler.on_edge(0).count(), 3);
        assert_eq!(sampler.in_triangle(0).count(), 9);
        assert_eq!(sampler.area(3), 0.5);
        let (mut count, mut area) = (0, 0.0);
        sampler.samples_of(0..sampler.part_count(), |_, share| {
            count += 1;
            area += share;
        });
        assert_eq!(count, 8 + 18 * 3 + 12 * 9);
        assert!((area - 6.0).abs() < 1e-12, "{area}");
    }

    #[test]
    fn samples_lie_on_their_triangle_and_fill_it() {
        let mesh = hand::strip(1);
        let sampler = Sampler::new(&mesh, Density { per_triangle: 1000, budget: 0, seed: 7 });
        let corners = mesh.corners(mesh.triangles[0]);
        let mut mean = Point3::origin().coords;
        for p in sampler.in_triangle(0) {
            assert!(squared_distance(p, corners) < 1e-24);
            mean += p.coords / 1000.0;
        }
        let middle: nalgebra::Vector3<f64> =
            corners.map(|c| geom::to_f64(c).coords).iter().sum::<nalgebra::Vector3<f64>>() / 3.0;
        assert!((mean - middle).norm() < 1e-3, "{mean}");
    }

    #[test]
    fn a_budget_goes_by_area_and_length() {
        let mut mesh = hand::soup(2);
        mesh.positions[3..].iter_mut().for_each(|p| *p = p.map(|x| 3.0 * x));
        let sampler = Sampler::new(&mesh, Density { per_triangle: 2, budget: 100, seed: 0 });
        assert_eq!([0, 1].map(|t| sampler.in_triangle(t).count()), [10, 90]);
        // Six edges, 25 samples: 2 + 2 * sqrt(2) of length against three times that.
        let long = sampler.edges.iter().position(|e| *e == [4, 5]).unwrap();
        assert_eq!(
            sampler.on_edge(long).count(),
            (30.0 * 3.0 * 2f64.sqrt() / (4.0 * (2.0 + 2f64.sqrt()))) as usize
        );
    }

    #[test]
    fn nothing_has_no_samples() {
        let empty = TriMesh::default();
        let sampler = Sampler::new(&empty, Density { per_triangle: 4, budget: 100, seed: 0 });
        assert_eq!((sampler.vertex_count(), sampler.edge_count(), sampler.triangle_count()), (0, 0, 0));
        let flat = TriMesh::new(vec![[1.0; 3]; 3], vec![[0, 1, 2]]);
        let sampler = Sampler::new(&flat, Density { per_triangle: 4, budget: 100, seed: 0 });
        assert_eq!(sampler.in_triangle(0).count(), 4);
    }
}
