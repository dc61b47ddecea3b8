//! Files that one process leaves for others: blobs end to end, behind them a record, and a short head that says what the file is. Hashes of all stand at the
//! end, and their own hash is the file's identity: whoever refers to a file by that gets what was meant, or an error.
//!
//! A file appears whole or not at all. Head and hashes are checked when it is opened, the record where it is read, the blobs block by block where they are
//! read: so whoever opens a large file, or reads some blobs of it, reads little more than these.

use crate::{AtomicFile, ExtmemError, FailPoints, platform};
use bytemuck::Pod;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use xxhash_rust::xxh3::Xxh3;

/// The last digit is the version of what surrounds the record.
const MAGIC: [u8; 8] = *b"CHPMPRT2";
/// Lengths of blobs, record and head, hash of the record, identity, magic.
const TRAILER: usize = 48;
/// Bytes of blobs that have one hash.
const BLOCK: usize = 1 << 15;

/// A part on its way.
pub struct PartWriter {
    out: AtomicFile,
    len: u64,
    hashes: Vec<u64>,
    block: Xxh3,
}

impl fmt::Debug for PartWriter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PartWriter").field("out", &self.out).field("len", &self.len).finish_non_exhaustive()
    }
}

impl PartWriter {
    /// Begins the file `path`, which replaces what has the name when it is whole.
    ///
    /// # Errors
    /// As [`AtomicFile::create_with`].
    pub fn create(path: &Path, fail_points: FailPoints) -> Result<Self, ExtmemError> {
        let out = AtomicFile::create_with(path, true, fail_points)?;
        Ok(PartWriter { out, len: 0, hashes: Vec::new(), block: Xxh3::new() })
    }

    /// Appends a blob, and answers where it begins.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`].
    pub fn append(&mut self, blob: &[u8]) -> Result<u64, ExtmemError> {
        let offset = self.len;
        let mut rest = blob;
        while !rest.is_empty() {
            let open = BLOCK - (self.len % BLOCK as u64) as usize;
            let (piece, tail) = rest.split_at(rest.len().min(open));
            self.block.update(piece);
            self.len += piece.len() as u64;
            if piece.len() == open {
                self.close_block();
            }
            rest = tail;
        }
        self.write(blob)?;
        Ok(offset)
    }

    /// Bytes so far.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Whether there is nothing yet.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Ends the file with its record and its head, and publishes it. Answers its identity.
    ///
    /// # Errors
    /// As [`AtomicFile::publish`].
    pub fn finish(mut self, head: &[u8], record: &[u8]) -> Result<u64, ExtmemError> {
        if !self.len.is_multiple_of(BLOCK as u64) {
            self.close_block();
        }
        let numbers = [self.len, record.len() as u64, head.len() as u64, hash_of(record)];
        let id = identity(head, &self.hashes, numbers);
        self.write(record)?;
        let hashes: Vec<u8> = self.hashes.iter().flat_map(|hash| hash.to_le_bytes()).collect();
        self.write(&hashes)?;
        self.write(head)?;
        let tail: Vec<u8> = numbers.iter().chain([&id]).flat_map(|number| number.to_le_bytes()).collect();
        self.write(&tail)?;
        self.write(&MAGIC)?;
        self.out.publish()?;
        Ok(id)
    }

    fn close_block(&mut self) {
        self.hashes.push(self.block.digest());
        self.block.reset();
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), ExtmemError> {
        self.out.write_all(bytes).map_err(|error| self.out.error(error))
    }
}

fn hash_of(bytes: &[u8]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(bytes);
    hash.digest()
}

fn identity(head: &[u8], hashes: &[u64], numbers: [u64; 4]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(head);
    hashes.iter().chain(&numbers).for_each(|number| hash.update(&number.to_le_bytes()));
    hash.digest()
}

/// A part that was written.
#[derive(Debug)]
pub struct PartFile {
    file: File,
    path: PathBuf,
    fail_points: FailPoints,
    len: u64,
    record_len: usize,
    record_hash: u64,
    head: Vec<u8>,
    hashes: Vec<u64>,
    /// A bit for each block that was found to be whole.
    checked: Vec<AtomicU64>,
    id: u64,
}

