//! How good a partition is.

use crate::{CsrGraph, PartitionError, repair::Fragments};

/// Measures of one partition.
#[derive(Clone, PartialEq, Debug)]
pub struct Quality {
    /// Summed weight of the edges between different parts.
    pub edge_cut: u64,
    /// Weight of the heaviest part over the average of all parts; 1 is perfect, and so is a graph without nodes.
    pub imbalance: f64,
    /// Parts without a node.
    pub empty_parts: u32,
    /// Connected pieces of every part; 0 for an empty one.
    pub fragments: Vec<u32>,
}

impl Quality {
    /// Measures the assignment of `graph`'s nodes to `part_count` parts. O(nodes + edges).
    ///
    /// # Errors
    /// [`PartitionError::AssignmentLength`] or [`PartitionError::PartOutOfRange`].
    pub fn measure(graph: &CsrGraph, parts: &[u32], part_count: u32) -> Result<Self, PartitionError> {
        graph.check_assignment(parts, part_count)?;
        let mut weights = vec![0u64; part_count as usize];
        let mut twice_cut = 0;
        for (node, &part) in parts.iter().enumerate() {
            weights[part as usize] += u64::from(graph.node_weight(node as u32));
            for (neighbor, weight) in graph.neighbors_of(node as u32) {
                if parts[neighbor as usize] != part {
                    twice_cut += u64::from(weight);
                }
            }
        }

        let mut fragments = vec![0; part_count as usize];
        for fragment in &Fragments::of(graph, parts).list {
            fragments[fragment.part as usize] += 1;
        }

        let heaviest = weights.iter().copied().max().unwrap_or(0);
        let total = graph.total_weight();
        let imbalance = if total == 0 { 1.0 } else { heaviest as f64 * f64::from(part_count) / total as f64 };
        Ok(Quality {
            edge_cut: twice_cut / 2,
            imbalance,
            empty_parts: fragments.iter().filter(|&&count| count == 0).count() as u32,
            fragments,
        })
    }

    /// Whether every part is one connected piece.
    pub fn all_connected(&self) -> bool {
        self.fragments.iter().all(|&count| count == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::tests::grid;

    #[test]
    fn a_grid_in_stripes_has_known_measures() {
        // Columns 0,1 | 2 | 0 again, of a grid of 4 columns and 3 rows.
        let parts: Vec<u32> = (0..12).map(|node| [0, 0, 1, 0][node % 4]).collect();
        let quality = Quality::measure(&grid(4, 3), &parts, 3).unwrap();
        assert_eq!(quality.edge_cut, 6);
        assert_eq!(quality.imbalance, 9.0 * 3.0 / 12.0);
        assert_eq!(quality.empty_parts, 1);
        assert_eq!(quality.fragments, [2, 1, 0]);
        assert!(!quality.all_connected());
    }

    #[test]
    fn an_assignment_that_does_not_fit_is_refused() {
        let graph = grid(2, 2);
        let short = Quality::measure(&graph, &[0, 0, 0], 1);
        assert_eq!(short, Err(PartitionError::AssignmentLength { got: 3, nodes: 4 }));
        let outside = Quality::measure(&graph, &[0, 0, 2, 0], 2);
        assert_eq!(outside, Err(PartitionError::PartOutOfRange { node: 2, part: 2, part_count: 2 }));
    }

    #[test]
    fn nothing_is_perfectly_balanced() {
        let graph = CsrGraph::from_edges(vec![], &[]).unwrap();
        assert_eq!(Quality::measure(&graph, &[], 2).unwrap().imbalance, 1.0);
    }
}
