//! A partitioner in Rust: recursive bisection by greedy graph growing, refined at the boundary.
//!
//! Growing starts at a node on the rim of the graph and takes in whichever node adds least to the cut (Karypis and
//! Kumar 1998, section 3.2, "greedy graph growing"). Refinement moves single nodes, best gain first and also
//! downhill, and goes back to the best state seen (Fiduccia and Mattheyses, "A linear-time heuristic for improving
//! network partitions", DAC 1982), with heaps instead of buckets since weights are arbitrary.
//!
//! It shares no state between calls and needs O(edges log nodes) per level of bisection. It serves as the oracle that
//! METIS is compared with, and takes over where METIS fails.

use crate::{BALANCE, CsrGraph, PartitionError, normalised, rebalance_bisection};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// Starting nodes that are tried; the growth with the smallest cut is refined.
const TRIES: u64 = 4;
/// Refinement passes at most; most bisections stop improving before.
const PASSES: usize = 8;
/// Moves in a row without improvement after which a pass ends, for a small graph.
const PATIENCE: usize = 64;

/// The part below `parts` of every node. No part is empty if there are enough nodes; with no more nodes than parts
/// each is a part of its own.
///
/// # Errors
/// [`PartitionError::NoParts`] if `parts` is zero.
pub fn kway(graph: &CsrGraph, parts: u32, seed: u64) -> Result<Vec<u32>, PartitionError> {
    if parts == 0 {
        return Err(PartitionError::NoParts);
    }
    // Imbalances multiply from level to level, so each level gets its share of what is allowed.
    let slack = (BALANCE - 1.0) / f64::from(parts.ilog2() + 1);
    let mut assignment = vec![0; graph.node_count()];
    let everything: Vec<u32> = (0..graph.node_count() as u32).collect();
    let mut waiting = vec![(graph.clone(), everything, parts, 0u32)];
    while let Some((graph, names, parts, first)) = waiting.pop() {
        if parts == 1 || names.len() <= parts as usize {
            for (index, &node) in names.iter().enumerate() {
                assignment[node as usize] = first + if parts == 1 { 0 } else { index as u32 };
            }
            continue;
        }
        let left = parts / 2;
        let fraction = f64::from(left) / f64::from(parts);
        let mut side = Bisection::new(&graph, fraction, slack).run(mix(seed, u64::from(first)));
        let room = [names.len() - (parts - left) as usize, names.len() - left as usize];
        rebalance_bisection(&graph, &mut side, room)?;
        for (which, parts, first) in [(0, left, first), (1, parts - left, first + left)] {
            let chosen: Vec<u32> =
                (0..names.len() as u32).filter(|&node| side[node as usize] == which).collect();
            let chosen_names = chosen.iter().map(|&node| names[node as usize]).collect();
            waiting.push((graph.subgraph(&chosen), chosen_names, parts, first));
        }
    }
    Ok(assignment)
}

/// The side, 0 or 1, of every node; neither is empty if there are two nodes.
///
/// # Errors
/// [`PartitionError::Fractions`] unless both fractions are positive and finite.
pub fn bisect(graph: &CsrGraph, fractions: [f64; 2], seed: u64) -> Result<Vec<u32>, PartitionError> {
    let [fraction, _] = normalised(fractions)?;
    let side = Bisection::new(graph, fraction, BALANCE - 1.0).run(seed);
    Ok(side.into_iter().map(u32::from).collect())
}

/// One bisection: where the weights should be, and the state of the nodes.
struct Bisection<'a> {
    graph: &'a CsrGraph,
    /// Weight that side 0 should have.
    target: u64,
    /// Weight that no side should exceed.
    limits: [u64; 2],
    side: Vec<u8>,
    weights: [u64; 2],
    counts: [usize; 2],
    /// By how much the cut falls if the node changes sides.
    gain: Vec<i64>,
}

impl<'a> Bisection<'a> {
    fn new(graph: &'a CsrGraph, fraction: f64, slack: f64) -> Self {
        let total = graph.total_weight();
        let target = ((total as f64 * fraction).round() as u64).min(total);
        // The smaller side sets the room. Less than the heaviest node would leave refinement without a move.
        let heaviest = graph.node_weights().iter().copied().max().unwrap_or(0);
        let room = ((target.min(total - target) as f64 * slack) as u64).max(heaviest.into());
        Bisection {
            graph,
            target,
            limits: [target + room, total - target + room],
            side: Vec::new(),
            weights: [0; 2],
            counts: [0; 2],
            gain: Vec::new(),
        }
    }

