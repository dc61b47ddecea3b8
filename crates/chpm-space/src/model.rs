//! A file as a question sees it: groups with the space that they hold, what they are wrong by, and the pages that were read.

use crate::block::Block;
use crate::error::Unproven;
use crate::patch::Patch;
use crate::shelf::{Shelf, lock};
use chpm_format::{Chpm, ErrorKind, FormatError};
use chpm_mesh::{Aabb, Bytes, ClusterId, GroupId};
use chpm_refine::Hierarchy;
use std::sync::{Arc, Mutex};

/// Bytes and pages read for an answer.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Reads {
    /// Pages.
    pub pages: u64,
    /// Their bytes in the file.
    pub bytes: Bytes,
}

impl Reads {
    /// Both together.
    pub fn plus(self, other: Reads) -> Reads {
        Reads { pages: self.pages + other.pages, bytes: Bytes(self.bytes.0 + other.bytes.0) }
    }
}

/// One of the two models of a question. It keeps pages, within a number of bytes, for the next question, and for all threads.
#[derive(Debug)]
pub struct Model<'a, D> {
    file: &'a Chpm<D>,
    hierarchy: Hierarchy,
    rounding: f64,
    /// By group, how far its source reaches at most beyond the boxes of the leaves: by their rounding, and in a trimmed file by what has vanished.
    beyond: Vec<f64>,
    /// The largest of them; those without an end do not count, since nothing is proven of their groups.
    farthest: f64,
    shelf: Mutex<Shelf>,
}

/// How wrong the finest meshes of a group's clusters are.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Wrong {
    /// No point of what is drawn is farther from the source.
    pub error: f64,
    /// No point of the source is farther from what is drawn.
    pub distance: f64,
}

impl Wrong {
    /// Both together.
    pub fn both(&self) -> f64 {
        self.error + self.distance
    }
}

impl<'a, D: AsRef<[u8]>> Model<'a, D> {
    /// Reads the tables of a file. Pages are kept up to `budget`, and one at least.
    ///
    /// # Errors
    /// A file that bounds no distances: of estimated errors, or of version 1.0.
    pub fn new(file: &'a Chpm<D>, budget: Bytes) -> Result<Self, Unproven> {
        let certified = file.header().error_kind() == Some(ErrorKind::Certified);
        if !certified || !file.has_gaps() {
            let got = if certified { "version 1.0, which has no gaps" } else { "estimated errors" };
            return Err(Unproven { expected: "a file with proven distances", got });
        }

        let shelf = Shelf::new(budget);
        let leaves = file.clusters().iter().filter(|record| record.is_leaf() && !record.is_trimmed());
        let rounding = leaves.map(|record| f64::from(record.min_error)).fold(0.0, f64::max);

        let (hierarchy, beyond) = (Hierarchy::new(file), vec![0.0; file.groups().len()]);
        let mut model = Model { file, hierarchy, rounding, beyond, farthest: 0.0, shelf: Mutex::new(shelf) };
        for group in model.hierarchy.top_down().iter().rev() {
            let below = file.fine(*group).iter().map(|fine| file.clusters()[*fine as usize].group());
            let below = below.map(|group| model.beyond[group.index()]).fold(0.0, f64::max);
            model.beyond[group.index()] =
                if model.is_leaf(*group) { model.wrong(*group).distance } else { below };
        }

        let ends = model.beyond.iter().filter(|beyond| **beyond < f64::from(f32::MAX));
        model.farthest = ends.copied().fold(0.0, f64::max);
        Ok(model)
    }

