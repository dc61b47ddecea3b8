//! Arrays that are reached by ranges: in memory when the budget grants it, else in an unnamed file that is read and written
//! at its offsets, or in a part that another process wrote. Nothing is mapped, so an array on disk takes no memory but what its reader hands in.

use crate::error::byte_len;
use crate::file::{Appender, DataFile};
use crate::saved::STEP;
use crate::{BufferWriter, ExtmemError, PartFile, PartWriter, Reservation, SavedFile, Store};
use bytemuck::Pod;
use std::ops::Range;
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3;

/// An array of records, read and written by ranges.
///
/// ```
/// use chpm_extmem::{Column, Store};
///
/// // Nothing fits a budget of no bytes, so that the column lies on disk.
/// let store = Store::create(&std::env::temp_dir(), 0)?;
/// let mut column = Column::zeroed(&store, "numbers", 1000)?;
/// column.write(10, &[1u32, 2, 3])?;
/// assert!(column.is_on_disk());
/// assert_eq!(column.read(9..12, &mut Vec::new())?, [0, 1, 2]);
/// # Ok::<(), chpm_extmem::ExtmemError>(())
/// ```
#[derive(Debug)]
pub struct Column<T: Pod> {
    place: Storage<T>,
    len: usize,
    what: &'static str,
}

#[derive(Debug)]
enum Storage<T: Pod> {
    Memory {
        data: Vec<T>,
        _reservation: Reservation,
    },
    Disk(DataFile),
    /// From an offset on in what another process wrote; it stays as it is.
    Part {
        part: Arc<PartFile>,
        offset: u64,
    },
}

impl<T: Pod> Column<T> {
    /// `len` zeroed elements; `what` names the array in errors.
    ///
    /// # Errors
    /// [`ExtmemError::DiskFull`] or [`ExtmemError::Io`] when the budget refuses and the disk does too,
    /// [`ExtmemError::TooLarge`] for a length that cannot be addressed.
    pub fn zeroed(store: &Store, what: &'static str, len: usize) -> Result<Self, ExtmemError> {
        let bytes = byte_len::<T>(what, len)? as u64;
        let in_memory = store
            .budget
            .try_reserve(what, bytes)
            .and_then(|reservation| Some((bytemuck::try_zeroed_vec(len).ok()?, reservation)));
        if let Some((data, reservation)) = in_memory {
            return Ok(Self::in_memory(what, data, reservation));
        }
        let file = DataFile::create(&store.workdir, None)?;
        file.set_len(bytes)?;
        Ok(Self::on_disk(what, file, len))
    }

    pub(crate) fn in_memory(what: &'static str, data: Vec<T>, reservation: Reservation) -> Self {
        Column { len: data.len(), place: Storage::Memory { data, _reservation: reservation }, what }
    }

    /// The first `len` elements of a file.
    pub(crate) fn on_disk(what: &'static str, file: DataFile, len: usize) -> Self {
        Column { place: Storage::Disk(file), len, what }
    }

    /// `len` elements that another process wrote, from `offset` on. They cannot be changed.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`] if the part has not so many.
    pub fn in_part(
        what: &'static str,
        part: Arc<PartFile>,
        offset: u64,
        len: usize,
    ) -> Result<Self, ExtmemError> {
        part.check_range(offset, byte_len::<T>(what, len)? as u64)?;
        Ok(Column { place: Storage::Part { part, offset }, len, what })
    }

    /// Appends the elements of a range to a part.
    ///
    /// # Errors
    /// As [`Self::read`] and [`PartWriter::append`].
    pub fn append_to(&self, range: Range<usize>, out: &mut PartWriter) -> Result<(), ExtmemError> {
        let mut scratch = Vec::new();
        pieces::<T>(range).try_for_each(|range| {
            out.append(bytemuck::cast_slice(self.read(range, &mut scratch)?))?;
            Ok(())
        })
    }

    /// The same array on disk.
    ///
    /// # Errors
    /// [`ExtmemError::DiskFull`] or [`ExtmemError::Io`].
    pub fn moved_to_disk(self, store: &Store) -> Result<Self, ExtmemError> {
        let Storage::Memory { data, .. } = &self.place else { return Ok(self) };
        let mut out = Appender::new(DataFile::create(&store.workdir, None)?);
        out.append(bytemuck::cast_slice(data))?;
        Ok(Self::on_disk(self.what, out.finish()?, self.len))
    }

