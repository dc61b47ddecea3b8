//! Puts topology counts together: those of leaves to that of a region ([`Ledger`]), those of regions to that of the source ([`Account`]).

use super::local::{EdgeKind, EdgeUse, Fan, LOOSE, TopologyCounts, hand_over};
use super::sets::Sets;
use crate::report::Repairs;
use chpm_extmem::{Buckets, ExtmemError, Store};
use rayon::prelude::*;

/// log2 of the shared vertices whose records an account settles at once, and the bytes that it gathers of those.
const SHARE_LOG: u32 = 15;
const BLOCK: usize = 1 << 13;

/// Takes in the leaves of a region, in order. Memory: 9 bytes for each shared vertex, and 12 for each record.
#[derive(Debug)]
pub(crate) struct Ledger {
    found: Repairs,
    /// Sets of shared ids: those that faces connect, and those that boundary edges do.
    surface: Sets,
    border: Sets,
    edges: Vec<EdgeUse>,
    fans: Vec<Fan>,
    /// By shared id: whether the vertex is known to be non-manifold.
    non_manifold: Vec<bool>,
    scratch: FanScratch,
}

impl Ledger {
    /// For shared vertices with numbers below `shared_count`. Above, a number may only be the end of a fan.
    pub(crate) fn new(shared_count: usize) -> Self {
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
            scratch: FanScratch::default(),
        }
    }

    /// Takes in what was counted next.
    pub(crate) fn enter(&mut self, part: TopologyCounts) {
        super::add(&mut self.found, &part.found);
        for [a, b] in part.connected {
            self.surface.join(a, b);
        }
        for [a, b] in part.bordering {
            self.border.join(a, b);
        }
        part.non_manifold.into_iter().for_each(|id| self.non_manifold[id as usize] = true);
        self.edges.extend(part.edges);
        self.fans.extend(part.fans);
    }

    /// Decides all edges and vertices that nothing later can add to, and forgets their records. A vertex is complete if
    /// all that use it were entered.
    fn settle(&mut self, is_complete: impl Fn(u32) -> bool) {
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
            if !is_complete(a) && !is_complete(b) {
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

        // The fans of a vertex from several leaves are one surface, or it is no manifold there.
        fans.par_sort_unstable();
        for about_one in fans.chunk_by(|x, y| x.vertex == y.vertex) {
            if is_complete(about_one[0].vertex) && !scratch.are_one(about_one) {
                non_manifold[about_one[0].vertex as usize] = true;
            }
        }
        fans.retain(|fan| !is_complete(fan.vertex));
    }

    /// The counts of everything that was entered. Vertices below `complete` are complete; what is open about the others is
    /// handed over.
    pub(crate) fn close(mut self, complete: u32) -> TopologyCounts {
        self.settle(|id| id < complete);
        let open = complete..self.non_manifold.len() as u32;
        let open_ids = || open.clone().map(|id| (id, id));
        let mut first = Vec::new();
        let mut rest = TopologyCounts {
            found: self.found,
            edges: self.edges,
            fans: self.fans,
            ..TopologyCounts::default()
        };
        rest.found.components += hand_over(&mut self.surface, open_ids(), &mut first, &mut rest.connected);
        rest.found.boundary_loops += hand_over(&mut self.border, open_ids(), &mut first, &mut rest.bordering);
        let (inner, outer) = self.non_manifold.split_at(complete as usize);
        rest.found.non_manifold_vertices += inner.iter().filter(|bad| **bad).count() as u64;
        rest.non_manifold.extend(open.clone().zip(outer).filter(|(_, bad)| **bad).map(|(id, _)| id));
        rest
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

/// Takes in regions, in any order. Memory: 9 bytes for each border vertex; records go to buckets, which are in memory or on disk.
#[derive(Debug)]
pub(crate) struct Account {
    ledger: Ledger,
    edges: Buckets<EdgeUse>,
    fans: Buckets<Fan>,
}

impl Account {
    /// For border vertices with numbers below `border_count`.
    pub(crate) fn new(border_count: usize, store: &Store) -> Self {
        let shares = (border_count >> SHARE_LOG) + 1;
        Account {
            ledger: Ledger::new(border_count),
            edges: Buckets::new(store, "edges between regions", shares, BLOCK),
            fans: Buckets::new(store, "fans between regions", shares, BLOCK),
        }
    }

    /// Takes in what was counted in a region.
    pub(crate) fn enter(&mut self, mut part: TopologyCounts) -> Result<(), ExtmemError> {
        for edge in part.edges.drain(..) {
            self.edges.push((edge.ends[0] >> SHARE_LOG) as usize, edge)?;
        }
        for fan in part.fans.drain(..) {
            self.fans.push((fan.vertex >> SHARE_LOG) as usize, fan)?;
        }
        self.ledger.enter(part);
        Ok(())
    }

    /// The counts of everything that was entered.
    pub(crate) fn close(mut self) -> Result<TopologyCounts, ExtmemError> {
        for share in 0..self.edges.count() {
            self.edges.read(share, &mut self.ledger.edges)?;
            self.fans.read(share, &mut self.ledger.fans)?;
            self.ledger.settle(|_| true);
        }
        let all = self.ledger.non_manifold.len() as u32;
        Ok(self.ledger.close(all))
    }
}
