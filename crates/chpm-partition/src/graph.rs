//! An undirected weighted graph as compressed rows: the neighbours of every node in one array, sorted.

use crate::PartitionError;

/// METIS counts nodes and edge ends in 32-bit signed integers.
const LIMIT: usize = i32::MAX as usize;

/// An undirected graph. Every edge is stored at both of its ends, no node neighbours itself, the neighbours of a
/// node ascend, and every weight is at least 1.
///
/// ```
/// use chpm_partition::CsrGraph;
///
/// let path = CsrGraph::from_edges(vec![1; 3], &[(0, 1, 5), (2, 1, 7)])?;
/// assert_eq!((path.node_count(), path.edge_count()), (3, 2));
/// assert_eq!(path.neighbors_of(1).collect::<Vec<_>>(), [(0, 5), (2, 7)]);
/// assert!(path.is_connected());
/// # Ok::<(), chpm_partition::PartitionError>(())
/// ```
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct CsrGraph {
    offsets: Vec<u32>,
    neighbors: Vec<u32>,
    edge_weights: Vec<u32>,
    node_weights: Vec<u32>,
}

impl CsrGraph {
    /// The graph of one node per entry of `node_weights` and the edges `(node, node, weight)`, in any order and
    /// direction. Loops are dropped, parallel edges become one of their summed weight (at most `u32::MAX`), and a
    /// weight of 0 counts as 1.
    ///
    /// # Errors
    /// [`PartitionError::NodeOutOfRange`], or [`PartitionError::TooLarge`] beyond 2^31 - 1 nodes or edge ends.
    pub fn from_edges(mut node_weights: Vec<u32>, edges: &[(u32, u32, u32)]) -> Result<Self, PartitionError> {
        let nodes = node_weights.len();
        check_size("nodes", nodes)?;
        check_size("edge ends", edges.len().saturating_mul(2))?;
        for weight in &mut node_weights {
            *weight = (*weight).max(1);
        }

        // Count, then place: rows come out with their neighbours in edge order.
        let mut starts = vec![0u32; nodes + 1];
        for (edge, &(a, b, _)) in edges.iter().enumerate() {
            let node = a.max(b);
            if node as usize >= nodes {
                return Err(PartitionError::NodeOutOfRange { edge, node, nodes });
            }
            if a != b {
                starts[a as usize + 1] += 1;
                starts[b as usize + 1] += 1;
            }
        }
        for node in 0..nodes {
            starts[node + 1] += starts[node];
        }
        let mut cursors = starts[..nodes].to_vec();
        let mut ends = vec![(0u32, 0u32); starts[nodes] as usize];
        for &(a, b, weight) in edges {
            if a != b {
                for (from, to) in [(a, b), (b, a)] {
                    let cursor = &mut cursors[from as usize];
                    ends[*cursor as usize] = (to, weight.max(1));
                    *cursor += 1;
                }
            }
        }

        let mut graph = CsrGraph {
            offsets: Vec::with_capacity(nodes + 1),
            neighbors: Vec::with_capacity(ends.len()),
            edge_weights: Vec::with_capacity(ends.len()),
            node_weights,
        };

        // Several edges between the same two nodes become one.
        graph.offsets.push(0);
        for row in starts.windows(2) {
            let row = &mut ends[row[0] as usize..row[1] as usize];
            row.sort_unstable();
            let first = graph.neighbors.len();
            for &(neighbor, weight) in &*row {
                if graph.neighbors.len() > first && graph.neighbors.last() == Some(&neighbor) {
                    let sum = &mut graph.edge_weights[graph.neighbors.len() - 1];
                    *sum = sum.saturating_add(weight);
                } else {
                    graph.neighbors.push(neighbor);
                    graph.edge_weights.push(weight);
                }
            }
            graph.offsets.push(graph.neighbors.len() as u32);
        }
        Ok(graph)
    }

    /// Number of nodes.
    pub fn node_count(&self) -> usize {
        self.node_weights.len()
    }

    /// Number of edges, each counted once.
    pub fn edge_count(&self) -> usize {
        self.neighbors.len() / 2
    }

