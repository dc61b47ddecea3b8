//! Puts the leaves' censuses together.

use super::local::{EdgeKind, EdgeUse, Fan, LOOSE, LeafCensus};
use super::sets::Sets;
use crate::report::Repairs;
use rayon::prelude::*;

/// Records that are let gather before settling is worth its sorting.
const LARGE: usize = 1 << 20;

/// Takes in leaves in order. Memory: 9 bytes for each shared vertex, and 12 for each record not settled yet.
#[derive(Debug)]
pub(super) struct Ledger {
    found: Repairs,
    /// Sets of shared ids: those that faces connect, and those that boundary edges do.
    surface: Sets,
    border: Sets,
    edges: Vec<EdgeUse>,
    fans: Vec<Fan>,
    /// By shared id: whether the vertex is known to be non-manifold.
    non_manifold: Vec<bool>,
    /// Records beyond which to settle.
    limit: usize,
    scratch: FanScratch,
}

impl Ledger {
    pub(super) fn new(shared_count: usize) -> Self {
        let mut absent = [Sets::default(), Sets::default()];
        absent.iter_mut().for_each(|sets| sets.absent(shared_count));
        let [surface, border] = absent;
        Ledger {
            found: Repairs::default(),
            surface,
            border,
            edges: Vec::new(),
            fans: Vec::new(),
            non_manifold: vec![false; shared_count],
            limit: LARGE,
            scratch: FanScratch::default(),
        }
    }

    /// Takes in what the next leaf counted.
    pub(super) fn enter(&mut self, leaf: LeafCensus) {
        super::add(&mut self.found, &leaf.found);
        for [a, b] in leaf.connected {
            self.surface.join(a, b);
        }
        for [a, b] in leaf.bordering {
            self.border.join(a, b);
        }
        self.edges.extend(leaf.edges);
        self.fans.extend(leaf.fans);
    }

    /// [`Self::settle`] once many records have come together.
    pub(super) fn settle_when_large(&mut self, done: u32, last_user: &impl Fn(u32) -> u32) {
        if self.edges.len() + self.fans.len() > self.limit {
            self.settle(done, last_user);
            self.limit = LARGE + 2 * (self.edges.len() + self.fans.len());
        }
    }

    /// Decides all edges and vertices that no leaf from `done` on can add to, and forgets their records. `last_user` names
    /// the last leaf that uses a shared vertex.
    pub(super) fn settle(&mut self, done: u32, last_user: &impl Fn(u32) -> u32) {
        let Ledger { found, border, edges, fans, non_manifold, scratch, .. } = self;
        edges.par_sort_unstable();
        edges.dedup_by(|next, kept| {
            let same = next.ends == kept.ends;
            if same {
                kept.faces.add(next.faces);
            }
            same
        });
        edges.retain(|edge| {
            let [a, b] = edge.ends;
            // Whoever has a face on an edge uses both its ends.
            if last_user(a).min(last_user(b)) >= done {
                return true;
            }
            match edge.faces.count(found) {
                EdgeKind::Boundary => {
                    border.join(a, b);
                }
                EdgeKind::Regular => {}
                EdgeKind::NonManifold => {
                    non_manifold[a as usize] = true;
                    non_manifold[b as usize] = true;
                }
            }
            false
        });
        fans.par_sort_unstable();
        for about_one in fans.chunk_by(|x, y| x.vertex == y.vertex) {
            if last_user(about_one[0].vertex) < done && !scratch.are_one(about_one) {
                non_manifold[about_one[0].vertex as usize] = true;
            }
        }
        fans.retain(|fan| last_user(fan.vertex) >= done);
    }

    /// The counts of everything, once all leaves are in.
    pub(super) fn close(mut self) -> Repairs {
        self.settle(u32::MAX, &|_| 0);
        self.found.components += u64::from(self.surface.count);
        self.found.boundary_loops += u64::from(self.border.count);
        self.found.non_manifold_vertices += self.non_manifold.iter().filter(|bad| **bad).count() as u64;
        self.found
    }
}

#[derive(Debug, Default)]
struct FanScratch {
    ends: Vec<(u32, u32)>,
    sets: Sets,
}

impl FanScratch {
    /// Whether fans about one vertex form a single one when glued at equal ends.
    fn are_one(&mut self, fans: &[Fan]) -> bool {
        if fans.len() == 1 {
            return true;
        }
        self.ends.clear();
        for (index, fan) in fans.iter().enumerate() {
            let glued = fan.ends.iter().filter(|end| **end != LOOSE);
            self.ends.extend(glued.map(|end| (*end, index as u32)));
        }
        self.ends.sort_unstable();
        self.sets.singletons(fans.len());
        for pair in self.ends.windows(2) {
            if pair[0].0 == pair[1].0 {
                self.sets.join_present(pair[0].1, pair[1].1);
            }
        }
        self.sets.count == 1
    }
}
