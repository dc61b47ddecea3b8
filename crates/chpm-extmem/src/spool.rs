//! A spool of byte blobs, appended from many threads, in memory first and then in a file.

use crate::saved::STEP;
use crate::segments::{Segment, Segments};
use crate::{ExtmemError, PartFile, PartFolder, SavedFile, Store};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use xxhash_rust::xxh3::Xxh3;

/// Bytes of a segment: large enough to make bookkeeping vanish, small beside any budget.
const SEGMENT: usize = 8 << 20;

/// Some bytes of a part that another process wrote, at the beginning of a spool.
#[derive(Clone, Debug)]
pub struct Extent {
    part: Arc<PartFile>,
    start: u64,
    len: u64,
}

impl Extent {
    /// The bytes of `part` in a range.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`] if it has not so many.
    pub fn new(part: Arc<PartFile>, range: Range<u64>) -> Result<Self, ExtmemError> {
        let Range { start, end } = range;
        match end.checked_sub(start) {
            Some(len) if end <= part.len() => Ok(Extent { part, start, len }),
            _ => Err(ExtmemError::OutOfRange { what: "a part", offset: start, len: end, size: part.len() }),
        }
    }

    /// How the part is found again.
    pub(crate) fn saved(&self) -> SavedExtent {
        let name = self.part.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
        SavedExtent { name, id: self.part.id(), start: self.start, len: self.len }
    }
}

/// [`Extent`] in a record.
#[derive(Serialize, Deserialize)]
pub(crate) struct SavedExtent {
    name: String,
    id: u64,
    start: u64,
    len: u64,
}

impl SavedExtent {
    /// The bytes, in the part of `parts` that was meant.
    pub(crate) fn of(&self, parts: &PartFolder) -> Result<Extent, ExtmemError> {
        let part = parts.open_same(&self.name, self.id)?;
        Extent::new(part, self.start..self.start.saturating_add(self.len))
    }
}

/// An append-only sequence of bytes. Blobs are laid end to end across segments; a segment is in memory if the
/// budget granted it, and from the first refusal on every further segment is in one file. Work that reserves memory and does not find it moves
/// all of them there.
///
/// Every method takes `&self`: threads copy into different places at the same time, and wait for one another only
/// where they touch the same segment in memory.
///
/// ```
/// use chpm_extmem::{Spool, Store};
///
/// let store = Store::create(&std::env::temp_dir(), 1 << 20)?;
/// let spool = Spool::new(&store, "pages");
/// let place = spool.append(b"a page")?;
/// let mut page = Vec::new();
/// spool.read(place, 6, &mut page)?;
/// assert_eq!(page, b"a page");
/// # Ok::<(), chpm_extmem::ExtmemError>(())
/// ```
#[derive(Debug)]
pub struct Spool {
    store: Store,
    what: &'static str,
    segment_len: usize,
    /// Bytes that other processes wrote, with the place of each in the spool, and where it ends.
    earlier: Vec<(u64, Extent)>,
    base: u64,
    /// Bytes of its own, which come behind that.
    len: AtomicU64,
    segments: Arc<Segments>,
    /// State for another run, if the file has a name.
    saved: Option<Box<Mutex<SavedFile>>>,
}

impl Spool {
    /// An empty spool; `what` names it in errors.
    pub fn new(store: &Store, what: &'static str) -> Self {
        Self::with_segment_len(store, what, SEGMENT)
    }

    /// An empty spool that can be saved: its file has a `name`, which no other has.
    pub fn named(store: &Store, what: &'static str, name: &str) -> Self {
        Self::with(store, what, SEGMENT, Some(name))
    }

    /// An empty spool with segments of `segment_len` bytes (at least one) instead of 8 MiB.
    pub fn with_segment_len(store: &Store, what: &'static str, segment_len: usize) -> Self {
        Self::with(store, what, segment_len, None)
    }

