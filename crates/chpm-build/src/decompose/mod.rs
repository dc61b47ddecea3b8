//! Decompose: the source becomes leaf clusters of about equal size (Quick-VDR 4.1, Yoon 4.2.1).
//!
//! Passes: vertices to grid cells; cells to clusters by k-way partition of the cell graph; vertices reordered by cluster, with
//! an old-to-new mapping; faces to the clusters of their vertices; then each cluster gathers its vertices, and vertices that
//! two clusters use are marked shared. Establishes I1: every triangle is in exactly one leaf.

mod assign;
mod cell_graph;
mod census;
mod grid;
mod leaf;
mod shared;

pub(crate) use cell_graph::nearest_pairs;
pub(crate) use leaf::{Leaf, LeafData};
pub(crate) use shared::SharedVertices;

use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::ingest::Source;
use crate::report::Repairs;
use assign::Assigned;
use chpm_extmem::{Buffer, Spool};
use chpm_partition::CsrGraph;
use grid::Grid;
use std::ops::Range;

/// The leaf clusters.
pub(crate) struct Decomposition {
    /// Vertices in the order of the clusters that own them.
    pub(crate) vertices: Vertices,
    /// The leaves' vertex lists and triangles.
    pub(crate) spool: Spool,
    pub(crate) leaves: Vec<Leaf>,
    pub(crate) shared: SharedVertices,
}

/// Vertex data in structure-of-arrays form.
pub(crate) struct Vertices {
    pub(crate) positions: Buffer<[f32; 3]>,
    pub(crate) normals: Option<Buffer<[f32; 3]>>,
    pub(crate) colors: Option<Buffer<[u8; 4]>>,
}

/// Cuts the source into leaves, and counts into `repairs` what is odd about it.
pub(crate) fn run(
    source: Source,
    settings: &Settings,
    context: &Context<'_>,
    repairs: &mut Repairs,
) -> Result<Decomposition, BuildError> {
    let wanted = leaf_count(source.triangles.len(), settings);
    let grid = Grid::build(&source.positions, &source.bounds, settings.cell_vertices);
    context.check()?;
    let cells = assign::find_cells(&source.positions, &grid, &context.store)?;
    let cell_parts = partition_cells(&grid, &cells, &source.triangles, wanted, settings)?;
    context.check()?;

    let Assigned { vertices, starts, triangles, triangle_starts } =
        assign::run(source, &grid, cells, &cell_parts, context)?;
    context.check()?;

    let spool = Spool::new(&context.store, "leaves");
    let gathered = leaf::gather(&triangles, &triangle_starts, &starts, &spool, context)?;
    let shared = SharedVertices::find(&gathered);
    let vertex_count = vertices.positions.len() as u64;
    repairs.unreferenced_vertices = vertex_count - shared.used_vertices;
    let leaves: Vec<Leaf> = gathered.into_iter().map(|g| g.leaf).filter(|l| l.triangle_count > 0).collect();
    census::run(&leaves, &spool, &vertices.positions, &shared, context)?.add_to(repairs);
    Ok(Decomposition { vertices, spool, leaves, shared })
}

/// Clusters of the leaf level: the power of two for which a leaf comes closest to the wanted size, so that the hierarchy is a
/// complete tree and all clusters of a level have a similar history.
fn leaf_count(triangles: usize, settings: &Settings) -> u32 {
    let exact = triangles as f64 / f64::from(settings.cluster_triangles.max(1));
    1 << exact.max(1.0).log2().round().min(31.0) as u32
}

/// Most parts of one call to the partitioner: its time grows with their number, so that more are made in rounds.
const ROUND_PARTS: u32 = 16;

/// The cluster of each cell.
fn partition_cells(
    grid: &Grid,
    cells: &[u32],
    triangles: &[[u32; 3]],
    parts: u32,
    settings: &Settings,
) -> Result<Vec<u32>, BuildError> {
    let mut assignment = vec![0; grid.cells.len()];
    let parts = parts.min(grid.cells.len() as u32);
    if parts > 1 {
        let graph = cell_graph::build(&grid.cells, cells, triangles, settings.cell_neighbors)?;
        let all: Vec<u32> = (0..grid.cells.len() as u32).collect();
        partition_region(&graph, &all, 0..parts, settings, &mut assignment)?;
    }
    Ok(assignment)
}

/// Assigns the parts in `range` to a region's cells: `graph` is the region's, `cells` its nodes' numbers.
fn partition_region(
    graph: &CsrGraph,
    cells: &[u32],
    range: Range<u32>,
    settings: &Settings,
    assignment: &mut [u32],
) -> Result<(), BuildError> {
    let count = range.end - range.start;
    let regions = if count > ROUND_PARTS && count.is_multiple_of(ROUND_PARTS) { ROUND_PARTS } else { count };
    let partition = settings.partitioner.kway(graph, regions, settings.seed)?.parts;
    if regions == count {
        for (cell, part) in cells.iter().zip(partition) {
            assignment[*cell as usize] = range.start + part;
        }
        return Ok(());
    }
    let mut members = vec![Vec::new(); regions as usize];
    for (node, region) in partition.iter().enumerate() {
        members[*region as usize].push(node as u32);
    }
    let step = count / regions;
    for (first, nodes) in (range.start..).step_by(step as usize).zip(&members) {
        let cells: Vec<u32> = nodes.iter().map(|n| cells[*n as usize]).collect();
        partition_region(&graph.subgraph(nodes), &cells, first..first + step, settings, assignment)?;
    }
    Ok(())
}
