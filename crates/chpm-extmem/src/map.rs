//! Memory maps.
//!
//! A map is sound only while nobody else changes the file below it. Scratch files have no name, so nobody else
//! can; input files are the user's, and the documentation says not to change them during a run. Where it happens in spite of that,
//! it is an error and not the end of the process: what can no longer be read of a map reads as zeros, and
//! [`MappedFile::check_unchanged`] tells.

use crate::error::byte_len;
use crate::file::DataFile;
use crate::{ExtmemError, WorkDir, platform};
use bytemuck::Pod;
use memmap2::{Mmap, MmapMut};
use std::fs::{File, Metadata};
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

/// How a mapped range is going to be read; a hint to the operating system.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Access {
    /// Front to back, once: read far ahead.
    Sequential,
    /// Here and there: do not read ahead.
    Random,
    /// Soon and entirely: start reading now.
    WillNeed,
}

/// Bytes that the system maps with those that are touched, where they are at hand.
const AROUND: u64 = 1 << 16;

/// A file mapped for reading. An empty file is an empty slice.
#[derive(Debug)]
pub struct MappedFile {
    /// Goes before the map: its addresses may be another's right after.
    guard: Option<platform::Guard>,
    map: Option<Mmap>,
    path: PathBuf,
    file: File,
    /// Length and time of the last change when it was mapped.
    fingerprint: (u64, Option<SystemTime>),
    /// Bytes that may stay resident, and those that were read since pages were dropped.
    keep: AtomicU64,
    read: AtomicU64,
}

impl MappedFile {
    /// Maps all of the regular file `path`.
    ///
    /// The file should not be changed or truncated while it is mapped: reads would then see the change, or zeros, which
    /// [`Self::check_unchanged`] tells afterwards.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] if it cannot be opened or mapped, [`ExtmemError::NotAFile`] for directories and devices.
    pub fn open(path: &Path) -> Result<Self, ExtmemError> {
        let failed = |action| move |source| ExtmemError::io(action, path, 0, source);
        // A FIFO, which is no file to be mapped, would be waited for until somebody writes to it.
        let file = platform::open_to_read(path).map_err(failed("open"))?;
        let metadata = file.metadata().map_err(failed("examine"))?;
        if !metadata.is_file() {
            return Err(ExtmemError::NotAFile { path: path.to_path_buf() });
        }
        // An empty range cannot be mapped.
        let map = if metadata.len() == 0 {
            None
        } else {
            // SAFETY: the map is read-only and lives as long as `self`; that nobody changes the file meanwhile is
            // the documented contract of this function, and the one thing no program can check.
            Some(unsafe { Mmap::map(&file) }.map_err(failed("map"))?)
        };
        let guard = map.as_deref().and_then(platform::Guard::of);
        let (keep, read) = (AtomicU64::new(u64::MAX), AtomicU64::new(0));
        Ok(MappedFile {
            guard,
            map,
            path: path.to_path_buf(),
            file,
            fingerprint: fingerprint(&metadata),
            keep,
            read,
        })
    }

    /// The mapped file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The mapped file's path without a link at its end: what belongs to it lies there.
    pub fn real_path(&self) -> PathBuf {
        let is_link = self.path.symlink_metadata().is_ok_and(|found| found.is_symlink());
        let real = if is_link { self.path.canonicalize().ok() } else { None };
        real.unwrap_or_else(|| self.path.clone())
    }

    /// Whether all that was read up to now is of the file as it was mapped; to be asked before a result of it is used.
    ///
    /// # Errors
    /// [`ExtmemError::Changed`] if somebody has truncated or changed the file, or its disk has failed; [`ExtmemError::Io`] if it
    /// cannot be examined.
    pub fn check_unchanged(&self) -> Result<(), ExtmemError> {
        let now = self.file.metadata().map_err(|source| ExtmemError::io("examine", &self.path, 0, source))?;
        let how = match (
            now.len() < self.fingerprint.0,
            self.guard.as_ref().is_some_and(platform::Guard::is_cut),
        ) {
            (true, _) => "was cut short",
            (false, true) => "could not be read to its end",
            _ if fingerprint(&now) != self.fingerprint => "was changed",
            _ => return Ok(()),
        };
        Err(ExtmemError::Changed { path: self.path.clone(), how })
    }

    /// Tells the operating system how the file will be read. A refused hint is ignored.
    pub fn advise(&self, access: Access) {
        self.advise_range(access, 0, usize::MAX);
    }