    /// Copies the array to the file `name`, for another run; the array itself may change afterwards.
    ///
    /// # Errors
    /// [`ExtmemError::DiskFull`] or [`ExtmemError::Io`].
    pub fn save(&self, store: &Store, name: &str) -> Result<SavedFile, ExtmemError> {
        let mut saved = SavedFile::new(name);
        if self.is_empty() {
            return Ok(saved);
        }
        let mut out = Appender::new(DataFile::create(&store.workdir, Some(name))?);
        let (mut hash, mut scratch) = (Xxh3::new(), Vec::new());
        for range in pieces::<T>(0..self.len) {
            let items = self.read(range, &mut scratch)?;
            hash.update(bytemuck::cast_slice(items));
            out.append(bytemuck::cast_slice(items))?;
        }
        saved.extend((self.len * size_of::<T>()) as u64, hash.digest());
        let file = out.finish()?;
        file.sync()?;
        store.workdir.protect(name);
        Ok(saved)
    }

    /// Reads back what another run saved.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if it is not what was saved; as [`BufferWriter`].
    pub fn load(store: &Store, what: &'static str, saved: &SavedFile) -> Result<Self, ExtmemError> {
        let size = size_of::<T>().max(1);
        let mut writer = BufferWriter::new(store, what, saved.len() as usize / size)?;
        // Records lie across the ends of the pieces that come.
        let (mut items, mut filled) = (vec![T::zeroed(); STEP / size + 1], 0);
        if !saved.is_empty() {
            saved.open(&store.workdir, |mut bytes| {
                while !bytes.is_empty() {
                    let gathered = bytemuck::cast_slice_mut::<T, u8>(&mut items);
                    let count = bytes.len().min(gathered.len() - filled);
                    gathered[filled..filled + count].copy_from_slice(&bytes[..count]);
                    (bytes, filled) = (&bytes[count..], filled + count);
                    let whole = filled / size;
                    writer.extend_from_slice(&items[..whole])?;
                    bytemuck::cast_slice_mut::<T, u8>(&mut items).copy_within(whole * size..filled, 0);
                    filled -= whole * size;
                }
                Ok(())
            })?;
        }
        writer.finish_column()
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether the array lives in a file.
    pub fn is_on_disk(&self) -> bool {
        !matches!(self.place, Storage::Memory { .. })
    }

    /// All elements, if they are in memory.
    pub fn as_slice(&self) -> Option<&[T]> {
        match &self.place {
            Storage::Memory { data, .. } => Some(data),
            Storage::Disk(_) | Storage::Part { .. } => None,
        }
    }

    /// All elements, if they are in memory.
    pub fn as_mut_slice(&mut self) -> Option<&mut [T]> {
        match &mut self.place {
            Storage::Memory { data, .. } => Some(data),
            Storage::Disk(_) | Storage::Part { .. } => None,
        }
    }

    /// The elements of `range`: those in memory as they are, those on disk read into `scratch`.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or [`ExtmemError::Io`] naming the work directory.
    pub fn read<'a>(&'a self, range: Range<usize>, scratch: &'a mut Vec<T>) -> Result<&'a [T], ExtmemError> {
        self.check(&range)?;
        match &self.place {
            Storage::Memory { data, .. } => Ok(&data[range]),
            Storage::Disk(file) => {
                scratch.resize(range.len(), T::zeroed());
                read_at(file, range.start, scratch)?;
                Ok(scratch)
            }
            Storage::Part { part, offset } => {
                scratch.resize(range.len(), T::zeroed());
                let begin = offset + range.start as u64 * size_of::<T>() as u64;
                part.read_exact(begin, bytemuck::cast_slice_mut(scratch))?;
                Ok(scratch)
            }
        }
    }

    /// Replaces the elements from `start` on by `items`.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], also if it lies in a part; or [`ExtmemError::DiskFull`] or [`ExtmemError::Io`] naming the work directory.
    pub fn write(&mut self, start: usize, items: &[T]) -> Result<(), ExtmemError> {
        let range = start..start.saturating_add(items.len());
        self.check(&range)?;
        match &mut self.place {
            Storage::Memory { data, .. } => {
                data[range].copy_from_slice(items);
                Ok(())
            }
            Storage::Disk(file) => write_at(file, start, items),
            Storage::Part { .. } => Err(self.out_of_range(&range)),
        }
    }

    /// Parts of `len` elements (the last may be shorter), to be changed independently of one another.
    pub fn parts_mut(&mut self, len: usize) -> Vec<Part<'_, T>> {
        let len = len.max(1);
        let starts = (0..self.len).step_by(len);
        match &mut self.place {
            Storage::Memory { data, .. } => {
                let parts = data.chunks_mut(len).zip(starts);
                parts.map(|(items, start)| Part { start, place: PartPlace::Memory(items) }).collect()
            }
            Storage::Disk(file) => {
                let end = self.len;
                let part = |start| PartPlace::Disk { file, len: len.min(end - start) };
                starts.map(|start| Part { start, place: part(start) }).collect()
            }
            Storage::Part { .. } => {
                let end = self.len;
                let place = |start| PartPlace::Fixed { what: self.what, len: len.min(end - start) };
                starts.map(|start| Part { start, place: place(start) }).collect()
            }
        }
    }

