//! Decompose: the source becomes leaf clusters of about equal size ([Q] 4.1, [Y] 4.2.1).
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
use grid::Grid;

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
    let wanted = source.triangles.len().div_ceil(settings.cluster_triangles.max(1) as usize) as u32;
    let grid = Grid::build(&source.positions, &source.bounds, settings.cell_vertices);
    context.check()?;
    let cell_parts = partition_cells(&grid, wanted, settings)?;
    context.check()?;

    let Assigned { vertices, starts, triangles, triangle_starts } = assign::run(source, &grid, &cell_parts, context)?;
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

fn partition_cells(grid: &Grid, wanted: u32, settings: &Settings) -> Result<Vec<u32>, BuildError> {
    let parts = wanted.min(grid.cells.len() as u32);
    if parts <= 1 {
        return Ok(vec![0; grid.cells.len()]);
    }
    let graph = cell_graph::build(&grid.cells, settings.cell_neighbors)?;
    Ok(settings.partitioner.kway(&graph, parts, settings.seed)?.parts)
}
