//! Ctrl-C, Ctrl-Break, and the end of a console, a session or the system, of Windows.

use anyhow::{Context, Result};

/// Number of the interrupt in the C library, which exit codes are made of.
const INTERRUPT: i32 = 2;

/// Hands each request to `receive`, as an interrupt: the system calls a handler in a thread of its own.
pub(super) fn listen(receive: impl Fn(i32) + Send + 'static) -> Result<()> {
    ctrlc::set_handler(move || receive(INTERRUPT)).context("cannot listen for Ctrl-C")
}
