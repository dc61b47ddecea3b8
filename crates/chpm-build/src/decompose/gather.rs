//! Results of regions, taken in one after another, in their order: so ids do not depend on who was first.

use super::Decomposition;
use super::leaf::Leaf;
use super::region::Done;
use super::shared::{Collector, SharedVertices};
use super::topology::Account;
use crate::config::{Normals, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::ingest::Source;
use crate::report::Repairs;
use chpm_extmem::{Spool, Store};
use chpm_qem::Displacement;
use serde::{Deserialize, Serialize};

/// Facts about a source beside its triangles.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct About {
    pub(super) vertex_count: u64,
    rounding: Displacement,
    scalar_words: u8,
}

impl About {
    pub(super) fn of(source: &Source) -> Self {
        About {
            vertex_count: source.vertices.positions.len() as u64,
            rounding: Displacement::within(source.rounding),
            scalar_words: source.vertices.scalars.len() as u8,
        }
    }
}

/// The most vertices that clusters share: one value of 32 bits is kept free.
const MOST: u64 = u32::MAX as u64;

/// Takes in regions, in their order.
pub(crate) struct Gatherer {
    collector: Collector,
    account: Account,
    border_count: u32,
    region_ends: Vec<u32>,
    copies: u64,
}

impl Gatherer {
    /// For regions with so many border vertices, on the way to which so many copies of triangles were left out.
    pub(super) fn new(
        border_count: u32,
        copies: u64,
        settings: &Settings,
        store: &Store,
    ) -> Result<Self, BuildError> {
        let is_computed = settings.normals == Normals::Computed;
        let collector = Collector::new(border_count as usize, is_computed, store)?;
        let account = Account::new(border_count as usize, store);
        Ok(Gatherer { collector, account, border_count, region_ends: Vec::new(), copies })
    }

    /// Takes in the next region.
    pub(super) fn take(&mut self, done: Done) -> Result<(), BuildError> {
        // Border numbers hold everywhere; inner numbers count from those of the regions before.
        let inner_before = self.collector.inner_count();
        let inner: u64 = done.interfaces.counts.iter().map(|count| u64::from(*count)).sum();
        if u64::from(self.border_count) + u64::from(inner_before) + inner > MOST {
            return Err(BuildError::TooManyShared { most: MOST });
        }
        self.collector.add(&done)?;
        let leaves_before = self.region_ends.last().copied().unwrap_or(0);
        self.region_ends.push(leaves_before + done.leaves.len() as u32);
        let border_count = self.border_count;
        let topology = done.topology.renumbered(|id| if id < border_count { id } else { id + inner_before });
        self.copies += done.copies;
        Ok(self.account.enter(topology)?)
    }

    /// The leaves, which lie in `spool`; what is odd about the source is counted into `repairs`.
    pub(super) fn finish(
        self,
        about: About,
        spool: Spool,
        context: &Context<'_>,
        repairs: &mut Repairs,
    ) -> Result<Decomposition, BuildError> {
        let Gatherer { collector, account, region_ends, copies, .. } = self;
        let traced = context.trace.task("account");
        account.close()?.add_to(repairs);
        drop(traced);
        context.check()?;
        let traced = context.trace.task("collect");
        let (leaves, shared): (Vec<Leaf>, SharedVertices) = collector.finish()?;
        drop(traced);
        repairs.merged_copies = copies;
        repairs.unreferenced_vertices = about.vertex_count - shared.used_vertices;
        let About { rounding, scalar_words, .. } = about;
        Decomposition { rounding, spool, leaves, region_ends, shared, scalar_words, held: None }
            .hold(&context.store)
    }
}

#[cfg(test)]
mod tests {
    use super::super::region::Interfaces;
    use super::*;

    #[test]
    fn more_shared_vertices_than_a_file_numbers_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), 1 << 30).unwrap();
        let done = |count| Done {
            leaves: Vec::new(),
            interfaces: Interfaces { users: vec![0, 1], starts: vec![0, 2], counts: vec![count] },
            border_uses: Vec::new(),
            topology: Default::default(),
            referenced: 0,
            copies: 0,
            normals: Vec::new(),
        };
        let mut gatherer = Gatherer::new(1000, 0, &Settings::default(), &store).unwrap();
        gatherer.take(done(u32::MAX - 1007)).unwrap();
        gatherer.take(done(7)).unwrap();
        let refused = gatherer.take(done(1)).unwrap_err().to_string();
        assert!(refused.contains("share more than 4294967295 vertices"), "{refused}");
    }
}
