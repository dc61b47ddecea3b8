//! Arrays that live in memory when the budget grants it, and in a mapped file when it does not.

use crate::error::byte_len;
use crate::file::{Appender, DataFile};
use crate::{Column, ExtmemError, MappedBuffer, Reservation, Store};
use bytemuck::Pod;
use rayon::prelude::*;
use std::ops::{Deref, DerefMut};

/// An array of records, wherever it lives.
#[derive(Debug)]
pub struct Buffer<T: Pod>(Storage<T>);

#[derive(Debug)]
enum Storage<T: Pod> {
    Memory { data: Vec<T>, _reservation: Reservation },
    Disk(MappedBuffer<T>),
}

impl<T: Pod> Buffer<T> {
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
        Ok(Buffer(match in_memory {
            Some((data, _reservation)) => Storage::Memory { data, _reservation },
            None => Storage::Disk(MappedBuffer::zeroed(&store.workdir, what, len)?),
        }))
    }

    /// Whether the array lives in a file.
    pub fn is_on_disk(&self) -> bool {
        matches!(self.0, Storage::Disk(_))
    }
}

impl<T: Pod> Deref for Buffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.0 {
            Storage::Memory { data, .. } => data,
            Storage::Disk(map) => map,
        }
    }
}

impl<T: Pod> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.0 {
            Storage::Memory { data, .. } => data,
            Storage::Disk(map) => map,
        }
    }
}

/// Builds a [`Buffer`] front to back, moving it to disk when the budget does not let it grow.
///
/// ```
/// use chpm_extmem::{BufferWriter, Store};
///
/// let store = Store::create(&std::env::temp_dir(), 1 << 20)?;
/// let mut writer = BufferWriter::new(&store, "triangles", 2)?;
/// writer.extend_from_slice(&[[0u32, 1, 2], [2, 1, 3]])?;
/// let column = writer.finish_column()?;
/// assert_eq!((column.len(), column.is_on_disk()), (2, false));
/// # Ok::<(), chpm_extmem::ExtmemError>(())
/// ```
#[derive(Debug)]
pub struct BufferWriter<T: Pod> {
    store: Store,
    what: &'static str,
    len: usize,
    place: Growing<T>,
}

#[derive(Debug)]
enum Growing<T> {
    /// Elements that were expected are there as zeros that nobody has touched: the system has not given the memory yet.
    Memory {
        data: Vec<T>,
        reservation: Reservation,
    },
    Disk(Appender),
}

impl<T: Pod> BufferWriter<T> {
    /// An empty array that expects `expected_len` elements; more or fewer may come.
    ///
    /// # Errors
    /// [`ExtmemError::Io`] or [`ExtmemError::DiskFull`] when the budget refuses and no file can be made.
    pub fn new(store: &Store, what: &'static str, expected_len: usize) -> Result<Self, ExtmemError> {
        let bytes = byte_len::<T>(what, expected_len)? as u64;
        let in_memory = store
            .budget
            .try_reserve(what, bytes)
            .and_then(|reservation| Some((bytemuck::try_zeroed_vec(expected_len).ok()?, reservation)));
        let place = match in_memory {
            Some((data, reservation)) => Growing::Memory { data, reservation },
            None => Growing::Disk(spill_file(store)?),
        };
        Ok(BufferWriter { store: store.clone(), what, len: 0, place })
    }

    /// Elements written so far.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether nothing was written yet.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Appends `items`.
    ///
    /// # Errors
    /// [`ExtmemError::DiskFull`] or [`ExtmemError::Io`] naming the work directory; the writer is then useless.
    pub fn extend_from_slice(&mut self, items: &[T]) -> Result<(), ExtmemError> {
        let len = self.len.saturating_add(items.len());
        if let Growing::Memory { data, reservation } = &mut self.place
            && data.len() < len
        {
            data.truncate(self.len);
            if data.capacity() < len && !grow::<T>(data, reservation, self.what, len)? {
                let mut file = spill_file(&self.store)?;
                file.append(bytemuck::cast_slice(data))?;
                self.place = Growing::Disk(file);
            }
        }
        match &mut self.place {
            Growing::Memory { data, .. } if data.len() < len => data.extend_from_slice(items),
            Growing::Memory { data, .. } => data[self.len..len].copy_from_slice(items),
            Growing::Disk(file) => file.append(bytemuck::cast_slice(items))?,
        }
        self.len = len;
        Ok(())
    }

