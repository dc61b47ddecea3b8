//! Ctrl-C, SIGTERM, and SIGHUP when a terminal is closed: work that has something to clean up is asked to stop, anything else ends at once.

#[cfg(unix)]
#[path = "unix.rs"]
mod system;
#[cfg(windows)]
#[path = "windows.rs"]
mod system;

use anyhow::{Result, ensure};
use chpm_build::Cancel;
use std::io::{self, Write};
use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};

/// The command's ear for signals.
pub(crate) struct Stop {
    cancel: Cancel,
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    /// Whether somebody looks at the request, so that the process need not be ended from outside.
    heeded: AtomicBool,
    /// The first signal that came, or 0.
    signal: AtomicI32,
}

impl Stop {
    /// Starts to listen. Must come before any other thread is started.
    pub(crate) fn listen() -> Result<Self> {
        let stop = Stop { cancel: Cancel::default(), shared: Arc::default() };
        let (cancel, shared) = (stop.cancel.clone(), Arc::clone(&stop.shared));
        system::listen(move |signal| receive(signal, &cancel, &shared))?;
        Ok(stop)
    }

    /// The request to stop, for work that looks at it: from now on the first signal asks and only the second ends the process.
    pub(crate) fn heed(&self) -> Cancel {
        self.shared.heeded.store(true, Ordering::SeqCst);
        self.cancel.clone()
    }

    /// The exit code that a shell expects after the signal that came, if one did.
    pub(crate) fn exit_code(&self) -> Option<u8> {
        match self.shared.signal.load(Ordering::SeqCst) {
            0 => None,
            signal => Some(exit_code(signal) as u8),
        }
    }
}

/// Message about work that was stopped.
pub(crate) const TOLD: &str = "stopped on request; nothing was written";

/// An error if a stop was asked for.
pub(crate) fn check(cancel: &Cancel) -> Result<()> {
    ensure!(!cancel.is_cancelled(), TOLD);
    Ok(())
}

/// A signal of this number came.
fn receive(signal: i32, cancel: &Cancel, shared: &Shared) {
    if !shared.heeded.load(Ordering::SeqCst) || cancel.is_cancelled() {
        process::exit(exit_code(signal));
    }
    shared.signal.store(signal, Ordering::SeqCst);
    cancel.cancel();
    let _ = writeln!(
        io::stderr(),
        "stopping; what a next run cannot go on from is removed. A second signal ends at once and may leave temporary files"
    );
}

fn exit_code(signal: i32) -> i32 {
    128 + signal
}
