//! The vertices next to each: where a vertex collapses to is nearly always one of them.

use super::connect::NONE;

/// By any number that 16 bits hold, so that none is out of range.
pub(super) type ByVertex<T> = Box<[T; 1 << 16]>;

pub(super) fn by_vertex<T: Copy + Default>() -> ByVertex<T> {
    let all: Box<[T]> = vec![T::default(); 1 << 16].into();
    all.try_into().unwrap_or_else(|_| unreachable!("it has that length"))
}

/// How many are known of each.
pub(super) const NEIGHBORS: usize = 8;

/// Some corners behind each vertex in its triangles.
pub(super) struct Around {
    /// A later one takes the place of one that came so many before.
    corners: ByVertex<[u16; NEIGHBORS]>,
    counts: ByVertex<u8>,
}

impl Around {
    pub(super) fn new() -> Self {
        Around { corners: by_vertex(), counts: by_vertex() }
    }

    pub(super) fn clear(&mut self, vertex_count: usize) {
        self.corners[..vertex_count].fill([NONE; NEIGHBORS]);
        self.counts[..vertex_count].fill(0);
    }

    #[inline(always)]
    pub(super) fn add(&mut self, [a, b, c]: [u16; 3]) {
        for (vertex, next) in [(a, b), (b, c), (c, a)] {
            let vertex = usize::from(vertex);
            let count = self.counts[vertex];
            self.corners[vertex][usize::from(count) % NEIGHBORS] = next;
            self.counts[vertex] = count.wrapping_add(1);
        }
    }

    pub(super) fn of(&self, vertex: usize) -> &[u16; NEIGHBORS] {
        &self.corners[vertex]
    }
}
