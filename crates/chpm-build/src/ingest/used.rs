//! Which vertices faces use: a bit for each.

use super::local::each;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use chpm_extmem::{Column, Reservation, Store};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// A set of vertices, as large as there are vertices: what a face names takes no memory.
pub(super) struct Used {
    words: Vec<AtomicU64>,
    /// Whether a face named a vertex that had not come yet, and was left out.
    is_partial: AtomicBool,
    share: Reservation,
}

impl Used {
    pub(super) fn new(store: &Store) -> Result<Self, BuildError> {
        let share = store.budget.reserve_work("which vertices are used", 0)?;
        Ok(Used { words: Vec::new(), is_partial: AtomicBool::new(false), share })
    }

    /// None of so many vertices.
    pub(super) fn none(vertices: usize, store: &Store) -> Result<Self, BuildError> {
        let mut used = Used::new(store)?;
        used.hold(vertices.div_ceil(64))?;
        Ok(used)
    }

    fn hold(&mut self, len: usize) -> Result<(), BuildError> {
        self.share.resize(8 * len as u64)?;
        self.words.reserve_exact(len - self.words.len());
        self.words.resize_with(len, AtomicU64::default);
        Ok(())
    }

    /// Makes room for the vertices up to now.
    pub(super) fn expect(&mut self, vertices: usize) -> Result<(), BuildError> {
        let needed = vertices.div_ceil(64);
        if needed > self.words.len() {
            // Where vertices and faces take turns, not every batch is to move the set.
            self.hold(needed.max(self.words.len() + self.words.len() / 4))?;
        }
        Ok(())
    }

    /// Takes triangles, whose vertices count from `base` on, from any thread.
    pub(super) fn mark<I: Id>(&self, triangles: &[[I; 3]], base: usize) {
        let corners = triangles.as_flattened().iter();
        if corners.fold(false, |partial, v| partial | !self.insert(base + v.index())) {
            self.is_partial.store(true, Relaxed);
        }
    }

    /// Takes triangles of the vertices up to now.
    pub(super) fn add<I: Id>(&mut self, triangles: &[[I; 3]], vertices: usize) -> Result<(), BuildError> {
        if !triangles.is_empty() {
            self.expect(vertices)?;
            self.mark(triangles, 0);
        }
        Ok(())
    }

    /// Takes a vertex; false if it had not come yet.
    pub(super) fn insert(&self, vertex: usize) -> bool {
        let bit = 1 << (vertex % 64);
        let Some(word) = self.words.get(vertex / 64) else { return false };
        // Five of six are known already, and looking is cheaper.
        if word.load(Relaxed) & bit == 0 {
            word.fetch_or(bit, Relaxed);
        }
        true
    }

    /// Looks again at all triangles if some came before their vertices, now that all have come.
    pub(super) fn complete<I: Id>(
        &mut self,
        triangles: &Column<[I; 3]>,
        vertices: usize,
        context: &Context<'_>,
    ) -> Result<(), BuildError> {
        if std::mem::take(self.is_partial.get_mut()) {
            each(triangles, context, |_, triangles| self.add(triangles, vertices))?;
        }
        Ok(())
    }

    pub(super) fn contains(&self, vertex: usize) -> bool {
        self.words.get(vertex / 64).is_some_and(|word| word.load(Relaxed) >> (vertex % 64) & 1 == 1)
    }

    /// How many there are.
    pub(super) fn count(&self) -> u64 {
        self.words.iter().map(|word| u64::from(word.load(Relaxed).count_ones())).sum()
    }
}