    fn check(&self, range: &Range<usize>) -> Result<(), ExtmemError> {
        if range.start <= range.end && range.end <= self.len {
            return Ok(());
        }
        Err(self.out_of_range(range))
    }

    fn out_of_range(&self, range: &Range<usize>) -> ExtmemError {
        let bytes = |count: usize| (count as u64).saturating_mul(size_of::<T>() as u64);
        ExtmemError::OutOfRange {
            what: self.what,
            offset: bytes(range.start),
            len: bytes(range.end.saturating_sub(range.start)),
            size: bytes(self.len),
        }
    }
}

/// A part of a [`Column`], which one thread may change while others change other parts.
#[derive(Debug)]
pub struct Part<'a, T: Pod> {
    start: usize,
    place: PartPlace<'a, T>,
}

#[derive(Debug)]
enum PartPlace<'a, T> {
    Memory(&'a mut [T]),
    Disk {
        file: &'a DataFile,
        len: usize,
    },
    /// Of an array that cannot be changed.
    Fixed {
        what: &'static str,
        len: usize,
    },
}

impl<T: Pod> Part<'_, T> {
    /// Index of the first element in the column.
    pub fn start(&self) -> usize {
        self.start
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        match &self.place {
            PartPlace::Memory(items) => items.len(),
            PartPlace::Disk { len, .. } | PartPlace::Fixed { len, .. } => *len,
        }
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Lets `change` have the elements, and keeps what it makes of them unless it fails.
    ///
    /// # Errors
    /// Those of `change`, or as [`Column::read`] and [`Column::write`].
    pub fn update<E: From<ExtmemError>>(
        self,
        scratch: &mut Vec<T>,
        change: impl FnOnce(&mut [T]) -> Result<(), E>,
    ) -> Result<(), E> {
        match self.place {
            PartPlace::Memory(items) => change(items),
            PartPlace::Disk { file, len } => {
                scratch.resize(len, T::zeroed());
                read_at(file, self.start, scratch)?;
                change(scratch)?;
                Ok(write_at(file, self.start, scratch)?)
            }
            PartPlace::Fixed { what, len } => {
                let [offset, len] = [self.start, len].map(|count| (count * size_of::<T>()) as u64);
                Err(ExtmemError::OutOfRange { what, offset, len, size: 0 }.into())
            }
        }
    }
}

/// Pieces of a range that are gone through one after another.
fn pieces<T>(range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let step = (STEP / size_of::<T>().max(1)).max(1);
    range.clone().step_by(step).map(move |start| start..range.end.min(start + step))
}

fn read_at<T: Pod>(file: &DataFile, start: usize, out: &mut [T]) -> Result<(), ExtmemError> {
    file.read_exact_at(bytemuck::cast_slice_mut(out), start as u64 * size_of::<T>() as u64)
}

