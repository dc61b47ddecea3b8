//! Decompose: the source becomes leaf clusters of about equal size (Quick-VDR 4.1, Yoon 4.2.1).
//!
//! First the whole is divided into regions of some dozen leaves, out of core: vertices are numbered by coarse cell, triangles
//! get the new numbers, and the graph of cells is cut (`number`, `join`, `homes`); triangles are sent to their regions, and it is
//! noted which vertices these have from others (`divide`). Then each region is loaded (`load`) and becomes leaves in memory: cells,
//! parts, leaves, shared vertices, topology (`region`). In a build in steps, `ground` and `regions` hand over what is between these.
//!
//! Establishes I1: every triangle is in exactly one leaf, and a vertex of two leaves is shared in both.

mod cell_graph;
mod copies;
mod cubes;
mod divide;
mod gather;
mod grid;
mod ground;
mod homes;
mod known;
mod leaf;
mod load;
mod normals;
mod number;
mod partition;
mod region;
mod regions;
mod shared;
mod size;
#[cfg(test)]
mod tests;
mod topology;

pub(crate) use cell_graph::nearest_pairs;
pub(crate) use ground::{Ground, Sent, write as write_ground};
pub(crate) use leaf::{Leaf, LeafPage};
pub(crate) use regions::{Parts, Regions, Results, write as write_regions};
pub(crate) use shared::SharedVertices;

use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::{Id, with_ids};
use crate::in_order::in_order;
use crate::ingest::Source;
use crate::report::Repairs;
use chpm_extmem::{Reservation, Spool, Store};
use chpm_qem::Displacement;
use divide::Divided;
use gather::{About, Gatherer};
use serde::{Deserialize, Serialize};
use size::leaf_count;

/// The leaf clusters.
#[derive(Serialize, Deserialize)]
pub(crate) struct Decomposition {
    /// How far a triangle of a leaf is from the source's own: its coordinates were rounded.
    pub(crate) rounding: Displacement,
    /// The leaves' data.
    spool: Spool,
    pub(crate) leaves: Vec<Leaf>,
    /// By region, where its leaves end among all.
    pub(crate) region_ends: Vec<u32>,
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
    let (about, leaves) = (About::of(&source), leaf_count(source.triangles.len(), settings));
    let Source { vertices, triangles, bounds, .. } = source;
    with_ids!(triangles, triangles => {
        let divided = divide::run(vertices, triangles, bounds, leaves, settings, context)?;
        work(divided, about, leaves, settings, context, repairs)
    })
}

/// Works on the regions one by one.
fn work<I: Id>(
    divided: Divided<I>,
    about: About,
    leaves: u32,
    settings: &Settings,
    context: &Context<'_>,
    repairs: &mut Repairs,
) -> Result<Decomposition, BuildError> {
    let shares = divided.shares(leaves);

    let spool = Spool::named(&context.store, LEAVES, LEAVES);
    let border_count = divided.border_count();
    let mut gatherer = Gatherer::new(border_count, shares.copies, settings, &context.store)?;

    // Regions are worked on several at a time, and taken in one after another.
    let carried = divided.carried();
    let costs: Vec<u64> =
        (0..divided.region_count()).map(|region| divided.size(region).cost(carried, settings)).collect();
    let (divided, workers, share) = share_of(divided, &costs, context)?;
    let phase = context.trace.phase();
    in_order(
        divided.region_count(),
        workers,
        |region| {
            let _traced = phase.task("region");
            context.check()?;
            let traced = context.trace.task("load");
            let mesh = divided.load(region, context)?;
            drop(traced);
            let leaves = shares.of(&mesh, settings);
            match &context.memo {
                None => region::done(mesh, leaves, border_count, settings, &spool, context),
                Some(memo) => {
                    known::done((memo, region), mesh, leaves, border_count, settings, &spool, context)
                }
            }
        },
        |done| gatherer.take(done),
    )?;
    let traced = context.trace.task("drop");
    drop((divided, share));
    drop(traced);
    gatherer.finish(about, spool, context, repairs)
}

/// How many regions of such costs to work on at the same time, and the memory for them: where it is short, arrays move to disk.
fn share_of<I: Id>(
    mut divided: Divided<I>,
    costs: &[u64],
    context: &Context<'_>,
) -> Result<(Divided<I>, usize, Reservation), BuildError> {
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
