//! Memory maps: the only unsafe code of the project.
//!
//! A map is sound only while nobody else changes the file below it. Scratch files have no name, so nobody else
//! can; input files are the user's, and the documentation says not to change them during a run.

use crate::error::byte_len;
use crate::file::DataFile;
use crate::{ExtmemError, WorkDir};
use bytemuck::Pod;
use memmap2::{Advice, Mmap, MmapMut, UncheckedAdvice};
use std::fs::File;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};

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

/// A file mapped for reading. An empty file is an empty slice.
#[derive(Debug)]
pub struct MappedFile {
    map: Option<Mmap>,
    path: PathBuf,
}

impl MappedFile {
    /// Maps all of the regular file `path`.
    ///
    /// The file must not be changed or truncated while it is mapped: reads would then see the change, or end the
    /// process with SIGBUS.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] if it cannot be opened or mapped, [`ExtmemError::NotAFile`] for directories and devices.
    pub fn open(path: &Path) -> Result<Self, ExtmemError> {
        let failed = |action| move |source| ExtmemError::io(action, path, 0, source);
        let file = File::open(path).map_err(failed("open"))?;
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
        Ok(MappedFile { map, path: path.to_path_buf() })
    }

    /// The mapped file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Tells the operating system how the file will be read. A refused hint is ignored.
    pub fn advise(&self, access: Access) {
        if let Some(map) = &self.map {
            let _ = map.advise(advice(access));
        }
    }

    /// Like [`Self::advise`], for `len` bytes from `offset`; what lies beyond the end is ignored.
    pub fn advise_range(&self, access: Access, offset: usize, len: usize) {
        if let Some(map) = &self.map {
            let start = offset.min(map.len());
            let _ = map.advise_range(advice(access), start, len.min(map.len() - start));
        }
    }

    /// Drops the pages from this process's resident memory; they are read again when touched.
    pub fn release_pages(&self) {
        if let Some(map) = &self.map {
            // SAFETY: a read-only map of a file: dropped pages are read back from the file unchanged.
            let _ = unsafe { map.unchecked_advise(UncheckedAdvice::DontNeed) };
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

fn advice(access: Access) -> Advice {
    match access {
        Access::Sequential => Advice::Sequential,
        Access::Random => Advice::Random,
        Access::WillNeed => Advice::WillNeed,
    }
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
        let allocated = workdir.faults().access().and_then(|()| allocate(&file, bytes as u64));
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
            let _ = map.advise(advice(access));
        }
    }

    /// Drops the pages from this process's resident memory; they are read again when touched.
    pub fn release_pages(&self) {
        if let Some(map) = &self.map {
            // SAFETY: a shared map of a file: what was written belongs to the file and is read back from it.
            let _ = unsafe { map.unchecked_advise(UncheckedAdvice::DontNeed) };
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

/// Has the C library map heap blocks of `bytes` and more, one by one; freeing such a block unmaps it.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(crate) fn map_large_blocks(bytes: i32) {
    // SAFETY: sets a number that allocations look at from now on; the library's own lock guards it, and it may be set at
    // any time.
    let _ = unsafe { nix::libc::mallopt(nix::libc::M_MMAP_THRESHOLD, bytes) };
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) fn map_large_blocks(_: i32) {}

#[cfg(target_os = "linux")]
fn allocate(file: &File, bytes: u64) -> std::io::Result<()> {
    if bytes == 0 {
        return Ok(());
    }
    let bytes = i64::try_from(bytes).map_err(|_| std::io::ErrorKind::FileTooLarge)?;
    Ok(nix::fcntl::posix_fallocate(file, 0, bytes)?)
}

#[cfg(not(target_os = "linux"))]
fn allocate(file: &File, bytes: u64) -> std::io::Result<()> {
    file.set_len(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_buffer_starts_zeroed_and_keeps_what_is_written_when_its_pages_go() {
        let dir = tempfile::tempdir().unwrap();
        let workdir = WorkDir::create(dir.path()).unwrap();
        let mut buffer = MappedBuffer::<u64>::zeroed(&workdir, "test", 5000).unwrap();
        assert!(buffer.len() == 5000 && buffer.iter().all(|&x| x == 0));
        for (i, x) in buffer.iter_mut().enumerate() {
            *x = i as u64 * 3;
        }
        buffer.advise(Access::Random);
        buffer.release_pages();
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
