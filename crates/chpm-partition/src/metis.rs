//! METIS (Karypis and Kumar, "A fast and high quality multilevel scheme for partitioning irregular graphs", SIAM
//! J. Sci. Comput. 20, 1998) through one door.
//!
//! Calls from many threads run side by side, and each gives the same answer as if it were alone: each thread has a random
//! sequence of its own, the same on every system, and the handlers that METIS sets are set once for all
//! ([`chpm_extmem::metis`]).
//!
//! During a call METIS takes over SIGTERM and SIGABRT with handlers that jump back into it. **A process that uses this module
//! should keep SIGTERM blocked in every thread** (block it before the first thread starts, so that all inherit the mask) and wait
//! for it in a thread of its own with `sigwait`. Otherwise a SIGTERM that arrives during a call may be swallowed, in which
//! case the call returns [`PartitionError::EndedEarly`], or delivered to a thread that METIS does not expect, which is fatal.
//!
//! The functions here return what METIS returns: parts may be empty or in several pieces. [`crate::Partitioner`]
//! repairs that.

use crate::{BALANCE, CsrGraph, PartitionError, normalised};
use chpm_extmem::metis::Traps;
use metis::option::{PType, Seed, UFactor};
use std::borrow::Cow;

/// Weights are scaled to sums below this: METIS adds them up, and multiplies the sums by the balance, in `i32`.
const WEIGHT_SUM: u64 = 1 << 30;

/// Below this many nodes per part, k-way refinement has so little room that it leaves parts empty.
const KWAY_NODES_PER_PART: usize = 16;

/// The part below `parts` of every node; few cut edges, weights within about 3% of equal where that is possible.
///
/// # Errors
/// [`PartitionError::NoParts`], [`PartitionError::TooLarge`], [`PartitionError::Metis`] for graphs that METIS does not take, or
/// [`PartitionError::EndedEarly`].
pub fn kway(graph: &CsrGraph, parts: u32, seed: u64) -> Result<Vec<u32>, PartitionError> {
    if parts == 0 {
        return Err(PartitionError::NoParts);
    }
    let few_nodes = graph.node_count() < KWAY_NODES_PER_PART.saturating_mul(parts as usize);
    let method = if few_nodes { PType::Rb } else { PType::Kway };
    Task { graph, parts, fractions: None, method, seed }.run()
}

/// The side, 0 or 1, of every node; the weights of the sides are about as the fractions.
///
/// # Errors
/// [`PartitionError::Fractions`], and those of [`kway`].
pub fn bisect(graph: &CsrGraph, fractions: [f64; 2], seed: u64) -> Result<Vec<u32>, PartitionError> {
    let fractions = normalised(fractions)?.map(|fraction| fraction as f32);
    Task { graph, parts: 2, fractions: Some(fractions), method: PType::Rb, seed }.run()
}

struct Task<'a> {
    graph: &'a CsrGraph,
    parts: u32,
    fractions: Option<[f32; 2]>,
    method: PType,
    seed: u64,
}

