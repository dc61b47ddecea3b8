//! How the memory that a build may have is divided, so that the process stays below it.

use crate::config::Resources;
use chpm_extmem::MemoryBudget;
use std::sync::Arc;

/// The least memory with which a build of any threads promises to stay below what it was given.
pub const MIN_MEMORY: u64 = 128 << 20;

/// The program, its tables of small things, and what the allocator has not given back.
const PROGRAM: u64 = 20 << 20;
/// Stack and scratch of a thread: one group of clusters with all that simplifying and ordering it takes.
const THREAD: u64 = 10 << 20;
/// What a thread needs for a region of usual size, and what is kept from arrays for that.
const REGION: u64 = 20 << 20;

/// The threads that `resources` has memory for, `available` at most, and the budget that is left.
pub(crate) fn divide(resources: &Resources, available: usize) -> (usize, Arc<MemoryBudget>) {
    let wanted = if resources.threads == 0 { available } else { resources.threads };
    let memory = resources.memory.0;
    // Below the least memory nothing is promised: arrays get what they would, and work what it needs.
    let total = memory.max(MIN_MEMORY) - PROGRAM;
    let threads = (wanted as u64).clamp(1, total / (THREAD + REGION));
    let beside_arrays = PROGRAM + threads * (THREAD + REGION);
    let budget = MemoryBudget::with_charges(memory.saturating_sub(beside_arrays), total - threads * THREAD);
    (threads as usize, budget)
}

/// Bytes that a build may have on disk at one time, beside the output, were no array in memory: at the end of simplify, when
/// the leaves, all pages and the displacements of a level are there. `vertex_len` is what a vertex has in the file.
pub(crate) fn disk(vertices: u64, triangles: u64, vertex_len: u64) -> u64 {
    vertices.saturating_mul(4 * vertex_len).saturating_add(triangles.saturating_mul(36))
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_mesh::Bytes;

    #[test]
    fn threads_and_arrays_share_the_memory() {
        let of = |threads, mib| {
            let resources = Resources { threads, memory: Bytes::mib(mib), work_dir: None };
            let (threads, budget) = divide(&resources, 8);
            (threads, budget.limit() >> 20, budget.chargeable() >> 20)
        };
        assert_eq!(of(2, 128), (2, 48, 88));
        assert_eq!(of(0, 1024), (8, 764, 924));
        assert_eq!(of(64, 128), (3, 18, 78));
        assert_eq!(of(2, 1), (2, 0, 88));
    }
}
