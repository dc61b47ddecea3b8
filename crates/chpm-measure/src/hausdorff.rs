//! Deviation of two surfaces, both ways, from dense samples.

use crate::{
    bvh::{Bvh, Nearest},
    sample::{Density, Sampler},
    sweep::Block,
    tally::{Side, Tally},
};
use chpm_mesh::TriMesh;
use nalgebra::Point3;
use rayon::prelude::*;

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

    /// The larger mean.
    pub fn mean(&self) -> f64 {
        self.forward.mean.max(self.backward.mean)
    }

    /// The larger root mean square.
    pub fn rms(&self) -> f64 {
        self.forward.rms.max(self.backward.rms)
    }

    /// Where the larger maximum was found, on the surface that was sampled; none if nothing was.
    pub fn at(&self) -> Option<[f64; 3]> {
        if self.backward.max > self.forward.max { self.backward.at } else { self.forward.at }
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
///
/// # Examples
/// ```
/// use chpm_synth::hand;
///
/// let (coarse, fine) = (hand::icosphere(1), hand::icosphere(3));
/// let found = chpm_measure::deviation(&coarse, &fine, 10);
/// assert!(found.mean() < found.rms() && found.rms() < found.max());
/// assert_eq!(chpm_measure::deviation(&fine, &fine, 10).max(), 0.0);
/// ```
pub fn deviation(a: &TriMesh, b: &TriMesh, samples_per_triangle: usize) -> Deviation {
    let all = deviation_while(a, b, samples_per_triangle, &|_, _| {}, &|| true);
    all.unwrap_or_default()
}

/// As [`deviation`], and tells `progress` from any thread how many more parts (vertices, edges, triangles) are measured,
/// and of how many. `go_on` is asked before every sample whether to: thousands may be on one triangle. If not, there is no answer.
///
/// # Panics
/// As [`deviation`].
pub fn deviation_while(
    a: &TriMesh,
    b: &TriMesh,
    samples_per_triangle: usize,
    progress: &(dyn Fn(u64, u64) + Sync),
    go_on: &(dyn Fn() -> bool + Sync),
) -> Option<Deviation> {
    let budget = samples_per_triangle.saturating_mul(a.triangles.len().max(b.triangles.len()));
    let density = Density { per_triangle: samples_per_triangle, budget, seed: 0 };
    let (from_a, from_b) = (Sampler::new(a, density), Sampler::new(b, density));
    let all = (from_a.part_count() + from_b.part_count()) as u64;
    let [forward, backward] = [(&from_a, b), (&from_b, a)].map(|(samples, to)| {
        let bvh = Bvh::new(&to.positions, &to.triangles);
        one_sided(samples, &bvh, &|done| progress(done, all), go_on)
    });
    Some(Deviation { forward: forward?, backward: backward? })
}

/// Distances from samples to the triangles of `to`; `progress` hears how many more parts are done.
fn one_sided(
    samples: &Sampler<'_>,
    to: &Bvh,
    progress: &(dyn Fn(u64) + Sync),
    go_on: &(dyn Fn() -> bool + Sync),
) -> Option<Side> {
    // Where nothing has an area, all samples count alike.
    let weight = |area| if samples.has_area() { area } else { 1.0 };
    let tallies = Block::all(samples).map(|block| {
        let parts = block.part_count() as u64;
        if !go_on() {
            return Vec::new();
        }
        let tallies: Vec<Tally> = block.sweep(
            samples,
            Last::default,
            |last, point, area| if go_on() { last.distance(to, point, weight(area)) } else { f64::INFINITY },
            |tally: &mut Tally, point, area, distance| tally.add(point, distance, weight(area)),
        );
        progress(parts);
        tallies
    });
    let tallies: Vec<Vec<Tally>> = tallies.collect();
    if !go_on() {
        return None;
    }
    // Sums of floats depend on their order, so this one is sequential.
    let mut all = Tally::default();
    tallies.iter().flatten().for_each(|tally| all.merge(tally));
    Some(all.side())
}

/// What the last samples have found.
#[derive(Default)]
struct Last {
    nearest: Option<Nearest>,
    largest: f64,
}

impl Last {
    fn distance(&mut self, to: &Bvh, point: Point3<f64>, area: f64) -> f64 {
        // What only the maximum knows of is not searched for where it is less than another one.
        if area == 0.0
            && let Some(nearest) = self.nearest
            && let distance = to.distance_of(nearest, point)
            && distance < self.largest
        {
            return distance;
        }
        let nearest = to.nearest(point, self.nearest);
        (self.nearest, self.largest) = (Some(nearest), self.largest.max(nearest.distance));
        nearest.distance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::squared_distance;
    use chpm_synth::{Shape, Synth, hand};
    use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

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
        let lifted = Side { at: Some([0.0, 0.0, 0.25]), ..result.forward };
        assert_eq!((result.forward.at, result.backward), (Some([0.0; 3]), lifted));
        // 16 vertices, 33 edges with 3 or 4 samples, 18 triangles with 5.
        assert!(result.forward.samples >= 16 + 33 * 3 + 18 * 5, "{result:?}");
    }

    /// Triangles may be no more than lines: these are as far from each other as they are.
    #[test]
    fn meshes_without_area_have_a_mean() {
        let line = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [4.0, 0.0, 0.0]], vec![[0, 1, 2]]);
        let result = deviation(&line, &moved(&line, [0.0, 0.0, 0.5]), 5);
        for side in [result.forward, result.backward] {
            assert_eq!((side.max, side.mean, side.rms), (0.5, 0.5, 0.5));
        }
        // Of a triangle as thin as can be, two sevenths lie beyond the line's end, 4/3 away in the mean.
        let longer = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [8.0, 0.0, 0.0]], vec![[0, 1, 2]]);
        let beyond = deviation(&longer, &line, 2000).forward;
        assert!(beyond.max == 4.0 && (beyond.mean - 8.0 / 21.0).abs() < 0.04, "{beyond:?}");
    }

    #[test]
    fn the_sides_differ_where_one_mesh_has_more() {
        let (one, two) = (hand::soup(1), hand::soup(2));
        let result = deviation(&one, &two, 4);
        assert_eq!(result.forward.max, 0.0);
        // The second triangle ends at x = 3, the first at x = 1.
        assert_eq!(result.backward.max, 2.0);
        assert_eq!(result.at(), Some([3.0, 0.0, 0.0]));
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
    fn a_stopped_measurement_searches_no_further() {
        let (coarse, fine) = (hand::cube(), hand::icosphere(4));
        let asked = AtomicU64::new(0);
        let go_on = || asked.fetch_add(1, Relaxed) < 100;
        assert_eq!(deviation_while(&coarse, &fine, 1000, &|_, _| {}, &go_on), None);
        let told = AtomicU64::new(0);
        let progress = |done, all| assert!(told.fetch_add(done, Relaxed) + done <= all);
        assert_eq!(
            deviation_while(&coarse, &fine, 2, &progress, &|| true),
            Some(deviation(&coarse, &fine, 2))
        );
        assert!(told.into_inner() > 0);
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
