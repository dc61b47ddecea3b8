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

/// When a vertex was last seen in a wing.
#[derive(Clone, Copy, Default, Debug)]
struct Mark {
    /// The tick in which it was seen first, and that wing.
    leaving: u32,
    wing: u16,
    /// The tick in which it was seen second.
    arriving: u32,
}

/// The faces about one vertex, and the loop of edges about them if they form a single fan. Marks make clearing free.
#[derive(Debug, Default)]
pub(crate) struct OneRing {
    vertex: u16,
    kind: OneRingKind,
    pub(crate) wings: Vec<Wing>,
    /// The loop of a single fan, if it is not too long, else empty.
    pub(crate) ring: Ring,
    /// Per vertex of the patch.
    marks: Vec<Mark>,
    tick: u32,
}

impl OneRing {
    pub(crate) fn reset(&mut self, vertex_count: usize) {
        if self.marks.len() < vertex_count || self.tick > u32::MAX / 2 {
            self.marks.clear();
            self.marks.resize(vertex_count.max(self.marks.len()), Mark::default());
            self.tick = 0;
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
        let (tick, marks) = (self.tick, &mut self.marks[..]);
        let mut manifold = !wings.is_empty();
        for (index, wing) in wings.iter().enumerate() {
            let mark = &mut marks[usize::from(wing.a)];
            manifold &= mark.leaving != tick;
            (mark.leaving, mark.wing) = (tick, index as u16);
            let mark = &mut marks[usize::from(wing.b)];
            manifold &= mark.arriving != tick;
            mark.arriving = tick;
        }
        if !manifold {
            return OneRingKind::Broken;
        }
        // An open fan starts at the one vertex that nothing arrives at; a closed one may be entered anywhere.
        let mut starts = wings.iter().map(|wing| wing.a).filter(|a| marks[usize::from(*a)].arriving != tick);
        let open = starts.next();
        if starts.next().is_some() {
            return OneRingKind::Broken;
        }
        let first = open.unwrap_or(wings[0].a);
        let fits = wings.len() + usize::from(open.is_some()) <= MAX_LOOP;
        let mut vertex = first;
        for step in 1..=wings.len() {
            let wing = wings[usize::from(marks[usize::from(vertex)].wing)];
            if fits {
                self.ring.push(vertex, wing.face);
            }
            vertex = wing.b;
            let ended = marks[usize::from(vertex)].leaving != tick || vertex == first;
            if ended != (step == wings.len()) {
                self.ring.clear();
                return OneRingKind::Broken;
            }
        }
        let Some(start) = open else { return OneRingKind::Closed };
        if fits {
            self.ring.push(vertex, NO_FACE);
        }
        OneRingKind::Open(start, vertex)
    }

    /// Looks up where the loop is.
    pub(crate) fn place(&mut self, given: &Given<'_>) {
        let place = |vertex: u16| given.patch.positions[usize::from(vertex)].map(f64::from);
        self.ring.place(place(self.vertex), place);
    }

    /// Whether `vertex` is in the ring that was classified last.
    #[inline]
    pub(crate) fn has(&self, vertex: u16) -> bool {
        let mark = self.marks[usize::from(vertex)];
        (mark.leaving == self.tick) | (mark.arriving == self.tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(triangles: &[[u16; 3]], vertex: u16) -> OneRingKind {
        let mut adjacency = Adjacency::default();
        adjacency.build(10, triangles);
        let mut one_ring = OneRing::default();
        one_ring.reset(10);
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
