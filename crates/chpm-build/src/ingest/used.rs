//! Which vertices faces use: a bit for each.

use crate::error::BuildError;
use chpm_extmem::{Reservation, Store};

/// A set of vertices, as large as its greatest member takes.
pub(super) struct Used {
    words: Vec<u64>,
    count: u64,
    share: Reservation,
}

impl Used {
    pub(super) fn new(store: &Store) -> Result<Self, BuildError> {
        Ok(Used { words: Vec::new(), count: 0, share: store.budget.charge("which vertices are used", 0)? })
    }

    pub(super) fn add(&mut self, triangles: &[[u32; 3]]) -> Result<(), BuildError> {
        let corners = triangles.as_flattened();
        let Some(highest) = corners.iter().max() else { return Ok(()) };
        let needed = *highest as usize / 64 + 1;
        if needed > self.words.len() {
            // Vertices come in about the order of their numbers: not every batch is to move the set.
            let len = needed.max(self.words.len() + self.words.len() / 4);
            self.share.resize(8 * len as u64)?;
            self.words.reserve_exact(len - self.words.len());
            self.words.resize(len, 0);
        }
        for corner in corners {
            let (word, bit) = (&mut self.words[*corner as usize / 64], 1 << (corner % 64));
            self.count += u64::from(*word & bit == 0);
            *word |= bit;
        }
        Ok(())
    }

    pub(super) fn contains(&self, vertex: usize) -> bool {
        self.words.get(vertex / 64).is_some_and(|word| word >> (vertex % 64) & 1 == 1)
    }

    /// How many there are.
    pub(super) fn count(&self) -> u64 {
        self.count
    }
}
