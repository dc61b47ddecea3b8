//! Decompose: the source becomes leaf clusters of about equal size (Quick-VDR 4.1, Yoon 4.2.1).
//!
//! First the whole is divided into regions of some dozen leaves, out of core: vertices are numbered by coarse cell, triangles
//! get the new numbers, and the graph of cells is cut (`number`, `join`, `divide`). Then each region is loaded and becomes
//! leaves in memory: cells, parts, leaves, shared vertices, topology (`region`). Establishes I1: every triangle is in exactly one
//! leaf, and a vertex of two leaves is shared in both.

mod cell_graph;
mod copies;
mod divide;
mod gather;
mod grid;
mod leaf;
mod normals;
mod number;
mod partition;
mod region;
mod scatter;
mod shared;
#[cfg(test)]
mod tests;
mod topology;

pub(crate) use cell_graph::nearest_pairs;
pub(crate) use leaf::{Leaf, LeafPage};
pub(crate) use scatter::{Regions, Results, scatter};
pub(crate) use shared::SharedVertices;

use crate::config::{Normals, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::in_order::in_order;
use crate::ingest::Source;
use crate::pairs::graph_bytes;
use crate::report::Repairs;
use chpm_extmem::{Reservation, Spool, Store};
use chpm_qem::Displacement;
use divide::Divided;
use gather::{About, Gatherer};
use region::Mesh;
use serde::{Deserialize, Serialize};

/// The leaf clusters.
#[derive(Serialize, Deserialize)]
pub(crate) struct Decomposition {
    /// How far a triangle of a leaf is from the source's own: its coordinates were rounded.
    pub(crate) rounding: Displacement,
    /// The leaves' data.
    spool: Spool,
    pub(crate) leaves: Vec<Leaf>,
    pub(crate) shared: SharedVertices,
    /// Words of the named scalars of a vertex.
    pub(crate) scalar_words: u8,
    /// Memory for what is shared.
    #[serde(skip)]
    held: Option<Reservation>,
}

impl Decomposition {
    /// Reserves the memory that it has.
    pub(crate) fn hold(mut self, store: &Store) -> Result<Self, BuildError> {
        self.held = Some(store.budget.reserve_work("shared vertices", self.shared.bytes())?);
        Ok(self)
    }

    /// Reads a leaf's page into `bytes`.
    pub(crate) fn read_leaf<'a>(
        &'a self,
        leaf: u32,
        bytes: &'a mut Vec<u8>,
    ) -> Result<LeafPage<'a>, BuildError> {
        self.leaves[leaf as usize].read(&self.spool, &self.shared, bytes)
    }

    /// Triangles of all leaves.
    pub(crate) fn triangle_count(&self) -> u64 {
        self.leaves.iter().map(|leaf| u64::from(leaf.triangle_count)).sum()
    }
}

/// Name of the leaves' spool, here and on disk.
const LEAVES: &str = "leaves";

/// Times that all triangles are gone through: they find the new numbers of their vertices, their regions, and their leaves.
pub(crate) const PASSES: u64 = 3;

/// Cuts the source into leaves, and counts into `repairs` what is odd about it.
pub(crate) fn run(
    source: Source,
    settings: &Settings,
    context: &Context<'_>,
    repairs: &mut Repairs,
) -> Result<Decomposition, BuildError> {
    let about = About::of(&source);
    let wanted = leaf_count(source.triangles.len(), settings);
    let divided = divide::run(source, wanted, settings, context)?;

    let spool = Spool::named(&context.store, LEAVES, LEAVES);
    let border_count = divided.border_count() as u32;
    let mut gatherer = Gatherer::new(border_count, divided.copies, settings, &context.store)?;

    // Regions are worked on several at a time, and taken in one after another.
    let costs: Vec<u64> =
        (0..divided.region_count()).map(|region| cost(&divided, region, settings)).collect();
    let (divided, workers, share) = share_of(divided, &costs, context)?;
    let phase = context.trace.phase();
    in_order(
        divided.region_count(),
        workers,
        |region| {
            let _traced = phase.task("region");
            context.check()?;
            let traced = context.trace.task("load");
            let (mesh, leaves) = load(&divided, region, wanted, settings, context)?;
            drop(traced);
            region::done(mesh, leaves, border_count, settings, &spool, context)
        },
        |done| gatherer.take(done),
    )?;
    let traced = context.trace.task("drop");
    drop((divided, share));
    drop(traced);
    gatherer.finish(about, spool, context, repairs)
}

/// The mesh of a region, and the leaves that it is cut into.
fn load(
    divided: &Divided,
    region: usize,
    wanted: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<(Mesh, u32), BuildError> {
    let mesh = divided.load(region, context)?;
    let leaves = divide::leaves_of(divided, &mesh, wanted, settings);
    Ok((mesh, leaves))
}

/// Clusters of the leaf level: the power of two for which a leaf comes closest to the wanted size, so that the hierarchy is a
/// complete tree and all clusters of a level have a similar history.
fn leaf_count(triangles: usize, settings: &Settings) -> u32 {
    let exact = triangles as f64 / f64::from(settings.cluster_triangles.max(1));
    1 << libm::log2(exact.max(1.0)).round().min(31.0) as u32
}

/// Memory that a region takes while it is worked on.
fn cost(divided: &Divided, region: usize, settings: &Settings) -> u64 {
    let (triangles, vertices) = (divided.triangle_count(region) as u64, divided.vertex_count(region) as u64);
    let used = vertices.min(3 * triangles);
    let is_computed = settings.normals == Normals::Computed;
    let sums = if is_computed { divided.border_vertices(region) as u64 } else { 0 };
    // Words are read, kept, and written, those of vertices that triangles do not have read alone.
    let words = 4 * divided.scalar_words() as u64;
    let sorted = TRIANGLE_COST * triangles
        + (VERTEX_COST + 3 * words) * used
        + (PASSED_COST + words) * (vertices - used)
        + SUM_COST * sums;
    // Its cells are cut before its leaves are gathered: of both the larger one.
    let cut = GRAPH_COST * triangles + (MESH_COST + divided.vertex_len() as u64) * used + SUM_COST * sums;
    if divided.is_joined_to_all(region) { sorted.max(cut) } else { sorted }
}

/// How many regions of such costs to work on at the same time, and the memory for them: where it is short, arrays move to disk.
fn share_of(
    mut divided: Divided,
    costs: &[u64],
    context: &Context<'_>,
) -> Result<(Divided, usize, Reservation), BuildError> {
    let largest = costs.iter().copied().max().unwrap_or(0);
    let budget = &context.store.budget;
    let fitting =
        (budget.available_for_work() / largest.max(1)).clamp(1, rayon::current_num_threads() as u64);
    if budget.available_for_work() < largest && budget.reserve_work("a region", largest).is_err() {
        divided = divided.moved_to_disk(&context.store)?;
    }
    let share = budget.reserve_work("a region", fitting * largest)?;
    Ok((divided, fitting as usize, share))
}

/// Bytes for each triangle and each vertex of a region while it is worked on, and for each vertex that its triangles cannot have.
const TRIANGLE_COST: u64 = 48;
const VERTEX_COST: u64 = 72;
const PASSED_COST: u64 = 16;
/// Bytes for each triangle of a region that is joined to all others, and for each vertex beside what it carries, while cells are cut: every
/// other triangle joins three pairs of cells that nothing else joins.
const GRAPH_COST: u64 = 12 + graph_bytes(3) / 2;
const MESH_COST: u64 = 11;
/// Bytes for what faces come to at a border vertex.
const SUM_COST: u64 = size_of::<normals::BorderSum>() as u64;
