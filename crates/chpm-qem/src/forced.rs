//! Collapses that change the topology, for vertices that nothing legal can be done with.
//!
//! A half-edge collapse maps the mesh's edges and faces, so that edges with an even number of faces keep an even number: however
//! the topology changes, no boundary appears. What remains to be guarded is the mesh boundary itself, where the number is odd,
//! and what other clusters know.

use crate::decimate::Decimator;
use crate::fan::{MAX_SPINE, MAX_VALENCE};
use crate::patch::{Patch, Topology};

impl Decimator {
    /// Where the vertex whose fan was gathered last may be forced to: the nearest, along an edge of three or more faces if it has one.
    pub(crate) fn nearest_forced(&mut self, patch: &Patch<'_>, u: u16) -> Option<u16> {
        if self.topology == Topology::Keep {
            return None;
        }
        self.gather_ring();
        let on_boundary = self.ring.iter().any(|(_, faces)| faces % 2 == 1);
        let mut best: Option<(bool, f64, u16)> = None;
        for i in 0..self.ring.len() {
            let (v, faces) = self.ring[i];
            // A boundary vertex stays on the boundary.
            if on_boundary && faces % 2 == 0 || !self.may_force(patch, u, v, faces) {
                continue;
            }
            let off_spine = faces < 3;
            let rank = (off_spine, self.offset(patch, u, v).norm_squared(), v);
            if best.is_none_or(|nearest| rank < nearest) {
                best = Some(rank);
            }
        }
        best.map(|(.., v)| v)
    }

    /// The ring's vertices, each with its number of faces.
    fn gather_ring(&mut self) {
        self.ring.clear();
        self.ring.extend(self.fan.wings.iter().flat_map(|&(a, b)| [(a, 1), (b, 1)]));
        self.ring.sort_unstable();
        self.ring.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            kept.1 += if same { next.1 } else { 0 };
            same
        });
    }

    /// Whether u may go to v, to which `faces` faces lead.
    fn may_force(&mut self, patch: &Patch<'_>, u: u16, v: u16, faces: u32) -> bool {
        if !self.sides.is_empty() && self.sides[usize::from(u)] & !self.sides[usize::from(v)] != 0 {
            return false;
        }
        // Each page of a book has two or three faces at a vertex of its spine.
        let most = (MAX_VALENCE + 4).max((5 * faces as usize).min(MAX_SPINE));
        let dying = if most > MAX_VALENCE + 4 { faces as usize } else { 0 };
        if self.adjacency.count(v) > 2 * MAX_SPINE
            || self.adjacency.living(v).0.len() + self.fan.wings.len() > most + 2 * dying
        {
            return false;
        }
        // Another cluster may have, or make, an edge or a face between locked vertices.
        let locked = |w: u16| patch.locked[usize::from(w)];
        let beside_edge =
            |w: u16| self.fan.wings.iter().any(|&(a, b)| (a == v && b == w) || (a == w && b == v));
        let mut surviving = self.fan.wings.iter().filter(|(a, b)| *a != v && *b != v);
        !locked(v)
            || !surviving.any(|&(a, b)| {
                (locked(a) && locked(b)) || [a, b].into_iter().any(|w| locked(w) && !beside_edge(w))
            })
    }
}
