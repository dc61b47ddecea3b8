//! Patches that are kept for the next question, up to a number of bytes.

use crate::model::Reads;
use crate::patch::Patch;
use chpm_mesh::{Bytes, ClusterId};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Patches that are kept, or on their way.
#[derive(Debug)]
pub(crate) struct Shelf {
    budget: u64,
    used: u64,
    clock: u64,
    kept: HashMap<ClusterId, Kept>,
    pub(crate) reads: Reads,
}

#[derive(Debug)]
struct Kept {
    slot: Arc<Slot>,
    bytes: u64,
    last: u64,
}

/// Empty until the first who asks has read the page; others wait for that.
pub(crate) type Slot = Mutex<Option<Arc<Patch>>>;

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What is behind it is never half changed.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shelf {
    pub(crate) fn new(budget: Bytes) -> Self {
        Shelf { budget: budget.0, used: 0, clock: 0, kept: HashMap::new(), reads: Reads::default() }
    }

    /// The place of a patch, which becomes the last one to go.
    pub(crate) fn slot(&mut self, cluster: ClusterId, bytes: u64) -> Arc<Slot> {
        self.clock += 1;
        if let Some(kept) = self.kept.get_mut(&cluster) {
            kept.last = self.clock;
            return Arc::clone(&kept.slot);
        }
        while self.used + bytes > self.budget && !self.kept.is_empty() {
            self.forget_oldest();
        }
        self.used += bytes;
        let slot = Arc::new(Slot::default());
        self.kept.insert(cluster, Kept { slot: Arc::clone(&slot), bytes, last: self.clock });
        slot
    }

    fn forget_oldest(&mut self) {
        let oldest = self.kept.iter().min_by_key(|(_, kept)| kept.last).map(|(cluster, _)| *cluster);
        if let Some(kept) = oldest.and_then(|cluster| self.kept.remove(&cluster)) {
            self.used -= kept.bytes;
        }
    }
}
