//! A file descriptor tells that the signal came, and the work is asked to stop.

use crate::error::Failure;
use nix::sys::signal::{SigSet, SigmaskHow, Signal, raise};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

/// The signal, kept away.
pub(crate) struct Terminations {
    before: SigSet,
    signals: SignalFd,
    came: Mutex<bool>,
}

impl Terminations {
    /// From now on.
    pub(crate) fn withhold() -> Result<Self, Failure> {
        let mut mask = SigSet::empty();
        mask.add(Signal::SIGTERM);
        let failed = |error: nix::Error| Failure::Asked(format!("cannot look after signals: {error}"));
        let signals = SignalFd::with_flags(&mask, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC);
        let signals = signals.map_err(failed)?;
        let before = mask.thread_swap_mask(SigmaskHow::SIG_BLOCK).map_err(failed)?;
        Ok(Terminations { before, signals, came: Mutex::new(false) })
    }

    /// Whether one came.
    pub(crate) fn is_any(&self) -> bool {
        let mut came = self.came.lock().unwrap_or_else(PoisonError::into_inner);
        *came |= matches!(self.signals.read_signal(), Ok(Some(_)));
        *came
    }

    /// Lets the signal do what it would have done.
    pub(crate) fn deliver(self) -> PyResult<()> {
        let came = self.is_any();
        drop(self);
        if came {
            let _ = raise(Signal::SIGTERM);
            // Where Python has a handler, it runs now.
            Python::attach(|py| py.check_signals())?;
        }
        Ok(())
    }
}

impl Drop for Terminations {
    fn drop(&mut self) {
        let _ = self.before.thread_set_mask();
    }
}
