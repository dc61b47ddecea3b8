//! Parts of a cell graph, in rounds: Quick-VDR 4.1 has one call of the partitioner.

use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use chpm_partition::CsrGraph;
use std::ops::Range;

/// Most parts of one call to the partitioner: its time grows with their number, so that more are made in rounds.
const ROUND_PARTS: u32 = 16;

/// The part, below `count`, of each node.
pub(crate) fn parts(
    graph: &CsrGraph,
    count: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Vec<u32>, BuildError> {
    let mut assignment = vec![0; graph.node_count()];
    if count > 1 {
        let all: Vec<u32> = (0..graph.node_count() as u32).collect();
        partition_region(graph, &all, 0..count, settings, context, &mut assignment)?;
    }
    Ok(assignment)
}

/// Assigns the parts in `range` to a region's cells: `graph` is the region's, `cells` its nodes' numbers.
fn partition_region(
    graph: &CsrGraph,
    cells: &[u32],
    range: Range<u32>,
    settings: &Settings,
    context: &Context<'_>,
    assignment: &mut [u32],
) -> Result<(), BuildError> {
    context.check()?;

    let count = range.end - range.start;
    let regions = if count > ROUND_PARTS && count.is_multiple_of(ROUND_PARTS) { ROUND_PARTS } else { count };
    let partition = settings.partitioner.kway(graph, regions, settings.seed)?.parts;

    if regions == count {
        for (cell, part) in cells.iter().zip(partition) {
            assignment[*cell as usize] = range.start + part;
        }
        return Ok(());
    }

    // Too many parts for one cut: a few first, then each of them by itself.
    let mut members = vec![Vec::new(); regions as usize];
    for (node, region) in partition.iter().enumerate() {
        members[*region as usize].push(node as u32);
    }

    let step = count / regions;
    for (first, nodes) in (range.start..).step_by(step as usize).zip(&members) {
        let cells: Vec<u32> = nodes.iter().map(|n| cells[*n as usize]).collect();
        partition_region(&graph.subgraph(nodes), &cells, first..first + step, settings, context, assignment)?;
    }
    Ok(())
}
