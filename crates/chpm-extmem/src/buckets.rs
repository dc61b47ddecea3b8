//! Many sequences written side by side: the tool for bringing records that come in any order to where they are needed.
//!
//! A sequence gathers one block in memory, and full blocks go to a [`Spool`]. So writing is sequential wherever the
//! records come from, and a sequence is read block by block.

use crate::{ExtmemError, Spool, Store};
use bytemuck::Pod;

/// A number of sequences of records. Memory: one block for each sequence that has any, and 8 bytes for each full block.
///
/// ```
/// use chpm_extmem::{Buckets, Store};
///
/// let store = Store::create(&std::env::temp_dir(), 1 << 20)?;
/// let mut buckets = Buckets::new(&store, "corners", 2, 4096);
/// for number in 0..10u32 {
///     buckets.push(number as usize % 2, number)?;
/// }
/// let mut odd = Vec::new();
/// buckets.read(1, &mut odd)?;
/// assert_eq!(odd, [1, 3, 5, 7, 9]);
/// # Ok::<(), chpm_extmem::ExtmemError>(())
/// ```
#[derive(Debug)]
pub struct Buckets<T: Pod> {
    spool: Spool,
    block_len: usize,
    sequences: Vec<Sequence<T>>,
}

#[derive(Clone, Debug)]
struct Sequence<T> {
    /// Where the full blocks are, in order.
    full: Vec<u64>,
    open: Vec<T>,
}

impl<T: Pod> Buckets<T> {
    /// `count` empty sequences that gather `block_bytes` each (at least one record); `what` names them in errors.
    pub fn new(store: &Store, what: &'static str, count: usize, block_bytes: usize) -> Self {
        let block_len = (block_bytes / size_of::<T>().max(1)).max(1);
        let mut buckets = Buckets { spool: Spool::new(store, what), block_len, sequences: Vec::new() };
        buckets.sequences.resize_with(count, Sequence::default);
        buckets
    }

    /// Number of sequences.
    pub fn count(&self) -> usize {
        self.sequences.len()
    }

    /// One more sequence; answers its number.
    pub fn add(&mut self) -> usize {
        self.sequences.push(Sequence::default());
        self.sequences.len() - 1
    }

    /// Records of a sequence.
    pub fn len(&self, sequence: usize) -> usize {
        let sequence = &self.sequences[sequence];
        sequence.full.len() * self.block_len + sequence.open.len()
    }

    /// Whether a sequence has no record.
    pub fn is_empty(&self, sequence: usize) -> bool {
        self.len(sequence) == 0
    }

    /// Appends a record to a sequence.
    ///
    /// # Errors
    /// As [`Spool::append`].
    #[inline]
    pub fn push(&mut self, sequence: usize, record: T) -> Result<(), ExtmemError> {
        let open = &mut self.sequences[sequence].open;
        if open.capacity() == 0 {
            open.reserve_exact(self.block_len);
        }
        open.push(record);
        if open.len() == self.block_len { self.close_block(sequence) } else { Ok(()) }
    }

    fn close_block(&mut self, sequence: usize) -> Result<(), ExtmemError> {
        let sequence = &mut self.sequences[sequence];
        sequence.full.push(self.spool.append(bytemuck::cast_slice(&sequence.open))?);
        sequence.open.clear();
        Ok(())
    }

