//! Counts of the topology of the source: what is odd about its surface, counted leaf by leaf and put together at their borders.
//!
//! A leaf counts alone whatever is complete in it ([`local`]); what crosses leaves is handed over as a few records for each
//! use of a shared vertex, and decided within its region ([`ledger`]), or if it crosses regions when all regions were counted. Every count is a sum that does not depend on order, so it is the same for any number of
//! threads.
//!
//! Definitions, with the number of faces of an edge as its degree: an edge of degree one is boundary, one of degree above
//! two is non-manifold, one of degree two whose faces walk it in the same direction has mixed winding. A vertex is manifold
//! if its faces form one fan: its link (neighbours, joined by faces) is one path or one cycle. Boundary edges that touch in
//! a vertex belong to one boundary loop. A face is the other side of one if an earlier one *of its leaf* has the same three vertices;
//! the same in two leaves shows as non-manifold edges only. Copies of the same turn are gone before (`copies`).

mod ledger;
mod local;
mod sets;
#[cfg(test)]
mod tests;

use crate::report::Repairs;
pub(crate) use ledger::{Account, Ledger};
pub(crate) use local::{Surveyor, TopologyCounts};

impl TopologyCounts {
    /// Adds the counts of the topology to `repairs`, and leaves its other counts alone.
    pub(crate) fn add_to(&self, repairs: &mut Repairs) {
        add(repairs, &self.found);
    }
}

fn add(to: &mut Repairs, found: &Repairs) {
    to.zero_area_faces += found.zero_area_faces;
    to.two_sided_faces += found.two_sided_faces;
    to.boundary_edges += found.boundary_edges;
    to.non_manifold_edges += found.non_manifold_edges;
    to.mixed_winding_edges += found.mixed_winding_edges;
    to.non_manifold_vertices += found.non_manifold_vertices;
    to.boundary_loops += found.boundary_loops;
    to.components += found.components;
}