    fn with(store: &Store, what: &'static str, segment_len: usize, name: Option<&str>) -> Self {
        let segment_len = segment_len.max(1);
        Spool {
            store: store.clone(),
            what,
            segment_len,
            earlier: Vec::new(),
            base: 0,
            len: AtomicU64::new(0),
            segments: Segments::new(store, segment_len, name),
            saved: name.map(|name| Box::new(Mutex::new(SavedFile::new(name)))),
        }
    }

    /// Has what another process wrote come next, before anything is appended.
    ///
    /// # Panics
    /// If something was appended.
    pub fn push_earlier(&mut self, extent: Extent) {
        assert_eq!(*self.len.get_mut(), 0, "what is appended comes behind what is there");
        self.earlier.push((self.base, extent.clone()));
        self.base += extent.len;
    }

    /// The same bytes behind what other processes wrote.
    pub(crate) fn with_earlier(mut self, extents: Vec<Extent>) -> Self {
        for extent in extents {
            self.earlier.push((self.base, extent));
            self.base += self.earlier[self.earlier.len() - 1].1.len;
        }
        self
    }

    /// Bytes that other processes wrote, in order.
    pub(crate) fn earlier(&self) -> impl Iterator<Item = &Extent> {
        self.earlier.iter().map(|(_, extent)| extent)
    }

    /// A spool with only what other processes wrote.
    pub fn of_others(&self, store: &Store) -> Self {
        Self::named(store, self.what, "others").with_earlier(self.earlier().cloned().collect())
    }

    /// Bytes that other processes wrote; what is appended comes behind them.
    pub fn earlier_len(&self) -> u64 {
        self.base
    }

    /// Writes what was appended since the last time to the file, and answers how another run finds all of it. No append may be in
    /// progress, and what was saved must not be overwritten.
    ///
    /// # Errors
    /// [`ExtmemError::DiskFull`] or [`ExtmemError::Io`]; [`ExtmemError::NotAFile`] if the spool has no name.
    pub fn save(&self) -> Result<SavedFile, ExtmemError> {
        let unnamed = || ExtmemError::NotAFile { path: self.store.workdir.path().to_owned() };
        let lock = self.saved.as_ref().ok_or_else(unnamed)?;
        let mut saved = locked(lock).clone();
        let (mut offset, end) = (saved.len(), self.own_len());
        if offset == end {
            return Ok(saved);
        }
        let file = self.segments.file()?;
        let name = file.name().ok_or_else(unnamed)?;
        let (mut hash, mut scratch) = (Xxh3::new(), vec![0; STEP.min((end - offset) as usize)]);

        while offset < end {
            let step = STEP.min((end - offset) as usize);
            self.each_piece(offset, step, |segment, range, at| {
                let piece = &mut scratch[..range.len()];
                let was_on_disk = segment.read(range, at, piece)?;
                hash.update(piece);
                if was_on_disk { Ok(()) } else { file.write_all_at(piece, at) }
            })?;
            offset += step as u64;
        }

        file.sync()?;
        self.store.workdir.protect(name);
        saved.extend(end, hash.digest());
        *locked(lock) = saved.clone();
        Ok(saved)
    }

    /// The spool that another run saved. What it holds stays on disk.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if it is not what was saved, [`ExtmemError::Io`].
    pub fn load(
        store: &Store,
        what: &'static str,
        name: &str,
        saved: &SavedFile,
    ) -> Result<Self, ExtmemError> {
        let spool = Self::named(store, what, name);
        if !saved.is_empty() {
            spool.segments.adopt(saved.open(&store.workdir, |_| Ok(()))?, saved.len())?;
            spool.len.store(saved.len(), Relaxed);
            spool.saved.iter().for_each(|lock| *locked(lock) = saved.clone());
        }
        Ok(spool)
    }

    /// Bytes appended so far, those of appends in progress included, and those that others wrote.
    pub fn len(&self) -> u64 {
        self.base + self.own_len()
    }

    fn own_len(&self) -> u64 {
        self.len.load(Relaxed)
    }

