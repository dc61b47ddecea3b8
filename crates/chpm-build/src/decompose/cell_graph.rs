//! The graph of cells: nodes weighted by vertex count, edges to the k nearest cells (Quick-VDR 4.1, second vertex pass).

use chpm_mesh::Aabb;
use chpm_partition::{CsrGraph, PartitionError};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;

/// Weight of a sampled triangle's edge between two cells; mere nearness weighs one.
const JOINED: u32 = 4;

/// A cell that holds vertices.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cell {
    /// Centre, object units.
    pub(crate) center: [f32; 3],
    /// Vertices in it.
    pub(crate) count: u32,
}

/// The graph that is cut into clusters: cells that triangles join, weighted by how many do, and where they join a cell to
/// fewer than `neighbors` others, its nearest ones, so that separate components find their neighbours.
///
/// Quick-VDR has the nearest cells only. The triangles' edges say what a cut costs, in shared vertices.
///
/// `joints` has each pair of cells that triangles join once, with the number of edges that do.
pub(crate) fn build(
    cells: &[Cell],
    joints: Vec<(u32, u32, u32)>,
    neighbors: u32,
) -> Result<CsrGraph, PartitionError> {
    let mut edges = joints;
    let mut degrees = vec![0; cells.len()];
    for (a, b, weight) in &mut edges {
        *weight = weight.saturating_mul(JOINED);
        degrees[*a as usize] += 1;
        degrees[*b as usize] += 1;
    }
    let centers: Vec<[f32; 3]> = cells.iter().map(|c| c.center).collect();
    let near = nearest_pairs(&centers, neighbors, |cell| degrees[cell as usize] < neighbors);
    edges.extend(near.into_iter().map(|(a, b, _)| (a, b, 1)));
    CsrGraph::from_edges(cells.iter().map(|c| c.count).collect(), &edges)
}

/// The pairs of cells that a triangle joins, by the cells of its corners; smaller first.
pub(crate) fn joints([a, b, c]: [u32; 3]) -> impl Iterator<Item = (u32, u32)> {
    let apart = [(a, b), (b, c), (c, a)].into_iter().filter(|(a, b)| a != b);
    apart.map(|(a, b)| (a.min(b), a.max(b)))
}

/// Pairs (a, b, distance) with a < b of points of which one is `wanted` and the other among its `k` nearest. Distances are in
/// units of their own, of which the points' box has about one.
pub(crate) fn nearest_pairs(
    points: &[[f32; 3]],
    k: u32,
    wanted: impl Fn(u32) -> bool + Sync,
) -> Vec<(u32, u32, f32)> {
    let points = &unit_sized(points);
    let Ok(tree) = ImmutableKdTree::new_from_slice(points) else { return Vec::new() };
    let count = NonZero::new(k as usize + 1).unwrap_or(NonZero::<usize>::MIN);
    let mut pairs: Vec<(u32, u32, f32)> = points
        .par_iter()
        .enumerate()
        .filter(|(from, _)| wanted(*from as u32))
        .flat_map_iter(|(from, point)| {
            let found = tree.query(point).nearest_n::<SquaredEuclidean<f32>>(count).execute();
            found.into_iter().filter_map(move |neighbor| {
                let (a, b) = (from as u32, neighbor.item);
                (a != b).then(|| (a.min(b), a.max(b), neighbor.distance.sqrt()))
            })
        })
        .collect();
    pairs.par_sort_unstable_by_key(|&(a, b, _)| (a, b));
    pairs.dedup_by_key(|&mut (a, b, _)| (a, b));
    pairs
}

/// The points times a power of two, so that squares of distances neither vanish nor overflow and nothing else changes.
fn unit_sized(points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let bounds = Aabb::of_points(points);
    let longest = (0..3).map(|a| f64::from(bounds.max[a]) - f64::from(bounds.min[a])).fold(0.0, f64::max);
    let scale = if longest > 0.0 { libm::exp2(-libm::log2(longest).floor()) } else { 1.0 };
    points.iter().map(|p| p.map(|x| (f64::from(x) * scale) as f32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbors_do_not_depend_on_the_scale() {
        let points: Vec<[f32; 3]> = (0..200u32)
            .map(|i| [7, 11, 13].map(|step| (i * i * step % 1009) as f32 + 0.125 * i as f32))
            .collect();
        let expected = nearest_pairs(&points, 4, |_| true);
        for exponent in [-140, -60, 60, 117] {
            // Exact: the smallest of these numbers is an eighth.
            let by = 2.0_f64.powi(exponent);
            let scaled: Vec<[f32; 3]> =
                points.iter().map(|p| p.map(|x| (f64::from(x) * by) as f32)).collect();
            assert_eq!(nearest_pairs(&scaled, 4, |_| true), expected, "2^{exponent}");
        }
    }
}
