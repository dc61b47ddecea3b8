//! The graph of cells: nodes weighted by vertex count, edges to the k nearest cells ([Q] 4.1, second vertex pass).

use super::grid::Cell;
use chpm_partition::{CsrGraph, PartitionError};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;

/// Pairs (a, b, distance) with a < b of points that are among each other's `k` nearest in one direction or both.
pub(crate) fn nearest_pairs(points: &[[f32; 3]], k: u32) -> Vec<(u32, u32, f32)> {
    let Ok(tree) = ImmutableKdTree::new_from_slice(points) else { return Vec::new() };
    let wanted = NonZero::new(k as usize + 1).unwrap_or(NonZero::<usize>::MIN);
    let mut pairs: Vec<(u32, u32, f32)> = points
        .par_iter()
        .enumerate()
        .flat_map_iter(|(from, point)| {
            let found = tree.query(point).nearest_n::<SquaredEuclidean<f32>>(wanted).execute();
            found.into_iter().filter_map(move |neighbor| {
                let (a, b) = (from as u32, neighbor.item as u32);
                (a != b).then(|| (a.min(b), a.max(b), neighbor.distance.sqrt()))
            })
        })
        .collect();
    pairs.par_sort_unstable_by_key(|&(a, b, _)| (a, b));
    pairs.dedup_by_key(|&mut (a, b, _)| (a, b));
    pairs
}

/// The graph that is cut into clusters. Cells hold similar numbers of vertices whatever their size, so that every border
/// between two of them costs about the same number of shared vertices: the edges weigh the same.
pub(crate) fn build(cells: &[Cell], neighbors: u32) -> Result<CsrGraph, PartitionError> {
    let centers: Vec<[f32; 3]> = cells.iter().map(|c| c.center).collect();
    let edges: Vec<(u32, u32, u32)> = nearest_pairs(&centers, neighbors).into_iter().map(|(a, b, _)| (a, b, 1)).collect();
    CsrGraph::from_edges(cells.iter().map(|c| c.count).collect(), &edges)
}
