//! Order of the pages in the file: those that a split brings are next to each other.
//!
//! Clusters are read as groups are split: all fine clusters of a group, or none. So they are one run of pages. Runs follow one another by falling error of what they
//! replace, as a camera that comes nearer asks for them; those of equal errors along a curve that fills space.

use chpm_mesh::Aabb;
use chpm_mesh::curve::{HILBERT_BITS, hilbert};
use std::cmp::Reverse;

/// Pages that are read together: the fine clusters of a group, or a root.
#[derive(Clone, Debug)]
pub struct Run {
    /// Error of what they replace; infinite for roots.
    pub error: f32,
    /// Centre of what they are about.
    pub center: [f32; 3],
    /// Numbers of the clusters.
    pub clusters: Vec<u32>,
}

/// All clusters of all runs in the order of the file. Those of a run stay in their order.
pub fn order(runs: Vec<Run>) -> Vec<u32> {
    let bounds = Aabb::of_points(runs.iter().map(|run| &run.center));
    // Numbers that are not negative order as their bits do.
    fn key(run: &Run, bounds: &Aabb) -> (Reverse<u32>, u64) {
        (Reverse(run.error.max(0.0).to_bits()), hilbert(cell(run.center, bounds)))
    }
    let mut keyed: Vec<_> = runs.into_iter().map(|run| (key(&run, &bounds), run.clusters)).collect();
    keyed.sort_unstable();
    keyed.into_iter().flat_map(|(_, clusters)| clusters).collect()
}

fn cell(point: [f32; 3], bounds: &Aabb) -> [u32; 3] {
    let widest = (0..3)
        .map(|axis| f64::from(bounds.max[axis]) - f64::from(bounds.min[axis]))
        .fold(f64::MIN_POSITIVE, f64::max);
    let most = f64::from((1u32 << HILBERT_BITS) - 1);
    std::array::from_fn(|axis| {
        ((f64::from(point[axis]) - f64::from(bounds.min[axis])) / widest * most) as u32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_fall_by_error_and_equal_ones_are_beside_their_neighbours() {
        let run =
            |error, x, clusters: &[u32]| Run { error, center: [x, 0.0, 0.0], clusters: clusters.to_vec() };
        let runs = vec![
            run(1.0, 9.0, &[7, 8]),
            run(2.0, 5.0, &[6, 1]),
            run(1.0, 0.0, &[3]),
            run(f32::INFINITY, 4.0, &[5]),
            run(1.0, 8.0, &[2]),
            run(0.0, 0.0, &[4]),
        ];
        let order = order(runs);
        assert_eq!(order[..3], [5, 6, 1]);
        assert_eq!(order[7], 4);
        // Beside one another, and the far one before or after both.
        assert!(order[3] == 3 || order[6] == 3, "{order:?}");
    }

    #[test]
    fn one_place_and_none_are_no_trouble() {
        let run = |cluster| Run { error: 1.0, center: [3.0; 3], clusters: vec![cluster] };
        assert_eq!(order(vec![run(4), run(2)]), [2, 4]);
        assert!(order(Vec::new()).is_empty());
    }
}
