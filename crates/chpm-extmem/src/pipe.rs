//! Seekable copy of a pipe's bytes: it can be read more than once, and has a length.

use crate::platform::Pipe;
use crate::{ExtmemError, FailPoints, WorkDir};
use std::fs::File;
use std::io::{Seek, Write};
use std::path::Path;

/// Bytes that are copied at once.
const STEP: usize = 1 << 16;
/// How long a silent pipe is waited for between two looks at whether to stop, milliseconds.
const WAIT: u16 = 100;

/// Copies all that comes through the pipe `path` to a file without a name in the folder `parent`, and goes back to its
/// beginning; none if `stopped` says so, which is asked for every 64 KiB and while nothing comes.
///
/// # Errors
/// [`ExtmemError::Io`] naming the pipe or the folder, [`ExtmemError::DiskFull`].
pub fn receive(
    path: &Path,
    parent: &Path,
    fail_points: &FailPoints,
    stopped: impl Fn() -> bool,
) -> Result<Option<File>, ExtmemError> {
    let unread = |source| ExtmemError::io("read", path, 0, source);
    let mut pipe = Pipe::open(path).map_err(unread)?;
    // The file stays when its folder goes.
    let mut file = WorkDir::create(parent)?.with_fail_points(fail_points.clone()).unnamed_file()?;
    let mut bytes = vec![0; STEP];
    while !stopped() {
        let Some(count) = pipe.read(&mut bytes, WAIT).map_err(unread)? else { continue };
        let written = fail_points.access().and_then(|()| match count {
            0 => file.rewind(),
            _ => file.write_all(&bytes[..count]),
        });
        written.map_err(|source| ExtmemError::io("write to a file in", parent, count as u64, source))?;
        if count == 0 {
            return Ok(Some(file));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::sys::stat::Mode;
    use std::cell::Cell;
    use std::io::Read;

    fn fifo() -> (tempfile::TempDir, std::path::PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("pipe");
        nix::unistd::mkfifo(&path, Mode::S_IRWXU).unwrap();
        (dir, path)
    }

    #[test]
    fn a_pipe_becomes_a_file() {
        let (dir, path) = fifo();
        let sent: Vec<u8> = (0..1_000_000u32).map(|i| (i.wrapping_mul(i) >> 7) as u8).collect();
        let writer = {
            let (path, sent) = (path.clone(), sent.clone());
            std::thread::spawn(move || File::options().write(true).open(path).unwrap().write_all(&sent))
        };
        let mut file = receive(&path, dir.path(), &FailPoints::default(), || false).unwrap().unwrap();
        writer.join().unwrap().unwrap();
        let mut received = Vec::new();
        file.read_to_end(&mut received).unwrap();
        assert!(received == sent);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "only the pipe itself");
    }

    #[test]
    fn nobody_has_to_write_for_a_stop_to_be_heeded() {
        let (dir, path) = fifo();
        let asked = Cell::new(0);
        let stopped = || {
            asked.set(asked.get() + 1);
            asked.get() > 2
        };
        assert!(receive(&path, dir.path(), &FailPoints::default(), stopped).unwrap().is_none());
        assert_eq!(asked.get(), 3);
    }

    #[test]
    fn a_full_disk_names_the_folder() {
        let (dir, path) = fifo();
        let writer = {
            let path = path.clone();
            std::thread::spawn(move || File::options().write(true).open(path).unwrap().write_all(b"x"))
        };
        // The first access makes the file.
        let error = receive(&path, dir.path(), &FailPoints::fail_at(1, true), || false).unwrap_err();
        writer.join().unwrap().unwrap();
        assert!(matches!(&error, ExtmemError::DiskFull { path, .. } if path == dir.path()), "{error}");
    }
}
