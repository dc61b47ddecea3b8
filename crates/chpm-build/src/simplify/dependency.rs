//! Cluster dependencies: which clusters of a level form a group that simplifies its group borders together (Quick-VDR 4.4,
//! Yoon 4.2.4).
//!
//! A pair of clusters is a candidate if it shares enough vertices, has a similar error-range and does not merge soon: group borders that
//! merge soon need no help. Pairs with more shared vertices come first; the published priority, the group border's error against
//! the interior's, was tried and gained nothing. The papers forbid chains of dependencies, since a split travels along them; a group
//! here splits by one rule of its own, so a chain costs no more than its length, and that is limited.

use super::{Inputs, cost};
use crate::config::Settings;
use crate::decompose::SharedVertices;
use crate::hierarchy::Tree;
use crate::pairs::Pairs;
use std::cmp::Reverse;

/// Members that a group border can tell apart: a bit of a byte each.
const MAX_MEMBERS: usize = 8;

/// Clusters that have the same shared vertex beyond which it is one that all share, as the apex of a huge fan is.
const MANY: usize = 64;

/// Who has the shared vertices while the levels are worked off.
pub(super) struct GroupBorders<'a> {
    shared: &'a SharedVertices,
    /// By interface: the level at which its clusters have merged.
    release: &'a [u8],
    /// The cluster of the current level, or the last one below it, over each leaf.
    cluster_over: Vec<u32>,
}

impl<'a> GroupBorders<'a> {
    pub(super) fn new(shared: &'a SharedVertices, release: &'a [u8], leaf_count: usize) -> Self {
        let cluster_over = (0..leaf_count as u32).collect();
        GroupBorders { shared, release, cluster_over }
    }

    /// At `level`.
    pub(super) fn at(level: u32, inputs: &Inputs<'a>) -> Self {
        let Inputs { decomposition, tree, release, .. } = *inputs;
        let mut borders = GroupBorders::new(&decomposition.shared, release, decomposition.leaves.len());
        (0..=level).for_each(|level| borders.rise(tree, level));
        borders
    }

    /// Goes on to `level`.
    pub(super) fn rise(&mut self, tree: &Tree, level: u32) {
        for cluster in &mut self.cluster_over {
            let parent = tree.nodes[*cluster as usize].parent;
            if let Some(parent) = parent.filter(|p| tree.nodes[*p as usize].level <= level) {
                *cluster = parent;
            }
        }
    }

    /// Whether all clusters that have a shared vertex are among `members`.
    pub(super) fn is_inside(&self, id: u32, members: &[u32]) -> bool {
        self.shared.users(id).iter().all(|leaf| members.contains(&self.cluster_over[*leaf as usize]))
    }

    /// Groups of the nodes of a level that `finest_error` answers for, each node in one. `left` is how many shared vertices of each
    /// interface have not collapsed, `cost` the bytes that a member takes.
    pub(super) fn groups(
        &self,
        tree: &Tree,
        level: u32,
        left: &[u32],
        settings: &Settings,
        finest_error: impl Fn(u32) -> Option<f32>,
        cost: impl Fn(u32) -> u64,
    ) -> Vec<Vec<u32>> {
        let nodes = tree.level(level);
        let first = nodes.start as u32;
        let mut group_of: Vec<u32> = (0..nodes.len() as u32).collect();
        let mut groups: Vec<Vec<u32>> = nodes.clone().map(|n| vec![n as u32]).collect();
        let mut costs: Vec<u64> = nodes.map(|n| cost(n as u32)).collect();

        // Groups grow from the pairs that share most, as long as they fit.
        let mut pairs = self.candidates(tree, level, left, settings, finest_error);
        pairs.sort_unstable_by_key(|&(a, b, shared)| (Reverse(shared), a, b));
        for (a, b, _) in pairs {
            let [into, from] = [a, b].map(|node| group_of[(node - first) as usize] as usize);
            let members = groups[into].len() + groups[from].len();
            let fits = members <= (settings.dependency_members as usize).min(MAX_MEMBERS)
                && costs[into] + costs[from] <= cost::GROUP;
            if into != from && fits {
                costs[into] += costs[from];
                let moved = std::mem::take(&mut groups[from]);
                moved.iter().for_each(|node| group_of[(node - first) as usize] = into as u32);
                groups[into].extend(moved);
            }
        }

        groups.retain(|g| !g.is_empty());
        groups.iter_mut().for_each(|g| g.sort_unstable());
        groups
    }

    /// Pairs (a, b, shared vertices) of nodes of the level that may depend on each other, a < b, ascending.
    fn candidates(
        &self,
        tree: &Tree,
        level: u32,
        left: &[u32],
        settings: &Settings,
        finest_error: impl Fn(u32) -> Option<f32>,
    ) -> Vec<(u32, u32, u32)> {
        let at_level =
            |node: &u32| tree.nodes[*node as usize].level == level && finest_error(*node).is_some();
        let mut pairs = Pairs::default();
        let mut having = Vec::new();
        for (interface, (users, _)) in self.shared.interfaces().enumerate() {
            // Group borders that are gone, and those that are free at this level anyway, tie nobody.
            let left = left[interface];
            if left == 0 || u32::from(self.release[interface]) <= level {
                continue;
            }

            having.clear();
            having.extend(users.iter().map(|leaf| self.cluster_over[*leaf as usize]).filter(at_level));
            having.sort_unstable();
            having.dedup();
            // What all share ties neighbours in the list, not each to each: their pairs would be without number.
            let reach = if having.len() > MANY { 1 } else { having.len() };
            for (i, a) in having.iter().enumerate() {
                having[i + 1..].iter().take(reach).for_each(|b| pairs.add(*a, *b, left));
            }
        }

        // Clusters that merge soon need not wait for each other, and errors that differ much would cost the finer one its detail.
        let mut pairs = pairs.sums();
        let alike = |a: u32, b: u32| {
            let (a, b) = (finest_error(a).unwrap_or(0.0), finest_error(b).unwrap_or(0.0));
            a.max(b) <= settings.dependency_error_ratio * a.min(b)
        };
        pairs.retain(|&(a, b, shared)| {
            let far = u32::from(tree.merge_level(&[a, b])) > level + settings.dependency_levels;
            shared >= settings.dependency_shared && far && alike(a, b)
        });
        pairs
    }
}
