//! Linux.

use super::absolute;
pub use super::unix::*;

pub(crate) use super::truncation::Guard;
use rustix::fs::{CWD, RenameFlags, renameat_with};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Whether keyboards have a Command key, which is the one for shortcuts.
pub const HAS_COMMAND_KEY: bool = false;

/// Two folders get each other's names, at once where the file system can do that.
///
/// # Errors
/// Those of the system; both have their names then.
pub fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    if renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE).is_ok() {
        return Ok(());
    }
    super::exchange_in_steps(one, other)
}

/// Has all files below a folder on the disk, by one call for all of them.
///
/// # Errors
/// Those of the system.
pub fn sync_below(folder: &Path) -> io::Result<()> {
    Ok(nix::unistd::syncfs(File::open(folder)?)?)
}

/// Gives a file its length, and takes the space on the disk.
pub(crate) fn allocate(file: &File, bytes: u64) -> io::Result<()> {
    if bytes == 0 {
        return Ok(());
    }
    let bytes = i64::try_from(bytes).map_err(|_| io::ErrorKind::FileTooLarge)?;
    Ok(nix::fcntl::posix_fallocate(file, 0, bytes)?)
}

/// Has the C library map heap blocks of `bytes` and more, one by one; freeing such a block unmaps it.
pub(crate) fn map_large_blocks(bytes: i32) {
    #[cfg(target_env = "gnu")]
    // SAFETY: sets a number that allocations look at from now on; the library's own lock guards it, and it may be set at
    // any time.
    let _ = unsafe { nix::libc::mallopt(nix::libc::M_MMAP_THRESHOLD, bytes) };
    // Others do so by themselves.
    #[cfg(not(target_env = "gnu"))]
    let _ = bytes;
}

/// Gives pages of the heap back that no block is on, of every thread's part of it.
pub(crate) fn trim_heap() {
    #[cfg(target_env = "gnu")]
    // SAFETY: gives back what the library holds free; its own locks guard that, and blocks in use stay where they are.
    let _ = unsafe { nix::libc::malloc_trim(0) };
}

/// The most bytes of physical memory that the process ever held.
pub fn peak_resident() -> Option<u64> {
    field(&fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// Bytes of physical memory that the process holds now.
pub fn resident() -> Option<u64> {
    field(&fs::read_to_string("/proc/self/status").ok()?, "VmRSS:")
}

/// The value of a line `Name:   123 kB`, in bytes.
fn field(text: &str, name: &str) -> Option<u64> {
    let value = text.lines().find_map(|line| line.strip_prefix(name))?;
    value.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// The user's folder for what can be made again.
pub fn cache_folder() -> Option<PathBuf> {
    absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")))
}

/// The user's folder for what programs remember.
pub fn state_folder() -> Option<PathBuf> {
    absolute("XDG_STATE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".local/state")))
}

/// The name of this computer.
pub(crate) fn host_name() -> Option<String> {
    fs::read_to_string("/proc/sys/kernel/hostname").ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_read_in_kibibytes() {
        let text = "Name:\tx\nVmHWM:\t    1200 kB\nVmRSS:\tmany kB\nThreads:\t3\n";
        assert_eq!(field(text, "VmHWM:"), Some(1200 << 10));
        assert_eq!(field(text, "VmRSS:"), None);
        assert_eq!(field(text, "VmSwap:"), None);
        assert_eq!(field(text, "Threads:"), None, "not a size");
    }
}
