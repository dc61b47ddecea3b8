//! Results that appear complete or not at all: written under a hidden name, synced, then renamed.

use crate::{ExtmemError, FailPoints, alive, hidden_name, platform, target};
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const WRITE_BUFFER: usize = 1 << 20;
const PARTIAL: &str = ".partial";
/// As many may write files of one name at a time.
const SLOTS: u32 = 1000;

/// A file being written as `.NAME.<N>.partial` beside its [`target`], so on the same file system. [`AtomicFile::publish`] gives
/// it its name; dropping it removes it. Errors name the target.
///
/// N is the first number that nobody is at work on: so the next to write a target finds what those left who were killed, and removes it.
///
/// ```
/// use chpm_extmem::{AtomicFile, WorkDir};
///
/// let folder = WorkDir::create(&std::env::temp_dir())?;
/// let path = folder.path().join("model.chpm");
/// let file = AtomicFile::create(&path, false)?;
/// file.write_all_at(b"all of it", 0)?;
/// assert!(!path.exists());
/// file.publish()?;
/// assert_eq!(std::fs::read(&path).unwrap(), b"all of it");
/// # Ok::<(), chpm_extmem::ExtmemError>(())
/// ```
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<File>,
    partial: PathBuf,
    target: PathBuf,
    overwrite: bool,
    published: bool,
    fail_points: FailPoints,
}

impl AtomicFile {
    /// Creates the partial file, which proves before the work starts that the directory can be written.
    ///
    /// # Errors
    /// Whatever [`target`] refuses; an error of the system if the partial file cannot be created.
    pub fn create(path: &Path, overwrite: bool) -> Result<Self, ExtmemError> {
        Self::create_with(path, overwrite, FailPoints::default())
    }

    /// Like [`Self::create`], with something going wrong: at any access but those through [`Write`].
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn create_with(path: &Path, overwrite: bool, fail_points: FailPoints) -> Result<Self, ExtmemError> {
        let target = target(path, overwrite)?;
        let opened = fail_points.access().and_then(|()| {
            take(|slot: u32| target.with_file_name(hidden_name(name(&target), &format!(".{slot}{PARTIAL}"))))
        });
        let (file, partial) = opened.map_err(|source| ExtmemError::making("create", &target, source))?;
        let file = BufWriter::with_capacity(WRITE_BUFFER, file);
        Ok(AtomicFile { file, partial, target, overwrite, published: false, fail_points })
    }

    /// The name that the file will have.
    pub fn path(&self) -> &Path {
        &self.target
    }

    /// The error within one of `write` or `seek`, for callers that write through [`Write`].
    pub fn error(&self, source: io::Error) -> ExtmemError {
        source.downcast().unwrap_or_else(|source| ExtmemError::io("write", &self.target, 0, source))
    }

    /// The same with its place, for callers that know of no other error.
    fn placed(&self, source: io::Error) -> io::Error {
        io::Error::new(source.kind(), self.error(source))
    }

    /// Sets the length of the file; what is never written reads as zeros.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`].
    pub fn set_len(&self, len: u64) -> Result<(), ExtmemError> {
        let extended = self.fail_points.access().and_then(|()| self.file.get_ref().set_len(len));
        extended.map_err(|source| ExtmemError::io("extend", &self.target, len, source))
    }