    /// Appends `pieces` one after another, from several threads where there is memory for what was expected; `copied` is called on
    /// the thread that copies a piece.
    ///
    /// # Errors
    /// As [`Self::extend_from_slice`].
    pub fn extend_from_slices<S>(
        &mut self,
        pieces: &[&[T]],
        copied: impl Fn() -> S + Sync,
    ) -> Result<(), ExtmemError>
    where
        T: Send + Sync,
    {
        let start = self.len;
        let end = start + pieces.iter().map(|piece| piece.len()).sum::<usize>();
        match &mut self.place {
            Growing::Memory { data, .. } if end <= data.len() => {
                let mut room = &mut data[start..end];
                let places = pieces.iter().map(|piece| {
                    let (place, rest) = std::mem::take(&mut room).split_at_mut(piece.len());
                    room = rest;
                    place
                });
                let places: Vec<&mut [T]> = places.collect();
                places.into_par_iter().zip(pieces).for_each(|(place, piece)| {
                    let _copied = copied();
                    place.copy_from_slice(piece);
                });
                self.len = end;
                Ok(())
            }
            _ => pieces.iter().try_for_each(|piece| self.extend_from_slice(piece)),
        }
    }

    /// The finished array; memory that was reserved beyond its length is given back.
    ///
    /// # Errors
    /// [`ExtmemError::DiskFull`] or [`ExtmemError::Io`] naming the work directory.
    pub fn finish(self) -> Result<Buffer<T>, ExtmemError> {
        let bytes = byte_len::<T>(self.what, self.len)?;
        Ok(Buffer(match self.place {
            Growing::Memory { mut data, mut reservation } => {
                data.truncate(self.len);
                data.shrink_to_fit();
                reservation.resize(bytes as u64)?;
                Storage::Memory { data, _reservation: reservation }
            }
            Growing::Disk(file) => {
                Storage::Disk(MappedBuffer::adopt(file.finish()?, &self.store.workdir, bytes)?)
            }
        }))
    }

    /// The finished array, for access by ranges; memory that was reserved beyond its length is given back.
    ///
    /// # Errors
    /// As [`Self::finish`].
    pub fn finish_column(self) -> Result<Column<T>, ExtmemError> {
        let bytes = byte_len::<T>(self.what, self.len)?;
        Ok(match self.place {
            Growing::Memory { mut data, mut reservation } => {
                data.truncate(self.len);
                data.shrink_to_fit();
                reservation.resize(bytes as u64)?;
                Column::in_memory(self.what, data, reservation)
            }
            Growing::Disk(file) => Column::on_disk(self.what, file.finish()?, self.len),
        })
    }
}

/// Makes room for `len` elements, half as many again where the budget allows; false if it does not allow `len`.
fn grow<T: Pod>(
    data: &mut Vec<T>,
    reservation: &mut Reservation,
    what: &'static str,
    len: usize,
) -> Result<bool, ExtmemError> {
    for capacity in [len.saturating_add(len / 2), len] {
        if let Ok(bytes) = byte_len::<T>(what, capacity)
            && reservation.resize(bytes as u64).is_ok()
        {
            return Ok(data.try_reserve_exact(capacity - data.len()).is_ok());
        }
    }
    byte_len::<T>(what, len).map(|_| false)
}