impl PartFile {
    /// Opens a file and checks all but its blobs and its record.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if it is not there or is not what was written, [`ExtmemError::Io`].
    pub fn open(path: &Path, fail_points: FailPoints) -> Result<Self, ExtmemError> {
        let damaged = |reason| ExtmemError::Damaged { path: path.to_owned(), reason };
        let failed = |error| ExtmemError::io("read", path, 0, error);
        let opened = fail_points.access().and_then(|()| File::open(path));
        let file = opened.map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => damaged("is not there"),
            _ => failed(error),
        })?;
        let size = file.metadata().map_err(failed)?.len();

        let mut trailer = [0; TRAILER];
        let Some(at) = size.checked_sub(TRAILER as u64) else { return Err(damaged("is too short")) };
        platform::read_exact_at(&file, &mut trailer, at).map_err(failed)?;
        let (numbers, magic) = trailer.split_at(TRAILER - MAGIC.len());
        if magic != MAGIC {
            return Err(damaged("is not whole, or of another version"));
        }
        let numbers = numbers.as_chunks::<8>().0;
        let [len, record_len, head_len, record_hash, id] =
            [0, 1, 2, 3, 4].map(|number| u64::from_le_bytes(numbers[number]));
        // Lengths that come to those of the file are no longer than it.
        let blocks = len.div_ceil(BLOCK as u64);
        let hashes_at = len.checked_add(record_len);
        let head_at = blocks.checked_mul(8).and_then(|hashes| hashes.checked_add(hashes_at?));
        let (Some(hashes_at), Some(head_at)) = (hashes_at, head_at) else {
            return Err(damaged("is not as long as it says"));
        };
        if head_at.checked_add(head_len) != Some(at) {
            return Err(damaged("is not as long as it says"));
        }

        let mut hashes = vec![0; 8 * blocks as usize];
        platform::read_exact_at(&file, &mut hashes, hashes_at).map_err(failed)?;
        let hashes: Vec<u64> =
            hashes.as_chunks::<8>().0.iter().map(|hash| u64::from_le_bytes(*hash)).collect();
        let mut head = vec![0; head_len as usize];
        platform::read_exact_at(&file, &mut head, head_at).map_err(failed)?;
        if identity(&head, &hashes, [len, record_len, head_len, record_hash]) != id {
            return Err(damaged("is not what was written"));
        }
        let checked = (0..blocks.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let (path, record_len) = (path.to_owned(), record_len as usize);
        Ok(PartFile { file, path, fail_points, len, record_len, record_hash, head, hashes, checked, id })
    }

    /// The head: what the file is.
    pub fn head(&self) -> &[u8] {
        &self.head
    }

    /// The record, read and checked.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if it is not what was written, [`ExtmemError::Io`].
    pub fn record(&self) -> Result<Vec<u8>, ExtmemError> {
        let mut record = vec![0; self.record_len];
        self.read(&mut record, self.len)?;
        if hash_of(&record) != self.record_hash {
            return Err(self.damaged());
        }
        Ok(record)
    }

    fn damaged(&self) -> ExtmemError {
        ExtmemError::Damaged { path: self.path.clone(), reason: "is not what was written" }
    }

    /// The identity: that of another content is another.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// Bytes of all blobs.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Whether there are no blobs.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Fills `out` with the blobs' bytes from `offset` on, which were checked.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if they are not what was written, [`ExtmemError::OutOfRange`], [`ExtmemError::Io`].
    pub fn read_exact(&self, mut offset: u64, mut out: &mut [u8]) -> Result<(), ExtmemError> {
        self.check_range(offset, out.len() as u64)?;
        let mut scratch = Vec::new();
        while !out.is_empty() {
            let (block, start) = (offset / BLOCK as u64, (offset % BLOCK as u64) as usize);
            let (piece, rest) = out.split_at_mut(out.len().min(BLOCK - start));
            if self.is_checked(block) {
                self.read(piece, offset)?;
            } else {
                self.check(block, &mut scratch)?;
                piece.copy_from_slice(&scratch[start..start + piece.len()]);
            }
            offset += piece.len() as u64;
            out = rest;
        }
        Ok(())
    }

    /// As many records of the blobs, from `offset` on, which were checked. There is memory for no more than the file has.
    ///
    /// # Errors
    /// As [`Self::read_exact`].
    pub fn read_items<T: Pod>(&self, offset: u64, count: usize) -> Result<Vec<T>, ExtmemError> {
        self.check_range(offset, (count as u64).saturating_mul(size_of::<T>() as u64))?;
        let mut items = vec![T::zeroed(); count];
        self.read_exact(offset, bytemuck::cast_slice_mut(&mut items))?;
        Ok(items)
    }

    /// An error unless the blobs have so many bytes from `offset` on.
    pub(crate) fn check_range(&self, offset: u64, len: u64) -> Result<(), ExtmemError> {
        match offset.checked_add(len) {
            Some(end) if end <= self.len => Ok(()),
            _ => Err(ExtmemError::OutOfRange { what: "a part", offset, len, size: self.len }),
        }
    }

    /// Checks the record and all blobs.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if one is not what was written, [`ExtmemError::Io`].
    pub fn check_all(&self) -> Result<(), ExtmemError> {
        self.record()?;
        let mut scratch = Vec::new();
        (0..self.hashes.len() as u64).try_for_each(|block| self.check(block, &mut scratch))
    }

    fn is_checked(&self, block: u64) -> bool {
        self.checked[block as usize / 64].load(Relaxed) & 1 << (block % 64) != 0
    }

    /// Reads a block and compares its hash.
    fn check(&self, block: u64, scratch: &mut Vec<u8>) -> Result<(), ExtmemError> {
        let start = block * BLOCK as u64;
        scratch.resize((self.len - start).min(BLOCK as u64) as usize, 0);
        self.read(scratch, start)?;
        if hash_of(scratch) != self.hashes[block as usize] {
            return Err(self.damaged());
        }
        self.checked[block as usize / 64].fetch_or(1 << (block % 64), Relaxed);
        Ok(())
    }

    fn read(&self, out: &mut [u8], offset: u64) -> Result<(), ExtmemError> {
        let read = self.fail_points.access().and_then(|()| platform::read_exact_at(&self.file, out, offset));
        read.map_err(|error| ExtmemError::io("read", &self.path, 0, error))
    }
}

