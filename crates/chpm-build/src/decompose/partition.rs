//! Parts of a cell graph, in rounds: Quick-VDR 4.1 has one call of the partitioner.

use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use chpm_partition::CsrGraph;
use rayon::prelude::*;

/// Most parts of one call to the partitioner: its time grows with their number, so that more are made in rounds.
const ROUND_PARTS: u32 = 16;

/// The part, below `count`, of each node.
pub(crate) fn parts(
    graph: &CsrGraph,
    count: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Vec<u32>, BuildError> {
    context.check()?;
    if count <= 1 {
        return Ok(vec![0; graph.node_count()]);
    }
    let regions = if count > ROUND_PARTS && count.is_multiple_of(ROUND_PARTS) { ROUND_PARTS } else { count };
    let traced = context.trace.task("kway");
    let mut assignment = settings.partitioner.kway(graph, regions, settings.seed)?.parts;
    drop(traced);
    if regions == count {
        return Ok(assignment);
    }

    // Too many parts for one cut: a few first, then each of them by itself.
    let mut members = vec![Vec::new(); regions as usize];
    for (node, region) in assignment.iter().enumerate() {
        members[*region as usize].push(node as u32);
    }
    let step = count / regions;
    let phase = context.trace.phase();
    let further = |nodes: &Vec<u32>| {
        let _traced = phase.task("parts");
        parts(&graph.subgraph(nodes), step, settings, context)
    };
    let below = members.par_iter().map(further).collect::<Result<Vec<_>, BuildError>>()?;
    for ((first, nodes), parts) in (0..).step_by(step as usize).zip(&members).zip(below) {
        nodes.iter().zip(parts).for_each(|(node, part)| assignment[*node as usize] = first + part);
    }
    Ok(assignment)
}
