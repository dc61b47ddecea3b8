//! Multilevel minimisation of the cache-oblivious metric (Yoon 6.3): coarsen by groups of neighbours, order the coarsest graph, expand
//! back and permute the members of each group, accepting what the metric calls an improvement.

use super::metric::expected_change;

const NONE: u32 = u32::MAX;
/// Nodes of a group, and of the coarsest graph, of which all orders are tried (Yoon 6.3.2).
const GROUP: usize = 5;
/// Groups grow to this; what is left alone joins one.
const GROWN: usize = 4;
/// Members with more edges than this in all stay as they are: no order is good for a node that everything leads to.
const MOST_EDGES: usize = 4096;

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

/// One coarsening: the finer graph, and the nodes of it that each coarse node stands for.
#[derive(Debug, Default)]
struct Step {
    graph: Graph,
    /// By coarse node: where its members start. One more at the end.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Step {
    fn members(&self, coarse: u32) -> &[u32] {
        &self.members[self.starts[coarse as usize] as usize..self.starts[coarse as usize + 1] as usize]
    }

    fn coarse_count(&self) -> usize {
        self.starts.len() - 1
    }
}

/// Scratch of the minimisation.
#[derive(Debug, Default)]
pub(super) struct Multilevel {
    steps: Vec<Step>,
    grouping: Grouping,
    slot: Vec<u32>,
    position: Vec<u32>,
    order: Vec<u32>,
    expanded: Vec<u32>,
    permuting: Permuting,
}

impl Multilevel {
    /// An order of the nodes of `graph`, which is taken and left behind as scratch.
    pub(super) fn order(&mut self, graph: &mut Graph) -> &[u32] {
        self.order_while(graph, &mut || true);
        &self.order
    }

    /// The same, asking between few nodes whether to go on; `None` if not.
    pub(super) fn order_while(
        &mut self,
        graph: &mut Graph,
        go_on: &mut impl FnMut() -> bool,
    ) -> Option<&[u32]> {
        let depth = self.coarsen(graph, go_on)?;
        let coarsest = &self.steps[depth].graph;
        let count = coarsest.node_count();
        self.order.clear();
        self.order.extend(0..count as u32);
        self.position.clear();
        self.position.extend(0..count as u32);
        if count <= GROUP {
            self.permuting.permute(coarsest, &mut self.order, 0, &mut self.position);
        }
        for step in (0..depth).rev() {
            self.expand(step, go_on)?;
        }
        std::mem::swap(graph, &mut self.steps[0].graph);
        Some(&self.order)
    }

    /// Fills `steps`; answers the index of the coarsest.
    fn coarsen(&mut self, graph: &mut Graph, go_on: &mut impl FnMut() -> bool) -> Option<usize> {
        if self.steps.is_empty() {
            self.steps.push(Step::default());
        }
        std::mem::swap(graph, &mut self.steps[0].graph);

        let mut depth = 0;
        while self.steps[depth].graph.node_count() > GROUP {
            if !go_on() {
                return None;
            }
            if self.steps.len() == depth + 1 {
                self.steps.push(Step::default());
            }

            let (fine, coarse) = self.steps.split_at_mut(depth + 1);
            let fine = &mut fine[depth];
            self.grouping.group(fine);
            if fine.coarse_count() * 20 > fine.graph.node_count() * 19 {
                break;
            }
            contract(fine, &self.grouping.coarse_of, &mut self.slot, &mut coarse[0].graph);
            depth += 1;
        }
        Some(depth)
    }

    /// Replaces each coarse node by its members, in the order of them that the metric wants.
    fn expand(&mut self, step: usize, go_on: &mut impl FnMut() -> bool) -> Option<()> {
        let step = &self.steps[step];
        self.expanded.clear();
        self.position.clear();
        self.position.resize(step.graph.node_count(), 0);
        for node in &self.order {
            for member in step.members(*node) {
                self.position[*member as usize] = self.expanded.len() as u32;
                self.expanded.push(*member);
            }
        }

        let mut at = 0;
        for node in &self.order {
            if !go_on() {
                return None;
            }
            let end = at + step.members(*node).len();
            self.permuting.permute(&step.graph, &mut self.expanded[at..end], at as u32, &mut self.position);
            at = end;
        }

        std::mem::swap(&mut self.order, &mut self.expanded);
        Some(())
    }
}

/// Scratch of the search for groups.
#[derive(Debug, Default)]
struct Grouping {
    coarse_of: Vec<u32>,
    /// By node that is next to the group: edges to it, and which nodes these are.
    pull: Vec<u32>,
    near: Vec<u32>,
    sizes: Vec<u8>,
}

