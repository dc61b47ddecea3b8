//! Collapses that change the topology, for vertices that nothing legal can be done with.
//!
//! A half-edge collapse maps the mesh's edges and faces, so that edges with an even number of faces keep an even number: however
//! the topology changes, no boundary appears. What remains to be guarded is the mesh boundary itself, where the number is odd,
//! and what other clusters know.

use crate::decimate::{Decimator, Patch, Topology};
use crate::fan::MAX_VALENCE;

impl Decimator {
    /// The cheapest forced collapse of the vertex whose fan was gathered last: its target, and as cost the squared displacement times
    /// the area, the vertex's own or the mean if that is larger: a speck of dust must not go far before its time, since the
    /// error of all later collapses starts from there.
    pub(crate) fn cheapest_forced(&mut self, patch: &Patch<'_>, u: u16) -> Option<(f32, u16)> {
        if self.topology == Topology::Keep {
            return None;
        }
        self.gather_ring();
        let area = self.quadrics[usize::from(u)].area.max(self.mean_area);
        let on_boundary = self.ring.iter().any(|(_, faces)| faces % 2 == 1);
        let mut best: Option<(f32, u16)> = None;
        for i in 0..self.ring.len() {
            let (v, faces) = self.ring[i];
            // A boundary vertex stays on the boundary.
            if on_boundary && faces % 2 == 0 || !self.may_force(patch, u, v) {
                continue;
            }
            let cost = (area * self.offset(patch, u, v).norm_squared() * self.cost_scale) as f32;
            if best.is_none_or(|(least, w)| cost < least || (cost == least && v < w)) {
                best = Some((cost, v));
            }
        }
        best
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

    fn may_force(&mut self, patch: &Patch<'_>, u: u16, v: u16) -> bool {
        if !self.sides.is_empty() && self.sides[usize::from(u)] & !self.sides[usize::from(v)] != 0 {
            return false;
        }
        if self.adjacency.count(v) > 4 * MAX_VALENCE
            || self.adjacency.living(v).0.len() + self.fan.wings.len() > MAX_VALENCE + 4
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
