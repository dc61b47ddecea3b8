//! The one-ring of a vertex: the faces about it, and whether they form one fan.

use crate::adjacency::{Adjacency, Wing};
use crate::patch::Given;
use crate::ring::{MAX_LOOP, NO_FACE, Ring};

/// Faces about a vertex beyond which it takes no part in collapses: their cost grows with the square of the valence.
pub(crate) const MAX_VALENCE: usize = 48;
/// The same for a vertex of several fans, which the pages of a book have in common: it goes along the spine, by force.
pub(crate) const MAX_SPINE: usize = 1024;

/// How the faces about a vertex lie together.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) enum OneRingKind {
    /// One closed ring: an interior vertex.
    Closed,
    /// One open fan, with its first and last ring vertex: a vertex on the mesh boundary.
    Open(u16, u16),
    /// Anything else, no face at all included.
    #[default]
    Broken,
}

/// Vertices that there can be; a table of this length takes any `u16` without a check.
const TABLE: usize = 1 << 16;

/// The faces about one vertex, and the loop of edges about them if they form a single fan. Marks make clearing free.
#[derive(Debug)]
pub(crate) struct OneRing {
    vertex: u16,
    kind: OneRingKind,
    pub(crate) wings: Vec<Wing>,
    /// The loop of a single fan, if it is not too long, else empty.
    pub(crate) ring: Ring,
    /// By vertex, the tick in which it was last seen in a one-ring, and the index of the wing that it led there.
    seen: Box<[u32; TABLE]>,
    led: Box<[u16; TABLE]>,
    /// The tick in which a vertex was last followed by a wing, where that was asked.
    arrived: Box<[u32; TABLE]>,
    tick: u32,
}

impl Default for OneRing {
    fn default() -> Self {
        OneRing {
            vertex: 0,
            kind: OneRingKind::Broken,
            wings: Vec::new(),
            ring: Ring::default(),
            seen: Box::new([0; TABLE]),
            led: Box::new([0; TABLE]),
            arrived: Box::new([0; TABLE]),
            tick: 0,
        }
    }
}

impl OneRing {
    /// Forgets the last patch, long before ticks run out.
    pub(crate) fn reset(&mut self) {
        if self.tick > u32::MAX / 2 {
            (self.seen, self.arrived, self.tick) = (Box::new([0; TABLE]), Box::new([0; TABLE]), 0);
        }
    }

    /// Looks at the faces of a vertex, and finds its loop. Afterwards [`Self::has`] answers for the ring's vertices.
    pub(crate) fn gather(&mut self, mesh: &Adjacency, vertex: u16) -> OneRingKind {
        let wings = mesh.wings(vertex);
        self.wings.clear();
        self.wings.extend_from_slice(wings);
        self.vertex = vertex;
        self.kind = self.classify(wings);
        self.kind
    }

    /// Whether the faces of a vertex may form an open fan: of one that is open, the sum does not close.
    pub(crate) fn may_be_open(wings: &[Wing]) -> bool {
        wings.iter().map(|wing| i32::from(wing.b) - i32::from(wing.a)).sum::<i32>() != 0
    }

    /// The vertex that was looked at last.
    pub(crate) fn vertex(&self) -> u16 {
        self.vertex
    }

    /// How its faces lie together.
    pub(crate) fn kind(&self) -> OneRingKind {
        self.kind
    }

    fn classify(&mut self, wings: &[Wing]) -> OneRingKind {
        self.ring.clear();
        self.tick += 1;
        let [first, ..] = wings else { return OneRingKind::Broken };
        let mut manifold = true;
        for (index, wing) in (0..).zip(wings) {
            let seen = &mut self.seen[usize::from(wing.a)];
            manifold &= *seen != self.tick;
            *seen = self.tick;
            self.led[usize::from(wing.a)] = index;
        }
        if !manifold {
            return OneRingKind::Broken;
        }

        // A walk from any wing comes back with the last one, unless there is an end.
        match self.walk(wings, first.a, wings.len() <= MAX_LOOP) {
            Some(end) if end == first.a => OneRingKind::Closed,
            _ => self.classify_open(wings),
        }
    }