    fn run(mut self, seed: u64) -> Vec<u8> {
        let nodes = self.graph.node_count();
        if nodes < 2 {
            return vec![0; nodes];
        }

        let mut best: Option<(u64, Vec<u8>)> = None;
        for attempt in 0..TRIES {
            let near = (mix(seed, attempt) % nodes as u64) as u32;
            let side = self.grow(self.rim_node(near));
            let cut = self.cut(&side);
            if best.as_ref().is_none_or(|(least, _)| cut < *least) {
                best = Some((cut, side));
            }
        }

        self.side = best.map(|(_, side)| side).unwrap_or_default();
        self.take_stock();
        for _ in 0..PASSES {
            if !self.refine() {
                break;
            }
        }
        self.side
    }

    /// A node that is far from everything in the component of `near`: the last that two searches reach.
    fn rim_node(&self, near: u32) -> u32 {
        let mut last = near;
        for _ in 0..2 {
            let mut seen = vec![false; self.graph.node_count()];
            let mut queue = VecDeque::from([last]);
            seen[last as usize] = true;
            while let Some(node) = queue.pop_front() {
                last = node;
                for (neighbor, _) in self.graph.neighbors_of(node) {
                    if !std::mem::replace(&mut seen[neighbor as usize], true) {
                        queue.push_back(neighbor);
                    }
                }
            }
        }
        last
    }

    /// Side 0 grown from `start` to the target weight; on to the next component where one is used up.
    fn grow(&self, start: u32) -> Vec<u8> {
        let nodes = self.graph.node_count();
        let mut side = vec![1u8; nodes];
        let mut rank: Vec<i64> = (0..nodes as u32)
            .map(|node| -self.graph.neighbors_of(node).map(|(_, weight)| i64::from(weight)).sum::<i64>())
            .collect();
        // Ranks only rise, so the newest entry of a node comes first; among equals the oldest keeps the shape round.
        let mut entries = 0u64;
        let mut heap = BinaryHeap::from([(rank[start as usize], Reverse(entries), start)]);
        let mut fresh = 0..nodes as u32;
        let mut weight = 0;
        let mut count = 0;
        while weight < self.target.max(1) && count + 1 < nodes {
            let Some(node) =
                heap.pop().map(|(.., node)| node).or_else(|| fresh.find(|&node| side[node as usize] == 1))
            else {
                break;
            };
            if side[node as usize] == 0 {
                continue;
            }
            let grown = weight + u64::from(self.graph.node_weight(node));
            // A heavy node may overshoot by more than what is missing.
            if count > 0 && grown.abs_diff(self.target) > self.target - weight {
                continue;
            }
            side[node as usize] = 0;
            weight = grown;
            count += 1;
            for (neighbor, edge_weight) in self.graph.neighbors_of(node) {
                if side[neighbor as usize] == 1 {
                    entries += 1;
                    rank[neighbor as usize] += 2 * i64::from(edge_weight);
                    heap.push((rank[neighbor as usize], Reverse(entries), neighbor));
                }
            }
        }
        side
    }

    fn cut(&self, side: &[u8]) -> u64 {
        let mut cut = 0;
        for node in 0..self.graph.node_count() as u32 {
            if side[node as usize] == 0 {
                let crossing = self.graph.neighbors_of(node).filter(|&(other, _)| side[other as usize] == 1);
                cut += crossing.map(|(_, weight)| u64::from(weight)).sum::<u64>();
            }
        }
        cut
    }

    /// Weights, counts and gains of the current sides.
    fn take_stock(&mut self) {
        let nodes = 0..self.graph.node_count() as u32;
        for node in nodes.clone() {
            let side = usize::from(self.side[node as usize]);
            self.weights[side] += u64::from(self.graph.node_weight(node));
            self.counts[side] += 1;
        }
        self.gain = nodes
            .map(|node| {
                let signed = self.graph.neighbors_of(node).map(|(other, weight)| {
                    let crosses = self.side[other as usize] != self.side[node as usize];
                    if crosses { i64::from(weight) } else { -i64::from(weight) }
                });
                signed.sum()
            })
            .collect();
    }

