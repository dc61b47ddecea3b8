//! Which dependency groups are split: what makes a cut legal.
//!
//! A set of split groups is legal if it is closed upward: the coarse clusters of a split group were all brought by splits
//! themselves, or are roots. The cut is then every cluster that was brought and whose own group is not split.

use chpm_format::{Chpm, ClusterRecord, GroupRecord};
use chpm_mesh::{ClusterId, GroupId};
use std::cmp::Reverse;

/// An upward closed set of groups.
pub(crate) struct Splits {
    split: Vec<bool>,
}

/// The groups, higher levels first, and by id within a level: every group comes after the groups that bring it.
pub(crate) fn top_down<D: AsRef<[u8]>>(file: &Chpm<D>) -> Vec<GroupId> {
    let mut order: Vec<_> = (0..file.groups().len() as u32).map(GroupId).collect();
    order.sort_by_key(|group| Reverse(file.groups()[group.index()].level));
    order
}

/// The groups that bring the coarse clusters of a group, once for each cluster.
pub(crate) fn parents<D: AsRef<[u8]>>(file: &Chpm<D>, group: GroupId) -> impl Iterator<Item = GroupId> {
    let coarse = file.coarse(group).iter().map(|cluster| &file.clusters()[*cluster as usize]);
    coarse.filter(|cluster| !cluster.is_root()).map(ClusterRecord::parent_group)
}

impl Splits {
    /// Asks for every group of `order` ([`top_down`]) whether it wants to be split, and splits those that can be. In a
    /// file with saturated errors whoever wants by error can; in a damaged one the cut is still legal.
    pub(crate) fn wanted<D: AsRef<[u8]>>(
        file: &Chpm<D>,
        order: &[GroupId],
        mut wants: impl FnMut(GroupId, &GroupRecord) -> bool,
    ) -> Self {
        let mut splits = Splits { split: vec![false; file.groups().len()] };
        for id in order {
            let group = &file.groups()[id.index()];
            let split = wants(*id, group) && !group.is_leaf() && splits.is_whole(file, *id);
            splits.split[id.index()] = split;
        }
        splits
    }

    /// The fewest splits that bring all of `clusters`.
    pub(crate) fn that_bring<D: AsRef<[u8]>>(
        file: &Chpm<D>,
        clusters: impl Iterator<Item = ClusterId>,
    ) -> Self {
        let parent = |cluster: ClusterId| file.clusters()[cluster.index()].parent_group();
        let mut splits = Splits { split: vec![false; file.groups().len()] };
        let mut above: Vec<_> = clusters.map(parent).collect();
        while let Some(group) = above.pop() {
            if group.is_some() && !splits.split[group.index()] {
                splits.split[group.index()] = true;
                above.extend(file.coarse(group).iter().map(|cluster| parent(ClusterId(*cluster))));
            }
        }
        splits
    }

    /// Splits a group that is whole.
    pub(crate) fn split(&mut self, group: GroupId) {
        self.split[group.index()] = true;
    }

    /// Whether a group is split.
    pub(crate) fn is_split(&self, group: GroupId) -> bool {
        self.split[group.index()]
    }

    /// Whether the cluster is a root or one that a split brought.
    fn brings(&self, cluster: &ClusterRecord) -> bool {
        cluster.is_root() || self.split[cluster.parent_group().index()]
    }

    /// Whether all coarse clusters of the group were brought, so that it can be split.
    pub(crate) fn is_whole<D: AsRef<[u8]>>(&self, file: &Chpm<D>, group: GroupId) -> bool {
        file.coarse(group).iter().all(|cluster| self.brings(&file.clusters()[*cluster as usize]))
    }

    /// Whether the cluster is in the cut.
    pub(crate) fn is_active(&self, cluster: &ClusterRecord) -> bool {
        self.brings(cluster) && !self.split[cluster.group().index()]
    }

    /// The clusters of the cut, ascending.
    pub(crate) fn active<'a, D: AsRef<[u8]>>(
        &'a self,
        file: &'a Chpm<D>,
    ) -> impl Iterator<Item = (ClusterId, &'a ClusterRecord)> {
        (0..).map(ClusterId).zip(file.clusters()).filter(|(_, cluster)| self.is_active(cluster))
    }
}