    /// Like [`Self::advise`], for `len` bytes from `offset`; what lies beyond the end is ignored.
    pub fn advise_range(&self, access: Access, offset: usize, len: usize) {
        if let Some(map) = &self.map {
            platform::advise(map, access, offset, len);
        }
    }

    /// From now on has about `bytes` resident at most, of what [`Self::note_read`] is told about.
    pub fn keep_resident(&self, bytes: u64) {
        self.keep.store(bytes, Ordering::Relaxed);
    }

    /// Notes that a range of so many bytes is about to be read, here or in `others`, which are kept with this one, and drops what was read before if that is too much.
    pub fn note_read(&self, others: &[Self], bytes: u64) {
        let bytes = bytes.saturating_add(AROUND);
        let read = self.read.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
        if read > self.keep.load(Ordering::Relaxed) {
            self.read.store(bytes, Ordering::Relaxed);
            std::iter::once(self).chain(others).for_each(Self::release_pages);
        }
    }

    /// Drops the pages from this process's resident memory; they are read again when touched.
    fn release_pages(&self) {
        if let Some(map) = &self.map {
            platform::drop_pages(map);
        }
    }
}

impl AsRef<[u8]> for MappedFile {
    fn as_ref(&self) -> &[u8] {
        self.map.as_deref().unwrap_or_default()
    }
}

impl Deref for MappedFile {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.as_ref()
    }
}

fn fingerprint(metadata: &Metadata) -> (u64, Option<SystemTime>) {
    (metadata.len(), metadata.modified().ok())
}

/// A writable array in an unnamed file of the work directory, mapped and shared with nobody.
#[derive(Debug)]
pub struct MappedBuffer<T: Pod> {
    map: Option<MmapMut>,
    element: PhantomData<T>,
}

impl<T: Pod> MappedBuffer<T> {
    /// `len` zeroed elements. The disk space is taken now, so that a full disk is an error here and not a SIGBUS
    /// at some later write.
    ///
    /// # Errors
    /// [`ExtmemError::DiskFull`], [`ExtmemError::Io`] naming the work directory, or [`ExtmemError::TooLarge`].
    pub fn zeroed(workdir: &WorkDir, what: &'static str, len: usize) -> Result<Self, ExtmemError> {
        let bytes = byte_len::<T>(what, len)?;
        let file = workdir.unnamed_file()?;
        let allocated = workdir.fail_points().access().and_then(|()| platform::allocate(&file, bytes as u64));
        allocated.map_err(|source| {
            ExtmemError::io("extend a work file in", workdir.place(), bytes as u64, source)
        })?;
        Self::of_file(file, workdir, bytes)
    }

    /// The first `bytes` bytes of a file without a name, which were all written.
    pub(crate) fn adopt(file: DataFile, workdir: &WorkDir, bytes: usize) -> Result<Self, ExtmemError> {
        match file.into_unnamed() {
            Some(file) => Self::of_file(file, workdir, bytes),
            // A file with a name could be changed by others, and is never mapped for writing.
            None => Err(ExtmemError::NotAFile { path: workdir.path().to_owned() }),
        }
    }

    /// The first `bytes` bytes of a file from [`WorkDir::unnamed_file`], which were all written.
    fn of_file(file: File, workdir: &WorkDir, bytes: usize) -> Result<Self, ExtmemError> {
        const { assert!(size_of::<T>() > 0, "elements without size have no place in a file") };
        if bytes == 0 {
            return Ok(MappedBuffer { map: None, element: PhantomData });
        }
        // SAFETY: the file has no name and this function owns its only handle, so nobody else can change or
        // truncate it while it is mapped.
        let map = unsafe { memmap2::MmapOptions::new().len(bytes).map_mut(&file) }
            .map_err(|source| ExtmemError::io("map a work file in", workdir.place(), 0, source))?;
        Ok(MappedBuffer { map: Some(map), element: PhantomData })
    }

    /// Tells the operating system how the array will be read. A refused hint is ignored.
    pub fn advise(&self, access: Access) {
        if let Some(map) = &self.map {
            platform::advise_buffer(map, access);
        }
    }
}

impl<T: Pod> Deref for MappedBuffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // Pages are aligned for every T that a file can hold, and the length is a multiple of T's.
        match &self.map {
            Some(map) => bytemuck::cast_slice(map),
            None => &[],
        }
    }
}