    /// Fills the loop with a walk from a vertex, if it `fits`; answers where that ends, if it takes all wings.
    fn walk(&mut self, wings: &[Wing], first: u16, fits: bool) -> Option<u16> {
        let OneRing { ring, seen, led, tick, .. } = self;
        let mut vertex = first;
        for step in 1..=wings.len() {
            let wing = wings[usize::from(led[usize::from(vertex)])];
            if fits {
                ring.push(vertex, wing.face);
            }
            vertex = wing.b;
            let ended = (seen[usize::from(vertex)] != *tick) | (vertex == first);
            if ended != (step == wings.len()) {
                ring.clear();
                return None;
            }
        }
        Some(vertex)
    }

    /// The same for what is no closed fan, if no vertex leads two wings. An open fan starts at the one vertex that nothing arrives at.
    fn classify_open(&mut self, wings: &[Wing]) -> OneRingKind {
        self.ring.clear();
        let mut manifold = true;
        for wing in wings {
            let arrived = &mut self.arrived[usize::from(wing.b)];
            manifold &= *arrived != self.tick;
            *arrived = self.tick;
        }
        let mut starts =
            wings.iter().map(|wing| wing.a).filter(|a| self.arrived[usize::from(*a)] != self.tick);
        let (Some(first), None, true) = (starts.next(), starts.next(), manifold) else {
            return OneRingKind::Broken;
        };

        let fits = wings.len() < MAX_LOOP;
        let Some(last) = self.walk(wings, first, fits) else { return OneRingKind::Broken };
        if fits {
            self.ring.push(last, NO_FACE);
        }
        self.seen[usize::from(last)] = self.tick;
        OneRingKind::Open(first, last)
    }

    /// Turns the loop to begin at v, and looks up where it is; false if there is none from v on.
    pub(crate) fn turn_to(&mut self, given: &Given<'_>, v: u16) -> bool {
        let place = |vertex: u16| given.patch.positions[usize::from(vertex)].map(f64::from);
        self.ring.turn_to(v, place(self.vertex), place)
    }

    /// Whether `vertex` is in the ring that was classified last.
    #[inline]
    pub(crate) fn has(&self, vertex: u16) -> bool {
        self.seen[usize::from(vertex)] == self.tick
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(triangles: &[[u16; 3]], vertex: u16) -> OneRingKind {
        let mut adjacency = Adjacency::default();
        adjacency.build(10, triangles);
        let mut one_ring = OneRing::default();
        one_ring.gather(&adjacency, vertex)
    }

    #[test]
    fn fans_are_told_apart() {
        assert_eq!(kind(&[[0, 1, 2], [0, 2, 3], [0, 3, 1]], 0), OneRingKind::Closed);
        assert_eq!(kind(&[[0, 2, 3], [0, 1, 2]], 0), OneRingKind::Open(1, 3));
        assert_eq!(kind(&[[0, 1, 2]], 0), OneRingKind::Open(1, 2));
    }

    #[test]
    fn whatever_is_no_single_fan_is_broken() {
        assert_eq!(kind(&[], 0), OneRingKind::Broken);
        assert_eq!(kind(&[[0, 1, 2], [0, 3, 4]], 0), OneRingKind::Broken, "bow-tie");
        assert_eq!(
            kind(&[[0, 1, 2], [0, 3, 1], [0, 1, 4]], 0),
            OneRingKind::Broken,
            "three faces on an edge"
        );
        assert_eq!(kind(&[[0, 1, 2], [0, 3, 2]], 0), OneRingKind::Broken, "mixed winding");
        let two_rings = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [0, 4, 5], [0, 5, 6], [0, 6, 4]];
        assert_eq!(kind(&two_rings, 0), OneRingKind::Broken, "two cones on one apex");
        let ring_and_fan = [[0, 1, 2], [0, 4, 5], [0, 5, 6], [0, 6, 4]];
        assert_eq!(kind(&ring_and_fan, 0), OneRingKind::Broken, "a cone and a face on one apex");
    }
}