    /// All sequences, to be extended independently of one another.
    pub fn parts_mut(&mut self) -> Vec<BucketMut<'_, T>> {
        let Buckets { spool, block_len, sequences } = self;
        sequences.iter_mut().map(|sequence| BucketMut { spool, block_len: *block_len, sequence }).collect()
    }

    /// Appends all records of a sequence to `out`, in order.
    ///
    /// # Errors
    /// As [`Spool::read`].
    pub fn read(&self, sequence: usize, out: &mut Vec<T>) -> Result<(), ExtmemError> {
        let from = &self.sequences[sequence];
        out.reserve(self.len(sequence));
        for offset in &from.full {
            let start = out.len();
            out.resize(start + self.block_len, T::zeroed());
            self.spool.read_exact(*offset, bytemuck::cast_slice_mut(&mut out[start..]))?;
        }
        out.extend_from_slice(&from.open);
        Ok(())
    }

    /// How many blocks a sequence has, for [`Self::read_block`].
    pub fn block_count(&self, sequence: usize) -> usize {
        self.sequences[sequence].full.len() + 1
    }

    /// Replaces `out` by a block of a sequence: a way to go over one that is too long for memory.
    ///
    /// # Errors
    /// As [`Spool::read`].
    pub fn read_block(&self, sequence: usize, block: usize, out: &mut Vec<T>) -> Result<(), ExtmemError> {
        let from = &self.sequences[sequence];
        out.clear();
        match from.full.get(block) {
            Some(offset) => {
                out.resize(self.block_len, T::zeroed());
                self.spool.read_exact(*offset, bytemuck::cast_slice_mut(out))?;
            }
            None => out.extend_from_slice(&from.open),
        }
        Ok(())
    }

    /// Forgets the records of a sequence. What they have on disk stays until all is dropped.
    pub fn clear(&mut self, sequence: usize) {
        self.sequences[sequence] = Sequence::default();
    }

    /// Lets `change` have the records of a sequence, block by block, and keeps what it makes of them.
    ///
    /// # Errors
    /// As [`Spool::read`] and [`Spool::overwrite`].
    pub fn update(
        &mut self,
        sequence: usize,
        scratch: &mut Vec<T>,
        mut change: impl FnMut(&mut [T]),
    ) -> Result<(), ExtmemError> {
        let sequence = &mut self.sequences[sequence];
        scratch.resize(self.block_len, T::zeroed());
        for offset in &sequence.full {
            self.spool.read_exact(*offset, bytemuck::cast_slice_mut(scratch))?;
            change(scratch);
            self.spool.overwrite(*offset, bytemuck::cast_slice(scratch))?;
        }
        change(&mut sequence.open);
        Ok(())
    }

    /// Takes the records out of all sequences, each in its order.
    pub fn drain(&self) -> Drain<'_, T> {
        Drain { buckets: self, taken: vec![Taken { records: Vec::new(), next: 0, block: 0 }; self.count()] }
    }
}

/// One of [`Buckets`], which a thread may extend while others extend other ones.
#[derive(Debug)]
pub struct BucketMut<'a, T: Pod> {
    spool: &'a Spool,
    block_len: usize,
    sequence: &'a mut Sequence<T>,
}

impl<T: Pod> BucketMut<'_, T> {
    /// Appends records one by one.
    ///
    /// # Errors
    /// As [`Spool::append`].
    pub fn extend(&mut self, records: impl IntoIterator<Item = T>) -> Result<(), ExtmemError> {
        records.into_iter().try_for_each(|record| self.extend_from_slice(&[record]))
    }

    /// Appends records.
    ///
    /// # Errors
    /// As [`Spool::append`].
    pub fn extend_from_slice(&mut self, mut records: &[T]) -> Result<(), ExtmemError> {
        let Sequence { full, open } = &mut *self.sequence;
        while !records.is_empty() {
            if open.capacity() == 0 {
                open.reserve_exact(self.block_len);
            }
            let (fitting, rest) = records.split_at(records.len().min(self.block_len - open.len()));
            open.extend_from_slice(fitting);
            if open.len() == self.block_len {
                full.push(self.spool.append(bytemuck::cast_slice(open))?);
                open.clear();
            }
            records = rest;
        }
        Ok(())
    }
}

impl<T> Default for Sequence<T> {
    fn default() -> Self {
        Sequence { full: Vec::new(), open: Vec::new() }
    }
}

/// Reads all sequences of [`Buckets`] side by side. Memory: one block for each.
#[derive(Debug)]
pub struct Drain<'a, T: Pod> {
    buckets: &'a Buckets<T>,
    taken: Vec<Taken<T>>,
}

