//! SIGTERM while work goes on: kept from the thread that waits for the work and from those that it starts. METIS takes the signal over while it
//! runs, and jumps out of the middle of itself in whatever thread has it.
//!
//! A file for each kind of system, all with the same functions.

#[cfg(target_os = "linux")]
#[path = "linux.rs"]
mod system;
#[cfg(all(unix, not(target_os = "linux")))]
#[path = "unix.rs"]
mod system;
#[cfg(windows)]
#[path = "windows.rs"]
mod system;

pub(crate) use system::Terminations;
