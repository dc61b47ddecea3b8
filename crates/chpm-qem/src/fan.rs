//! The fan of faces about one vertex, and whether they form one.

use crate::adjacency::Adjacency;

/// Faces about a vertex beyond which it takes no part in collapses: their cost grows with the square of the valence.
pub(crate) const MAX_VALENCE: usize = 48;
/// The same for a vertex of several fans, which the pages of a book have in common: it goes along the spine, by force.
pub(crate) const MAX_SPINE: usize = 256;

/// How the faces about a vertex lie together.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum FanKind {
    /// One closed ring: an interior vertex.
    Closed,
    /// One open fan, with its first and last ring vertex: a vertex on the mesh boundary.
    Open(u16, u16),
    /// Anything else, no face at all included.
    Broken,
}

/// Scratch that gathers fans; stamps make clearing free.
#[derive(Debug, Default)]
pub(crate) struct Fan {
    /// Per face of the vertex: the two corners that follow it.
    pub(crate) wings: Vec<(u16, u16)>,
    /// The wings' faces.
    pub(crate) faces: Vec<u32>,
    /// Per vertex: the tick in which it was seen first in a wing, and that wing.
    leaving: Vec<(u32, u16)>,
    /// Per vertex: the tick in which it was seen second in a wing.
    arriving: Vec<u32>,
    tick: u32,
}

impl Fan {
    pub(crate) fn reset(&mut self, vertex_count: usize) {
        if self.leaving.len() < vertex_count || self.tick > u32::MAX / 2 {
            self.leaving.clear();
            self.leaving.resize(vertex_count.max(self.leaving.len()), (0, 0));
            self.arriving.clear();
            self.arriving.resize(self.leaving.len(), 0);
            self.tick = 0;
        }
    }

    /// Gathers the wings of `vertex`, without looking at how they hang together.
    #[inline]
    pub(crate) fn gather(&mut self, adjacency: &mut Adjacency, vertex: u16) {
        self.wings.clear();
        self.faces.clear();
        let (slice, faces) = adjacency.living(vertex);
        self.faces.extend_from_slice(slice);
        self.wings.extend(slice.iter().map(|&id| faces[id as usize].others(vertex)));
    }

    /// Classifies the gathered wings. Afterwards [`Self::has`] answers for the ring's vertices.
    pub(crate) fn classify(&mut self) -> FanKind {
        self.tick += 1;
        let tick = self.tick;
        let mut manifold = !self.wings.is_empty();
        for (wing, &(a, b)) in self.wings.iter().enumerate() {
            manifold &= self.leaving[usize::from(a)].0 != tick && self.arriving[usize::from(b)] != tick;
            self.leaving[usize::from(a)] = (tick, wing as u16);
            self.arriving[usize::from(b)] = tick;
        }
        if !manifold {
            return FanKind::Broken;
        }
        let count = self.wings.len();
        // An open fan starts at the one vertex that nothing arrives at; a closed one may be entered anywhere.
        let mut starts =
            self.wings.iter().filter(|(a, _)| self.arriving[usize::from(*a)] != tick).map(|(a, _)| *a);
        let open = starts.next();
        if starts.next().is_some() {
            return FanKind::Broken;
        }
        let first = open.unwrap_or(self.wings[0].0);
        let mut vertex = first;
        for step in 1..=count {
            vertex = self.wings[usize::from(self.leaving[usize::from(vertex)].1)].1;
            let ended = self.leaving[usize::from(vertex)].0 != tick || vertex == first;
            if ended != (step == count) {
                return FanKind::Broken;
            }
        }
        match open {
            Some(start) => FanKind::Open(start, vertex),
            None => FanKind::Closed,
        }
    }

    /// The face that `vertex` leads in the fan that was classified last, and the vertex that follows.
    #[inline]
    pub(crate) fn after(&self, vertex: u16) -> Option<(u32, u16)> {
        let (tick, wing) = self.leaving[usize::from(vertex)];
        (tick == self.tick).then(|| (self.faces[usize::from(wing)], self.wings[usize::from(wing)].1))
    }

    /// Whether `vertex` is in the ring that was classified last.
    #[inline]
    pub(crate) fn has(&self, vertex: u16) -> bool {
        self.leaving[usize::from(vertex)].0 == self.tick || self.arriving[usize::from(vertex)] == self.tick
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(triangles: &[[u16; 3]], vertex: u16) -> FanKind {
        let mut adjacency = Adjacency::default();
        adjacency.build(10, triangles);
        let mut fan = Fan::default();
        fan.reset(10);
        fan.gather(&mut adjacency, vertex);
        fan.classify()
    }

    #[test]
    fn fans_are_told_apart() {
        assert_eq!(kind(&[[0, 1, 2], [0, 2, 3], [0, 3, 1]], 0), FanKind::Closed);
        assert_eq!(kind(&[[0, 2, 3], [0, 1, 2]], 0), FanKind::Open(1, 3));
        assert_eq!(kind(&[[0, 1, 2]], 0), FanKind::Open(1, 2));
    }

    #[test]
    fn whatever_is_no_single_fan_is_broken() {
        assert_eq!(kind(&[], 0), FanKind::Broken);
        assert_eq!(kind(&[[0, 1, 2], [0, 3, 4]], 0), FanKind::Broken, "bow-tie");
        assert_eq!(kind(&[[0, 1, 2], [0, 3, 1], [0, 1, 4]], 0), FanKind::Broken, "three faces on an edge");
        assert_eq!(kind(&[[0, 1, 2], [0, 3, 2]], 0), FanKind::Broken, "mixed winding");
        let two_rings = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [0, 4, 5], [0, 5, 6], [0, 6, 4]];
        assert_eq!(kind(&two_rings, 0), FanKind::Broken, "two cones on one apex");
        let ring_and_fan = [[0, 1, 2], [0, 4, 5], [0, 5, 6], [0, 6, 4]];
        assert_eq!(kind(&ring_and_fan, 0), FanKind::Broken, "a cone and a face on one apex");
    }
}
