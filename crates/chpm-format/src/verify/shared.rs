//! Shared vertices: one entry per id, over the whole file.

use super::{Invariant, Report};
use crate::error::FilePart;
use crate::header::{BoundaryMode, Header};
use chpm_mesh::{ClusterId, GroupId};
use std::ops::Range;

/// Facts about a shared vertex so far.
#[derive(Clone, Copy)]
struct SharedVertex {
    /// Bits of its position.
    position: [u32; 3],
    /// The cluster that listed it last; [`ClusterId::NONE`] before the first.
    last: ClusterId,
    /// The highest level that lists it, and one group that does so there.
    top: (u32, GroupId),
    /// The group in which it collapses.
    gone_in: GroupId,
    /// Whether two groups of the level `top` list it.
    mixed: bool,
    /// Leaf clusters that list it, up to 2.
    leaves: u8,
}

/// Bytes that are known about a shared vertex.
pub(super) const ENTRY: usize = size_of::<SharedVertex>();

/// Some of the ids; what is told about others is nothing to it.
pub(super) struct SharedIds {
    first: u32,
    entries: Vec<SharedVertex>,
}

impl SharedIds {
    /// The ids of a range. Their number was checked against the lists of the file, so that it cannot ask for more memory than they
    /// take.
    pub(super) fn new(ids: Range<u32>) -> Self {
        let unseen = SharedVertex {
            position: [0; 3],
            last: ClusterId::NONE,
            top: (0, GroupId::NONE),
            gone_in: GroupId::NONE,
            mixed: false,
            leaves: 0,
        };
        SharedIds { first: ids.start, entries: vec![unseen; ids.len()] }
    }

    /// Whether an id is one of these.
    pub(super) fn has(&self, id: u32) -> bool {
        id.checked_sub(self.first).is_some_and(|at| (at as usize) < self.entries.len())
    }

    fn entry(&mut self, id: u32) -> Option<&mut SharedVertex> {
        self.entries.get_mut(id.checked_sub(self.first)? as usize)
    }

    /// Takes in that a cluster of `group` and `level` lists `id` at `position`.
    pub(super) fn list(
        &mut self,
        id: u32,
        position: [u32; 3],
        cluster: ClusterId,
        (level, group): (u32, GroupId),
        report: &mut Report,
    ) {
        let Some(entry) = self.entry(id) else { return };
        if !entry.last.is_some() {
            (entry.position, entry.top) = (position, (level, group));
        }
        let once = entry.last != cluster;
        if !once || entry.position != position {
            blame(id, position, cluster, entry, report);
        }
        entry.last = cluster;
        if level > entry.top.0 {
            (entry.top, entry.mixed) = ((level, group), false);
        } else if level == entry.top.0 {
            entry.mixed |= group != entry.top.1;
        }
        if level == 0 && once {
            entry.leaves = (entry.leaves + 1).min(2);
        }
    }

    /// Takes in that `id` collapses in the clusters of `group`.
    pub(super) fn collapse(&mut self, id: u32, group: GroupId) {
        let Some(entry) = self.entry(id) else { return };
        if entry.gone_in.is_some() && entry.gone_in != group {
            entry.mixed = true;
        }
        entry.gone_in = group;
    }

    /// Ids that a leaf lists.
    pub(super) fn leaf_ids(&self) -> u64 {
        self.entries.iter().filter(|entry| entry.leaves > 0).count() as u64
    }

    /// Checks that need all lists together.
    pub(super) fn finish(&self, header: &Header, trimmed: bool, report: &mut Report) {
        // Partitioned again, a cluster may get neighbours where no two leaves met. Where leaves were coarser once, what they
        // shared may have vanished from one of them.
        let least = if trimmed { 1 } else { 2 };
        let by_leaves = header.boundary_mode() != Some(BoundaryMode::VPartition);
        for (id, entry) in (self.first..).zip(&self.entries) {
            let listed = if by_leaves { entry.leaves >= least } else { entry.last.is_some() };
            let message =
                format_args!("shared vertex {id} in two leaf clusters expected, got {}", entry.leaves);
            report.expect(listed, Invariant::Coverage, FilePart::File, message);
            let alone = !entry.gone_in.is_some() || (entry.gone_in == entry.top.1 && !entry.mixed);
            let gone = entry.gone_in;
            let message = format_args!("shared vertex {id} collapses here, but clusters outside have it too");
            report.expect(alone, Invariant::Boundary, FilePart::Group(gone), message);
        }
    }
}

/// Says what is wrong where a cluster lists a vertex that was listed before.
#[cold]
fn blame(id: u32, position: [u32; 3], cluster: ClusterId, before: &SharedVertex, report: &mut Report) {
    let place = FilePart::Page(cluster);
    let once = before.last != cluster;
    report.expect(once, Invariant::Coverage, place, format_args!("shared vertex {id} is listed twice"));
    let (here, there) = (position.map(f32::from_bits), before.position.map(f32::from_bits));
    let message =
        format_args!("shared vertex {id} at {there:?} expected (as in {}), got {here:?}", before.last);
    report.expect(before.position == position, Invariant::Coverage, place, message);
}
