//! Deviation of two surfaces, both ways, from dense samples.

use crate::{
    bvh::{Bvh, Nearest},
    sample::{Density, Sampler},
};
use chpm_mesh::TriMesh;
use nalgebra::Point3;
use rayon::prelude::*;

/// Distances of one surface's samples to the other surface, in object units.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Side {
    /// The largest, over vertices, edges and triangles: never above the true one-sided Hausdorff distance.
    pub max: f64,
    /// The mean over the surface, by area.
    pub mean: f64,
    /// The root of the mean square over the surface, by area.
    pub rms: f64,
    /// Samples taken.
    pub samples: u64,
}

/// The deviation of two meshes.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Deviation {
    /// From the first mesh to the second.
    pub forward: Side,
    /// From the second mesh to the first.
    pub backward: Side,
}

impl Deviation {
    /// The larger maximum: a lower estimate of the Hausdorff distance.
    pub fn max(&self) -> f64 {
        self.forward.max.max(self.backward.max)
    }

    /// The larger root mean square.
    pub fn rms(&self) -> f64 {
        self.forward.rms.max(self.backward.rms)
    }
}

/// Measures `a` against `b` and `b` against `a`.
///
/// Every triangle gets at least `samples_per_triangle` samples inside (and the root of that on each edge), and both
/// sides get about `samples_per_triangle` times the triangles of the finer mesh, so that a coarse
/// mesh is sampled as densely as a fine one. An empty mesh deviates by nothing, and others deviate infinitely from it.
/// Runs on the current rayon pool; the result has the same bits for any number of threads.
///
/// # Panics
/// If a triangle names a vertex that is not there.
pub fn deviation(a: &TriMesh, b: &TriMesh, samples_per_triangle: usize) -> Deviation {
    let budget = samples_per_triangle.saturating_mul(a.triangles.len().max(b.triangles.len()));
    let density = Density { per_triangle: samples_per_triangle, budget, seed: 0 };
    let bvh = |mesh: &TriMesh| Bvh::new(&mesh.positions, &mesh.triangles);
    Deviation {
        forward: one_sided(&Sampler::new(a, density), &bvh(b)),
        backward: one_sided(&Sampler::new(b, density), &bvh(a)),
    }
}

/// Parts that one task measures in turn, each search hinting the next one; fixed, so that no result depends on threads.
const CHUNK: usize = 256;

/// Distances from samples to the triangles of `to`.
pub fn one_sided(samples: &Sampler<'_>, to: &Bvh) -> Side {
    let vertices = in_chunks(samples.vertex_count(), |index, search| {
        search.distance(to, samples.vertex(index));
    });
    let edges = in_chunks(samples.edge_count(), |index, search| {
        samples.on_edge(index).for_each(|p| {
            search.distance(to, p);
        });
    });
    let triangles = in_chunks(samples.triangle_count(), |index, search| {
        let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
        for p in samples.in_triangle(index) {
            let d = search.distance(to, p);
            (sum, squares, count) = (sum + d, squares + d * d, count + 1.0);
        }
        let area = samples.area(index);
        if count > 0.0 && area > 0.0 {
            search.area += area;
            search.sum += area * sum / count;
            search.squares += area * squares / count;
        }
    });
    let per_area = |sum: f64| if triangles.area > 0.0 { sum / triangles.area } else { 0.0 };
    Side {
        max: vertices.max.max(edges.max).max(triangles.max),
        mean: per_area(triangles.sum),
        rms: per_area(triangles.squares).sqrt(),
        samples: vertices.samples + edges.samples + triangles.samples,
    }
}

/// The running state of one chunk, and the sum of many.
#[derive(Clone, Copy, Default)]
struct Search {
    hint: Option<Nearest>,
    max: f64,
    samples: u64,
    area: f64,
    sum: f64,
    squares: f64,
}

impl Search {
    fn distance(&mut self, to: &Bvh, point: Point3<f64>) -> f64 {
        let nearest = to.nearest(point, self.hint);
        self.hint = Some(nearest);
        self.max = self.max.max(nearest.distance);
        self.samples += 1;
        nearest.distance
    }
}

