//! Collapses that change the topology, for vertices that nothing legal can be done with.
//!
//! A half-edge collapse maps the mesh's edges and faces, so that edges with an even number of faces keep an even number: however
//! the topology changes, no boundary appears. What remains to be guarded is the mesh boundary itself, where the number is odd,
//! and what other clusters know.

use crate::adjacency::{Adjacency, MANY};
use crate::one_ring::{MAX_SPINE, MAX_VALENCE, OneRing};
use crate::patch::Given;

/// Vertices about one, each with the number of faces that lead there. The scratch of [`Self::nearest`].
#[derive(Debug, Default)]
pub(crate) struct Neighbors(Vec<(u16, u32)>);

impl Neighbors {
    /// Where the vertex of a one-ring may be forced to: the nearest, along an edge of three or more faces if it has one.
    pub(crate) fn nearest(&mut self, given: &Given<'_>, mesh: &Adjacency, one_ring: &OneRing) -> Option<u16> {
        self.gather(one_ring);
        let on_boundary = self.0.iter().any(|(_, faces)| faces % 2 == 1);
        let mut best: Option<(bool, f64, u16)> = None;
        for &(v, faces) in &self.0 {
            // A boundary vertex stays on the boundary.
            if on_boundary && faces % 2 == 0 || !may_force(given, mesh, one_ring, v, faces) {
                continue;
            }
            let off_spine = faces < 3;
            let rank = (off_spine, given.offset(one_ring.vertex(), v).norm_squared(), v);
            if best.is_none_or(|nearest| rank < nearest) {
                best = Some(rank);
            }
        }
        best.map(|(.., v)| v)
    }

    fn gather(&mut self, one_ring: &OneRing) {
        let all = &mut self.0;
        all.clear();
        all.extend(one_ring.wings.iter().flat_map(|wing| [(wing.a, 1), (wing.b, 1)]));
        all.sort_unstable();
        all.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            kept.1 += if same { next.1 } else { 0 };
            same
        });
    }
}

/// Where a vertex may be forced to whose only face has no corner in common with another: to the nearer of the two, unless one of them has to
/// stay.
pub(crate) fn alone(given: &Given<'_>, mesh: &Adjacency, u: u16) -> Option<u16> {
    let [wing] = mesh.wings(u) else { return None };
    let is_free = |w: u16| mesh.count(w) == 1 && !given.is_locked(w);
    let rank = |w: u16| (given.offset(u, w).norm_squared(), w);
    let nearer = if rank(wing.a) < rank(wing.b) { wing.a } else { wing.b };
    (given.sides.is_empty() && is_free(wing.a) && is_free(wing.b)).then_some(nearer)
}

/// Whether the one-ring's vertex may go to v, to which `faces` faces lead.
fn may_force(given: &Given<'_>, mesh: &Adjacency, one_ring: &OneRing, v: u16, faces: u32) -> bool {
    if !given.is_known_with(one_ring.vertex(), v) {
        return false;
    }
    // Where more than two faces meet along an edge, its ends may have more in the same measure.
    let most = ((MAX_VALENCE + 4) * faces as usize / 2).clamp(MAX_VALENCE + 4, MAX_SPINE);
    let dying = if faces > 2 { 2 * faces as usize } else { 0 };
    if mesh.count(v) + one_ring.wings.len() > (most + dying).min(MANY) {
        return false;
    }
    // Another cluster may have, or make, an edge or a face between locked vertices.
    let beside_edge = |w: u16| one_ring.wings.iter().any(|wing| wing.has(v) && wing.has(w));
    let mut surviving = one_ring.wings.iter().filter(|wing| !wing.has(v));
    !given.is_locked(v)
        || !surviving.any(|wing| {
            (given.is_locked(wing.a) && given.is_locked(wing.b))
                || [wing.a, wing.b].into_iter().any(|w| given.is_locked(w) && !beside_edge(w))
        })
}
