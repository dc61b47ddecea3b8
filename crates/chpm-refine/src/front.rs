//! The incremental selection's groups: splits and collapses from the last frame's state on, in flat arrays.

use crate::hierarchy::Hierarchy;
use crate::splits::parents;
use crate::view::View;
use chpm_format::{Chpm, ClusterRecord};
use chpm_mesh::{ClusterId, GroupId};

/// Splits and collapses of a frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Changes {
    /// Groups that were split.
    pub splits: u64,
    /// Groups that were collapsed.
    pub collapses: u64,
    /// Vertex splits and half-edge collapses along the progressive meshes.
    pub pm_steps: u64,
}

impl Changes {
    /// Dependency checks that a frame took (Quick-VDR 5.2): one for each split and collapse of a group, which stands for all of
    /// its clusters. None is ever answered with another split that must come first.
    pub fn checks(&self) -> u64 {
        self.splits + self.collapses
    }
}

/// Which groups are split, from frame to frame. A frame costs one bound for every group that could be split or collapsed next,
/// and work for what changes. It reads no page.
#[derive(Clone, Debug)]
pub struct Front {
    states: Vec<GroupState>,
    /// Groups that are whole and not split.
    open: Vec<GroupId>,
    /// Groups that are split, every one after those above it.
    split: Vec<GroupId>,
    /// Clusters that the last update brought; some of them may have been replaced since.
    entered: Vec<Entered>,
}

/// A cluster that the cut got, with the side that it came from.
#[derive(Clone, Copy, Debug)]
pub struct Entered {
    /// The cluster.
    pub cluster: ClusterId,
    /// Whether it replaced finer clusters, which look like its finest mesh; otherwise it looks like its base mesh.
    pub finest: bool,
}

#[derive(Clone, Copy, Debug)]
struct GroupState {
    /// The view's bound, of an open group.
    bound: f32,
    /// Coarse clusters that are still to be brought.
    missing: u32,
    /// Fine clusters whose groups are split.
    below: u32,
    split: bool,
}

impl Front {
    /// The coarsest cut of a file.
    pub fn new<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let ids = (0..file.groups().len() as u32).map(GroupId);
        let states: Vec<_> = ids
            .clone()
            .map(|id| {
                let missing = file
                    .coarse(id)
                    .iter()
                    .map(|id| u32::from(!file.clusters()[*id as usize].is_root()))
                    .sum();
                GroupState { bound: f32::INFINITY, missing, below: 0, split: false }
            })
            .collect();
        let open = ids.filter(|id| states[id.index()].missing == 0).collect();
        Front { states, open, split: Vec::new(), entered: Vec::new() }
    }

    /// Goes on to a view. `allowed` may keep groups from being split, and then must keep all below from it too (nothing else can
    /// be split as long as they are not). The groups that are split are those that [`crate::select()`] splits, and are allowed.
    pub fn update<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        view: &View,
        allowed: impl Fn(GroupId) -> bool,
    ) -> Changes {
        self.update_by(file, hierarchy, |group| hierarchy.bound(group, view), allowed)
    }

    /// The same by bounds that somebody else keeps: those of a view ([`Hierarchy::bound`]), where several fronts follow it. Each is asked
    /// for once, or twice where a group changes.
    pub fn update_by<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        hierarchy: &Hierarchy,
        mut bound_of: impl FnMut(GroupId) -> f32,
        allowed: impl Fn(GroupId) -> bool,
    ) -> Changes {
        let mut changes = Changes::default();
        self.entered.clear();
        let mut next = 0;
        // Grows while it is walked: a split opens the groups below.
        while let Some(&group) = self.open.get(next) {
            next += 1;
            let bound = bound_of(group);
            self.states[group.index()].bound = bound;
            if hierarchy.wants(group, bound) && allowed(group) {
                changes.splits += 1;
                self.split(file, group);
            }
        }
        // Groups below come first, so that one that is free to collapse has been asked.
        for place in (0..self.split.len()).rev() {
            let group = self.split[place];
            if self.states[group.index()].below > 0 {
                continue;
            }
            let bound = bound_of(group);
            if !(hierarchy.wants(group, bound) && allowed(group)) {
                changes.collapses += 1;
                self.collapse(file, group, bound);
            }
        }
        if changes.splits + changes.collapses > 0 {
            let states = &self.states;
            self.open.retain(|group| states[group.index()].is_open());
            self.split.retain(|group| states[group.index()].split);
        }
        changes
    }

    /// Replaces the coarse clusters of an open group by the fine ones.
    pub(crate) fn split<D: AsRef<[u8]>>(&mut self, file: &Chpm<D>, group: GroupId) {
        self.states[group.index()].split = true;
        self.split.push(group);
        for above in parents(file, group) {
            self.states[above.index()].below += 1;
        }
        for fine in file.fine(group).iter().copied().map(ClusterId) {
            self.entered.push(Entered { cluster: fine, finest: false });
            let below = file.clusters()[fine.index()].group();
            let state = &mut self.states[below.index()];
            state.missing -= 1;
            if state.missing == 0 {
                self.open.push(below);
            }
        }
    }

    /// Replaces the fine clusters of a split group by the coarse ones; none of those below is split.
    fn collapse<D: AsRef<[u8]>>(&mut self, file: &Chpm<D>, group: GroupId, bound: f32) {
        let state = &mut self.states[group.index()];
        (state.split, state.bound) = (false, bound);
        self.open.push(group);
        for above in parents(file, group) {
            self.states[above.index()].below -= 1;
        }
        for fine in file.fine(group) {
            self.states[file.clusters()[*fine as usize].group as usize].missing += 1;
        }
        let coarse = file.coarse(group).iter().copied().map(ClusterId);
        self.entered.extend(coarse.map(|cluster| Entered { cluster, finest: true }));
    }

    /// Whether a group is split.
    ///
    /// # Panics
    /// For a group that the file does not have.
    pub fn is_split(&self, group: GroupId) -> bool {
        self.states[group.index()].split
    }

    /// The groups that are in the cut as a whole: what may be split next.
    pub fn open_groups(&self) -> &[GroupId] {
        &self.open
    }

    /// The groups that are split; every one comes after those above it.
    pub fn split_groups(&self) -> &[GroupId] {
        &self.split
    }

    /// Whether a cluster is in the cut.
    pub fn is_active(&self, cluster: &ClusterRecord) -> bool {
        let brought = cluster.is_root() || self.is_split(cluster.parent_group());
        brought && !self.is_split(cluster.group())
    }

    /// The bound that the clusters of a group in the cut are positioned by: the view's; none at all where the group is there in
    /// part, because what replaces the others looks like their base meshes.
    pub fn bound(&self, group: GroupId) -> f32 {
        let state = &self.states[group.index()];
        if state.missing == 0 { state.bound } else { f32::INFINITY }
    }

    /// The clusters that the last update brought, in the order of the changes; some may have been replaced by later ones.
    pub fn entered(&self) -> &[Entered] {
        &self.entered
    }
}

impl GroupState {
    fn is_open(&self) -> bool {
        !self.split && self.missing == 0
    }
}
