//! Arrays that are reached by ranges: in memory when the budget grants it, else in an unnamed file that is read and written
//! at its offsets. Nothing is mapped, so an array on disk takes no memory but what its reader hands in.

use crate::error::byte_len;
use crate::{ExtmemError, Reservation, Store};
use bytemuck::Pod;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;

/// An array of records, read and written by ranges.
#[derive(Debug)]
pub struct Column<T: Pod> {
    place: Place<T>,
    len: usize,
    what: &'static str,
}

#[derive(Debug)]
enum Place<T: Pod> {
    Memory { data: Vec<T>, _share: Reservation },
    Disk { file: File, store: Store },
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
            .and_then(|share| Some((bytemuck::try_zeroed_vec(len).ok()?, share)));
        if let Some((data, share)) = in_memory {
            return Ok(Self::in_memory(what, data, share));
        }
        let file = store.workdir.unnamed_file()?;
        file.set_len(bytes)
            .map_err(|source| ExtmemError::io("extend a file in", store.workdir.path(), bytes, source))?;
        Ok(Self::on_disk(store, what, file, len))
    }

    pub(crate) fn in_memory(what: &'static str, data: Vec<T>, share: Reservation) -> Self {
        Column { len: data.len(), place: Place::Memory { data, _share: share }, what }
    }

    /// The first `len` elements of a file.
    pub(crate) fn on_disk(store: &Store, what: &'static str, file: File, len: usize) -> Self {
        Column { place: Place::Disk { file, store: store.clone() }, len, what }
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
        matches!(self.place, Place::Disk { .. })
    }

    /// All elements, if they are in memory.
    pub fn as_slice(&self) -> Option<&[T]> {
        match &self.place {
            Place::Memory { data, .. } => Some(data),
            Place::Disk { .. } => None,
        }
    }

    /// All elements, if they are in memory.
    pub fn as_mut_slice(&mut self) -> Option<&mut [T]> {
        match &mut self.place {
            Place::Memory { data, .. } => Some(data),
            Place::Disk { .. } => None,
        }
    }

    /// The elements of `range`: those in memory as they are, those on disk read into `scratch`.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or [`ExtmemError::Io`] naming the work directory.
    pub fn read<'a>(&'a self, range: Range<usize>, scratch: &'a mut Vec<T>) -> Result<&'a [T], ExtmemError> {
        self.check(&range)?;
        match &self.place {
            Place::Memory { data, .. } => Ok(&data[range]),
            Place::Disk { file, store } => {
                scratch.resize(range.len(), T::zeroed());
                read_at(file, store, range.start, scratch)?;
                Ok(scratch)
            }
        }
    }

    /// Replaces the elements from `start` on by `items`.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or [`ExtmemError::DiskFull`] or [`ExtmemError::Io`] naming the work directory.
    pub fn write(&mut self, start: usize, items: &[T]) -> Result<(), ExtmemError> {
        let range = start..start.saturating_add(items.len());
        self.check(&range)?;
        match &mut self.place {
            Place::Memory { data, .. } => {
                data[range].copy_from_slice(items);
                Ok(())
            }
            Place::Disk { file, store } => write_at(file, store, start, items),
        }
    }

    /// Parts of `len` elements (the last may be shorter), to be changed independently of one another.
    pub fn parts_mut(&mut self, len: usize) -> Vec<Part<'_, T>> {
        let len = len.max(1);
        let starts = (0..self.len).step_by(len);
        match &mut self.place {
            Place::Memory { data, .. } => {
                let parts = data.chunks_mut(len).zip(starts);
                parts.map(|(items, start)| Part { start, place: PartPlace::Memory(items) }).collect()
            }
            Place::Disk { file, store } => {
                let end = self.len;
                let part = |start| PartPlace::Disk { file, store, len: len.min(end - start) };
                starts.map(|start| Part { start, place: part(start) }).collect()
            }
        }
    }

    fn check(&self, range: &Range<usize>) -> Result<(), ExtmemError> {
        if range.start <= range.end && range.end <= self.len {
            return Ok(());
        }
        let bytes = |count: usize| (count as u64).saturating_mul(size_of::<T>() as u64);
        Err(ExtmemError::OutOfRange {
            what: self.what,
            offset: bytes(range.start),
            len: bytes(range.end.saturating_sub(range.start)),
            size: bytes(self.len),
        })
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
    Disk { file: &'a File, store: &'a Store, len: usize },
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
            PartPlace::Disk { len, .. } => *len,
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
            PartPlace::Disk { file, store, len } => {
                scratch.resize(len, T::zeroed());
                read_at(file, store, self.start, scratch)?;
                change(scratch)?;
                Ok(write_at(file, store, self.start, scratch)?)
            }
        }
    }
}

fn read_at<T: Pod>(file: &File, store: &Store, start: usize, out: &mut [T]) -> Result<(), ExtmemError> {
    let offset = start as u64 * size_of::<T>() as u64;
    file.read_exact_at(bytemuck::cast_slice_mut(out), offset)
        .map_err(|source| ExtmemError::io("read a file in", store.workdir.path(), 0, source))
}

fn write_at<T: Pod>(file: &File, store: &Store, start: usize, items: &[T]) -> Result<(), ExtmemError> {
    let offset = start as u64 * size_of::<T>() as u64;
    let needed = size_of_val(items) as u64;
    file.write_all_at(bytemuck::cast_slice(items), offset)
        .map_err(|source| ExtmemError::io("write a file in", store.workdir.path(), needed, source))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BufferWriter;
    use proptest::prelude::*;

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

    proptest! {
        /// Whatever the budget, a column is what was written to it.
        #[test]
        fn a_column_is_a_vector(
            items in prop::collection::vec(any::<[u32; 3]>(), 0..60),
            limit in 0u64..900,
            part in 1usize..20,
            (at, fresh) in (0usize..60, prop::collection::vec(any::<[u32; 3]>(), 0..10)),
        ) {
            let (_dir, store) = store(limit);
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
            drop(column);
            prop_assert_eq!(store.budget.used(), 0);
        }
    }
}