fn in_chunks(count: usize, measure: impl Fn(usize, &mut Search) + Sync) -> Search {
    let chunk = |start: usize| {
        let mut search = Search::default();
        let start = start * CHUNK;
        (start..count.min(start + CHUNK)).for_each(|index| measure(index, &mut search));
        search
    };
    let parts: Vec<Search> = (0..count.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
    // Sums of floats depend on their order, so this one is sequential.
    parts.iter().fold(Search::default(), |all, part| Search {
        hint: None,
        max: all.max.max(part.max),
        samples: all.samples + part.samples,
        area: all.area + part.area,
        sum: all.sum + part.sum,
        squares: all.squares + part.squares,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::squared_distance;
    use chpm_mesh::synth::{Shape, Synth, hand};

    fn moved(mesh: &TriMesh, by: [f32; 3]) -> TriMesh {
        let positions = mesh.positions.iter().map(|p| std::array::from_fn(|a| p[a] + by[a])).collect();
        TriMesh::new(positions, mesh.triangles.clone())
    }

    #[test]
    fn parallel_planes_are_their_distance_apart() {
        let plane = hand::grid(3, 3);
        let result = deviation(&plane, &moved(&plane, [0.0, 0.0, 0.25]), 5);
        for side in [result.forward, result.backward] {
            assert_eq!((side.max, side.mean), (0.25, 0.25));
            assert!((side.rms - 0.25).abs() < 1e-15);
        }
        assert_eq!(result.forward, result.backward);
        // 16 vertices, 33 edges with 3 or 4 samples, 18 triangles with 5.
        assert!(result.forward.samples >= 16 + 33 * 3 + 18 * 5, "{result:?}");
    }

    #[test]
    fn the_sides_differ_where_one_mesh_has_more() {
        let (one, two) = (hand::soup(1), hand::soup(2));
        let result = deviation(&one, &two, 4);
        assert_eq!(result.forward.max, 0.0);
        // The second triangle ends at x = 3, the first at x = 1.
        assert_eq!(result.backward.max, 2.0);
        assert_eq!(result.max(), 2.0);
        assert_eq!(result.rms(), result.backward.rms);
    }

    #[test]
    fn a_mesh_does_not_deviate_from_itself() {
        let mesh = Synth::new(Shape::Plates, 3000, 1).to_mesh();
        assert!(deviation(&mesh, &mesh, 4).max() < 1e-12);
    }

    #[test]
    fn an_inscribed_ball_deviates_by_its_deepest_chord() {
        let (coarse, fine) = (hand::icosphere(1), hand::icosphere(4));
        let result = deviation(&fine, &coarse, 10);
        let depth = |t: &[u32; 3]| {
            let [a, b, c] = coarse.corners(*t);
            let n = chpm_mesh::geom::area_vector(a, b, c);
            1.0 - n.normalize().dot(&chpm_mesh::geom::to_f64(a).coords)
        };
        let deepest = coarse.triangles.iter().map(depth).fold(0.0, f64::max);
        assert!(result.max() <= deepest + 1e-6 && result.max() > 0.97 * deepest, "{result:?} {deepest}");
    }

    #[test]
    fn nothing_against_something() {
        let empty = TriMesh::default();
        let result = deviation(&empty, &hand::cube(), 3);
        assert_eq!(result.forward, Side::default());
        assert_eq!(result.max(), f64::INFINITY);
        assert_eq!(deviation(&empty, &empty, 3), Deviation::default());
    }

    #[test]
    fn agrees_with_brute_force_and_does_not_depend_on_threads() {
        let fine = Synth::new(Shape::Terrain, 800, 4).to_mesh();
        let coarse = crate::naive::simplify(&fine, 60, &[]);
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let results = [1, 2, 3].map(|n| pool(n).install(|| deviation(&fine, &coarse, 6)));
        assert_eq!(results[0], results[1]);
        assert_eq!(results[0], results[2]);

        let density = Density { per_triangle: 6, budget: 6 * fine.triangles.len(), seed: 0 };
        let brute = |from: &TriMesh, to: &TriMesh| {
            let s = Sampler::new(from, density);
            let points = (0..s.vertex_count())
                .map(|v| s.vertex(v))
                .chain((0..s.edge_count()).flat_map(|e| s.on_edge(e)))
                .chain((0..s.triangle_count()).flat_map(|t| s.in_triangle(t)));
            points
                .map(|p| {
                    let all = to.triangles.iter().map(|t| squared_distance(p, to.corners(*t)));
                    all.fold(f64::INFINITY, f64::min).sqrt()
                })
                .fold(0.0, f64::max)
        };
        assert!((results[0].forward.max - brute(&fine, &coarse)).abs() < 1e-12);
        assert!((results[0].backward.max - brute(&coarse, &fine)).abs() < 1e-12);
    }
}