fn spill_file(store: &Store) -> Result<Appender, ExtmemError> {
    Ok(Appender::new(DataFile::create(&store.workdir, None)?))
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
    fn memory_is_used_while_it_lasts_and_given_back() {
        let (_dir, store) = store(1000);
        let first = Buffer::<u32>::zeroed(&store, "first", 200).unwrap();
        let second = Buffer::<u32>::zeroed(&store, "second", 51).unwrap();
        assert!(!first.is_on_disk() && second.is_on_disk());
        assert_eq!(store.budget.used(), 800);
        assert!(first.iter().chain(second.iter()).all(|&x| x == 0));
        drop(first);
        assert_eq!(store.budget.used(), 0);
        assert!(!Buffer::<u32>::zeroed(&store, "third", 250).unwrap().is_on_disk());
    }

    #[test]
    fn a_buffer_on_disk_takes_writes() {
        let (_dir, store) = store(0);
        let mut buffer = Buffer::<[u16; 3]>::zeroed(&store, "triples", 3000).unwrap();
        buffer[2999] = [1, 2, 3];
        buffer.sort_unstable();
        assert!(buffer.is_on_disk());
        assert_eq!((buffer[0], buffer[2999]), ([0; 3], [1, 2, 3]));
    }

    #[test]
    fn a_writer_gives_back_what_it_did_not_need() {
        let (_dir, store) = store(1000);
        let mut writer = BufferWriter::<u8>::new(&store, "bytes", 900).unwrap();
        assert!(writer.is_empty());
        writer.extend_from_slice(b"abc").unwrap();
        assert_eq!((writer.len(), store.budget.used()), (3, 900));
        let buffer = writer.finish().unwrap();
        assert_eq!((&*buffer, store.budget.used()), (&b"abc"[..], 3));
    }

    #[test]
    fn a_writer_moves_to_disk_when_it_may_not_grow() {
        let (_dir, store) = store(100);
        let mut writer = BufferWriter::<u32>::new(&store, "numbers", 10).unwrap();
        writer.extend_from_slice(&[7; 25]).unwrap();
        assert_eq!(store.budget.used(), 100, "the exact need, as half as much again is not to be had");
        writer.extend_from_slice(&[8]).unwrap();
        assert_eq!(store.budget.used(), 0);
        let buffer = writer.finish().unwrap();
        assert!(buffer.is_on_disk());
        assert_eq!((buffer.len(), buffer[24], buffer[25]), (26, 7, 8));
    }

    #[test]
    fn an_empty_writer_gives_an_empty_buffer_in_both_places() {
        let (_dir, store) = store(10);
        for expected in [0, 1000] {
            let buffer = BufferWriter::<u64>::new(&store, "nothing", expected).unwrap().finish().unwrap();
            assert!(buffer.is_empty());
        }
    }

    proptest! {
        /// The content is that of a plain vector, whatever the budget.
        #[test]
        fn a_writer_is_a_vector_under_any_budget(
            pieces in prop::collection::vec(prop::collection::vec(any::<u32>(), 0..40), 0..12),
            limit in 0u64..1200,
            expected in 0usize..200,
        ) {
            let (_dir, store) = store(limit);
            let mut writer = BufferWriter::new(&store, "pieces", expected).unwrap();
            for (round, pieces) in pieces.chunks(3).enumerate() {
                let all: Vec<&[u32]> = pieces.iter().map(Vec::as_slice).collect();
                match round % 2 {
                    0 => writer.extend_from_slices(&all, || ()).unwrap(),
                    _ => all.iter().for_each(|piece| writer.extend_from_slice(piece).unwrap()),
                }
                prop_assert!(store.budget.used() <= limit);
            }
            let plain = pieces.concat();
            let mut buffer = writer.finish().unwrap();
            prop_assert_eq!(&*buffer, &plain[..]);
            buffer.reverse();
            prop_assert!(buffer.iter().eq(plain.iter().rev()));
            drop(buffer);
            prop_assert_eq!(store.budget.used(), 0);
        }
    }
}