#[derive(Clone, Debug)]
struct Taken<T> {
    records: Vec<T>,
    next: usize,
    /// The block after that of `records`.
    block: usize,
}

impl<T: Pod> Drain<'_, T> {
    /// The next record of a sequence.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`] after the last one, or as [`Spool::read`].
    #[inline]
    pub fn next(&mut self, sequence: usize) -> Result<T, ExtmemError> {
        let taken = &mut self.taken[sequence];
        if taken.next == taken.records.len() {
            taken.refill(self.buckets, sequence)?;
        }
        taken.next += 1;
        Ok(taken.records[taken.next - 1])
    }
}

impl<T: Pod> Taken<T> {
    fn refill(&mut self, buckets: &Buckets<T>, sequence: usize) -> Result<(), ExtmemError> {
        let from = &buckets.sequences[sequence];
        self.records.clear();
        self.next = 0;
        if let Some(offset) = from.full.get(self.block) {
            self.records.resize(buckets.block_len, T::zeroed());
            buckets.spool.read_exact(*offset, bytemuck::cast_slice_mut(&mut self.records))?;
        } else if self.block == from.full.len() && !from.open.is_empty() {
            self.records.extend_from_slice(&from.open);
        } else {
            let size = (buckets.len(sequence) * size_of::<T>()) as u64;
            let len = size_of::<T>() as u64;
            return Err(ExtmemError::OutOfRange { what: "sequence", offset: size, len, size });
        }
        self.block += 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Sequences are plain vectors, read whole, changed block by block, or drained side by side.
        #[test]
        fn sequences_are_vectors(
            records in prop::collection::vec((0usize..5, any::<u32>()), 0..200),
            limit in prop::sample::select(vec![0u64, 1 << 24]),
            block_bytes in 0usize..40,
        ) {
            let dir = tempfile::tempdir().unwrap();
            let store = Store::create(dir.path(), limit).unwrap();
            let mut buckets = Buckets::new(&store, "records", 4, block_bytes);
            prop_assert_eq!(buckets.add(), 4);

            let mut plain = vec![Vec::new(); 5];
            for (sequence, record) in &records {
                let many = [*record; 9];
                let many = &many[..*record as usize % 10];
                buckets.push(*sequence, *record).unwrap();
                buckets.parts_mut()[*sequence].extend_from_slice(many).unwrap();
                plain[*sequence].push(*record);
                plain[*sequence].extend_from_slice(many);
            }

            let mut scratch = Vec::new();
            for (sequence, expected) in plain.iter_mut().enumerate() {
                prop_assert_eq!((buckets.len(sequence), buckets.is_empty(sequence)), (expected.len(), expected.is_empty()));
                let mut read = vec![7];
                buckets.read(sequence, &mut read).unwrap();
                prop_assert_eq!((&read[..1], &read[1..]), (&[7][..], &expected[..]));

                let change = |items: &mut [u32]| items.iter_mut().for_each(|x| *x = x.wrapping_mul(3));
                let mut blocks = Vec::new();
                for block in 0..buckets.block_count(sequence) {
                    buckets.read_block(sequence, block, &mut scratch).unwrap();
                    blocks.extend_from_slice(&scratch);
                }
                prop_assert_eq!(&blocks, &*expected);
                buckets.update(sequence, &mut scratch, change).unwrap();
                change(expected);
            }

            let mut drain = buckets.drain();
            let mut at = [0; 5];
            for sequence in records.iter().flat_map(|(sequence, record)| (0..=record % 10).map(|_| *sequence)) {
                prop_assert_eq!(drain.next(sequence).unwrap(), plain[sequence][at[sequence]]);
                at[sequence] += 1;
            }
            prop_assert!((0..5).all(|sequence| drain.next(sequence).is_err()));
            drop(drain);
            buckets.clear(2);
            prop_assert!(buckets.is_empty(2));
        }
    }
}
