//! The topology census of the source: what is odd about its surface, counted leaf by leaf and put together at the seams.
//!
//! A leaf counts alone whatever is complete in it ([`local`]); what crosses leaves is handed over as a few records for each
//! use of a shared vertex, and decided as soon as the last leaf that may add to it was counted ([`ledger`]). Every count is
//! a sum that does not depend on order, so it is the same for any number of threads.
//!
//! Definitions, with the number of faces of an edge as its degree: an edge of degree one is boundary, one of degree above
//! two is non-manifold, one of degree two whose faces walk it in the same direction has mixed winding. A vertex is manifold
//! if its faces form one fan: its link (neighbours, joined by faces) is one path or one cycle. Boundary edges that touch in
//! a vertex belong to one boundary loop. A face is a duplicate if an earlier one *of its leaf* has the same three vertices;
//! copies that lie in different leaves show as non-manifold edges only.

mod ledger;
mod local;
mod sets;
#[cfg(test)]
mod tests;

use super::leaf::{Leaf, LeafData};
use super::shared::SharedVertices;
use crate::context::Context;
use crate::error::BuildError;
use crate::report::Repairs;
use chpm_extmem::Spool;
use ledger::Ledger;
use local::{LeafCensus, Surveyor};
use rayon::prelude::*;

/// Leaves that are counted before their records are taken over.
const BATCH: usize = 512;

/// What was counted.
#[derive(Debug)]
pub(crate) struct Census {
    found: Repairs,
}

impl Census {
    /// Adds the counts of the census to `repairs`, and leaves its other counts alone.
    pub(crate) fn add_to(&self, repairs: &mut Repairs) {
        add(repairs, &self.found);
    }
}

/// Counts all leaves, which must be numbered as the users of `shared` are.
pub(crate) fn run(
    leaves: &[Leaf],
    spool: &Spool,
    positions: &[[f32; 3]],
    shared: &SharedVertices,
    context: &Context<'_>,
) -> Result<Census, BuildError> {
    let last_user = |id: u32| shared.users(id).last().copied().unwrap_or(0);
    let mut ledger = Ledger::new(shared.len());
    let mut done = 0;
    for batch in leaves.chunks(BATCH) {
        let counted: Vec<LeafCensus> = batch
            .par_iter()
            .map_init(Desk::default, |desk, leaf| {
                context.check()?;
                desk.data.read(leaf, spool)?;
                desk.marks.clear();
                shared.mark(&desk.data.vertices, &mut desk.marks);
                Ok(desk.surveyor.survey(&desk.data.triangles, &desk.data.vertices, &desk.marks, positions))
            })
            .collect::<Result<_, BuildError>>()?;
        counted.into_iter().for_each(|leaf| ledger.enter(leaf));
        done += batch.len() as u32;
        ledger.settle_when_large(done, &last_user);
    }
    Ok(Census { found: ledger.close() })
}

/// What a thread needs to count leaves.
#[derive(Debug, Default)]
struct Desk {
    data: LeafData,
    marks: Vec<(u16, u32)>,
    surveyor: Surveyor,
}

fn add(to: &mut Repairs, found: &Repairs) {
    to.zero_area_faces += found.zero_area_faces;
    to.duplicate_faces += found.duplicate_faces;
    to.boundary_edges += found.boundary_edges;
    to.non_manifold_edges += found.non_manifold_edges;
    to.mixed_winding_edges += found.mixed_winding_edges;
    to.non_manifold_vertices += found.non_manifold_vertices;
    to.boundary_loops += found.boundary_loops;
    to.components += found.components;
}
