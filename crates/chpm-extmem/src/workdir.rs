//! The work directory: a place for intermediate files, gone when the work ends, unless another run is to go on with it.

use crate::{ExtmemError, FailPoints, alive, platform};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A directory that is removed with all its files when dropped, unless it is to be kept.
///
/// ```
/// use chpm_extmem::WorkDir;
///
/// let folder = WorkDir::create(&std::env::temp_dir())?;
/// let path = folder.path().to_owned();
/// assert!(path.is_dir());
/// drop(folder);
/// assert!(!path.exists());
/// # Ok::<(), chpm_extmem::ExtmemError>(())
/// ```
#[derive(Debug)]
pub struct WorkDir {
    path: PathBuf,
    kept: AtomicBool,
    fail_points: FailPoints,
    /// Open, which says that somebody is at work; not where another run may go on, whose makers take turns by themselves.
    held: Option<File>,
    /// Where another run may go on: names of files that stay when they are closed, since a manifest names them, or soon will.
    listed: Option<Mutex<BTreeSet<String>>>,
}

impl WorkDir {
    /// Creates a new directory `.chpm-XXXXXX.work` in `parent`, which must exist, and removes those that others left there who were killed.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] naming `parent`.
    pub fn create(parent: &Path) -> Result<Self, ExtmemError> {
        let failed = |source| ExtmemError::io("create a work directory in", parent, 0, plain(source));
        clear(parent);
        loop {
            let made = tempfile::Builder::new().prefix(PREFIX).suffix(SUFFIX).tempdir_in(parent);
            let path = made.map_err(failed)?.keep();
            let held = match platform::open_folder(&path) {
                // One that is gone already was taken for left.
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                held => held.inspect_err(|_| drop(fs::remove_dir(&path))).map_err(failed)?,
            };
            if alive::hold(&held, &path) {
                return Ok(WorkDir {
                    path,
                    kept: AtomicBool::new(false),
                    fail_points: FailPoints::default(),
                    held: Some(held),
                    listed: None,
                });
            }
        }
    }

    /// Opens `path` for work that another run may go on with: it is made if it is not there, and what an earlier run left in it
    /// stays, to be taken up or swept away. Only one process may have it open at a time; that is for the caller to see to.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] naming the directory.
    pub fn resumable(path: &Path, fail_points: FailPoints) -> Result<Self, ExtmemError> {
        let made = fail_points.access().and_then(|()| match fs::create_dir(path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
            made => made,
        });
        made.map_err(|source| ExtmemError::io("create a work directory in", place(path), 0, source))?;
        clear(place(path));
        Ok(WorkDir {
            path: path.to_owned(),
            kept: AtomicBool::new(path.join(Self::MANIFEST).exists()),
            fail_points,
            held: None,
            listed: Some(Mutex::default()),
        })
    }

    /// The same directory with something going wrong.
    pub fn with_fail_points(self, fail_points: FailPoints) -> Self {
        // Fields cannot be moved out of what is dropped, so that this is a change.
        let mut dir = self;
        dir.fail_points = fail_points;
        dir
    }

    /// Whether another run may go on with what is in it.
    pub fn is_resumable(&self) -> bool {
        self.listed.is_some()
    }

    /// Planned failures of its files.
    pub fn fail_points(&self) -> &FailPoints {
        &self.fail_points
    }

    /// Where the directory is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder that the directory lies in, which is the one that people know.
    pub fn place(&self) -> &Path {
        place(&self.path)
    }

    /// Leaves the directory and its files in place when this is dropped, or no longer does so.
    pub fn keep(&self, kept: bool) {
        self.kept.store(kept, Relaxed);
    }

    /// Fails unless the file system has `bytes` free, as far as it tells.
    ///
    /// # Errors
    /// [`ExtmemError::NoSpace`].
    pub fn require(&self, bytes: u64) -> Result<(), ExtmemError> {
        match platform::free_bytes(&self.path) {
            Some(free) if free < bytes => {
                Err(ExtmemError::NoSpace { path: self.place().to_owned(), needed: bytes, free })
            }
            _ => Ok(()),
        }
    }

    /// Creates the file `name`, open for reading and writing; it must not exist yet.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] naming the [`place`](Self::place).
    pub fn create_file(&self, name: &str) -> Result<File, ExtmemError> {
        let path = self.path.join(name);
        fn open(path: &Path) -> Result<File, io::Error> {
            File::options().read(true).write(true).create_new(true).open(path)
        }
        let opened = self.fail_points.access().and_then(|()| open(&path));
        opened.map_err(|source| ExtmemError::io("create a work file in", self.place(), 0, source))
    }