    /// One pass of single moves, each node at most once, back to the best state seen; whether that is a better one.
    fn refine(&mut self) -> bool {
        let nodes = self.graph.node_count();
        let mut heaps = [BinaryHeap::new(), BinaryHeap::new()];
        for node in 0..nodes as u32 {
            let side = self.side[node as usize];
            let at_boundary =
                self.graph.neighbors_of(node).any(|(other, _)| self.side[other as usize] != side);
            if at_boundary || self.weights[usize::from(side)] > self.limits[usize::from(side)] {
                heaps[usize::from(side)].push((self.gain[node as usize], Reverse(node)));
            }
        }

        // Moves go on past a worse state; at the end all behind the best one are taken back.
        let mut moved = vec![false; nodes];
        let mut moves: Vec<u32> = Vec::new();
        let patience = PATIENCE.max(nodes / 64);
        let (mut fall, mut best_fall) = (0i64, 0i64);
        let (mut best_excess, mut best_length) = (self.excess(), 0);

        while moves.len() < best_length + patience
            && let Some(node) = self.next_move(&mut heaps, &moved)
        {
            fall += self.gain[node as usize];
            self.flip(node);
            moved[node as usize] = true;
            moves.push(node);
            for (neighbor, _) in self.graph.neighbors_of(node) {
                if !moved[neighbor as usize] {
                    let side = usize::from(self.side[neighbor as usize]);
                    heaps[side].push((self.gain[neighbor as usize], Reverse(neighbor)));
                }
            }

            let excess = self.excess();
            if (excess, -fall) < (best_excess, -best_fall) {
                (best_excess, best_fall, best_length) = (excess, fall, moves.len());
            }
        }

        for node in moves.drain(best_length..).rev() {
            self.flip(node);
        }
        best_length > 0
    }

    /// The unmoved node with the highest gain whose move leaves its new side within limits and its old not empty.
    fn next_move(&self, heaps: &mut [BinaryHeap<(i64, Reverse<u32>)>; 2], moved: &[bool]) -> Option<u32> {
        let mut candidates = [None; 2];
        for from in 0..2 {
            while let Some(&(gain, Reverse(node))) = heaps[from].peek() {
                let to = 1 - from;
                let stale = moved[node as usize]
                    || usize::from(self.side[node as usize]) != from
                    || self.gain[node as usize] != gain;
                let weight = u64::from(self.graph.node_weight(node));
                if stale || self.counts[from] == 1 || self.weights[to] + weight > self.limits[to] {
                    heaps[from].pop();
                } else {
                    candidates[from] = Some((gain, Reverse(node)));
                    break;
                }
            }
        }

        // A side that is too heavy gives first; else the larger gain decides.
        let overweight = (0..2).find(|&side| self.weights[side] > self.limits[side]);
        let from = match overweight {
            Some(side) if candidates[side].is_some() => side,
            _ => usize::from(candidates[1] > candidates[0]),
        };

        let (_, Reverse(node)) = candidates[from]?;
        heaps[from].pop();
        Some(node)
    }

    fn flip(&mut self, node: u32) {
        let from = usize::from(self.side[node as usize]);
        let weight = u64::from(self.graph.node_weight(node));
        self.side[node as usize] = 1 - from as u8;
        self.weights[from] -= weight;
        self.weights[1 - from] += weight;
        self.counts[from] -= 1;
        self.counts[1 - from] += 1;
        self.gain[node as usize] = -self.gain[node as usize];
        for (neighbor, weight) in self.graph.neighbors_of(node) {
            let together = usize::from(self.side[neighbor as usize]) != from;
            let change = if together { -2 } else { 2 } * i64::from(weight);
            self.gain[neighbor as usize] += change;
        }
    }

    /// Weight beyond the limits.
    fn excess(&self) -> u64 {
        (0..2).map(|side| self.weights[side].saturating_sub(self.limits[side])).sum()
    }
}

