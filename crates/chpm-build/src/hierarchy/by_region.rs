//! A tree in which each region has a subtree of its own, which depends on nothing else: where a region stays as it was, so does what is below its node.
//!
//! I2 holds with one level more. A region's subtree of height h has more than half of 2^h leaves, so that all of them have room in a tree of twice as many leaves;
//! and numbers that are powers of two and fill no more than two halves can be divided between these.

use super::cluster_graph;
use super::tree::{Node, Tree, append, join, split};
use crate::config::Settings;
use crate::context::Context;
use crate::decompose::Decomposition;
use crate::error::BuildError;
use crate::pairs::{Pairs, graph_bytes};
use chpm_partition::CsrGraph;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::ops::Range;

/// Pairs of nodes with their weights.
type Edges = Vec<(u32, u32, u32)>;

/// The root of a subtree, and its inner nodes, children first.
type Subtree = (u32, Vec<Node>);

/// The tree over all leaves.
pub(super) fn tree(
    decomposition: &Decomposition,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Tree, BuildError> {
    let regions = Regions::of(decomposition);
    let shared = cluster_graph::shared_edges(decomposition);
    let _share = context.store.budget.reserve_work("the graph of clusters", graph_bytes(shared.len()))?;
    let (within, between) = regions.divide(shared);

    let leaf_count = decomposition.leaves.len() as u32;
    let phase = context.trace.phase();
    let subtree = |(leaves, mut edges): (&Range<u32>, Edges)| {
        let _traced = phase.task("region");
        let of_region = &decomposition.leaves[leaves.start as usize..leaves.end as usize];
        let centers: Vec<[f32; 3]> = of_region.iter().map(|leaf| leaf.center).collect();
        edges.extend(cluster_graph::near_edges(&centers));
        let graph = CsrGraph::from_edges(of_region.iter().map(|leaf| leaf.vertex_count).collect(), &edges)?;
        let members: Vec<u32> = leaves.clone().collect();
        split(&graph, &members, leaf_count, settings, context)
    };
    let subtrees =
        regions.leaves.par_iter().zip(within).map(subtree).collect::<Result<Vec<Subtree>, BuildError>>()?;

    // What a region's subtree takes of a tree, in leaves.
    let rooms: Vec<u32> =
        regions.leaves.iter().map(|leaves| leaves.len().next_power_of_two() as u32).collect();
    let mut edges = between;
    edges.extend(cluster_graph::near_edges(&regions.centers(decomposition)));
    let graph = CsrGraph::from_edges(rooms, &edges)?;
    let mut nodes = vec![Node { level: 0, parent: None, children: None }; leaf_count as usize];
    let mut roots = Vec::with_capacity(subtrees.len());
    let mut inner = Vec::new();
    for subtree in subtrees {
        roots.push(append(&mut inner, subtree, leaf_count));
    }
    unite(&graph, &roots, &mut inner, leaf_count, settings, context)?;
    nodes.extend(inner);
    Ok(Tree::of_unsorted(nodes, leaf_count as usize))
}

/// The regions that have leaves.
struct Regions {
    leaves: Vec<Range<u32>>,
}

impl Regions {
    fn of(decomposition: &Decomposition) -> Self {
        let ends = &decomposition.region_ends;
        let starts = std::iter::once(0).chain(ends.iter().copied());
        let leaves = starts.zip(ends).map(|(start, end)| start..*end).filter(|leaves| !leaves.is_empty());
        Regions { leaves: leaves.collect() }
    }

    /// The region of a leaf, and which of its leaves that is.
    fn place(&self, leaf: u32) -> (u32, u32) {
        let region = self.leaves.partition_point(|leaves| leaves.end <= leaf);
        (region as u32, leaf - self.leaves[region].start)
    }

    /// Edges between leaves of one region, by region and in their numbers there, and edges between regions.
    fn divide(&self, edges: Edges) -> (Vec<Edges>, Edges) {
        let (mut within, mut between) = (vec![Vec::new(); self.leaves.len()], Pairs::default());
        for (a, b, weight) in edges {
            let [(region, a), (other, b)] = [a, b].map(|leaf| self.place(leaf));
            match region == other {
                true => within[region as usize].push((a, b, weight)),
                false => between.add(region.min(other), region.max(other), weight),
            }
        }
        (within, between.sums())
    }

    /// Middles of the regions' leaves.
    fn centers(&self, decomposition: &Decomposition) -> Vec<[f32; 3]> {
        let center = |leaves: &Range<u32>| {
            let leaves = &decomposition.leaves[leaves.start as usize..leaves.end as usize];
            let sum = |axis: usize| leaves.iter().map(|leaf| f64::from(leaf.center[axis])).sum::<f64>();
            std::array::from_fn(|axis| (sum(axis) / leaves.len() as f64) as f32)
        };
        self.leaves.iter().map(center).collect()
    }
}

/// Joins subtrees, of which the graph has the rooms as weights; answers the root.
fn unite(
    graph: &CsrGraph,
    roots: &[u32],
    nodes: &mut Vec<Node>,
    leaf_count: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<u32, BuildError> {
    if let [root] = roots {
        return Ok(*root);
    }
    context.check()?;
    let half = graph.total_weight().next_power_of_two() / 2;
    let mut sides: Vec<u8> = match roots.len() {
        2 => vec![0, 1],
        _ => {
            let parts = settings.partitioner.bisect(graph, [0.5, 0.5], settings.seed)?.parts;
            parts.into_iter().map(|part| part as u8).collect()
        }
    };
    fit(graph, &mut sides, half);
    let mut halves = [0; 2];
    for side in 0..2 {
        let chosen: Vec<u32> = (0..roots.len() as u32).filter(|i| sides[*i as usize] == side).collect();
        let below: Vec<u32> = chosen.iter().map(|i| roots[*i as usize]).collect();
        halves[usize::from(side)] =
            unite(&graph.subgraph(&chosen), &below, nodes, leaf_count, settings, context)?;
    }
    Ok(join(nodes, halves, leaf_count))
}

/// Moves nodes, whose weights are powers of two, until both sides weigh `half` at most and have one each: those that save most weight of cut edges first.
fn fit(graph: &CsrGraph, sides: &mut [u8], half: u64) {
    let mut weights = [0u64; 2];
    for (node, side) in (0..).zip(&*sides) {
        weights[usize::from(*side)] += u64::from(graph.node_weight(node));
    }
    while let Some(from) =
        (0..2u8).find(|side| weights[usize::from(*side)] > half || weights[usize::from(1 - side)] == 0)
    {
        let to = 1 - from;
        let gain = |node: u32| -> i64 {
            let gains =
                graph.neighbors_of(node).map(|(neighbor, weight)| match sides[neighbor as usize] == to {
                    true => i64::from(weight),
                    false => -i64::from(weight),
                });
            gains.sum()
        };
        let fits = |node: &u32| {
            let weight = u64::from(graph.node_weight(*node));
            sides[*node as usize] == from && weights[usize::from(to)] + weight <= half
        };
        let Some(node) =
            (0..sides.len() as u32).filter(fits).max_by_key(|node| (gain(*node), Reverse(*node)))
        else {
            return pack(graph, sides);
        };
        sides[node as usize] = to;
        let weight = u64::from(graph.node_weight(node));
        (weights[usize::from(from)], weights[usize::from(to)]) =
            (weights[usize::from(from)] - weight, weights[usize::from(to)] + weight);
    }
}

/// The largest first, each to the side that weighs less: so powers of two fill both sides evenly.
fn pack(graph: &CsrGraph, sides: &mut [u8]) {
    let mut order: Vec<u32> = (0..sides.len() as u32).collect();
    order.sort_by_key(|node| Reverse(graph.node_weight(*node)));
    let mut weights = [0u64; 2];
    for node in order {
        let side = usize::from(weights[1] < weights[0]);
        sides[node as usize] = side as u8;
        weights[side] += u64::from(graph.node_weight(node));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn weights(graph: &CsrGraph, sides: &[u8]) -> [u64; 2] {
        let mut weights = [0; 2];
        (0..)
            .zip(sides)
            .for_each(|(node, side)| weights[usize::from(*side)] += u64::from(graph.node_weight(node)));
        weights
    }

    proptest! {
        /// Whatever sides they begin on, powers of two come to fit both halves.
        #[test]
        fn both_halves_hold_what_they_are_given(
            logs in prop::collection::vec(0u32..7, 2..60),
            sides in prop::collection::vec(0u8..2, 60),
            edges in prop::collection::vec((0u32..60, 0u32..60, 1u32..9), 0..100),
        ) {
            let rooms: Vec<u32> = logs.iter().map(|log| 1 << log).collect();
            let count = rooms.len() as u32;
            let edges: Vec<_> = edges.into_iter().map(|(a, b, w)| (a % count, b % count, w))
                .filter(|(a, b, _)| a < b).collect();
            let graph = CsrGraph::from_edges(rooms, &edges).unwrap();
            let half = graph.total_weight().next_power_of_two() / 2;
            let mut sides = sides[..count as usize].to_vec();
            fit(&graph, &mut sides, half);
            let [first, second] = weights(&graph, &sides);
            prop_assert!((1..=half).contains(&first) && (1..=half).contains(&second), "{first} {second} of {half}");
        }
    }
}
