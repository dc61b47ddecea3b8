//! Multilevel minimisation of the cache-oblivious metric (Yoon 6.3): coarsen by matching, order the coarsest graph, expand back
//! and permute locally, accepting what the metric calls an improvement.
//!
//! A coarse node stands for at most two nodes, so that a local permutation is the choice which of the two comes first. Yoon allows
//! up to five; pairs cost a fraction and leave the later stage of this project something to gain.

use super::metric::{Steps, expected_change};

const NONE: u32 = u32::MAX;
/// Nodes of the coarsest graph, all of whose orders are tried.
const COARSEST: usize = 5;

/// An undirected graph in compressed rows; every edge is in the rows of both its ends, once.
#[derive(Clone, Debug, Default)]
pub(super) struct Graph {
    offsets: Vec<u32>,
    neighbors: Vec<u32>,
    /// Edges of the original graph that an edge stands for.
    weights: Vec<u32>,
}

impl Graph {
    pub(super) fn node_count(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    fn row(&self, node: u32) -> std::ops::Range<usize> {
        self.offsets[node as usize] as usize..self.offsets[node as usize + 1] as usize
    }

    fn neighbors(&self, node: u32) -> &[u32] {
        &self.neighbors[self.row(node)]
    }

    /// Refills from pairs (a, b), which may repeat and come in any direction.
    pub(super) fn fill(
        &mut self,
        node_count: usize,
        pairs: impl Iterator<Item = (u32, u32)> + Clone,
        scratch: &mut Vec<u32>,
    ) {
        // Rows by a counting sort: offsets are the rows' ends first, and fall to their starts as neighbours are put in.
        self.offsets.clear();
        self.offsets.resize(node_count + 1, 0);
        for (a, b) in pairs.clone() {
            self.offsets[a as usize] += 1;
            self.offsets[b as usize] += 1;
        }
        let mut end = 0;
        for offset in &mut self.offsets {
            end += *offset;
            *offset = end;
        }
        self.neighbors.clear();
        self.neighbors.resize(end as usize, 0);
        for (a, b) in pairs {
            for (from, to) in [(a, b), (b, a)] {
                self.offsets[from as usize] -= 1;
                self.neighbors[self.offsets[from as usize] as usize] = to;
            }
        }

        // Drop repeats in each row; `scratch` remembers the row in which a node was seen last.
        scratch.clear();
        scratch.resize(node_count, NONE);
        let mut kept = 0;
        for node in 0..node_count as u32 {
            let row = self.row(node);
            self.offsets[node as usize] = kept as u32;
            for i in row {
                let to = self.neighbors[i];
                if std::mem::replace(&mut scratch[to as usize], node) != node {
                    self.neighbors[kept] = to;
                    kept += 1;
                }
            }
        }

        self.offsets[node_count] = kept as u32;
        self.neighbors.truncate(kept);
        self.weights.clear();
        self.weights.resize(kept, 1);
    }
}

/// One coarsening: the finer graph, and the one or two nodes of it that each coarse node stands for.
#[derive(Debug, Default)]
struct Step {
    graph: Graph,
    members: Vec<[u32; 2]>,
}

/// Scratch of the minimisation.
#[derive(Debug, Default)]
pub(super) struct Multilevel {
    steps: Vec<Step>,
    coarse_of: Vec<u32>,
    slot: Vec<u32>,
    position: Vec<u32>,
    order: Vec<u32>,
    expanded: Vec<u32>,
    changes: Vec<(u32, i32)>,
    /// What a swap would do.
    spans: Steps,
}

impl Multilevel {
    /// An order of the nodes of `graph`, which is taken and left behind as scratch.
    pub(super) fn order(&mut self, graph: &mut Graph) -> &[u32] {
        let depth = self.coarsen(graph);
        let coarsest = &self.steps[depth].graph;
        self.order.clear();
        self.order.extend(0..coarsest.node_count() as u32);
        if (2..=COARSEST).contains(&coarsest.node_count()) {
            best_order(coarsest, &mut self.order, &mut self.changes);
        }
        for step in (0..depth).rev() {
            self.expand(step);
        }
        std::mem::swap(graph, &mut self.steps[0].graph);
        &self.order
    }

