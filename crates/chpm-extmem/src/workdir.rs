//! The work directory: a fresh place for intermediate files, gone when the work ends.

use crate::ExtmemError;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// A uniquely named directory that is removed with all its files when dropped, unless [`WorkDir::keep`] was called.
#[derive(Debug)]
pub struct WorkDir {
    path: PathBuf,
    kept: AtomicBool,
}

impl WorkDir {
    /// Creates a new directory `chpm-XXXXXX` in `parent`, which must exist.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] naming `parent`.
    pub fn create(parent: &Path) -> Result<Self, ExtmemError> {
        let dir = tempfile::Builder::new()
            .prefix("chpm-")
            .tempdir_in(parent)
            .map_err(|source| ExtmemError::io("create a work directory in", parent, 0, source))?;
        Ok(WorkDir { path: dir.keep(), kept: AtomicBool::new(false) })
    }

    /// Where the directory is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Leaves the directory and its files in place when this is dropped.
    pub fn keep(&self) {
        self.kept.store(true, Relaxed);
    }

    /// Fails unless the file system has `bytes` free, as far as it tells.
    ///
    /// # Errors
    /// [`ExtmemError::NoSpace`].
    pub fn require(&self, bytes: u64) -> Result<(), ExtmemError> {
        match free_bytes(&self.path) {
            Some(free) if free < bytes => {
                Err(ExtmemError::NoSpace { path: self.path.clone(), needed: bytes, free })
            }
            _ => Ok(()),
        }
    }

    /// Creates the file `name`, open for reading and writing; it must not exist yet.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] naming the file.
    pub fn create_file(&self, name: &str) -> Result<File, ExtmemError> {
        let path = self.path.join(name);
        File::options()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&path)
            .map_err(|source| ExtmemError::io("create", &path, 0, source))
    }

    /// Creates a file without a name, open for reading and writing; its space is freed when it is closed.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] naming the directory.
    pub fn unnamed_file(&self) -> Result<File, ExtmemError> {
        tempfile::tempfile_in(&self.path)
            .map_err(|source| ExtmemError::io("create a file in", &self.path, 0, source))
    }
}

/// Bytes that a user without privileges may still write to the file system of `path`.
fn free_bytes(path: &Path) -> Option<u64> {
    let found = nix::sys::statvfs::statvfs(path).ok()?;
    // The types differ between systems.
    #[allow(clippy::unnecessary_cast)]
    (found.blocks_available() as u64).checked_mul(found.fragment_size() as u64)
}

impl Drop for WorkDir {
    fn drop(&mut self) {
        if !self.kept.load(Relaxed) {
            // A directory that cannot be removed must not turn a finished run into a failed one.
            let _ = fs::remove_dir_all(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn two_directories_differ_and_vanish_with_their_files() {
        let parent = tempfile::tempdir().unwrap();
        let first = WorkDir::create(parent.path()).unwrap();
        let second = WorkDir::create(parent.path()).unwrap();
        assert_ne!(first.path(), second.path());
        first.create_file("faces").unwrap().write_all(b"data").unwrap();
        assert_eq!(fs::read(first.path().join("faces")).unwrap(), b"data");
        assert!(first.create_file("faces").is_err(), "a file is never replaced");
        drop((first, second));
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
    }

    #[test]
    fn space_that_is_not_there_is_refused_with_both_numbers() {
        let parent = tempfile::tempdir().unwrap();
        let dir = WorkDir::create(parent.path()).unwrap();
        dir.require(1).unwrap();
        let error = dir.require(1 << 60).unwrap_err();
        assert!(matches!(error, ExtmemError::NoSpace { needed, free, .. } if needed == 1 << 60 && free > 0));
        assert!(error.to_string().contains("1099511627776.0 MiB"), "{error}");
    }

    #[test]
    fn a_kept_directory_stays() {
        let parent = tempfile::tempdir().unwrap();
        let dir = WorkDir::create(parent.path()).unwrap();
        let path = dir.path().to_path_buf();
        dir.create_file("log").unwrap();
        dir.keep();
        drop(dir);
        assert!(path.join("log").exists());
    }

    #[test]
    fn an_unnamed_file_is_not_seen() {
        let parent = tempfile::tempdir().unwrap();
        let dir = WorkDir::create(parent.path()).unwrap();
        let _file = dir.unnamed_file().unwrap();
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_missing_parent_is_named() {
        let parent = tempfile::tempdir().unwrap();
        let missing = parent.path().join("not-here");
        assert!(WorkDir::create(&missing).unwrap_err().to_string().contains("not-here"));
    }
}
