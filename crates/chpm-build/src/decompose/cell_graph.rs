//! The graph of cells: nodes weighted by vertex count, edges to the k nearest cells (Quick-VDR 4.1, second vertex pass).

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
                let (a, b) = (from as u32, neighbor.item);
                (a != b).then(|| (a.min(b), a.max(b), neighbor.distance.sqrt()))
            })
        })
        .collect();
    pairs.par_sort_unstable_by_key(|&(a, b, _)| (a, b));
    pairs.dedup_by_key(|&mut (a, b, _)| (a, b));
    pairs
}

/// The graph that is cut into clusters: cells that triangles join, by how many of them do, and each cell's nearest ones, so
/// that separate components find their neighbours.
///
/// Quick-VDR has the nearest cells only. The triangles' edges say what a cut costs, in shared vertices; a sample of them says it too.
pub(crate) fn build(
    cells: &[Cell],
    cell_of: &[u32],
    triangles: &[[u32; 3]],
    neighbors: u32,
) -> Result<CsrGraph, PartitionError> {
    let centers: Vec<[f32; 3]> = cells.iter().map(|c| c.center).collect();
    let mut edges: Vec<(u32, u32, u32)> =
        nearest_pairs(&centers, neighbors).into_iter().map(|(a, b, _)| (a, b, 1)).collect();
    let mut joined: Vec<(u32, u32)> = triangles
        .par_iter()
        .step_by(SAMPLE)
        .flat_map_iter(|t| {
            let [a, b, c] = t.map(|v| cell_of[v as usize]);
            [(a, b), (b, c), (c, a)].into_iter().filter(|(a, b)| a != b).map(|(a, b)| (a.min(b), a.max(b)))
        })
        .collect();
    joined.par_sort_unstable();
    edges.extend(
        joined.chunk_by(|x, y| x == y).map(|same| (same[0].0, same[0].1, JOINED * same.len() as u32)),
    );
    CsrGraph::from_edges(cells.iter().map(|c| c.count).collect(), &edges)
}

/// One in so many triangles is looked at.
const SAMPLE: usize = 4;
/// Weight of a sampled triangle's edge between two cells; mere nearness weighs one.
const JOINED: u32 = 4;
