//! Ctrl-C, SIGTERM, and SIGHUP when a terminal is closed: work that has something to clean up is asked to stop, anything else ends at once.
//!
//! The signals are blocked in every thread, and one thread waits for them. METIS installs a SIGTERM handler of its own
//! while it runs, which jumps out of the library's middle; a blocked signal never reaches it.

use anyhow::{Context, Result, ensure};
use chpm_build::Cancel;
use nix::sys::signal::{SigSet, Signal};
use std::fs;
use std::io::{self, Write};
use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::thread;

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
    /// Blocks the signals and starts to listen. Must come before any other thread is started: threads inherit the mask.
    pub(crate) fn listen() -> Result<Self> {
        let mut signals = SigSet::empty();
        signals.add(Signal::SIGINT);
        signals.add(Signal::SIGTERM);
        // A blocked signal would come although `nohup` has it ignored.
        if !is_ignored(Signal::SIGHUP) {
            signals.add(Signal::SIGHUP);
        }
        // With SIGXFSZ blocked, too, a file beyond `ulimit -f` is an error like a full disk; nobody waits for that signal.
        let mut blocked = signals;
        blocked.add(Signal::SIGXFSZ);
        blocked.thread_block().context("cannot block signals")?;
        let stop = Stop { cancel: Cancel::default(), shared: Arc::default() };
        let (cancel, shared) = (stop.cancel.clone(), Arc::clone(&stop.shared));
        thread::Builder::new()
            .name("signals".to_owned())
            .spawn(move || {
                while let Ok(signal) = signals.wait() {
                    receive(signal, &cancel, &shared);
                }
            })
            .context("cannot start the thread that waits for signals")?;
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

fn receive(signal: Signal, cancel: &Cancel, shared: &Shared) {
    if !shared.heeded.load(Ordering::SeqCst) || cancel.is_cancelled() {
        process::exit(exit_code(signal as i32));
    }
    shared.signal.store(signal as i32, Ordering::SeqCst);
    cancel.cancel();
    let _ = writeln!(
        io::stderr(),
        "stopping; what a next run cannot go on from is removed. A second signal ends at once and may leave temporary files"
    );
}

/// Whether whoever started the process has it ignore a signal; so it is taken where the system does not tell.
fn is_ignored(signal: Signal) -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_none_or(|mask| mask >> (signal as i32 - 1) & 1 == 1)
}

fn exit_code(signal: i32) -> i32 {
    128 + signal
}