    /// The neighbours of `node`, ascending, each with the weight of its edge.
    pub fn neighbors_of(&self, node: u32) -> impl ExactSizeIterator<Item = (u32, u32)> + '_ {
        let row = self.offsets[node as usize] as usize..self.offsets[node as usize + 1] as usize;
        self.neighbors[row.clone()].iter().copied().zip(self.edge_weights[row].iter().copied())
    }

    /// The weight of `node`.
    pub fn node_weight(&self, node: u32) -> u32 {
        self.node_weights[node as usize]
    }

    /// The sum of all node weights.
    pub fn total_weight(&self) -> u64 {
        self.node_weights.iter().map(|&weight| u64::from(weight)).sum()
    }

    /// Where the row of every node starts in [`Self::neighbors`], and the end of the last.
    pub fn offsets(&self) -> &[u32] {
        &self.offsets
    }

    /// The neighbours of all nodes, row after row.
    pub fn neighbors(&self) -> &[u32] {
        &self.neighbors
    }

    /// The weights of the edges to [`Self::neighbors`].
    pub fn edge_weights(&self) -> &[u32] {
        &self.edge_weights
    }

    /// The weights of all nodes.
    pub fn node_weights(&self) -> &[u32] {
        &self.node_weights
    }

    /// The graph of the given nodes and the edges between them; node `i` of it is `nodes[i]` here. The nodes must
    /// be of this graph and ascend.
    pub fn subgraph(&self, nodes: &[u32]) -> CsrGraph {
        debug_assert!(nodes.is_sorted());
        let mut local = vec![u32::MAX; self.node_count()];
        for (new, &old) in nodes.iter().enumerate() {
            local[old as usize] = new as u32;
        }

        let mut graph = CsrGraph {
            offsets: Vec::with_capacity(nodes.len() + 1),
            neighbors: Vec::new(),
            edge_weights: Vec::new(),
            node_weights: nodes.iter().map(|&node| self.node_weight(node)).collect(),
        };

        graph.offsets.push(0);
        for &node in nodes {
            for (neighbor, weight) in self.neighbors_of(node) {
                if local[neighbor as usize] != u32::MAX {
                    graph.neighbors.push(local[neighbor as usize]);
                    graph.edge_weights.push(weight);
                }
            }
            graph.offsets.push(graph.neighbors.len() as u32);
        }
        graph
    }

    /// Whether there is a path between any two nodes.
    pub fn is_connected(&self) -> bool {
        let mut seen = vec![false; self.node_count()];
        let mut stack: Vec<u32> =
            seen.first_mut().map(|first| *first = true).map(|()| 0).into_iter().collect();
        let mut reached = 0;
        while let Some(node) = stack.pop() {
            reached += 1;
            for (neighbor, _) in self.neighbors_of(node) {
                if !std::mem::replace(&mut seen[neighbor as usize], true) {
                    stack.push(neighbor);
                }
            }
        }
        reached == self.node_count()
    }

    /// Fails unless `parts` gives every node one of `part_count` parts.
    pub(crate) fn check_assignment(&self, parts: &[u32], part_count: u32) -> Result<(), PartitionError> {
        if parts.len() != self.node_count() {
            return Err(PartitionError::AssignmentLength { got: parts.len(), nodes: self.node_count() });
        }
        match parts.iter().position(|&part| part >= part_count) {
            Some(node) => Err(PartitionError::PartOutOfRange { node, part: parts[node], part_count }),
            None => Ok(()),
        }
    }
}

