//! Left-over files of killed processes, told from live ones by a lock of the kernel (`flock`) on the file or folder itself, which is given back
//! however a process ends.
//!
//! Where a file system has no such locks, nothing is ever taken for left.

use crate::platform::{is_at, open_folder};
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;

/// Takes what was just made at `path` for the time that `made` is open, unless somebody has cleared it away already.
pub(crate) fn hold(made: &File, path: &Path) -> bool {
    let is_held = !matches!(made.try_lock(), Err(TryLockError::WouldBlock));
    is_held && is_at(made, path)
}

/// Removes the file or folder at `path`, unless somebody holds it.
pub(crate) fn clear(path: &Path) {
    let Ok(kind) = fs::symlink_metadata(path).map(|found| found.file_type()) else { return };
    if !kind.is_file() && !kind.is_dir() {
        return;
    }
    // Some file systems lock only what is open for writing; folders never are.
    fn open(path: &Path, is_folder: bool) -> io::Result<File> {
        if is_folder { open_folder(path) } else { File::options().read(true).write(true).open(path) }
    }
    let Ok(left) = open(path, kind.is_dir()) else { return };
    // Until the lock was there, another may have removed it, and a third made it anew.
    if left.try_lock().is_ok() && is_at(&left, path) {
        let removed = if kind.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
        // Some systems remove only what nobody has open; a folder of this kind is never made anew by the same name.
        if removed.is_err() && kind.is_dir() {
            drop(left);
            let _ = fs::remove_dir_all(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn what_is_held_stays_and_what_is_left_goes() {
        let dir = tempfile::tempdir().unwrap();
        let (file, folder) = (dir.path().join("file"), dir.path().join("folder"));
        let made = File::create(&file).unwrap();
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join("inner"), "").unwrap();
        let opened = File::open(&folder).unwrap();
        assert!(hold(&made, &file) && hold(&opened, &folder));
        clear(&file);
        clear(&folder);
        assert!(file.exists() && folder.join("inner").exists());
        drop((made, opened));
        symlink("file", dir.path().join("link")).unwrap();
        clear(&dir.path().join("link"));
        clear(&dir.path().join("absent"));
        assert!(file.exists() && dir.path().join("link").is_symlink(), "a link is nobody's work");
        clear(&file);
        clear(&folder);
        assert!(!file.exists() && !folder.exists());
    }

    #[test]
    fn what_was_cleared_away_at_once_is_not_held() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        let made = File::create(&path).unwrap();
        clear(&path);
        assert!(!hold(&made, &path) && !path.exists());
        let (first, _second) = (File::create(&path).unwrap(), File::create(&path).unwrap());
        fs::remove_file(&path).unwrap();
        File::create(&path).unwrap();
        assert!(!hold(&first, &path), "another has the name");
    }

    #[test]
    fn what_is_held_is_never_cleared_by_others() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        let held = AtomicU32::new(0);

        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..300 {
                        clear(&path);
                        let Ok(made) = File::options().write(true).create_new(true).open(&path) else {
                            continue;
                        };
                        if hold(&made, &path) {
                            assert_eq!(held.fetch_add(1, Ordering::SeqCst), 0);
                            assert!(is_at(&made, &path));
                            held.fetch_sub(1, Ordering::SeqCst);
                            fs::remove_file(&path).unwrap();
                        }
                    }
                });
            }
        });
    }
}
