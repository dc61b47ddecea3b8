//! Other systems of the kind do not tell that a signal waits: it comes when the work has ended.

use crate::error::Failure;
use nix::sys::signal::{SigSet, SigmaskHow, Signal};
use pyo3::prelude::*;

/// The signal, kept away.
pub(crate) struct Terminations {
    before: SigSet,
}

impl Terminations {
    /// From now on.
    pub(crate) fn withhold() -> Result<Self, Failure> {
        let mut mask = SigSet::empty();
        mask.add(Signal::SIGTERM);
        let before = mask.thread_swap_mask(SigmaskHow::SIG_BLOCK);
        let before = before.map_err(|error| Failure::Asked(format!("cannot look after signals: {error}")))?;
        Ok(Terminations { before })
    }

    /// Whether one is known to have come.
    pub(crate) fn is_any(&self) -> bool {
        false
    }

    /// Lets the signal do what it would have done.
    pub(crate) fn deliver(self) -> PyResult<()> {
        drop(self);
        // Where Python has a handler, it runs now.
        Python::attach(|py| py.check_signals())
    }
}

impl Drop for Terminations {
    fn drop(&mut self) {
        let _ = self.before.thread_set_mask();
    }
}