/// A number that looks random and depends on both (the finaliser of SplitMix64).
fn mix(seed: u64, stream: u64) -> u64 {
    let mut x = seed.wrapping_add(stream.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quality;
    use crate::graph::tests::{any_graph, grid};
    use proptest::prelude::*;

    /// The least cut over all ways to put exactly `count` nodes on side 0.
    fn least_cut(graph: &CsrGraph, count: u32) -> u64 {
        let nodes = graph.node_count();
        (0u32..1 << nodes)
            .filter(|set| set.count_ones() == count)
            .map(|set| {
                let parts: Vec<u32> = (0..nodes).map(|node| set >> node & 1).collect();
                Quality::measure(graph, &parts, 2).unwrap().edge_cut
            })
            .min()
            .unwrap()
    }

    /// Against the best of all bisections with the same counts, summed over many small random graphs.
    #[test]
    fn small_bisections_are_near_the_optimum() {
        let (mut cuts, mut least) = (0, 0);
        for case in 0..200 {
            let random = |stream: u64, below: u64| (mix(case, stream) % below) as u32;
            let edge = |e: u64| (random(3 * e, 10), random(3 * e + 1, 10), random(3 * e + 2, 3) + 1);
            let edges: Vec<_> = (0..5 + case % 20).map(edge).collect();
            let graph = CsrGraph::from_edges(vec![1; 10], &edges).unwrap();
            let side = bisect(&graph, [0.5, 0.5], case).unwrap();
            let count = side.iter().filter(|&&part| part == 1).count() as u32;
            assert!((4..=6).contains(&count));
            cuts += Quality::measure(&graph, &side, 2).unwrap().edge_cut;
            least += least_cut(&graph, count);
        }
        assert!(cuts as f64 <= 1.1 * least as f64, "{cuts} against {least}");
    }

    #[test]
    fn a_dumbbell_is_cut_at_its_bar() {
        // Two cliques of six, joined by one edge.
        let mut edges = vec![(2, 9, 1)];
        for clique in [0, 6] {
            for a in 0..6 {
                edges.extend((0..a).map(|b| (clique + a, clique + b, 1)));
            }
        }
        let graph = CsrGraph::from_edges(vec![1; 12], &edges).unwrap();
        let side = bisect(&graph, [1.0, 1.0], 1).unwrap();
        assert!(
            side[..6].iter().all(|&part| part == side[0]) && side[6..].iter().all(|&part| part != side[0])
        );
    }

    #[test]
    fn a_long_grid_is_cut_across() {
        let graph = grid(20, 5);
        for seed in 0..20 {
            let side = bisect(&graph, [0.5, 0.5], seed).unwrap();
            let quality = Quality::measure(&graph, &side, 2).unwrap();
            assert!(quality.edge_cut <= 6 && quality.imbalance <= 1.03, "seed {seed}: {quality:?}");
        }
    }

    #[test]
    fn fractions_are_kept() {
        let graph = grid(30, 30);
        let side = bisect(&graph, [1.0, 3.0], 5).unwrap();
        let on_zero = side.iter().filter(|&&part| part == 0).count();
        assert!((218..=232).contains(&on_zero), "{on_zero} of 900");
        assert!(bisect(&graph, [0.0, 1.0], 5).is_err());
        assert!(bisect(&graph, [f64::NAN, 1.0], 5).is_err());
        assert!(bisect(&graph, [f64::MAX, f64::MAX], 5).is_err());
    }

    #[test]
    fn sixteen_parts_of_a_grid_are_balanced_and_round() {
        let graph = grid(32, 32);
        let parts = kway(&graph, 16, 7).unwrap();
        let quality = Quality::measure(&graph, &parts, 16).unwrap();
        // Sixteen squares of 8 x 8 cut 192 edges, sixteen stripes of 2 x 32 cut 480.
        assert!(quality.edge_cut <= 240, "{quality:?}");
        assert!(quality.imbalance <= 1.05, "{quality:?}");
    }

    #[test]
    fn heavy_nodes_are_weighed() {
        // A path whose first node weighs as much as all others together.
        let edges: Vec<_> = (1..10).map(|node| (node - 1, node, 1)).collect();
        let mut weights = vec![1; 10];
        weights[0] = 9;
        let graph = CsrGraph::from_edges(weights, &edges).unwrap();
        let side = bisect(&graph, [0.5, 0.5], 3).unwrap();
        assert_eq!(Quality::measure(&graph, &side, 2).unwrap().edge_cut, 1);
        let with_heavy = side.iter().filter(|&&part| part == side[0]).count();
        assert!(with_heavy <= 9, "{side:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn every_part_gets_a_node(graph in any_graph(), parts in 1u32..70, seed in any::<u64>()) {
            let assignment = kway(&graph, parts, seed).unwrap();
            let quality = Quality::measure(&graph, &assignment, parts).unwrap();
            let filled = parts - quality.empty_parts;
            prop_assert_eq!(filled as usize, graph.node_count().min(parts as usize));
            prop_assert_eq!(kway(&graph, parts, seed).unwrap(), assignment);
        }

        /// No single move that the limits allow makes the result better.
        #[test]
        fn a_bisection_is_a_local_optimum(graph in any_graph(), fraction in 0.2f64..0.8, seed in any::<u64>()) {
            let mut end = Bisection::new(&graph, fraction, 0.1);
            end.side = Bisection::new(&graph, fraction, 0.1).run(seed);
            end.take_stock();
            for node in 0..graph.node_count() {
                let from = usize::from(end.side[node]);
                let weight = u64::from(graph.node_weight(node as u32));
                let allowed = end.counts[from] > 1 && end.weights[1 - from] + weight <= end.limits[1 - from];
                prop_assert!(!allowed || end.gain[node] <= 0, "moving {node} gains {}", end.gain[node]);
            }
        }
    }
}