    /// Opens the file `name`, for reading and writing.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if it is not there, [`ExtmemError::Io`] naming the [`place`](Self::place).
    pub fn open_file(&self, name: &str) -> Result<File, ExtmemError> {
        let path = self.path.join(name);
        fn open(path: &Path) -> Result<File, io::Error> {
            File::options().read(true).write(true).open(path)
        }
        self.fail_points.access().and_then(|()| open(&path)).map_err(|source| match source.kind() {
            io::ErrorKind::NotFound => ExtmemError::Damaged { path, reason: "is not there" },
            _ => ExtmemError::io("open a work file in", self.place(), 0, source),
        })
    }

    /// Creates a file without a name, open for reading and writing; its space is freed when it is closed.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] naming the [`place`](Self::place).
    pub fn unnamed_file(&self) -> Result<File, ExtmemError> {
        let made = self.fail_points.access().and_then(|()| tempfile::tempfile_in(&self.path).map_err(plain));
        made.map_err(|source| ExtmemError::io("create a work file in", self.place(), 0, source))
    }

    /// Has the file `name` stay when it is closed, until a manifest is published that does not name it.
    pub(crate) fn protect(&self, name: &str) {
        if let Some(mut listed) = self.listed() {
            listed.insert(name.to_owned());
        }
    }

    /// The file `name` is no longer needed by this run.
    pub(crate) fn discard(&self, name: &str) {
        if self.listed().is_none_or(|listed| !listed.contains(name)) {
            // What cannot be removed is swept away by the next run.
            let _ = fs::remove_file(self.path.join(name));
        }
    }

    /// From now on only these files are needed by the manifest: others that were are removed.
    pub(crate) fn list(&self, names: BTreeSet<String>) {
        if let Some(mut listed) = self.listed() {
            for name in listed.difference(&names) {
                let _ = fs::remove_file(self.path.join(name));
            }
            *listed = names;
        }
    }

    /// Removes all files but those of these names and, if it is to stay, the manifest.
    pub(crate) fn sweep(&self, names: &BTreeSet<String>, manifest: bool) -> Result<(), ExtmemError> {
        let failed = |source| ExtmemError::io("clear a work directory in", self.place(), 0, source);
        let is_needed = |name: &str| names.contains(name) || (manifest && name == Self::MANIFEST);
        for entry in self.fail_points.access().and_then(|()| fs::read_dir(&self.path)).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            if entry.file_name().to_str().is_some_and(is_needed) {
                continue;
            }
            match fs::remove_file(entry.path()) {
                // A file without a name has one on some systems, for as long as it is open.
                Err(error) if platform::is_in_use(&error) => {}
                removed => removed.map_err(failed)?,
            }
        }
        Ok(())
    }

    fn listed(&self) -> Option<MutexGuard<'_, BTreeSet<String>>> {
        self.listed.as_ref().map(|listed| listed.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// How the name of a directory begins and ends that no other run goes on with.
const PREFIX: &str = ".chpm-";
const SUFFIX: &str = ".work";

/// Removes such directories that nobody is at work in.
fn clear(parent: &Path) {
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_work = name.to_str().and_then(|name| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX));
        if is_work.is_some_and(|id| id.len() == 6 && id.bytes().all(|byte| byte.is_ascii_alphanumeric())) {
            alive::clear(&entry.path());
        }
    }
}

/// The folder of a work directory.
fn place(path: &Path) -> &Path {
    path.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

/// The same error without the hidden name that `tempfile` tells with it.
fn plain(error: io::Error) -> io::Error {
    match error.to_string().split_once(" at path ") {
        Some((why, _)) => io::Error::new(error.kind(), why),
        None => error,
    }
}

impl Drop for WorkDir {
    fn drop(&mut self) {
        // Some systems remove only what nobody has open.
        self.held = None;
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
    fn what_the_killed_left_goes_with_the_next() {
        let parent = tempfile::tempdir().unwrap();
        let at = |name: &str| parent.path().join(name);
        let leave = || {
            for name in [".chpm-0aZ9xy.work", ".chpm-notes.work", ".chpm-0aZ9xy", "chpm-0aZ9xy.work"] {
                fs::create_dir_all(at(name)).unwrap();
                fs::write(at(name).join("pages"), "left").unwrap();
            }
        };
        leave();
        let alive = WorkDir::create(parent.path()).unwrap();
        assert!(!at(".chpm-0aZ9xy.work").exists() && alive.path().exists());
        assert!(
            [".chpm-notes.work", ".chpm-0aZ9xy", "chpm-0aZ9xy.work"]
                .iter()
                .all(|name| at(name).join("pages").exists())
        );
        leave();
        drop(WorkDir::resumable(&at(".x.work"), FailPoints::default()).unwrap());
        assert!(!at(".chpm-0aZ9xy.work").exists() && alive.path().exists());
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
        dir.keep(true);
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
        let told = WorkDir::create(&missing).err().unwrap().to_string();
        assert!(told.contains("not-here'") && !told.contains("chpm-"), "{told}");
        let told =
            WorkDir::resumable(&missing.join(".x.work"), FailPoints::default()).err().unwrap().to_string();
        assert!(told.contains("not-here'") && !told.contains(".work"), "{told}");
    }
}