    /// The file.
    pub fn file(&self) -> &'a Chpm<D> {
        self.file
    }

    /// How far the leaves' triangles are from the source's, which may be of doubles: no question is answered nearer than that.
    pub fn rounding(&self) -> f64 {
        self.rounding
    }

    /// Reads so far.
    pub fn reads(&self) -> Reads {
        lock(&self.shelf).reads
    }

    /// How far what is of the source may be beyond the boxes of the leaves, at most.
    pub fn farthest(&self) -> f64 {
        self.farthest
    }

    /// A box about all of the source, which the file's box is but for rounding and what was trimmed away.
    pub fn bounds(&self) -> Aabb {
        let Aabb { min, max } = self.file.header().aabb();
        if self.farthest <= 0.0 {
            return Aabb { min, max };
        }
        Aabb {
            min: min.map(|x| ((f64::from(x) - self.farthest) as f32).next_down()),
            max: max.map(|x| ((f64::from(x) + self.farthest) as f32).next_up()),
        }
    }

    /// Whether nothing is below a group.
    pub fn is_leaf(&self, group: GroupId) -> bool {
        self.file.fine(group).is_empty()
    }

    /// The level of a group.
    pub fn level(&self, group: GroupId) -> u32 {
        self.file.groups()[group.index()].level
    }

    /// A box about all of the source that the group stands for: the tables' is about what the leaves hold of it.
    pub fn block(&self, group: GroupId) -> Block {
        let (region, beyond) = (self.hierarchy.region(group), self.beyond[group.index()]);
        Block::wide(region.low.map(|x| x - beyond), region.high.map(|x| x + beyond))
    }

    /// The box of a cluster's own vertices.
    pub fn cluster_block(&self, cluster: ClusterId) -> Block {
        let record = &self.file.clusters()[cluster.index()];
        Block::new(record.aabb_min, record.aabb_max)
    }

    /// How wrong the finest meshes of a group's coarse clusters are.
    pub fn wrong(&self, group: GroupId) -> Wrong {
        let record = &self.file.groups()[group.index()];
        let error = record.min_error;
        // Leaves are the source: nothing has vanished, whatever their collapses will cost.
        let mut clusters = self.coarse(group);
        let is_source = record.is_leaf() && !clusters.any(|id| self.file.clusters()[id.index()].is_trimmed());
        let distance = if is_source { error } else { self.file.gaps(group).distance(error) };
        Wrong { error: error.into(), distance: distance.into() }
    }

    /// The coarse clusters of a group.
    pub fn coarse(&self, group: GroupId) -> impl Iterator<Item = ClusterId> + use<'a, D> {
        self.file.coarse(group).iter().map(|id| ClusterId(*id))
    }

    /// The groups that stand for the same part of the source together, finer; ascending.
    pub fn below(&self, group: GroupId) -> Vec<GroupId> {
        self.groups_of(self.file.fine(group).iter().copied())
    }

    /// The groups that stand for all.
    pub fn top(&self) -> Vec<GroupId> {
        self.groups_of(self.file.roots().map(|id| id.0))
    }

    fn groups_of(&self, clusters: impl Iterator<Item = u32>) -> Vec<GroupId> {
        let mut groups: Vec<GroupId> = clusters.map(|id| self.file.clusters()[id as usize].group()).collect();
        groups.sort_unstable();
        groups.dedup();
        groups
    }

    /// The finest mesh of a cluster: kept, or read.
    pub fn patch(&self, cluster: ClusterId) -> Result<Arc<Patch>, FormatError> {
        self.take(cluster, false)
    }

    /// The same for thousands of questions, each a short one.
    pub fn patch_for_many(&self, cluster: ClusterId) -> Result<Arc<Patch>, FormatError> {
        self.take(cluster, true)
    }

    fn take(&self, cluster: ClusterId, often: bool) -> Result<Arc<Patch>, FormatError> {
        let record = &self.file.clusters()[cluster.index()];
        let slot = lock(&self.shelf).slot(cluster, Patch::bytes_of(record));
        let mut held = lock(&slot);
        if let Some(patch) = &*held {
            return Ok(Arc::clone(patch));
        }
        let page = self.file.page(cluster)?;
        let patch = Arc::new(Patch::new(&page.view(), often));
        *held = Some(Arc::clone(&patch));
        let reads = &mut lock(&self.shelf).reads;
        reads.pages += 1;
        reads.bytes.0 += u64::from(record.page_len);
        Ok(patch)
    }
}
