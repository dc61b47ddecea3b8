//! Signals of Unix: blocked in every thread, and one thread waits for them. METIS installs a SIGTERM handler of its own
//! while it runs, which jumps out of the library's middle; a blocked signal never reaches it.

use anyhow::{Context, Result};
use nix::sys::signal::{SigSet, Signal};
use std::fs;
use std::thread;

/// Blocks the signals and hands each that comes to `receive`. Must come before any other thread is started: threads inherit the mask.
pub(super) fn listen(receive: impl Fn(i32) + Send + 'static) -> Result<()> {
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

    let wait = move || {
        while let Ok(signal) = signals.wait() {
            receive(signal as i32);
        }
    };
    let started = thread::Builder::new().name("signals".to_owned()).spawn(wait);
    started.map(drop).context("cannot start the thread that waits for signals")
}

/// Whether whoever started the process has it ignore a signal; so it is taken where the system does not tell.
fn is_ignored(signal: Signal) -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_none_or(|mask| mask >> (signal as i32 - 1) & 1 == 1)
}
