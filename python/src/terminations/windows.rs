//! Windows ends processes without a signal.

use crate::error::Failure;
use pyo3::prelude::*;

/// Nothing to keep away.
pub(crate) struct Terminations;

impl Terminations {
    /// From now on.
    pub(crate) fn withhold() -> Result<Self, Failure> {
        Ok(Terminations)
    }

    /// Whether one came.
    pub(crate) fn is_any(&self) -> bool {
        false
    }

    /// Lets the signal do what it would have done.
    pub(crate) fn deliver(self) -> PyResult<()> {
        Ok(())
    }
}
