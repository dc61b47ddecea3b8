//! Cluster dependencies: which clusters of a level form a group that simplifies its seams together (Quick-VDR 4.4,
//! Yoon 4.2.4).
//!
//! A pair of clusters is a candidate if it shares enough vertices and does not merge soon: seams that merge soon need no help.
//! A cluster joins a group only if it is a candidate with every member, so that there are no chains. Pairs with more shared
//! vertices come first; the published priority, the seam's error against the interior's, is still to come.

use crate::decompose::SharedVertices;
use crate::hierarchy::Tree;

/// Least number of vertices that dependent clusters share (Quick-VDR 4.4: 5).
const MIN_SHARED: u32 = 5;
/// Levels within which a pair merges anyway (Quick-VDR 4.4: 2).
const MERGE_SOON: u32 = 2;
/// Most members of a group: groups split and collapse as a whole, so small ones follow a view more closely.
const MAX_MEMBERS: usize = 4;

/// Who has the shared vertices while the levels are worked off.
pub(super) struct Seams<'a> {
    shared: &'a SharedVertices,
    release: &'a [u8],
    /// Whether a shared vertex has collapsed.
    gone: Vec<bool>,
    /// The cluster of the current level, or the last one below it, over each leaf.
    cluster_over: Vec<u32>,
}

impl<'a> Seams<'a> {
    pub(super) fn new(shared: &'a SharedVertices, release: &'a [u8], leaf_count: usize) -> Self {
        let cluster_over = (0..leaf_count as u32).collect();
        Seams { shared, release, gone: vec![false; shared.len()], cluster_over }
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

    /// Notes that a shared vertex has collapsed.
    pub(super) fn remove(&mut self, id: u32) {
        self.gone[id as usize] = true;
    }

    /// Whether all clusters that have a shared vertex are among `members`.
    pub(super) fn is_inside(&self, id: u32, members: &[u32]) -> bool {
        self.shared.users(id).iter().all(|leaf| members.contains(&self.cluster_over[*leaf as usize]))
    }

    /// Groups of the nodes of a level, each node in one; most are alone where boundaries stay locked.
    pub(super) fn groups(&self, tree: &Tree, level: u32, built: impl Fn(u32) -> bool) -> Vec<Vec<u32>> {
        let nodes = tree.level(level);
        let first = nodes.start as u32;
        let mut group_of: Vec<u32> = (0..nodes.len() as u32).collect();
        let mut groups: Vec<Vec<u32>> = nodes.map(|n| vec![n as u32]).collect();
        let pairs = self.candidates(tree, level, built);
        let is_pair =
            |a: u32, b: u32| pairs.binary_search_by_key(&(a.min(b), a.max(b)), |p| (p.0, p.1)).is_ok();
        let mut by_priority = pairs.clone();
        by_priority.sort_unstable_by_key(|&(a, b, shared)| (std::cmp::Reverse(shared), a, b));
        for (a, b, _) in by_priority {
            let [into, from] = [a, b].map(|node| group_of[(node - first) as usize] as usize);
            let fits = groups[into].len() + groups[from].len() <= MAX_MEMBERS;
            let all_share = || groups[into].iter().all(|x| groups[from].iter().all(|y| is_pair(*x, *y)));
            if into != from && fits && all_share() {
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
    fn candidates(&self, tree: &Tree, level: u32, built: impl Fn(u32) -> bool) -> Vec<(u32, u32, u32)> {
        let at_level = |node: &u32| tree.nodes[*node as usize].level == level && built(*node);
        let mut pairs = Vec::new();
        let mut having = Vec::new();
        for id in 0..self.shared.len() as u32 {
            if self.gone[id as usize] || u32::from(self.release[id as usize]) <= level {
                continue;
            }
            having.clear();
            having.extend(
                self.shared.users(id).iter().map(|leaf| self.cluster_over[*leaf as usize]).filter(at_level),
            );
            having.sort_unstable();
            having.dedup();
            for (i, a) in having.iter().enumerate() {
                pairs.extend(having[i + 1..].iter().map(|b| (*a, *b)));
            }
        }
        pairs.sort_unstable();
        pairs
            .chunk_by(|x, y| x == y)
            .map(|same| (same[0].0, same[0].1, same.len() as u32))
            .filter(|&(a, b, shared)| {
                shared >= MIN_SHARED && u32::from(tree.merge_level(&[a, b])) > level + MERGE_SOON
            })
            .collect()
    }
}