impl<T: Pod> DerefMut for MappedBuffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.map {
            Some(map) => bytemuck::cast_slice_mut(map),
            None => &mut [],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn a_file_that_is_truncated_reads_as_zeros_and_is_told() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("data");
        std::fs::write(&path, vec![7; 100_000]).unwrap();
        let (map, other) = (MappedFile::open(&path).unwrap(), MappedFile::open(&path).unwrap());
        map.check_unchanged().unwrap();
        File::options().write(true).open(&path).unwrap().set_len(10_000).unwrap();
        assert_eq!((map[0], map[60_000], map[99_999]), (7, 0, 0));
        assert_eq!(map.iter().filter(|byte| **byte != 0).count(), 10_000);
        let told = map.check_unchanged().unwrap_err().to_string();
        assert!(told.contains(&format!("'{}' was cut short", path.display())), "{told}");
        // As long as before, but not what was mapped.
        let file = File::options().write(true).open(&path).unwrap();
        file.set_len(100_000).unwrap();
        file.set_modified(SystemTime::UNIX_EPOCH).unwrap();
        assert!(map.check_unchanged().unwrap_err().to_string().contains("could not be read to its end"));
        assert!(matches!(other.check_unchanged(), Err(ExtmemError::Changed { how: "was changed", .. })));
        // The place of a map that is gone is used again, without what happened to it.
        drop(map);
        std::fs::write(&path, vec![8; 100_000]).unwrap();
        let map = MappedFile::open(&path).unwrap();
        assert_eq!(map[99_999], 8);
        map.check_unchanged().unwrap();
    }

    #[test]
    fn a_file_is_seen_byte_for_byte() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("data");
        let bytes: Vec<u8> = (0..10_000u32).map(|i| (i % 251) as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        let map = MappedFile::open(&path).unwrap();
        for access in [Access::Sequential, Access::Random, Access::WillNeed] {
            map.advise(access);
            map.advise_range(access, 5000, 100_000);
            map.advise_range(access, 20_000, 1);
        }
        map.release_pages();
        assert_eq!(map.as_ref(), bytes);
        assert_eq!(map.path(), path);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn what_was_read_does_not_stay_resident_beyond_what_is_kept() {
        let _alone = crate::process::WATCHED.lock();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("data");
        std::fs::write(&path, vec![1; 96 << 20]).unwrap();
        let map = MappedFile::open(&path).unwrap();
        map.keep_resident(8 << 20);
        let before = crate::process::resident().unwrap();
        let (mut most, mut sum) = (0, 0);
        for piece in map.chunks(1 << 20) {
            map.note_read(&[], piece.len() as u64);
            sum += piece.iter().step_by(512).map(|x| u64::from(*x)).sum::<u64>();
            most = most.max(crate::process::resident().unwrap());
        }
        assert_eq!(sum, (96 << 20) / 512);
        // Other tests of this process take memory at the same time, but not so much.
        assert!(most < before + (64 << 20), "{before} and then {most}");
    }

    #[test]
    fn an_empty_file_is_an_empty_slice() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("empty");
        std::fs::write(&path, b"").unwrap();
        let map = MappedFile::open(&path).unwrap();
        map.advise(Access::Sequential);
        map.release_pages();
        assert!(map.is_empty());
    }

    #[test]
    fn what_is_no_file_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(MappedFile::open(dir.path()), Err(ExtmemError::NotAFile { .. })));
        assert!(matches!(
            MappedFile::open(&dir.path().join("missing")),
            Err(ExtmemError::Io { action: "open", .. })
        ));
    }

    #[test]
    fn a_buffer_starts_zeroed_and_keeps_what_is_written() {
        let dir = tempfile::tempdir().unwrap();
        let workdir = WorkDir::create(dir.path()).unwrap();
        let mut buffer = MappedBuffer::<u64>::zeroed(&workdir, "test", 5000).unwrap();
        assert!(buffer.len() == 5000 && buffer.iter().all(|&x| x == 0));
        for (i, x) in buffer.iter_mut().enumerate() {
            *x = i as u64 * 3;
        }
        buffer.advise(Access::Random);
        assert!(buffer.iter().enumerate().all(|(i, &x)| x == i as u64 * 3));
        assert!(MappedBuffer::<u32>::zeroed(&workdir, "test", 0).unwrap().is_empty());
        assert!(MappedBuffer::<u64>::zeroed(&workdir, "test", usize::MAX / 4).is_err());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn more_than_the_disk_holds_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let workdir = WorkDir::create(dir.path()).unwrap();
        let error = MappedBuffer::<u8>::zeroed(&workdir, "test", 1 << 60).unwrap_err();
        assert!(
            matches!(error, ExtmemError::DiskFull { needed, .. } if needed == 1 << 60)
                || matches!(error, ExtmemError::FileTooLarge { .. }),
            "{error}"
        );
    }
}
