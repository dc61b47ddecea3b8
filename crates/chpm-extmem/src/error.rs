//! Errors between memory and disk, each with a remedy.

use std::io;
use std::path::{Path, PathBuf};

/// Everything that this crate can fail with.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExtmemError {
    /// The operating system refused a file operation.
    #[error("cannot {action} '{}': {source}", path.display())]
    Io {
        /// The operation, as a verb: "create", "read".
        action: &'static str,
        /// The file or directory concerned.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },

    /// Memory was asked for beyond the limit.
    #[error(
        "no memory for {what}: {} asked, {} of {} in use; raise --memory to at least {}",
        mib(*asked), mib(*used), mib(*limit), mib(*enough)
    )]
    Budget {
        /// Purpose of the memory.
        what: &'static str,
        /// Bytes asked for.
        asked: u64,
        /// Bytes already reserved.
        used: u64,
        /// The budget's limit in bytes.
        limit: u64,
        /// Bytes that work would then hold; 0 if this was for an array.
        work: u64,
        /// The limit that would do. Whoever divides a larger whole into limits raises it to what that whole has to be.
        enough: u64,
    },

    /// The target of a result exists and was not to be replaced.
    #[error("'{}' exists already; pass --force to replace it, or choose another name", path.display())]
    Exists {
        /// The existing file.
        path: PathBuf,
    },

    /// Another build makes the same file.
    #[error("'{}' is being built by {owner}; wait for it, or choose another name", path.display())]
    Locked {
        /// The file to be made.
        path: PathBuf,
        /// Note that the holder of the lock left in it.
        owner: String,
    },

    /// The folder of a result is not there.
    #[error("'{}' cannot be written: there is no folder '{}'; make it first", path.display(), folder.display())]
    NoFolder {
        /// The file to be made.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },

    /// The path does not name a regular file where one is needed.
    #[error("'{}' does not name a file; give the path of a file, not of a directory or device", path.display())]
    NotAFile {
        /// The path as given.
        path: PathBuf,
    },

    /// The name of a result is of something that is never replaced.
    #[error("'{}' is {is}, and only a regular file is ever replaced; choose another name", path.display())]
    Irregular {
        /// The name as given.
        path: PathBuf,
        /// Kind of thing that is in the way.
        is: &'static str,
    },

    /// The name of a result is of a symbolic link to a file that is not there.
    #[error(
        "'{}' is a link to '{}', which is not there; remove the link, or name the file itself",
        path.display(), to.display()
    )]
    Dangling {
        /// The link.
        path: PathBuf,
        /// Target of the link.
        to: PathBuf,
    },

    /// No file may become as large, by a limit of the process or of the file system.
    #[error(
        "cannot {action} '{}': larger than a file may be; raise the limit (`ulimit -f unlimited`) or, if there is none, \
         choose a file system that takes larger files",
        path.display()
    )]
    FileTooLarge {
        /// The operation, as a verb.
        action: &'static str,
        /// The file being written, or the directory of an unnamed one.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },

    /// The file system, or the user's quota on it, is full.
    #[error("no space left to {action} '{}'{}; free space or choose another place", path.display(), more(*needed))]
    DiskFull {
        /// The operation, as a verb.
        action: &'static str,
        /// The file being written, or the directory of an unnamed one.
        path: PathBuf,
        /// Bytes of the write that failed; 0 where that is not known.
        needed: u64,
        /// The operating system's reason.
        source: io::Error,
    },

    /// The file system has less space than the work is going to need.
    #[error(
        "the work may need {} in '{}', where {} are free; free space, name another place with --work-dir, or raise --memory",
        mib(*needed), path.display(), mib(*free)
    )]
    NoSpace {
        /// The work directory.
        path: PathBuf,
        /// Bytes that the work may need.
        needed: u64,
        /// Bytes that are free.
        free: u64,
    },

    /// A file that an earlier run saved is not what it was.
    #[error("'{}' {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Reason, in words.
        reason: &'static str,
    },

    /// A file is no longer what it was when reading began.
    #[error("'{}' {how} while it was read; run this again when nobody writes to it, or copy or build it again", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
        /// Kind of damage.
        how: &'static str,
    },

    /// A range beyond the end of what was stored.
    #[error("{what}: bytes {offset}..{offset}+{len} lie beyond the {size} bytes stored")]
    OutOfRange {
        /// The store that was asked.
        what: &'static str,
        /// First byte asked for.
        offset: u64,
        /// Bytes asked for.
        len: u64,
        /// Bytes stored.
        size: u64,
    },

    /// More elements than this machine can address.
    #[error("{what}: {len} elements of {element} bytes cannot be addressed on this machine; split the input")]
    TooLarge {
        /// The array concerned.
        what: &'static str,
        /// Elements asked for.
        len: usize,
        /// Bytes of one element.
        element: usize,
    },
}

