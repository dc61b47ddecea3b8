//! Differences between operating systems. None are anywhere else, but for how the command hears signals.
//!
//! A file each: `linux.rs` (with `truncation.rs`), `macos.rs` (and other systems of its kind), `windows.rs`; `unix.rs` is what the first two share. All of them have the same
//! functions, so that a system that lacks one does not compile. Where a system cannot do what a function says, its comment says what happens there.

#[cfg(target_os = "linux")]
#[path = "linux.rs"]
mod system;
#[cfg(all(unix, not(target_os = "linux")))]
#[path = "macos.rs"]
mod system;
#[cfg(windows)]
#[path = "windows.rs"]
mod system;
#[cfg(target_os = "linux")]
mod truncation;
#[cfg(unix)]
mod unix;

pub use system::{
    FileId, HAS_COMMAND_KEY, Pipe, STDIN, cache_folder, exchange, id_at, is_closed_pipe, kind, kind_at,
    open_files, open_to_read, peak_resident, process_time, read_exact_at, replace_process, resident,
    state_folder, sync_below, sync_folder, thread_time, write_all_at,
};
pub(crate) use system::{
    Guard, advise, advise_buffer, allocate, drop_pages, end_process, error_of_device, error_of_full_disk,
    first_bytes, free_bytes, host_name, is_at, is_in_use, map_large_blocks, open_folder, trim_heap,
};
#[cfg(feature = "metis")]
pub(crate) use system::{SignalAction, THREADS_KEEP_VARIABLES};

use std::env;
use std::fs::{self, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Kinds of things that have a path.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    /// A regular file.
    File,
    /// A folder.
    Folder,
    /// A named pipe.
    Pipe,
    /// A socket.
    Socket,
    /// A terminal or a device that is read byte by byte.
    Terminal,
    /// A device that holds blocks.
    Blocks,
    /// Anything else.
    Other,
}

/// The path that a variable of the environment holds, unless it depends on where the process is.
fn absolute(variable: &str) -> Option<PathBuf> {
    env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute())
}

/// Two folders get each other's names, one after the other.
fn exchange_in_steps(one: &Path, other: &Path) -> io::Result<()> {
    let mut old = one.to_owned().into_os_string();
    old.push(".old");
    fs::rename(other, &old)?;
    if let Err(error) = fs::rename(one, other) {
        let _ = fs::rename(&old, other);
        return Err(error);
    }
    fs::rename(&old, one)
}

/// When a file was changed last: seconds since 1970, and nanoseconds. Zero where the file system does not tell.
pub fn modified(metadata: &Metadata) -> (i64, u32) {
    let Ok(time) = metadata.modified() else { return (0, 0) };
    match time.duration_since(UNIX_EPOCH) {
        Ok(since) => (since.as_secs() as i64, since.subsec_nanos()),
        Err(before) => {
            // Nanoseconds count on from the second before.
            let until = before.duration();
            let (seconds, nanoseconds) = (-(until.as_secs() as i64), until.subsec_nanos());
            if nanoseconds == 0 { (seconds, 0) } else { (seconds - 1, 1_000_000_000 - nanoseconds) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};
    use std::time::Duration;

    #[test]
    fn times_are_those_that_the_system_has() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        fs::write(&path, "").unwrap();
        let file = File::options().write(true).open(&path).unwrap();
        let (half, third) = (Duration::from_millis(2500), Duration::from_secs(3));
        for (time, expected) in [
            (UNIX_EPOCH + half, (2, 500_000_000)),
            (UNIX_EPOCH - half, (-3, 500_000_000)),
            (UNIX_EPOCH - third, (-3, 0)),
        ] {
            file.set_modified(time).unwrap();
            assert_eq!(modified(&fs::metadata(&path).unwrap()), expected);
        }
    }

    #[test]
    fn bytes_are_read_and_written_at_their_places() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        let file = File::options().read(true).write(true).create_new(true).open(&path).unwrap();
        allocate(&file, 10).unwrap();
        write_all_at(&file, b"abc", 7).unwrap();
        let mut read = [1; 4];
        read_exact_at(&file, &mut read, 6).unwrap();
        assert_eq!((&read, file.metadata().unwrap().len()), (b"\0abc", 10));
        assert!(read_exact_at(&file, &mut read, 7).is_err(), "beyond the end");
    }

    #[test]
    fn a_file_is_told_from_others() {
        let dir = tempfile::tempdir().unwrap();
        let [one, two] = ["one", "two"].map(|name| dir.path().join(name));
        fs::write(&one, "").unwrap();
        fs::write(&two, "").unwrap();
        let opened = File::open(&one).unwrap();
        assert!(is_at(&opened, &one) && !is_at(&opened, &two) && !is_at(&opened, &dir.path().join("none")));
        assert_ne!(id_at(&one).unwrap(), id_at(&two).unwrap());
        let folder = open_folder(dir.path()).unwrap();
        assert!(is_at(&folder, dir.path()));
    }

    #[test]
    fn folders_change_places() {
        let dir = tempfile::tempdir().unwrap();
        let [old, new] = ["old", "new"].map(|name| dir.path().join(name));
        for folder in [&old, &new] {
            fs::create_dir(folder).unwrap();
            fs::write(folder.join(folder.file_name().unwrap()), "").unwrap();
        }
        sync_below(&new).unwrap();
        exchange(&new, &old).unwrap();
        assert!(old.join("new").exists() && new.join("old").exists());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2);
    }
}
