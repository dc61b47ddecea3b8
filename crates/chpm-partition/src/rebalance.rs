//! Two sides with a bound on the number of nodes of each.

use crate::{CsrGraph, PartitionError};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Moves nodes off the side that has too many until both sides have at most `max_nodes`, and returns how many were
/// moved. Nodes at the boundary go first, those that lower the cut most before others; connection is not looked after.
///
/// # Errors
/// [`PartitionError::Capacity`] if the two sides together are too small, [`PartitionError::AssignmentLength`],
/// [`PartitionError::PartOutOfRange`] for a side other than 0 and 1; `side` is then unchanged.
pub fn rebalance_bisection(
    graph: &CsrGraph,
    side: &mut [u8],
    max_nodes: [usize; 2],
) -> Result<usize, PartitionError> {
    let nodes = graph.node_count();
    if side.len() != nodes {
        return Err(PartitionError::AssignmentLength { got: side.len(), nodes });
    }
    if let Some(node) = side.iter().position(|&side| side > 1) {
        return Err(PartitionError::PartOutOfRange { node, part: side[node].into(), part_count: 2 });
    }
    if max_nodes[0].saturating_add(max_nodes[1]) < nodes {
        return Err(PartitionError::Capacity { nodes, max_nodes });
    }

    // One side may have too many; as many as are too many leave it.
    let on_one = side.iter().filter(|&&side| side == 1).count();
    let counts = [nodes - on_one, on_one];
    let from: u8 = if counts[0] > max_nodes[0] { 0 } else { 1 };
    let surplus = counts[usize::from(from)].saturating_sub(max_nodes[usize::from(from)]);
    if surplus == 0 {
        return Ok(0);
    }

    let mut heap: BinaryHeap<_> = (0..nodes as u32)
        .filter(|&node| side[node as usize] == from)
        .map(|node| rank(side, node, from, graph))
        .collect();
    let mut moved = 0;
    while moved < surplus
        && let Some((.., Reverse(node))) = heap.pop()
    {
        // Ranks only rise as neighbours leave, so a node's newest entry comes first and the others find it gone.
        if side[node as usize] != from {
            continue;
        }
        side[node as usize] = 1 - from;
        moved += 1;
        for (neighbor, _) in graph.neighbors_of(node) {
            if side[neighbor as usize] == from {
                heap.push(rank(side, neighbor, from, graph));
            }
        }
    }
    Ok(moved)
}

/// Those at the border go first, then those that save most weight of cut edges.
fn rank(side: &[u8], node: u32, from: u8, graph: &CsrGraph) -> (bool, i64, Reverse<u32>) {
    let mut gain = 0i64;
    let mut boundary = false;
    for (neighbor, weight) in graph.neighbors_of(node) {
        let outside = side[neighbor as usize] != from;
        boundary |= outside;
        gain += if outside { i64::from(weight) } else { -i64::from(weight) };
    }
    (boundary, gain, Reverse(node))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::tests::{any_graph, grid};
    use proptest::prelude::*;

    fn path(nodes: u32) -> CsrGraph {
        grid(nodes, 1)
    }

    #[test]
    fn a_bisection_gives_up_its_best_nodes() {
        // Node 3 of the path 0-1-2-3 is at the boundary, and the first to go.
        let mut side = [0, 0, 0, 0, 1];
        assert_eq!(rebalance_bisection(&path(5), &mut side, [3, 3]), Ok(1));
        assert_eq!(side, [0, 0, 0, 1, 1]);
        let mut side = [1, 1, 1, 1, 1];
        assert_eq!(rebalance_bisection(&path(5), &mut side, [2, 3]), Ok(2));
        assert_eq!(side, [0, 0, 1, 1, 1], "without a boundary, an end");
        assert_eq!(rebalance_bisection(&path(5), &mut side, [2, 3]), Ok(0));
    }

    #[test]
    fn a_bisection_that_cannot_be_is_refused() {
        let mut side = [0, 0, 1, 1, 1];
        let error = rebalance_bisection(&path(5), &mut side, [2, 2]);
        assert_eq!(error, Err(PartitionError::Capacity { nodes: 5, max_nodes: [2, 2] }));
        assert!(rebalance_bisection(&path(4), &mut side, [4, 4]).is_err());
        assert!(rebalance_bisection(&path(5), &mut [0, 0, 2, 0, 0], [4, 4]).is_err());
    }

    proptest! {
        #[test]
        fn rebalancing_moves_no_more_than_it_must(graph in any_graph(), split in any::<u64>(), room in 0usize..60) {
            let nodes = graph.node_count();
            let mut side: Vec<u8> = (0..nodes).map(|node| (split >> node & 1) as u8).collect();
            let room = room.min(nodes);
            let max_nodes = [room, nodes - room];
            let ones = side.iter().filter(|&&side| side == 1).count();
            let moved = rebalance_bisection(&graph, &mut side, max_nodes).unwrap();
            prop_assert_eq!(moved, ones.abs_diff(nodes - room));
            prop_assert_eq!(side.iter().filter(|&&side| side == 1).count(), nodes - room);
        }
    }
}
