//! Checks everything about a file that the file alone can show.
//!
//! [`crate::Chpm::open`] makes a file safe to read; this makes it right: page checksums, statistics, and the invariants of
//! FORMAT.md. Pages are looked at group by group, each twice (as a coarse and as a fine cluster), so memory is that of the
//! largest group and of a table of the shared vertices, which may be made in parts: the shared vertices of all pages are looked at
//! once more for each further part.

mod cluster;
mod group;
mod remnants;
mod shared;
mod sheets;
mod tables;

use crate::error::FilePart;
use crate::reader::Chpm;
use chpm_mesh::{ClusterId, GroupId};
use group::GroupCheck;
use shared::SharedIds;
use std::fmt;
use std::ops::ControlFlow;

/// Faults that a report holds in full; further ones are counted.
pub const MAX_FAULTS: usize = 100;

/// The invariants of FORMAT.md that a file alone can show, in whole or in part.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[non_exhaustive]
pub enum Invariant {
    /// I1: leaves hold the source, and shared vertices are known to all that have them.
    Coverage,
    /// I2: the hierarchy is balanced.
    Balance,
    /// I3: progressive meshes end in the base mesh they announce.
    ProgressiveMesh,
    /// I4: finest meshes of the coarse clusters are the base meshes of the fine ones.
    Union,
    /// I6: errors are monotone, boxes and spheres enclose.
    Nesting,
    /// I7: what neighbours share collapses in all of them alike.
    Boundary,
    /// I8: no vertex moves.
    Vertices,
    /// I10: bytes are what was written; nothing is where zeros belong.
    Bytes,
    /// I13: triangles are in their charts at every position.
    Sheets,
}

impl fmt::Display for Invariant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Invariant::Coverage => "I1 coverage",
            Invariant::Balance => "I2 balance",
            Invariant::ProgressiveMesh => "I3 progressive mesh",
            Invariant::Union => "I4 union of children",
            Invariant::Nesting => "I6 nesting",
            Invariant::Boundary => "I7 boundary",
            Invariant::Vertices => "I8 vertices",
            Invariant::Bytes => "I10 bytes",
            Invariant::Sheets => "I13 sheets",
        })
    }
}

/// One thing that is wrong.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Fault {
    /// Broken invariant.
    pub invariant: Invariant,
    /// Where.
    pub place: FilePart,
    /// Expected and found values, in words.
    pub message: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.invariant, self.place, self.message)
    }
}

/// Findings of [`verify`].
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Report {
    /// Pages whose checksum and structure are right.
    pub good_pages: u64,
    /// Finest triangles of those pages.
    pub triangles: u64,
    /// The first [`MAX_FAULTS`] faults.
    pub faults: Vec<Fault>,
    /// Number of all faults.
    pub fault_count: u64,
}

impl Report {
    /// Whether nothing is wrong.
    pub fn is_ok(&self) -> bool {
        self.fault_count == 0
    }

    /// Notes a fault unless `ok`; the text is made only where it is kept.
    fn expect(&mut self, ok: bool, invariant: Invariant, place: FilePart, message: impl fmt::Display) {
        if ok {
            return;
        }
        self.fault_count += 1;
        if self.faults.len() < MAX_FAULTS {
            self.faults.push(Fault { invariant, place, message: message.to_string() });
        }
    }
}

/// Verifies a file. `progress` is told clusters done and clusters in all, after every group.
pub fn verify<D: AsRef<[u8]>>(file: &Chpm<D>, mut progress: impl FnMut(u64, u64)) -> Report {
    let mut report = Report::default();
    let whole = check(file, u64::MAX, &mut report, |done, all| {
        progress(done, all);
        ControlFlow::Continue(())
    });
    debug_assert!(whole.is_continue());
    report
}

/// As [`verify`], with `memory` bytes for the table of shared vertices: with several parts of it, clusters are told as often. There is no
/// report where `progress` says that it is enough.
pub fn verify_within<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    memory: u64,
    progress: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Option<Report> {
    let mut report = Report::default();
    check(file, memory, &mut report, progress).is_continue().then_some(report)
}

fn check<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    memory: u64,
    report: &mut Report,
    mut progress: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> ControlFlow<()> {
    tables::check(file, report);
    let count = file.header().shared_vertex_count;
    let at_once = (memory / shared::ENTRY as u64).clamp(1, u64::from(u32::MAX)) as u32;
    let part = |first: u32| SharedIds::new(first..count.min(first.saturating_add(at_once)));
    let mut shared = part(0);
    let mut groups = GroupCheck::of(file);
    let clusters = file.clusters().len() as u64;
    let total = clusters * u64::from(count.div_ceil(at_once).max(1));
    let mut done = 0;
    for (id, group) in (0..).map(GroupId).zip(file.groups()) {
        groups.run(file, id, &mut shared, report);
        done += u64::from(group.coarse_count);
        progress(done, total)?;
    }
    // A page that could not be read leaves its shared vertices unseen, which would blame the wrong thing.
    if report.good_pages < clusters {
        return ControlFlow::Continue(());
    }

    shared.finish(file.header(), file.is_trimmed(), report);
    let mut leaf_ids = shared.leaf_ids();
    for first in (0..count).step_by(at_once as usize).skip(1) {
        // The part before must not be in memory beside this one.
        drop(shared);
        shared = part(first);
        for (id, group) in (0..).map(GroupId).zip(file.groups()) {
            for cluster in file.coarse(id).iter().copied().map(ClusterId) {
                if let Ok(page) = file.page(cluster) {
                    cluster::list_shared(file, cluster, &page.view(), &mut shared, report);
                }
            }
            done += u64::from(group.coarse_count);
            progress(done, total)?;
        }
        shared.finish(file.header(), file.is_trimmed(), report);
        leaf_ids += shared.leaf_ids();
    }
    tables::check_source_vertices(file, leaf_ids, report);
    ControlFlow::Continue(())
}