fn write_at<T: Pod>(file: &DataFile, start: usize, items: &[T]) -> Result<(), ExtmemError> {
    file.write_all_at(bytemuck::cast_slice(items), start as u64 * size_of::<T>() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FailPoints, MemoryBudget, WorkDir};
    use proptest::prelude::*;
    use std::sync::Arc;

    fn store(limit: u64) -> (tempfile::TempDir, Store) {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), limit).unwrap();
        (dir, store)
    }

    #[test]
    fn ranges_beyond_the_end_are_refused_in_both_places() {
        for limit in [0, 1000] {
            let (_dir, store) = store(limit);
            let mut column = Column::<u32>::zeroed(&store, "numbers", 10).unwrap();
            assert_eq!((column.is_on_disk(), column.as_slice().is_some()), (limit == 0, limit > 0));
            let mut scratch = Vec::new();
            assert!(matches!(
                column.read(5..11, &mut scratch),
                Err(ExtmemError::OutOfRange { size: 40, .. })
            ));
            assert!(column.write(10, &[1]).is_err() && column.write(usize::MAX, &[1]).is_err());
            column.write(8, &[1, 2]).unwrap();
            assert_eq!(column.read(7..10, &mut scratch).unwrap(), [0, 1, 2]);
            assert!(column.read(10..10, &mut scratch).unwrap().is_empty());
            let all = column.as_mut_slice().map(|all| all.to_vec());
            assert_eq!(all, (limit > 0).then(|| vec![0, 0, 0, 0, 0, 0, 0, 0, 1, 2]));
        }
    }

    #[test]
    fn a_failed_change_of_a_part_on_disk_is_not_kept() {
        let (_dir, store) = store(0);
        let mut column = Column::<u16>::zeroed(&store, "numbers", 3).unwrap();
        let part = column.parts_mut(3).pop().unwrap();
        let failed = part.update(&mut Vec::new(), |items| {
            items.fill(7);
            Err(ExtmemError::NotAFile { path: "x".into() })
        });
        assert!(failed.is_err());
        assert_eq!(column.read(0..3, &mut Vec::new()).unwrap(), [0; 3]);
    }

    #[test]
    fn what_lies_in_a_part_is_read_and_not_changed() {
        let (dir, store) = store(1 << 20);
        let path = dir.path().join("a.part");
        let mut writer = BufferWriter::new(&store, "items", 0).unwrap();
        let items: Vec<[u32; 3]> = (0..300_000).map(|i| [i, i ^ 7, 3 * i]).collect();
        writer.extend_from_slice(&items).unwrap();
        let mut part = PartWriter::create(&path, FailPoints::default()).unwrap();
        part.append(b"before").unwrap();
        let column = writer.finish_column().unwrap();
        for range in [0..1, 1..299_999, 299_999..300_000] {
            column.append_to(range, &mut part).unwrap();
        }
        part.finish(b"", b"").unwrap();

        let part = Arc::new(PartFile::open(&path, FailPoints::default()).unwrap());
        let mut column = Column::<[u32; 3]>::in_part("items", Arc::clone(&part), 6, items.len()).unwrap();
        assert!(column.is_on_disk() && column.as_slice().is_none() && column.as_mut_slice().is_none());
        let mut scratch = Vec::new();
        for range in [0..1, 77..70_000, 299_999..300_000, 5..5] {
            assert_eq!(column.read(range.clone(), &mut scratch).unwrap(), &items[range]);
        }
        assert!(column.read(0..300_001, &mut scratch).is_err() && column.write(0, &[[1; 3]]).is_err());
        let all = column.parts_mut(1 << 18);
        assert_eq!(all.iter().map(Part::len).collect::<Vec<_>>(), [1 << 18, 300_000 - (1 << 18)]);
        for part in all {
            assert!(part.update(&mut scratch, |_| Ok::<(), ExtmemError>(())).is_err());
        }
        let column = column.moved_to_disk(&store).unwrap();
        assert_eq!(column.read(299_998..300_000, &mut scratch).unwrap(), &items[299_998..]);
        for (offset, len) in [(6, 300_001), (7, 300_000), (u64::MAX, 1), (0, usize::MAX / 12)] {
            assert!(Column::<[u32; 3]>::in_part("items", Arc::clone(&part), offset, len).is_err());
        }
    }

    proptest! {
        /// Whatever the budget, a column is what was written to it.
        #[test]
        fn a_column_is_a_vector(
            items in prop::collection::vec(any::<[u32; 3]>(), 0..60),
            limit in 0u64..900,
            part in 1usize..20,
            (at, fresh) in (0usize..60, prop::collection::vec(any::<[u32; 3]>(), 0..10)),
        ) {
            let dir = tempfile::tempdir().unwrap();
            let workdir = WorkDir::resumable(&dir.path().join("work"), FailPoints::default()).unwrap();
            let store = Store { budget: MemoryBudget::new(limit), workdir: Arc::new(workdir) };
            let mut plain = items.clone();
            let mut writer = BufferWriter::new(&store, "items", 7).unwrap();
            writer.extend_from_slice(&items).unwrap();
            let mut column = writer.finish_column().unwrap();
            let fits = at + fresh.len() <= plain.len();
            prop_assert_eq!(column.write(at, &fresh).is_ok(), fits);
            if fits {
                plain[at..at + fresh.len()].copy_from_slice(&fresh);
            }
            let mut scratch = Vec::new();
            for part in column.parts_mut(part) {
                let start = part.start() as u32;
                let change = |items: &mut [[u32; 3]]| {
                    items.iter_mut().zip(start..).for_each(|(item, index)| item[1] ^= index);
                    Ok::<(), ExtmemError>(())
                };
                part.update(&mut scratch, change).unwrap();
            }
            plain.iter_mut().zip(0..).for_each(|(item, index)| item[1] ^= index);
            prop_assert_eq!(column.read(0..plain.len(), &mut scratch).unwrap(), &plain[..]);

            // Saved, it is the same again, whatever becomes of the first.
            let saved = column.save(&store, "items").unwrap();
            column.write(0, &plain[..plain.len() / 2]).unwrap();
            drop(column);
            let column = Column::<[u32; 3]>::load(&store, "items", &saved).unwrap();
            prop_assert_eq!(column.read(0..plain.len(), &mut scratch).unwrap(), &plain[..]);
            let column = column.moved_to_disk(&store).unwrap();
            prop_assert_eq!(column.read(0..plain.len(), &mut scratch).unwrap(), &plain[..]);
            prop_assert_eq!(store.budget.used(), 0);
        }
    }
}