    /// Writes at a place, from any thread. Not to be mixed with writing through [`Write`].
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`].
    pub fn write_all_at(&self, bytes: &[u8], offset: u64) -> Result<(), ExtmemError> {
        let write = || platform::write_all_at(self.file.get_ref(), bytes, offset);
        let written = self.fail_points.access().and_then(|()| write());
        written.map_err(|source| ExtmemError::io("write", &self.target, bytes.len() as u64, source))
    }

    /// Reads what was written at a place, to write it elsewhere.
    ///
    /// # Errors
    /// [`ExtmemError::Io`].
    pub fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> Result<(), ExtmemError> {
        let mut look = || platform::read_exact_at(self.file.get_ref(), bytes, offset);
        let read = self.fail_points.access().and_then(|()| look());
        read.map_err(|source| ExtmemError::io("read", &self.target, bytes.len() as u64, source))
    }

    /// Flushes and syncs to disk, so that only its name is missing.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`].
    pub fn sync(&mut self) -> Result<(), ExtmemError> {
        let written = self.fail_points.access().and_then(|()| self.file.flush());
        let synced = written.and_then(|()| self.file.get_ref().sync_all());
        synced.map_err(|source| self.error(source))
    }

    /// Flushes, syncs to disk, renames to the target and syncs the directory.
    ///
    /// # Errors
    /// What [`target`] refuses, if something has the name by now that may not be replaced, [`ExtmemError::Io`] or
    /// [`ExtmemError::DiskFull`]; up to the rename the partial file is then removed and the target untouched.
    pub fn publish(mut self) -> Result<(), ExtmemError> {
        self.sync()?;
        if target(&self.target, self.overwrite)? != self.target {
            return Err(ExtmemError::Irregular { path: self.target.clone(), is: "a link by now" });
        }
        let renamed = self.fail_points.access().and_then(|()| fs::rename(&self.partial, &self.target));
        renamed.map_err(|source| ExtmemError::io("rename the finished file to", &self.target, 0, source))?;
        self.published = true;
        // The new name itself lives in the directory, and survives a power cut only if that is synced too.
        let directory = directory(&self.target);
        let synced = self.fail_points.access().and_then(|()| platform::sync_folder(directory));
        synced.map_err(|source| ExtmemError::io("sync the directory", directory, 0, source))
    }
}

