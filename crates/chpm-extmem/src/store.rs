//! Memory budget and work directory of a spilling container.

use crate::{ExtmemError, MemoryBudget, WorkDir};
use std::path::Path;
use std::sync::Arc;

/// A memory budget and the work directory used where it refuses. Cheap to clone; all clones share both.
#[derive(Clone, Debug)]
pub struct Store {
    /// Asked before memory is taken.
    pub budget: Arc<MemoryBudget>,
    /// Where the rest goes.
    pub workdir: Arc<WorkDir>,
}

impl Store {
    /// A store with a new budget of `limit_bytes` and a fresh work directory in `parent`.
    ///
    /// # Errors
    /// As [`WorkDir::create`].
    pub fn create(parent: &Path, limit_bytes: u64) -> Result<Self, ExtmemError> {
        Self::with_budget(parent, MemoryBudget::new(limit_bytes))
    }

    /// A store with the given budget and a fresh work directory in `parent`.
    ///
    /// # Errors
    /// As [`WorkDir::create`].
    pub fn with_budget(parent: &Path, budget: Arc<MemoryBudget>) -> Result<Self, ExtmemError> {
        Ok(Store { budget, workdir: Arc::new(WorkDir::create(parent)?) })
    }
}