    /// Whether nothing was appended yet.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends `blob` and returns the offset of its first byte. Where it lies among blobs of other threads depends
    /// on who comes first; callers that need an order sort by their own keys.
    ///
    /// # Errors
    /// [`ExtmemError::DiskFull`] or [`ExtmemError::Io`] naming the work directory; the blob's range is then lost.
    pub fn append(&self, blob: &[u8]) -> Result<u64, ExtmemError> {
        let offset = self.len.fetch_add(blob.len() as u64, Relaxed);
        self.grow(offset + blob.len() as u64)?;
        self.put(offset, blob)?;
        Ok(self.base + offset)
    }

    /// Replaces the bytes from `offset` on by `blob`, all of which must have been appended before.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or as [`Self::append`].
    pub fn overwrite(&self, offset: u64, blob: &[u8]) -> Result<(), ExtmemError> {
        self.check(offset, blob.len() as u64)?;
        let (what, len, size) = (self.what, blob.len() as u64, self.len());
        let own = offset.checked_sub(self.base);
        self.put(own.ok_or(ExtmemError::OutOfRange { what, offset, len, size })?, blob)
    }

    /// Makes `out` the `len` bytes from `offset` on. They are whole once the appends that wrote them have returned.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or [`ExtmemError::Io`] naming the work directory.
    pub fn read(&self, offset: u64, len: usize, out: &mut Vec<u8>) -> Result<(), ExtmemError> {
        self.check(offset, len as u64)?;
        out.clear();
        out.resize(len, 0);
        self.read_exact(offset, out)
    }

    /// Fills `out` with the bytes from `offset` on.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_exact(&self, offset: u64, out: &mut [u8]) -> Result<(), ExtmemError> {
        self.check(offset, out.len() as u64)?;
        let of_others = self.base.saturating_sub(offset).min(out.len() as u64) as usize;
        let (earlier, out) = out.split_at_mut(of_others);
        self.read_earlier(offset, earlier)?;

        let (len, own) = (out.len(), (offset + of_others as u64).saturating_sub(self.base));
        let mut rest = out;
        self.each_piece(own, len, |segment, range, at| {
            let (piece, tail) = std::mem::take(&mut rest).split_at_mut(range.len());
            rest = tail;
            segment.read(range, at, piece).map(|_| ())
        })
    }

    fn read_earlier(&self, mut offset: u64, mut out: &mut [u8]) -> Result<(), ExtmemError> {
        while !out.is_empty() {
            let next = self.earlier.partition_point(|(begin, _)| *begin <= offset);
            let (begin, extent) = &self.earlier[next - 1];
            let inside = offset - begin;
            let (piece, rest) = out.split_at_mut((extent.len - inside).min(out.len() as u64) as usize);
            extent.part.read_exact(extent.start + inside, piece)?;
            offset += piece.len() as u64;
            out = rest;
        }
        Ok(())
    }

    fn put(&self, offset: u64, blob: &[u8]) -> Result<(), ExtmemError> {
        let mut rest = blob;
        self.each_piece(offset, blob.len(), |segment, range, at| {
            let (piece, tail) = rest.split_at(range.len());
            rest = tail;
            segment.put(range, at, piece)
        })
    }

    /// Visits the segments under a range, each with the part of it that the range covers, and where that begins in the spool.
    fn each_piece(
        &self,
        mut offset: u64,
        mut len: usize,
        mut visit: impl FnMut(&Segment, Range<usize>, u64) -> Result<(), ExtmemError>,
    ) -> Result<(), ExtmemError> {
        while len > 0 {
            let index = (offset / self.segment_len as u64) as usize;
            let start = (offset % self.segment_len as u64) as usize;
            let piece = len.min(self.segment_len - start);
            let Some(segment) = self.segments.get(index) else {
                // An append of another thread has taken the range but not made its segments yet, or failed to.
                let size = self.segments.count() as u64 * self.segment_len as u64;
                return Err(ExtmemError::OutOfRange { what: self.what, offset, len: len as u64, size });
            };
            visit(&segment, start..start + piece, offset)?;
            offset += piece as u64;
            len -= piece;
        }
        Ok(())
    }

    /// Adds segments until there are `end` bytes of them.
    fn grow(&self, end: u64) -> Result<(), ExtmemError> {
        let needed = end.div_ceil(self.segment_len as u64) as usize;
        self.segments.grow(&self.store, self.what, needed)
    }

    fn check(&self, offset: u64, len: u64) -> Result<(), ExtmemError> {
        let size = self.len();
        match offset.checked_add(len) {
            Some(end) if end <= size => Ok(()),
            _ => Err(ExtmemError::OutOfRange { what: self.what, offset, len, size }),
        }
    }
}