impl Grouping {
    /// Fills the step's members: each node takes the nodes in that most edges tie to those that are in already.
    fn group(&mut self, step: &mut Step) {
        let Grouping { coarse_of, pull, near, sizes } = self;
        let graph = &step.graph;
        let count = graph.node_count();
        for (numbers, value) in [(&mut *coarse_of, NONE), (&mut *pull, 0)] {
            numbers.clear();
            numbers.resize(count, value);
        }
        sizes.clear();
        for first in 0..count as u32 {
            if coarse_of[first as usize] != NONE {
                continue;
            }
            let coarse = sizes.len() as u32;
            let (mut size, mut next) = (0u8, Some(first));
            while let Some(node) = next {
                coarse_of[node as usize] = coarse;
                size += 1;
                if usize::from(size) == GROWN {
                    break;
                }
                for i in graph.row(node) {
                    let (to, weight) = (graph.neighbors[i], graph.weights[i]);
                    if coarse_of[to as usize] == NONE {
                        if pull[to as usize] == 0 {
                            near.push(to);
                        }
                        pull[to as usize] += weight;
                    }
                }
                let free = near.iter().copied().filter(|node| coarse_of[*node as usize] == NONE);
                next = free.max_by_key(|node| (pull[*node as usize], std::cmp::Reverse(*node)));
            }
            for node in near.drain(..) {
                pull[node as usize] = 0;
            }
            // One that is alone joins the group next to it that most edges lead to and that has room.
            let ties = graph.row(first).filter_map(|i| {
                let group = coarse_of[graph.neighbors[i] as usize];
                (group < coarse && usize::from(sizes[group as usize]) < GROUP)
                    .then(|| (graph.weights[i], std::cmp::Reverse(group)))
            });
            match if size == 1 { ties.max() } else { None } {
                Some((_, std::cmp::Reverse(group))) => {
                    coarse_of[first as usize] = group;
                    sizes[group as usize] += 1;
                }
                None => sizes.push(size),
            }
        }
        // Members by a counting sort.
        step.starts.clear();
        step.starts.push(0);
        let mut end = 0;
        step.starts.extend(sizes.iter().map(|size| {
            end += u32::from(*size);
            end
        }));
        step.members.clear();
        step.members.resize(count, 0);
        for node in (0..count as u32).rev() {
            let left = &mut sizes[coarse_of[node as usize] as usize];
            *left -= 1;
            step.members[(step.starts[coarse_of[node as usize] as usize] + u32::from(*left)) as usize] = node;
        }
    }
}

/// Scratch of the trial of all orders of a few nodes side by side.
#[derive(Debug, Default)]
struct Permuting {
    /// Edges that lead out: the member's number, and the place of the other end.
    out: Vec<(usize, u32)>,
    /// Edges between two members, by their numbers.
    inner: Vec<(usize, usize)>,
    changes: Vec<(u32, i32)>,
}

impl Permuting {
    /// Puts nodes that lie side by side from `at` on into the order that the metric prefers to all that were tried before it.
    fn permute(&mut self, graph: &Graph, nodes: &mut [u32], at: u32, position: &mut [u32]) {
        let count = nodes.len();
        let edges: usize = nodes.iter().map(|node| graph.row(*node).len()).sum();
        if count < 2 || edges > MOST_EDGES {
            return;
        }
        let Permuting { out, inner, changes } = self;
        out.clear();
        inner.clear();
        for (member, node) in nodes.iter().enumerate() {
            for neighbor in graph.neighbors(*node) {
                let place = position[*neighbor as usize];
                match place.checked_sub(at).map(|other| other as usize).filter(|other| *other < count) {
                    Some(other) if member < other => inner.push((member, other)),
                    Some(_) => {}
                    None => out.push((member, place)),
                }
            }
        }
        // By member: its place among the others.
        let mut best: [u32; GROUP] = [0, 1, 2, 3, 4];
        let mut trial = best;
        while next_permutation(&mut trial[..count]) {
            changes.clear();
            for (member, place) in out.iter() {
                let [before, after] = [best, trial].map(|places| place.abs_diff(at + places[*member]));
                if before != after {
                    changes.extend([(before, -1), (after, 1)]);
                }
            }
            for (a, b) in inner.iter() {
                let [before, after] = [best, trial].map(|places| places[*a].abs_diff(places[*b]));
                if before != after {
                    changes.extend([(before, -1), (after, 1)]);
                }
            }
            if expected_change(changes) < 0 {
                best = trial;
            }
        }
        let mut members = [0; GROUP];
        members[..count].copy_from_slice(nodes);
        for (node, place) in members.iter().zip(best).take(count) {
            nodes[place as usize] = *node;
            position[*node as usize] = at + place;
        }
    }
}

/// The graph of the coarse nodes. Whether an edge is new in its row is a coin toss, so the loop does the same either way: it
/// writes to the edge's slot or to the next free one.
fn contract(fine: &Step, coarse_of: &[u32], slot: &mut Vec<u32>, out: &mut Graph) {
    let (graph, count) = (&fine.graph, fine.coarse_count());
    let edge_count = graph.neighbors.len();
    out.neighbors.clear();
    out.neighbors.resize(edge_count + 1, 0);
    out.weights.clear();
    out.weights.resize(edge_count + 1, 0);
    out.offsets.clear();
    out.offsets.push(0);
    // One more than the index of a neighbour's edge in the row in which it was seen last.
    slot.clear();
    slot.resize(count, 0);
    let mut end = 0u32;
    for coarse in 0..count {
        let start = end;
        for member in fine.members(coarse as u32) {
            for i in graph.row(*member) {
                let to = coarse_of[graph.neighbors[i] as usize];
                let seen = slot[to as usize];
                let fresh = seen <= start;
                let edge = if fresh { end } else { seen - 1 };
                out.neighbors[edge as usize] = to;
                out.weights[edge as usize] += graph.weights[i];
                // A group's own edge is overwritten by the next one.
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