impl Task<'_> {
    /// Whether one node alone outweighs a few parts. METIS then bisects sides that have no node left, and says so on the standard
    /// output, where it must not.
    fn outweighs_parts(&self) -> bool {
        let heaviest = self.graph.node_weights().iter().copied().max().unwrap_or(0);
        u64::from(heaviest) * u64::from(self.parts) > 3 * self.graph.total_weight()
    }

    fn run(self) -> Result<Vec<u32>, PartitionError> {
        let graph = self.graph;
        if graph.node_count() <= self.parts as usize {
            return Ok((0..graph.node_count() as u32).collect());
        }
        let parts = i32::try_from(self.parts).map_err(|_| PartitionError::TooLarge {
            what: "parts",
            got: self.parts as usize,
            limit: i32::MAX as usize,
        })?;
        let offsets = as_i32(graph.offsets());
        let neighbors = as_i32(graph.neighbors());
        let node_weights = scaled(graph.node_weights());
        let edge_weights = scaled(graph.edge_weights());
        let mut assignment = vec![0i32; graph.node_count()];

        fn failed(reason: String) -> PartitionError {
            PartitionError::Metis { reason }
        }
        if self.outweighs_parts() {
            return Err(failed("a node weighs as much as several parts".to_owned()));
        }
        let mut task = metis::Graph::new(1, parts, offsets, neighbors)
            .map_err(|error| failed(error.to_string()))?
            .set_vwgt(&node_weights)
            .set_adjwgt(&edge_weights)
            .set_option(Seed((self.seed ^ (self.seed >> 32)) as i32 & i32::MAX))
            .set_option(UFactor(((BALANCE - 1.0) * 1000.0).round() as i32));
        if let Some(fractions) = &self.fractions {
            task = task.set_tpwgts(fractions);
        }
        let traps = Traps::set().map_err(|error| failed(error.to_string()))?;
        let result = match self.method {
            PType::Rb => task.part_recursive(&mut assignment),
            PType::Kway => task.part_kway(&mut assignment),
        };
        drop(traps);
        result.map_err(|error| match error {
            metis::Error::Input => failed(error.to_string()),
            _ => PartitionError::EndedEarly {
                reason: error.to_string(),
                nodes: graph.node_count(),
                edges: graph.neighbors().len() / 2,
            },
        })?;
        let in_range: Option<Vec<u32>> = assignment
            .into_iter()
            .map(|part| u32::try_from(part).ok().filter(|&part| part < self.parts))
            .collect();
        in_range.ok_or_else(|| failed("a part out of range".to_owned()))
    }
}

/// Offsets and nodes, which [`CsrGraph`] keeps below 2^31.
fn as_i32(values: &[u32]) -> &[i32] {
    bytemuck::cast_slice(values)
}

/// Weights, of at least 1, divided by the power of two that brings their sum below the limit: most stay as and where they are.
fn scaled(weights: &[u32]) -> Cow<'_, [i32]> {
    let sum: u64 = weights.iter().map(|&weight| u64::from(weight)).sum();
    let mut shift = 0;
    while (sum >> shift) >= WEIGHT_SUM {
        shift += 1;
    }
    if shift == 0 {
        return Cow::Borrowed(as_i32(weights));
    }
    weights.iter().map(|&weight| (weight >> shift).max(1) as i32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quality;
    use crate::graph::tests::grid;

    #[test]
    fn weights_keep_their_proportions_below_the_limit() {
        assert_eq!(scaled(&[3, 1, 7])[..], [3, 1, 7]);
        assert_eq!(scaled(&[u32::MAX, 1 << 31, 1])[..], [(1 << 29) - 1, 1 << 28, 1]);
        let many = vec![u32::MAX; 1 << 12];
        assert!(scaled(&many).iter().map(|&weight| weight as u64).sum::<u64>() < WEIGHT_SUM);
    }

    #[test]
    fn enormous_weights_do_not_matter() {
        let small = grid(16, 16);
        let edges: Vec<_> = (0..256)
            .flat_map(|node| small.neighbors_of(node).map(move |(neighbor, _)| (node, neighbor, u32::MAX)))
            .collect();
        let large = CsrGraph::from_edges(vec![u32::MAX; 256], &edges).unwrap();
        let parts = kway(&large, 8, 3).unwrap();
        let quality = Quality::measure(&large, &parts, 8).unwrap();
        assert!(quality.imbalance < 1.1 && quality.empty_parts == 0, "{quality:?}");
    }

    #[test]
    fn fractions_are_kept() {
        let graph = grid(30, 30);
        let side = bisect(&graph, [1.0, 3.0], 5).unwrap();
        let on_zero = side.iter().filter(|&&part| part == 0).count();
        assert!((211..=239).contains(&on_zero), "{on_zero} of 900");
        assert!(bisect(&graph, [-1.0, 3.0], 5).is_err());
    }

    #[test]
    fn few_nodes_are_each_a_part() {
        assert_eq!(kway(&grid(3, 1), 5, 0).unwrap(), [0, 1, 2]);
        assert_eq!(kway(&grid(3, 1), 0, 0), Err(PartitionError::NoParts));
        assert_eq!(kway(&grid(3, 1), 1, 0).unwrap(), [0, 0, 0]);
    }
}
