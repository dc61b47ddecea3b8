//! The cluster graph (Quick-VDR 4.2): nodes weighted by vertices, edges by shared vertices first and by nearness second.

use crate::decompose::{Decomposition, nearest_pairs};
use crate::error::BuildError;
use crate::pairs::Pairs;
use chpm_partition::CsrGraph;

/// Weight of one shared vertex. Nearness adds at most as much, and that for the closest pair of all.
const SHARED: u32 = 16;
/// Nearest clusters that each cluster is tied to, so that separate components find their neighbours.
const NEIGHBORS: u32 = 6;

/// The edges of the graph: those that share, and those that are near.
pub(crate) fn edges(decomposition: &Decomposition) -> Vec<(u32, u32, u32)> {
    let mut edges = shared_edges(decomposition);
    let centers: Vec<[f32; 3]> = decomposition.leaves.iter().map(|leaf| leaf.center).collect();
    edges.extend(near_edges(&centers));
    edges
}

/// Edges between what is near each other.
pub(super) fn near_edges(centers: &[[f32; 3]]) -> impl Iterator<Item = (u32, u32, u32)> + use<> {
    let pairs = nearest_pairs(centers, NEIGHBORS, |_| true);
    let positive = pairs.iter().map(|p| p.2).filter(|d| *d > 0.0);
    let nearest = positive.fold(f32::INFINITY, f32::min);
    pairs.into_iter().map(move |(a, b, distance)| {
        let nearness = if distance > 0.0 { nearest / distance } else { 1.0 };
        (a, b, ((SHARED as f32 * nearness) as u32).max(1))
    })
}

/// The graph of all leaves.
pub(crate) fn build(
    decomposition: &Decomposition,
    edges: Vec<(u32, u32, u32)>,
) -> Result<CsrGraph, BuildError> {
    Ok(CsrGraph::from_edges(decomposition.leaves.iter().map(|l| l.vertex_count).collect(), &edges)?)
}

/// One edge for each pair of leaves and interface that both are of; the graph adds them up.
pub(super) fn shared_edges(decomposition: &Decomposition) -> Vec<(u32, u32, u32)> {
    let mut edges = Pairs::default();
    for (users, count) in decomposition.shared.interfaces() {
        let weight = SHARED.saturating_mul(count);
        // The apex of a huge fan is shared by everyone: tie such users in a chain, not each to each.
        if users.len() > 16 {
            users.windows(2).for_each(|w| edges.add(w[0], w[1], weight));
            continue;
        }
        for (i, a) in users.iter().enumerate() {
            users[i + 1..].iter().for_each(|b| edges.add(*a, *b, weight));
        }
    }
    edges.sums()
}
