//! Graph partitioning: METIS from any thread, and a pure-Rust partitioner as oracle and fallback.
//!
//! [`Partitioner`] is the whole service: it partitions, repairs what the partitioner left (empty parts, parts in
//! several pieces) and reports what it did. The same graph, part count and seed give the same partition, from any
//! thread. The crate knows graphs, not meshes.
//!
//! METIS takes over SIGTERM and SIGABRT while it runs: see [`metis`] for what a process has to do about it.
#![forbid(unsafe_code)]

mod error;
mod graph;
pub mod greedy;
pub mod metis;
mod quality;
mod rebalance;
mod repair;

pub use error::PartitionError;
pub use graph::CsrGraph;
pub use quality::Quality;
pub use rebalance::rebalance_bisection;
pub use repair::{RepairReport, repair};

use std::fmt;
use std::str::FromStr;

/// How much heavier than the average a part should become at most; both partitioners and the repair aim at it.
pub const BALANCE: f64 = 1.03;

/// Which algorithm partitions.
///
/// ```
/// use chpm_partition::{CsrGraph, Partitioner, Quality};
///
/// let edges: Vec<_> = (0..99).map(|node| (node, node + 1, 1)).collect();
/// let path = CsrGraph::from_edges(vec![1; 100], &edges)?;
/// let partition = Partitioner::Greedy.kway(&path, 4, 17)?;
/// let quality = Quality::measure(&path, &partition.parts, partition.part_count)?;
/// assert!(quality.all_connected() && quality.edge_cut == 3);
/// # Ok::<(), chpm_partition::PartitionError>(())
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Partitioner {
    /// METIS: multilevel, few cut edges.
    #[default]
    Metis,
    /// Greedy graph growing with boundary refinement, in Rust; more cut edges.
    Greedy,
}

/// A partition after repair.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Partition {
    /// The part of every node, below `part_count`.
    pub parts: Vec<u32>,
    /// The number of parts, none of them empty: the number asked for, or the number of nodes if that is smaller.
    pub part_count: u32,
    /// Findings and changes of the repair.
    pub report: RepairReport,
    /// The algorithm that made the partition: [`Partitioner::Greedy`] also where METIS was asked for and does not take the graph.
    pub used: Partitioner,
}

impl Partitioner {
    /// Partitions into `parts` parts of about equal weight with few cut edges. Every part is connected if the graph
    /// is. With no more nodes than parts, each node is a part of its own.
    ///
    /// # Errors
    /// [`PartitionError::NoParts`] if `parts` is zero, [`PartitionError::EndedEarly`].
    pub fn kway(self, graph: &CsrGraph, parts: u32, seed: u64) -> Result<Partition, PartitionError> {
        if parts == 0 {
            return Err(PartitionError::NoParts);
        }
        if graph.node_count() <= parts as usize {
            return Ok(self.each_its_own(graph));
        }
        let (assignment, used) =
            self.choose(|| metis::kway(graph, parts, seed), || greedy::kway(graph, parts, seed))?;
        let average = graph.total_weight() as f64 / f64::from(parts);
        repaired(graph, assignment, parts, average, used)
    }

    /// Partitions into two parts whose weights are about as `fractions` is to its sum.
    ///
    /// # Errors
    /// [`PartitionError::Fractions`] unless both fractions are positive and finite, [`PartitionError::EndedEarly`].
    pub fn bisect(
        self,
        graph: &CsrGraph,
        fractions: [f64; 2],
        seed: u64,
    ) -> Result<Partition, PartitionError> {
        let fractions = normalised(fractions)?;
        if graph.node_count() <= 2 {
            return Ok(self.each_its_own(graph));
        }
        let (assignment, used) =
            self.choose(|| metis::bisect(graph, fractions, seed), || greedy::bisect(graph, fractions, seed))?;
        let larger = graph.total_weight() as f64 * fractions[0].max(fractions[1]);
        repaired(graph, assignment, 2, larger, used)
    }

    /// The chosen algorithm's answer, or the greedy one for graphs that METIS never takes. What may be otherwise another time is an error:
    /// the same graph has one partition.
    fn choose(
        self,
        metis: impl FnOnce() -> Result<Vec<u32>, PartitionError>,
        greedy: impl FnOnce() -> Result<Vec<u32>, PartitionError>,
    ) -> Result<(Vec<u32>, Partitioner), PartitionError> {
        if self == Partitioner::Metis {
            match metis() {
                Err(PartitionError::Metis { .. }) => {}
                result => return Ok((result?, Partitioner::Metis)),
            }
        }
        Ok((greedy()?, Partitioner::Greedy))
    }

    fn each_its_own(self, graph: &CsrGraph) -> Partition {
        let part_count = graph.node_count() as u32;
        let parts = (0..part_count).collect();
        Partition { parts, part_count, report: RepairReport::default(), used: self }
    }
}

fn repaired(
    graph: &CsrGraph,
    mut parts: Vec<u32>,
    part_count: u32,
    target_weight: f64,
    used: Partitioner,
) -> Result<Partition, PartitionError> {
    let report = repair(graph, &mut parts, part_count, (target_weight * BALANCE).ceil() as u64)?;
    Ok(Partition { parts, part_count, report, used })
}

/// Both fractions divided by their sum.
fn normalised(fractions: [f64; 2]) -> Result<[f64; 2], PartitionError> {
    let sum = fractions[0] + fractions[1];
    if fractions.iter().all(|&fraction| fraction > 0.0) && sum.is_finite() {
        Ok([fractions[0] / sum, fractions[1] / sum])
    } else {
        Err(PartitionError::Fractions { got: fractions })
    }
}

impl fmt::Display for Partitioner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Partitioner::Metis => "metis",
            Partitioner::Greedy => "greedy",
        })
    }
}

impl FromStr for Partitioner {
    type Err = PartitionError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "metis" => Ok(Partitioner::Metis),
            "greedy" => Ok(Partitioner::Greedy),
            _ => Err(PartitionError::UnknownPartitioner { got: text.to_owned() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greedy_steps_in_for_graphs_that_metis_does_not_take() {
        let failed = || Err(PartitionError::Metis { reason: "a node outweighs".to_owned() });
        assert_eq!(Partitioner::Metis.choose(failed, || Ok(vec![7])), Ok((vec![7], Partitioner::Greedy)));
        assert_eq!(Partitioner::Metis.choose(|| Ok(vec![8]), failed), Ok((vec![8], Partitioner::Metis)));
        assert_eq!(Partitioner::Greedy.choose(failed, || Ok(vec![7])), Ok((vec![7], Partitioner::Greedy)));
        assert_eq!(Partitioner::Metis.choose(failed, failed).map(|_| ()), failed().map(|_| ()));
    }
}