fn locked(saved: &Mutex<SavedFile>) -> MutexGuard<'_, SavedFile> {
    saved.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MemoryBudget;
    use proptest::prelude::*;

    fn store(limit: u64) -> (tempfile::TempDir, Store) {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), limit).unwrap();
        (dir, store)
    }

    #[test]
    fn what_others_wrote_comes_first() {
        let (dir, store) = store(0);
        let [first, second] = ["a.part", "b.part"].map(|name| {
            let path = dir.path().join(name);
            let mut part = crate::PartWriter::create(&path, crate::FailPoints::default()).unwrap();
            part.append(name.as_bytes()).unwrap();
            part.finish(b"", b"").unwrap();
            Arc::new(PartFile::open(&path, crate::FailPoints::default()).unwrap())
        });
        let mut spool = Spool::new(&store, "blobs");
        spool.push_earlier(Extent::new(Arc::clone(&first), 2..6).unwrap());
        spool.push_earlier(Extent::new(Arc::clone(&second), 0..0).unwrap());
        spool.push_earlier(Extent::new(second, 0..1).unwrap());
        assert!(Extent::new(first, 2..7).is_err());
        assert_eq!((spool.append(b"own").unwrap(), spool.len(), spool.earlier_len()), (5, 8, 5));
        let mut out = Vec::new();
        for (offset, text) in [(0, "part"), (0, "partbown"), (3, "tb"), (4, "bo"), (5, "own"), (8, "")] {
            spool.read(offset, text.len(), &mut out).unwrap();
            assert_eq!(out, text.as_bytes(), "{offset}");
        }
        spool.overwrite(6, b"ld").unwrap();
        spool.read(4, 4, &mut out).unwrap();
        assert_eq!(out, b"bold");
        assert!(spool.overwrite(4, b"c").is_err(), "it is another's");
        assert!(spool.read(5, 4, &mut out).is_err());
    }

    #[test]
    fn blobs_cross_from_memory_to_disk() {
        let (_dir, store) = store(20);
        let spool = Spool::with_segment_len(&store, "blobs", 8);
        let blob: Vec<u8> = (0..50).collect();
        assert_eq!(spool.append(b"abc").unwrap(), 0);
        assert_eq!(spool.append(&blob).unwrap(), 3);
        assert_eq!((spool.len(), store.budget.used()), (53, 16), "the rest is on disk");
        let mut out = vec![9; 3];
        spool.read(3, 50, &mut out).unwrap();
        assert_eq!(out, blob);
        spool.overwrite(10, &[255; 20]).unwrap();
        spool.read(0, 53, &mut out).unwrap();
        assert_eq!(out, [&b"abc"[..], &blob[..7], &[255; 20], &blob[27..]].concat());
        drop(spool);
        assert_eq!(store.budget.used(), 0);
    }

    #[test]
    fn work_that_does_not_fit_moves_it_to_disk() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::with_budget(dir.path(), MemoryBudget::with_work_limit(40, 100)).unwrap();
        let spool = Spool::with_segment_len(&store, "blobs", 8);
        spool.append(b"0123456789abcdefghi").unwrap();
        let other = Spool::with_segment_len(&store, "blobs", 8);
        other.append(b"xyz").unwrap();
        assert_eq!(store.budget.used(), 32);

        // The older one is enough.
        let mut work = store.budget.reserve_work("work", 90).unwrap();
        assert_eq!(store.budget.used(), 98);
        work.resize(100).unwrap();
        assert_eq!(store.budget.used(), 100);
        assert!(store.budget.reserve_work("more", 1).is_err());
        drop(work);

        spool.overwrite(7, b"--").unwrap();
        spool.append(b"jkl").unwrap();
        let mut out = Vec::new();
        spool.read(0, 22, &mut out).unwrap();
        assert_eq!(out, b"0123456--9abcdefghijkl");
        other.read(0, 3, &mut out).unwrap();
        assert_eq!((&out[..], store.budget.used()), (&b"xyz"[..], 0), "what moved stays on disk");
    }

    #[test]
    fn ranges_beyond_the_end_are_refused() {
        let (_dir, store) = store(1 << 10);
        let spool = Spool::with_segment_len(&store, "blobs", 64);
        assert!(spool.is_empty());
        spool.append(b"0123456789").unwrap();
        let mut out = Vec::new();
        for (offset, len) in [(0, 11), (10, 1), (u64::MAX, 2)] {
            assert!(matches!(
                spool.read(offset, len, &mut out),
                Err(ExtmemError::OutOfRange { size: 10, .. })
            ));
            assert!(spool.overwrite(offset, &vec![0; len]).is_err());
        }
        spool.read(10, 0, &mut out).unwrap();
        assert!(out.is_empty());
    }

    #[test]
    fn threads_append_side_by_side_and_find_their_own() {
        for limit in [0, 1000, 1 << 20] {
            let (_dir, store) = store(limit);
            let spool = Spool::with_segment_len(&store, "blobs", 128);

            let written: Vec<Vec<(u64, Vec<u8>)>> = std::thread::scope(|scope| {
                let spool = &spool;
                let workers: Vec<_> = (0..4u8)
                    .map(|thread| {
                        scope.spawn(move || {
                            let blob = |i: usize| vec![thread * 50 + (i % 50) as u8; 1 + (i * 37) % 300];
                            (0..200).map(|i| (spool.append(&blob(i)).unwrap(), blob(i))).collect()
                        })
                    })
                    .collect();
                workers.into_iter().map(|worker| worker.join().unwrap()).collect()
            });

            let mut blobs = written.concat();
            blobs.sort();
            let mut end = 0;
            let mut out = Vec::new();
            for (offset, blob) in &blobs {
                assert_eq!(*offset, end, "blobs lie end to end");
                spool.read(*offset, blob.len(), &mut out).unwrap();
                assert_eq!(&out, blob);
                end += blob.len() as u64;
            }

            assert_eq!(spool.len(), end);
        }
    }

    proptest! {
        /// Appends, overwrites and reads act as on one growing vector, whatever lives where.
        #[test]
        fn a_spool_is_a_vector(
            blobs in prop::collection::vec((prop::collection::vec(any::<u8>(), 0..50), any::<u16>()), 0..30),
            limit in 0u64..600,
            segment_len in 1usize..40,
        ) {
            let (_dir, store) = store(limit);
            let spool = Spool::with_segment_len(&store, "blobs", segment_len);
            let mut plain: Vec<u8> = Vec::new();
            let mut out = Vec::new();
            for (blob, choice) in blobs {
                let at = choice as usize % (plain.len() + 1);
                if choice % 3 == 0 && at + blob.len() <= plain.len() {
                    spool.overwrite(at as u64, &blob).unwrap();
                    plain[at..at + blob.len()].copy_from_slice(&blob);
                } else {
                    prop_assert_eq!(spool.append(&blob).unwrap(), plain.len() as u64);
                    plain.extend(blob);
                }
                spool.read(at.min(plain.len()) as u64, plain.len() - at, &mut out).unwrap();
                prop_assert_eq!(&out[..], &plain[at..]);
            }
            prop_assert_eq!(spool.len(), plain.len() as u64);
        }
    }
}
