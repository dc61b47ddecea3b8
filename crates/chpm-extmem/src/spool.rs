//! A spool of byte blobs, appended from many threads, in memory first and then in a file.

use crate::{ExtmemError, Reservation, Store};
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, PoisonError, RwLock};

/// Bytes of a segment: large enough to make bookkeeping vanish, small beside any budget.
const SEGMENT: usize = 8 << 20;

/// An append-only sequence of bytes. Blobs are laid end to end across segments; a segment is in memory if the
/// budget granted it, and from the first refusal on every further segment is in one unnamed file.
///
/// Every method takes `&self`: threads copy into different places at the same time, and wait for one another only
/// where they touch the same segment in memory.
#[derive(Debug)]
pub struct Spool {
    store: Store,
    what: &'static str,
    segment_len: usize,
    len: AtomicU64,
    segments: RwLock<Segments>,
}

#[derive(Debug, Default)]
struct Segments {
    list: Vec<Arc<Segment>>,
    file: Option<Arc<File>>,
    on_disk: u64,
}

#[derive(Debug)]
enum Segment {
    Memory { bytes: RwLock<Vec<u8>>, _share: Reservation },
    Disk { file: Arc<File>, start: u64 },
}

impl Spool {
    /// An empty spool; `what` names it in errors.
    pub fn new(store: &Store, what: &'static str) -> Self {
        Self::with_segment_len(store, what, SEGMENT)
    }

    /// An empty spool with segments of `segment_len` bytes (at least one) instead of 8 MiB.
    pub fn with_segment_len(store: &Store, what: &'static str, segment_len: usize) -> Self {
        Spool {
            store: store.clone(),
            what,
            segment_len: segment_len.max(1),
            len: AtomicU64::new(0),
            segments: RwLock::default(),
        }
    }

    /// Bytes appended so far, those of appends in progress included.
    pub fn len(&self) -> u64 {
        self.len.load(Relaxed)
    }

    /// Whether nothing was appended yet.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of segments that live in the file.
    pub fn bytes_on_disk(&self) -> u64 {
        self.segments.read().unwrap_or_else(PoisonError::into_inner).on_disk
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
        Ok(offset)
    }

    /// Replaces the bytes from `offset` on by `blob`, all of which must have been appended before.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or as [`Self::append`].
    pub fn overwrite(&self, offset: u64, blob: &[u8]) -> Result<(), ExtmemError> {
        self.check(offset, blob.len() as u64)?;
        self.put(offset, blob)
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
        let len = out.len();
        let mut rest = out;
        self.each_piece(offset, len, |segment, range| {
            let (piece, tail) = std::mem::take(&mut rest).split_at_mut(range.len());
            rest = tail;
            match segment {
                Segment::Memory { bytes, .. } => {
                    piece.copy_from_slice(&bytes.read().unwrap_or_else(PoisonError::into_inner)[range]);
                    Ok(())
                }
                Segment::Disk { file, start } => file
                    .read_exact_at(piece, start + range.start as u64)
                    .map_err(|source| self.error("read a file in", piece.len(), source)),
            }
        })
    }

    fn put(&self, offset: u64, blob: &[u8]) -> Result<(), ExtmemError> {
        let mut rest = blob;
        self.each_piece(offset, blob.len(), |segment, range| {
            let (piece, tail) = rest.split_at(range.len());
            rest = tail;
            match segment {
                Segment::Memory { bytes, .. } => {
                    bytes.write().unwrap_or_else(PoisonError::into_inner)[range].copy_from_slice(piece);
                    Ok(())
                }
                Segment::Disk { file, start } => file
                    .write_all_at(piece, start + range.start as u64)
                    .map_err(|source| self.error("write a file in", piece.len(), source)),
            }
        })
    }

    /// Visits the segments under a range, each with the part of it that the range covers.
    fn each_piece(
        &self,
        mut offset: u64,
        mut len: usize,
        mut visit: impl FnMut(&Segment, Range<usize>) -> Result<(), ExtmemError>,
    ) -> Result<(), ExtmemError> {
        while len > 0 {
            let index = (offset / self.segment_len as u64) as usize;
            let start = (offset % self.segment_len as u64) as usize;
            let piece = len.min(self.segment_len - start);
            // The list is held only for this look-up, so that it can grow while bytes are copied.
            let segments = self.segments.read().unwrap_or_else(PoisonError::into_inner);
            let Some(segment) = segments.list.get(index).map(Arc::clone) else {
                // An append of another thread has taken the range but not made its segments yet, or failed to.
                let size = segments.list.len() as u64 * self.segment_len as u64;
                return Err(ExtmemError::OutOfRange { what: self.what, offset, len: len as u64, size });
            };
            drop(segments);
            visit(&segment, start..start + piece)?;
            offset += piece as u64;
            len -= piece;
        }
        Ok(())
    }

    /// Adds segments until there are `end` bytes of them.
    fn grow(&self, end: u64) -> Result<(), ExtmemError> {
        let needed = end.div_ceil(self.segment_len as u64) as usize;
        if self.segments.read().unwrap_or_else(PoisonError::into_inner).list.len() >= needed {
            return Ok(());
        }
        let mut segments = self.segments.write().unwrap_or_else(PoisonError::into_inner);
        while segments.list.len() < needed {
            let segment = self.new_segment(&mut segments)?;
            segments.list.push(Arc::new(segment));
        }
        Ok(())
    }

    fn new_segment(&self, segments: &mut Segments) -> Result<Segment, ExtmemError> {
        let file = match &segments.file {
            Some(file) => Arc::clone(file),
            None => {
                let share = self.store.budget.try_reserve(self.what, self.segment_len as u64);
                if let Some(_share) = share
                    && let Ok(bytes) = bytemuck::try_zeroed_vec(self.segment_len)
                {
                    return Ok(Segment::Memory { bytes: RwLock::new(bytes), _share });
                }
                let file = Arc::new(self.store.workdir.unnamed_file()?);
                segments.file.insert(file).clone()
            }
        };
        let start = segments.on_disk;
        // The whole segment exists from now on, as zeros (and as a hole, where the file system knows holes).
        file.set_len(start + self.segment_len as u64)
            .map_err(|source| self.error("extend a file in", self.segment_len, source))?;
        segments.on_disk += self.segment_len as u64;
        Ok(Segment::Disk { file, start })
    }

    fn check(&self, offset: u64, len: u64) -> Result<(), ExtmemError> {
        let size = self.len();
        match offset.checked_add(len) {
            Some(end) if end <= size => Ok(()),
            _ => Err(ExtmemError::OutOfRange { what: self.what, offset, len, size }),
        }
    }

    fn error(&self, action: &'static str, needed: usize, source: std::io::Error) -> ExtmemError {
        ExtmemError::io(action, self.store.workdir.path(), needed as u64, source)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn store(limit: u64) -> (tempfile::TempDir, Store) {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), limit).unwrap();
        (dir, store)
    }

    #[test]
    fn blobs_cross_from_memory_to_disk() {
        let (_dir, store) = store(20);
        let spool = Spool::with_segment_len(&store, "blobs", 8);
        let blob: Vec<u8> = (0..50).collect();
        assert_eq!(spool.append(b"abc").unwrap(), 0);
        assert_eq!(spool.append(&blob).unwrap(), 3);
        assert_eq!((spool.len(), store.budget.used(), spool.bytes_on_disk()), (53, 16, 40));
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
