//! One at a time: a lock file beside what is being made.
//!
//! The lock is the kernel's (`flock`), which gives it back when its holder ends, however it ends: what a dead process leaves
//! behind is a file, and the next one takes it over. The text in it is for people.

use crate::{ExtmemError, hidden_name, platform};
use std::fs::{self, File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

/// The right to make a file, held until it is dropped.
#[derive(Debug)]
pub struct Lock {
    /// Open, since closing it gives the lock back.
    file: File,
    path: PathBuf,
}

impl Lock {
    /// Takes the lock of `target` by a file `.NAME.lock` beside it, which holds process and host for the others to read.
    ///
    /// # Errors
    /// [`ExtmemError::Locked`] with what the other says of itself, if another holds it, in this process or any other that sees
    /// the same file system; [`ExtmemError::NotAFile`] for a path without a name; [`ExtmemError::Io`].
    pub fn acquire(target: &Path) -> Result<Lock, ExtmemError> {
        let name = target.file_name().ok_or_else(|| ExtmemError::NotAFile { path: target.to_owned() })?;
        let path = target.with_file_name(hidden_name(name, ".lock"));
        loop {
            let failed = |source| ExtmemError::making("make a lock beside", target, source);
            let opened = File::options().read(true).write(true).create(true).truncate(false).open(&path);
            let mut file = opened.map_err(failed)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(ExtmemError::Locked { path: target.to_owned(), owner: owner(&mut file) });
                }
                Err(TryLockError::Error(source)) => return Err(failed(source)),
            }
            // Its last holder may have removed the file between our opening and our locking it.
            if platform::is_at(&file, &path) {
                let text = format!("process {} on {}\n", std::process::id(), host());
                let written = file
                    .set_len(0)
                    .and_then(|()| file.rewind())
                    .and_then(|()| file.write_all(text.as_bytes()));
                written.map_err(failed)?;
                return Ok(Lock { file, path });
            }
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Only while the lock is held: afterwards the file may be another's.
        let _ = fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}

/// Note of the holder, shortened to something safe to print.
fn owner(file: &mut File) -> String {
    let mut bytes = Vec::new();
    let read = file.take(100).read_to_end(&mut bytes);
    let text: String = String::from_utf8_lossy(&bytes).trim().chars().filter(|c| !c.is_control()).collect();
    if read.is_err() || text.is_empty() { "another process".to_owned() } else { text }
}

fn host() -> String {
    let name = platform::host_name().unwrap_or_default();
    if name.trim().is_empty() { "an unnamed host".to_owned() } else { name.trim().to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn the_second_is_told_who_was_first() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.chpm");
        let first = Lock::acquire(&target).unwrap();
        let error = Lock::acquire(&target).unwrap_err();
        let owner = format!("process {} on ", std::process::id());
        assert!(matches!(error, ExtmemError::Locked { .. }));
        assert!(error.to_string().contains(&owner) && error.to_string().contains("model.chpm"), "{error}");
        let other = Lock::acquire(&dir.path().join("other.chpm")).unwrap();
        let long = ["a", "b"].map(|last| Lock::acquire(&dir.path().join("x".repeat(254) + last)).unwrap());
        assert!(Lock::acquire(&dir.path().join("x".repeat(254) + "b")).is_err());
        drop((first, other, long));
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        Lock::acquire(&target).unwrap();
    }

    #[test]
    fn what_the_dead_leave_is_taken_over() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.chpm");
        let left = dir.path().join(".model.chpm.lock");
        fs::write(&left, "process 1 on a machine with a rather long name that is gone").unwrap();
        let lock = Lock::acquire(&target).unwrap();
        assert_eq!(
            fs::read_to_string(&left).unwrap(),
            format!("process {} on {}\n", std::process::id(), host())
        );
        drop(lock);
        assert!(!left.exists());
    }

    #[test]
    fn many_threads_are_never_two_inside() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.chpm");
        let (inside, taken, start) = (AtomicU32::new(0), AtomicU32::new(0), Barrier::new(4));

        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    start.wait();
                    for _ in 0..500 {
                        match Lock::acquire(&target) {
                            Ok(lock) => {
                                assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                                taken.fetch_add(1, Ordering::SeqCst);
                                inside.fetch_sub(1, Ordering::SeqCst);
                                drop(lock);
                            }
                            Err(error) => assert!(matches!(error, ExtmemError::Locked { .. }), "{error}"),
                        }
                    }
                });
            }
        });

        assert!(taken.load(Ordering::SeqCst) > 0);
        assert!(!dir.path().join(".model.chpm.lock").exists());
    }

    #[test]
    fn places_that_hold_no_file_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(Lock::acquire(Path::new("/")), Err(ExtmemError::NotAFile { .. })));
        let error = Lock::acquire(&dir.path().join("missing/model.chpm")).unwrap_err();
        assert!(matches!(error, ExtmemError::NoFolder { .. }), "{error}");
        assert!(!error.to_string().contains(".lock"), "{error}");
    }
}