/// A new file at the first of these places that is free or can be made so; what is left at those behind it goes.
fn take(place: impl Fn(u32) -> PathBuf) -> io::Result<(File, PathBuf)> {
    for slot in 0..SLOTS {
        let path = place(slot);
        alive::clear(&path);
        match File::options().read(true).write(true).create_new(true).open(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            made => {
                let file = made?;
                if alive::hold(&file, &path) {
                    let behind = (slot + 1..SLOTS).map(place);
                    behind
                        .take_while(|path| path.symlink_metadata().is_ok())
                        .for_each(|path| alive::clear(&path));
                    return Ok((file, path));
                }
            }
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

fn directory(path: &Path) -> &Path {
    path.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

/// The last part of a target, which has one.
fn name(target: &Path) -> &OsStr {
    target.file_name().unwrap_or_default()
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes).map_err(|source| self.placed(source))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush().map_err(|source| self.placed(source))
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position).map_err(|source| self.placed(source))
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
    use nix::sys::stat::Mode;
    use nix::unistd::mkfifo;
    use std::os::unix::fs::symlink;

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
        assert_eq!(names(dir.path()), [".model.chpm.0.partial"]);
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
    fn what_the_killed_left_goes_with_the_next() {
        let dir = tempfile::tempdir().unwrap();
        let left =
            [".a.0.partial", ".a.2.partial", ".a.3.partial", ".a.5.partial", ".a.x.partial", ".b.0.partial"];
        let target = dir.path().join("a");
        let first = AtomicFile::create(&target, false).unwrap();
        for name in &left[1..] {
            fs::write(dir.path().join(name), "left").unwrap();
        }
        let mut second = AtomicFile::create(&target, false).unwrap();
        // 5 is behind a gap, and is found when it is the next.
        assert_eq!(
            names(dir.path()),
            [".a.0.partial", ".a.1.partial", ".a.5.partial", ".a.x.partial", ".b.0.partial"]
        );
        second.write_all(b"second").unwrap();
        second.publish().unwrap();
        assert!(first.publish().is_err(), "it was not there before");
        assert_eq!(fs::read(&target).unwrap(), b"second");
        assert_eq!(names(dir.path()), [".a.5.partial", ".a.x.partial", ".b.0.partial", "a"]);
    }

    #[test]
    fn the_longest_names_are_written_and_cleared_each_for_itself() {
        let dir = tempfile::tempdir().unwrap();
        let targets = ["a", "b"].map(|last| dir.path().join("x".repeat(254) + last));
        let left = targets.each_ref().map(|target| {
            let file = AtomicFile::create(target, false).unwrap();
            file.partial.clone()
        });
        // As if killed.
        left.iter().for_each(|partial| fs::write(partial, "left").unwrap());
        assert_eq!(names(dir.path()).len(), 2);
        let mut file = AtomicFile::create(&targets[0], false).unwrap();
        file.write_all(b"new").unwrap();
        file.publish().unwrap();
        assert_eq!(fs::read(&targets[0]).unwrap(), b"new");
        assert!(!left[0].exists() && left[1].exists(), "the other's is left");
        drop(AtomicFile::create(&targets[1], false).unwrap());
        assert_eq!(names(dir.path()), ["x".repeat(254) + "a"]);
    }

    #[test]
    fn what_a_link_points_at_is_replaced_and_the_link_stays() {
        let dir = tempfile::tempdir().unwrap();
        let far = dir.path().join("far");
        fs::create_dir(&far).unwrap();
        fs::write(far.join("file"), b"old").unwrap();
        let link = dir.path().join("link");
        symlink("far/file", &link).unwrap();
        let mut file = AtomicFile::create(&link, true).unwrap();
        assert_eq!(
            (names(dir.path()).len(), names(&far).len()),
            (2, 2),
            "the partial file lies beside the target"
        );
        file.write_all(b"new").unwrap();
        file.publish().unwrap();
        assert_eq!(fs::read_link(&link).unwrap(), Path::new("far/file"));
        assert_eq!((fs::read(far.join("file")).unwrap(), names(&far).len()), (b"new".to_vec(), 1));
    }

    #[test]
    fn what_appears_meanwhile_and_is_no_file_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.chpm");
        let publish = || AtomicFile::create(&path, true).unwrap();
        let file = publish();
        mkfifo(&path, Mode::S_IRWXU).unwrap();
        assert!(matches!(file.publish(), Err(ExtmemError::Irregular { is: "a FIFO", .. })));
        fs::remove_file(&path).unwrap();
        let file = publish();
        fs::write(dir.path().join("other"), b"theirs").unwrap();
        symlink("other", &path).unwrap();
        assert!(matches!(file.publish(), Err(ExtmemError::Irregular { .. })));
        assert_eq!(fs::read(&path).unwrap(), b"theirs");
        assert_eq!(names(dir.path()), ["model.chpm", "other"]);
    }

    #[test]
    fn errors_of_writing_name_the_target() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.chpm");
        let mut file = AtomicFile::create(&target, false).unwrap();
        // A place that no file has.
        let error = file.seek(SeekFrom::Current(i64::MIN)).unwrap_err();
        let told = file.error(error);
        assert!(matches!(&told, ExtmemError::Io { path, .. } if *path == target), "{told}");
        assert_eq!(told.to_string().matches("model.chpm").count(), 1, "{told}");
    }

    #[test]
    fn any_fault_is_an_error_and_leaves_whole_files() {
        for (at, was_renamed) in [(0, false), (1, false), (2, false), (3, false), (4, false), (5, true)] {
            let dir = tempfile::tempdir().unwrap();
            let target = dir.path().join("model.chpm");
            fs::write(&target, b"old").unwrap();
            let make = |fail_points| {
                let file = AtomicFile::create_with(&target, true, fail_points)?;
                file.set_len(3)?;
                file.write_all_at(b"new", 0)?;
                file.publish()
            };
            assert!(make(FailPoints::fail_at(at, at % 2 == 0)).is_err(), "{at}");
            assert_eq!(fs::read(&target).unwrap(), if was_renamed { b"new" } else { b"old" }, "{at}");
            assert_eq!(names(dir.path()), ["model.chpm"]);
            make(FailPoints::fail_at(6, true)).unwrap();
        }
    }

    #[test]
    fn places_that_hold_no_file_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(AtomicFile::create(dir.path(), true), Err(ExtmemError::Irregular { .. })));
        assert!(matches!(AtomicFile::create(Path::new("/"), true), Err(ExtmemError::NotAFile { .. })));
        let error = AtomicFile::create(&dir.path().join("missing/model.chpm"), false).unwrap_err();
        assert!(matches!(error, ExtmemError::NoFolder { .. }), "{error}");
    }
}