    /// Fills `steps`; answers the index of the coarsest.
    fn coarsen(&mut self, graph: &mut Graph) -> usize {
        if self.steps.is_empty() {
            self.steps.push(Step::default());
        }
        std::mem::swap(graph, &mut self.steps[0].graph);
        let mut depth = 0;
        while self.steps[depth].graph.node_count() > COARSEST {
            if self.steps.len() == depth + 1 {
                self.steps.push(Step::default());
            }
            let (fine, coarse) = self.steps.split_at_mut(depth + 1);
            let fine = &mut fine[depth];
            match_heaviest(&fine.graph, &mut self.coarse_of, &mut fine.members);
            if fine.members.len() * 20 > fine.graph.node_count() * 19 {
                break;
            }
            contract(fine, &self.coarse_of, &mut self.slot, &mut coarse[0].graph);
            depth += 1;
        }
        depth
    }

    /// Replaces each coarse node by its members and lets each pair swap if the metric wants it.
    fn expand(&mut self, step: usize) {
        let Step { graph, members } = &self.steps[step];
        self.spans.fit(graph.node_count());
        self.expanded.clear();
        self.position.clear();
        self.position.resize(graph.node_count(), 0);
        for node in &self.order {
            for member in members[*node as usize].into_iter().filter(|m| *m != NONE) {
                self.position[member as usize] = self.expanded.len() as u32;
                self.expanded.push(member);
            }
        }
        let mut at = 0u32;
        for node in &self.order {
            let [a, b] = members[*node as usize];
            if b == NONE {
                at += 1;
                continue;
            }
            // Only spans of edges to third nodes change, each by one: towards the left for b, towards the right for a.
            for (node, other, longer_left) in [(a, b, 1), (b, a, -1)] {
                for neighbor in graph.neighbors(node).iter().filter(|n| **n != other) {
                    let q = self.position[*neighbor as usize];
                    let left = q < at;
                    let near = if left { at - q } else { q - at - 1 };
                    self.spans.push(near, if left { longer_left } else { -longer_left });
                }
            }
            if self.spans.expected_change() < 0 {
                self.expanded.swap(at as usize, at as usize + 1);
                self.position.swap(a as usize, b as usize);
            }
            at += 2;
        }
        std::mem::swap(&mut self.order, &mut self.expanded);
    }
}

/// Matches every node with the unmatched neighbour that most edges lead to.
fn match_heaviest(graph: &Graph, coarse_of: &mut Vec<u32>, members: &mut Vec<[u32; 2]>) {
    coarse_of.clear();
    coarse_of.resize(graph.node_count(), NONE);
    members.clear();
    for node in 0..graph.node_count() as u32 {
        if coarse_of[node as usize] != NONE {
            continue;
        }
        let mut best = (0, NONE);
        for i in graph.row(node) {
            let (neighbor, weight) = (graph.neighbors[i], graph.weights[i]);
            if coarse_of[neighbor as usize] == NONE
                && (weight > best.0 || (weight == best.0 && neighbor < best.1))
            {
                best = (weight, neighbor);
            }
        }
        let coarse = members.len() as u32;
        coarse_of[node as usize] = coarse;
        if best.1 != NONE {
            coarse_of[best.1 as usize] = coarse;
        }
        members.push([node, best.1]);
    }
}

/// The graph of the coarse nodes. Whether an edge is new in its row is a coin toss, so the loop does the same either way: it
/// writes to the edge's slot or to the next free one.
fn contract(fine: &Step, coarse_of: &[u32], slot: &mut Vec<u32>, out: &mut Graph) {
    let Step { graph, members } = fine;
    let edge_count = graph.neighbors.len();
    out.neighbors.clear();
    out.neighbors.resize(edge_count + 1, 0);
    out.weights.clear();
    out.weights.resize(edge_count + 1, 0);
    out.offsets.clear();
    out.offsets.push(0);
    // One more than the index of a neighbour's edge in the row in which it was seen last.
    slot.clear();
    slot.resize(members.len(), 0);
    let mut end = 0u32;
    for (coarse, pair) in members.iter().enumerate() {
        let start = end;
        for member in pair.iter().filter(|m| **m != NONE) {
            for i in graph.row(*member) {
                let to = coarse_of[graph.neighbors[i] as usize];
                let seen = slot[to as usize];
                let fresh = seen <= start;
                let edge = if fresh { end } else { seen - 1 };
                out.neighbors[edge as usize] = to;
                out.weights[edge as usize] += graph.weights[i];
                // The pair's own edge is overwritten by the next one.
                let own = to as usize == coarse;
                slot[to as usize] = if own { 0 } else { edge + 1 };
                if own {
                    out.weights[edge as usize] = 0;
                }
                end += u32::from(fresh & !own);
            }
        }
        out.offsets.push(end);
    }
    out.neighbors.truncate(end as usize);
    out.weights.truncate(end as usize);
}

/// Tries all orders of a handful of nodes and keeps the one that the metric prefers to those before it.
fn best_order(graph: &Graph, order: &mut Vec<u32>, changes: &mut Vec<(u32, i32)>) {
    let spans = |order: &[u32], sign: i32, changes: &mut Vec<(u32, i32)>| {
        for (i, a) in order.iter().enumerate() {
            for (j, b) in order.iter().enumerate().skip(i + 1) {
                if graph.neighbors(*a).contains(b) {
                    changes.push(((j - i) as u32, sign));
                }
            }
        }
    };
    let mut candidate = order.clone();
    while next_permutation(&mut candidate) {
        changes.clear();
        spans(order, -1, changes);
        spans(&candidate, 1, changes);
        if expected_change(changes) < 0 {
            order.clone_from(&candidate);
        }
    }
}

fn next_permutation(items: &mut [u32]) -> bool {
    let Some(i) = (1..items.len()).rev().find(|i| items[i - 1] < items[*i]) else { return false };
    let Some(j) = (i..items.len()).rev().find(|j| items[*j] > items[i - 1]) else { return false };
    items.swap(i - 1, j);
    items[i..].reverse();
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ordered(node_count: usize, pairs: &[(u32, u32)]) -> Vec<u32> {
        let mut graph = Graph::default();
        graph.fill(node_count, pairs.iter().copied(), &mut Vec::new());
        Multilevel::default().order(&mut graph).to_vec()
    }

    fn spans(order: &[u32], pairs: &[(u32, u32)]) -> Vec<u32> {
        let mut position = vec![0; order.len()];
        order.iter().enumerate().for_each(|(i, n)| position[*n as usize] = i as u32);
        pairs.iter().map(|(a, b)| position[*a as usize].abs_diff(position[*b as usize])).collect()
    }

    #[test]
    fn a_shuffled_path_becomes_a_path() {
        let pairs = [(3, 0), (0, 4), (4, 1), (1, 2)];
        assert!(spans(&ordered(5, &pairs), &pairs).iter().all(|s| *s == 1));
    }

    #[test]
    fn every_node_comes_once_and_grids_stay_close() {
        let side = 24u32;
        // A permutation of the grid's numbers, so that the given order says nothing.
        let id = |x: u32, y: u32| (y * side + x) * 137 % (side * side);
        let mut pairs = Vec::new();
        for y in 0..side {
            for x in 0..side {
                if x + 1 < side {
                    pairs.push((id(x, y), id(x + 1, y)));
                }
                if y + 1 < side {
                    pairs.push((id(x, y), id(x, y + 1)));
                }
            }
        }
        let order = ordered((side * side) as usize, &pairs);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..side * side));
        let mut spans = spans(&order, &pairs);
        spans.sort_unstable();
        assert!(spans[spans.len() / 2] <= 4, "median span {}", spans[spans.len() / 2]);
    }

    #[test]
    fn graphs_without_edges_are_ordered_too() {
        assert!(ordered(0, &[]).is_empty());
        assert_eq!(ordered(8, &[]).len(), 8);
    }
}
