//! Results that appear complete or not at all: written under a hidden name, synced, then renamed.

use crate::ExtmemError;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

const WRITE_BUFFER: usize = 1 << 20;

/// A file being written as `.NAME.<process>.partial` beside its target. [`AtomicFile::publish`] gives it its name;
/// dropping it removes it.
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<File>,
    partial: PathBuf,
    target: PathBuf,
    overwrite: bool,
    published: bool,
}

impl AtomicFile {
    /// Creates the partial file, which proves before the work starts that the directory can be written.
    ///
    /// # Errors
    /// [`ExtmemError::Exists`] if `path` exists and `overwrite` is false, [`ExtmemError::NotAFile`] if it is a
    /// directory or ends in no name, [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] if the partial file cannot
    /// be created.
    pub fn create(path: &Path, overwrite: bool) -> Result<Self, ExtmemError> {
        let Some(name) = path.file_name().filter(|_| !path.is_dir()) else {
            return Err(ExtmemError::NotAFile { path: path.to_path_buf() });
        };
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}.partial", std::process::id()));
        let partial = path.with_file_name(hidden);

        refuse_existing(path, overwrite)?;
        let file = File::options()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&partial)
            .map_err(|source| ExtmemError::io("create", &partial, 0, source))?;
        let file = BufWriter::with_capacity(WRITE_BUFFER, file);
        Ok(AtomicFile { file, partial, target: path.to_path_buf(), overwrite, published: false })
    }

    /// The name that the file will have.
    pub fn path(&self) -> &Path {
        &self.target
    }

    /// Gives an error of `write` or `seek` its place, for callers that write through [`Write`].
    pub fn error(&self, source: io::Error) -> ExtmemError {
        ExtmemError::io("write", &self.partial, 0, source)
    }

    /// Sets the length of the file; what is never written reads as zeros.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`].
    pub fn set_len(&self, len: u64) -> Result<(), ExtmemError> {
        let file = self.file.get_ref();
        file.set_len(len).map_err(|source| ExtmemError::io("extend", &self.partial, len, source))
    }

    /// Writes at a place, from any thread. Not to be mixed with writing through [`Write`].
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`].
    pub fn write_all_at(&self, bytes: &[u8], offset: u64) -> Result<(), ExtmemError> {
        let written = self.file.get_ref().write_all_at(bytes, offset);
        written.map_err(|source| ExtmemError::io("write", &self.partial, bytes.len() as u64, source))
    }

    /// Flushes, syncs to disk, renames to the target and syncs the directory.
    ///
    /// # Errors
    /// [`ExtmemError::Exists`] if the target appeared meanwhile and may not be replaced, [`ExtmemError::Io`] or
    /// [`ExtmemError::DiskFull`]; up to the rename the partial file is then removed and the target untouched.
    pub fn publish(mut self) -> Result<(), ExtmemError> {
        let written = self.file.flush().and_then(|()| self.file.get_ref().sync_all());
        written.map_err(|source| self.error(source))?;
        refuse_existing(&self.target, self.overwrite)?;
        fs::rename(&self.partial, &self.target)
            .map_err(|source| ExtmemError::io("rename the finished file to", &self.target, 0, source))?;
        self.published = true;
        // The new name itself lives in the directory, and survives a power cut only if that is synced too.
        let directory = match self.target.parent() {
            Some(parent) if parent != Path::new("") => parent,
            _ => Path::new("."),
        };
        File::open(directory)
            .and_then(|directory| directory.sync_all())
            .map_err(|source| ExtmemError::io("sync the directory", directory, 0, source))
    }
}

fn refuse_existing(path: &Path, overwrite: bool) -> Result<(), ExtmemError> {
    // A dangling link counts as existing: the rename would replace it.
    if !overwrite && path.symlink_metadata().is_ok() {
        return Err(ExtmemError::Exists { path: path.to_path_buf() });
    }
    Ok(())
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position)
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if !self.published {
            let _ = fs::remove_file(&self.partial);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_published_file_is_complete_and_alone() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.chpm");
        let mut file = AtomicFile::create(&target, false).unwrap();
        file.write_all(b"....body").unwrap();
        assert_eq!(names(dir.path()), [format!(".model.chpm.{}.partial", std::process::id())]);
        file.seek(SeekFrom::Start(0)).unwrap();
        file.write_all(b"HEAD").unwrap();
        assert_eq!(file.path(), target);
        file.publish().unwrap();
        assert_eq!(names(dir.path()), ["model.chpm"]);
        assert_eq!(fs::read(&target).unwrap(), b"HEADbody");
    }

    #[test]
    fn a_dropped_file_leaves_nothing_and_the_old_one_in_place() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.chpm");
        fs::write(&target, b"old").unwrap();
        let mut file = AtomicFile::create(&target, true).unwrap();
        file.write_all(&vec![1; 3 << 20]).unwrap();
        drop(file);
        assert_eq!(names(dir.path()), ["model.chpm"]);
        assert_eq!(fs::read(&target).unwrap(), b"old");
    }

    #[test]
    fn an_existing_target_is_replaced_only_when_asked() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.chpm");
        fs::write(&target, b"old").unwrap();
        let error = AtomicFile::create(&target, false).unwrap_err();
        assert!(matches!(error, ExtmemError::Exists { .. }) && error.to_string().contains("--force"));
        let mut file = AtomicFile::create(&target, true).unwrap();
        file.write_all(b"new").unwrap();
        file.publish().unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"new");
        assert_eq!(names(dir.path()), ["model.chpm"]);
    }

    #[test]
    fn a_target_that_appears_meanwhile_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.chpm");
        let file = AtomicFile::create(&target, false).unwrap();
        fs::write(&target, b"theirs").unwrap();
        assert!(matches!(file.publish(), Err(ExtmemError::Exists { .. })));
        assert_eq!(fs::read(&target).unwrap(), b"theirs");
        assert_eq!(names(dir.path()), ["model.chpm"]);
    }

    #[test]
    fn places_that_hold_no_file_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(AtomicFile::create(dir.path(), true), Err(ExtmemError::NotAFile { .. })));
        assert!(matches!(AtomicFile::create(Path::new("/"), true), Err(ExtmemError::NotAFile { .. })));
        let error = AtomicFile::create(&dir.path().join("missing/model.chpm"), false).unwrap_err();
        assert!(matches!(error, ExtmemError::Io { action: "create", .. }));
    }
}