impl ExtmemError {
    /// Gives an I/O error its place; a full disk or quota becomes [`ExtmemError::DiskFull`] with the `needed` bytes, a file beyond a
    /// limit [`ExtmemError::FileTooLarge`].
    pub fn io(action: &'static str, path: &Path, needed: u64, source: io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                ExtmemError::DiskFull { action, path, needed, source }
            }
            io::ErrorKind::FileTooLarge => ExtmemError::FileTooLarge { action, path, source },
            _ => ExtmemError::Io { action, path, source },
        }
    }

    /// The same for a file that was to be made at or beside `path`: where that is not there, its folder is not.
    pub(crate) fn making(action: &'static str, path: &Path, source: io::Error) -> Self {
        match path.parent() {
            Some(folder) if source.kind() == io::ErrorKind::NotFound => {
                ExtmemError::NoFolder { path: path.to_owned(), folder: folder.to_owned() }
            }
            _ => ExtmemError::io(action, path, 0, source),
        }
    }
}

/// Bytes of `len` elements of `T`, checked against what a slice may span.
pub(crate) fn byte_len<T>(what: &'static str, len: usize) -> Result<usize, ExtmemError> {
    let element = size_of::<T>();
    len.checked_mul(element).filter(|&bytes| bytes <= isize::MAX as usize).ok_or(ExtmemError::TooLarge {
        what,
        len,
        element,
    })
}

fn mib(bytes: u64) -> String {
    if bytes < 1 << 20 { format!("{bytes} bytes") } else { format!("{:.1} MiB", bytes as f64 / 1048576.0) }
}

fn more(needed: u64) -> String {
    if needed == 0 { String::new() } else { format!(" ({} more needed)", mib(needed)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_apart_and_says_what_it_needed() {
        let full = ExtmemError::io("write", Path::new("out.chpm"), 3 << 20, nix::errno::Errno::ENOSPC.into());
        assert!(matches!(full, ExtmemError::DiskFull { needed, .. } if needed == 3 << 20));
        assert!(full.to_string().contains("'out.chpm' (3.0 MiB more needed)"), "{full}");
        let other =
            ExtmemError::io("write", Path::new("out.chpm"), 1, io::ErrorKind::PermissionDenied.into());
        assert!(matches!(other, ExtmemError::Io { action: "write", .. }));
        let large = ExtmemError::io("write", Path::new("out.chpm"), 1, nix::errno::Errno::EFBIG.into());
        assert!(
            large.to_string().contains("'out.chpm'") && large.to_string().contains("ulimit -f"),
            "{large}"
        );
    }

    #[test]
    fn lengths_that_overflow_are_refused() {
        assert_eq!(byte_len::<u32>("x", 3).unwrap(), 12);
        assert!(matches!(
            byte_len::<u32>("x", usize::MAX / 2),
            Err(ExtmemError::TooLarge { element: 4, .. })
        ));
    }
}