fn check_size(what: &'static str, got: usize) -> Result<(), PartitionError> {
    if got <= LIMIT { Ok(()) } else { Err(PartitionError::TooLarge { what, got, limit: LIMIT }) }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A grid of `width` x `height` nodes of weight 1; edges to the right weigh 1, downwards 1.
    pub(crate) fn grid(width: u32, height: u32) -> CsrGraph {
        let mut edges = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let node = y * width + x;
                if x + 1 < width {
                    edges.push((node, node + 1, 1));
                }
                if y + 1 < height {
                    edges.push((node, node + width, 1));
                }
            }
        }
        CsrGraph::from_edges(vec![1; (width * height) as usize], &edges).unwrap()
    }

    /// Any small graph, connected or not.
    pub(crate) fn any_graph() -> impl Strategy<Value = CsrGraph> {
        (1u32..60).prop_flat_map(|nodes| {
            let edges = prop::collection::vec((0..nodes, 0..nodes, 0u32..9), 0..150);
            let weights = prop::collection::vec(0u32..6, nodes as usize);
            (weights, edges).prop_map(|(weights, edges)| CsrGraph::from_edges(weights, &edges).unwrap())
        })
    }

    /// Any small connected graph: the edges of a random tree, and some more.
    pub(crate) fn any_connected_graph() -> impl Strategy<Value = CsrGraph> {
        (any_graph(), any::<prop::sample::Index>()).prop_map(|(graph, index)| {
            let nodes = graph.node_count() as u32;
            let reach = index.index(graph.node_count()) as u32 + 1;
            let mut edges: Vec<_> =
                (1..nodes).map(|node| (node, node - 1 - node * 7 % node.min(reach), 1)).collect();
            for node in 0..nodes {
                edges.extend(graph.neighbors_of(node).map(|(neighbor, weight)| (node, neighbor, weight)));
            }
            CsrGraph::from_edges(graph.node_weights().to_vec(), &edges).unwrap()
        })
    }

    #[test]
    fn edges_are_symmetric_sorted_and_merged() {
        let edges = [(2, 0, 5), (0, 1, 1), (1, 1, 9), (0, 2, 3), (2, 0, 0), (1, 0, u32::MAX)];
        let graph = CsrGraph::from_edges(vec![4, 0, 2, 1], &edges).unwrap();
        assert_eq!(graph.offsets(), [0, 2, 3, 4, 4]);
        assert_eq!(graph.neighbors(), [1, 2, 0, 0]);
        assert_eq!(graph.edge_weights(), [u32::MAX, 9, u32::MAX, 9]);
        assert_eq!(graph.node_weights(), [4, 1, 2, 1]);
        assert_eq!((graph.node_count(), graph.edge_count(), graph.total_weight()), (4, 2, 8));
        assert!(!graph.is_connected());
    }

    #[test]
    fn a_node_that_is_not_there_is_named() {
        let error = CsrGraph::from_edges(vec![1; 3], &[(0, 1, 1), (3, 1, 1)]).unwrap_err();
        assert_eq!(error, PartitionError::NodeOutOfRange { edge: 1, node: 3, nodes: 3 });
    }

    #[test]
    fn small_graphs_know_whether_they_hang_together() {
        assert!(CsrGraph::from_edges(vec![], &[]).unwrap().is_connected());
        assert!(CsrGraph::from_edges(vec![1], &[]).unwrap().is_connected());
        assert!(!CsrGraph::from_edges(vec![1, 1], &[]).unwrap().is_connected());
        assert!(grid(7, 5).is_connected());
    }

    #[test]
    fn a_subgraph_keeps_the_edges_between_its_nodes() {
        let part = grid(3, 3).subgraph(&[1, 4, 5, 6]);
        assert_eq!(part.neighbors_of(0).collect::<Vec<_>>(), [(1, 1)]);
        assert_eq!(part.neighbors_of(1).collect::<Vec<_>>(), [(0, 1), (2, 1)]);
        assert_eq!(part.neighbors_of(3).len(), 0);
    }

    proptest! {
        /// Against a matrix.
        #[test]
        fn rows_are_those_of_the_matrix(edges in prop::collection::vec((0u32..9, 0u32..9, 1u32..9), 0..60)) {
            let graph = CsrGraph::from_edges(vec![1; 9], &edges).unwrap();
            let mut matrix = [[0u32; 9]; 9];
            for (a, b, weight) in edges {
                if a != b {
                    matrix[a as usize][b as usize] += weight;
                    matrix[b as usize][a as usize] += weight;
                }
            }
            for (node, row) in matrix.iter().enumerate() {
                let expected: Vec<_> =
                    (0..9).filter(|&j| row[j] > 0).map(|j| (j as u32, row[j])).collect();
                prop_assert_eq!(graph.neighbors_of(node as u32).collect::<Vec<_>>(), expected);
            }
        }
    }
}