/// The parts in a folder, each opened once.
#[derive(Debug)]
pub struct PartFolder {
    path: PathBuf,
    fail_points: FailPoints,
    opened: Mutex<BTreeMap<String, Arc<PartFile>>>,
}

impl PartFolder {
    /// Those in the folder `path`.
    pub fn new(path: &Path, fail_points: FailPoints) -> Self {
        PartFolder { path: path.to_owned(), fail_points, opened: Mutex::default() }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The part of a name.
    ///
    /// # Errors
    /// As [`PartFile::open`].
    pub fn open(&self, name: &str) -> Result<Arc<PartFile>, ExtmemError> {
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(part) = opened.get(name) {
            return Ok(Arc::clone(part));
        }
        let part = Arc::new(PartFile::open(&self.path.join(name), self.fail_points.clone())?);
        opened.insert(name.to_owned(), Arc::clone(&part));
        Ok(part)
    }

    /// The part of a name, which must be the one that something was made of.
    ///
    /// # Errors
    /// As [`Self::open`]; [`ExtmemError::Damaged`] if its identity is not `id`.
    pub fn open_same(&self, name: &str, id: u64) -> Result<Arc<PartFile>, ExtmemError> {
        let part = self.open(name)?;
        if part.id() != id {
            let reason = "is another one than what was made of it says; make that again";
            return Err(ExtmemError::Damaged { path: part.path().to_owned(), reason });
        }
        Ok(part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(path: &Path, blobs: &[Vec<u8>]) -> (Vec<u64>, u64) {
        let mut part = PartWriter::create(path, FailPoints::default()).unwrap();
        let places = blobs.iter().map(|blob| part.append(blob).unwrap()).collect();
        (places, part.finish(b"the head", b"the record").unwrap())
    }

    fn blobs() -> Vec<Vec<u8>> {
        [0, 1, 70_000, BLOCK - 5, 2 * BLOCK, 3].iter().zip(1..).map(|(len, byte)| vec![byte; *len]).collect()
    }

    #[test]
    fn blobs_and_record_are_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let (path, blobs) = (dir.path().join("a.part"), blobs());
        let (places, id) = write(&path, &blobs);
        let part = PartFile::open(&path, FailPoints::default()).unwrap();
        assert_eq!((part.record().unwrap(), part.id()), (b"the record".to_vec(), id));
        assert_eq!(part.head(), b"the head");
        // Twice: the second time blocks are known to be whole.
        for (blob, place) in blobs.iter().zip(&places).cycle().take(2 * blobs.len()) {
            let mut out = vec![0; blob.len()];
            part.read_exact(*place, &mut out).unwrap();
            assert_eq!(out, *blob);
        }
        part.check_all().unwrap();
        assert!(part.read_exact(part.len(), &mut [0]).is_err());
        assert_eq!(write(&dir.path().join("b.part"), &blobs).1, id, "the same content");
    }

    #[test]
    fn any_byte_that_changes_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.part");
        let (places, _) = write(&path, &blobs());
        let whole = std::fs::read(&path).unwrap();
        for at in (0..whole.len()).step_by(9973).chain(whole.len() - 120..whole.len()) {
            let mut bytes = whole.clone();
            bytes[at] ^= 4;
            std::fs::write(&path, &bytes).unwrap();
            let found = PartFile::open(&path, FailPoints::default()).and_then(|part| part.check_all());
            assert!(matches!(found, Err(ExtmemError::Damaged { .. })), "{at}: {found:?}");
        }
        for len in [0, 10, 47, 48, whole.len() - 1] {
            std::fs::write(&path, &whole[..len]).unwrap();
            let error = PartFile::open(&path, FailPoints::default()).unwrap_err();
            assert!(matches!(error, ExtmemError::Damaged { .. }), "{len}");
        }

        // Where a blob is whole, it is read though another is not.
        let mut bytes = whole.clone();
        bytes[places[4] as usize + BLOCK] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        let part = PartFile::open(&path, FailPoints::default()).unwrap();
        part.read_exact(places[2], &mut [0; 70_000]).unwrap();
        assert!(part.read_exact(places[4], &mut vec![0; 2 * BLOCK]).is_err());
    }

    #[test]
    fn lengths_that_lie_take_no_memory() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.part");
        write(&path, &blobs());
        let whole = std::fs::read(&path).unwrap();
        let size = whole.len() as u64;
        for number in 0..3 {
            for lie in [0, 1, size - TRAILER as u64, size, 1 << 40, u64::MAX - 7, u64::MAX] {
                let mut bytes = whole.clone();
                let at = whole.len() - TRAILER + 8 * number;
                bytes[at..at + 8].copy_from_slice(&lie.to_le_bytes());
                std::fs::write(&path, &bytes).unwrap();
                let error = PartFile::open(&path, FailPoints::default()).unwrap_err();
                assert!(matches!(error, ExtmemError::Damaged { .. }), "{number}: {lie}");
            }
        }
        std::fs::write(&path, &whole).unwrap();
        let part = PartFile::open(&path, FailPoints::default()).unwrap();
        for (offset, count) in [(0, usize::MAX), (u64::MAX, 1), (0, whole.len()), (1 << 40, 0)] {
            let items = part.read_items::<[u64; 2]>(offset, count);
            assert!(matches!(items, Err(ExtmemError::OutOfRange { .. })), "{offset} {count}");
        }
    }

    #[test]
    fn any_fault_is_an_error_and_nothing_half_written_appears() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.part");
        let folder = PartFolder::new(dir.path(), FailPoints::default());
        assert!(matches!(folder.open("a.part"), Err(ExtmemError::Damaged { reason: "is not there", .. })));
        for at in 0..3 {
            let make = || -> Result<u64, ExtmemError> {
                let mut part = PartWriter::create(&path, FailPoints::fail_at(at, false))?;
                part.append(b"a blob")?;
                part.finish(b"", b"")
            };
            assert!(make().is_err() && !path.exists(), "{at}");
        }
    }
}
