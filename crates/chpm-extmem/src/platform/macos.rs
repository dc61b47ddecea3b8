//! macOS, and what else is like Unix and not Linux.

use super::absolute;
pub use super::unix::*;

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Whether keyboards have a Command key, which is the one for shortcuts.
pub const HAS_COMMAND_KEY: bool = cfg!(target_os = "macos");

/// Two folders get each other's names, one after the other.
///
/// # Errors
/// Those of the system; both have their names then.
pub fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    super::exchange_in_steps(one, other)
}

/// Has all files on the disk: there is no call for those of one folder.
///
/// # Errors
/// None.
pub fn sync_below(_: &Path) -> io::Result<()> {
    nix::unistd::sync();
    Ok(())
}

/// Gives a file its length. The space is taken as it is written.
pub(crate) fn allocate(file: &File, bytes: u64) -> io::Result<()> {
    file.set_len(bytes)
}

/// Nothing: large blocks are mapped one by one as it is.
pub(crate) fn map_large_blocks(_: i32) {}

/// Nothing: the system's own allocator does so by itself.
pub(crate) fn trim_heap() {}

/// The most bytes of physical memory that the process ever held.
pub fn peak_resident() -> Option<u64> {
    use nix::sys::resource::{UsageWho, getrusage};
    let peak = u64::try_from(getrusage(UsageWho::RUSAGE_SELF).ok()?.max_rss()).ok()?;
    // Bytes on macOS, elsewhere kibibytes.
    Some(if cfg!(target_os = "macos") { peak } else { peak * 1024 })
}

/// Bytes of physical memory that the process holds now: not told.
pub fn resident() -> Option<u64> {
    None
}

/// The user's folder for what can be made again.
pub fn cache_folder() -> Option<PathBuf> {
    let below = if HAS_COMMAND_KEY { "Library/Caches" } else { ".cache" };
    absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(below)))
}

/// The user's folder for what programs remember.
pub fn state_folder() -> Option<PathBuf> {
    let below = if HAS_COMMAND_KEY { "Library/Application Support" } else { ".local/state" };
    absolute("XDG_STATE_HOME").or_else(|| absolute("HOME").map(|home| home.join(below)))
}

/// The name of this computer.
pub(crate) fn host_name() -> Option<String> {
    nix::unistd::gethostname().ok()?.into_string().ok()
}

/// Nothing: a mapped file that is truncated ends the process, by a signal whose codes differ from system to system.
#[derive(Debug)]
pub(crate) struct Guard;

impl Guard {
    pub(crate) fn of(_: &[u8]) -> Option<Guard> {
        None
    }

    pub(crate) fn is_cut(&self) -> bool {
        false
    }
}
