//! An array in any order: in memory if the budget has room, else on disk, of which some blocks are at hand.

use crate::{Column, ExtmemError, Reservation, Store};
use bytemuck::Pod;

/// Bytes of a block, and how many are at hand.
const BLOCK: usize = 1 << 12;
const BLOCKS: usize = 1 << 9;

/// An array whose items are read and changed one by one.
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// use chpm_extmem::{Paged, Store};
///
/// // No memory is granted, so the array is in a file, of which some blocks are at hand.
/// let store = Store::create(folder.path(), 0)?;
/// let mut numbers = Paged::<u64>::zeroed(&store, "numbers", 1_000_000)?;
/// numbers.set(999_999, 7)?;
/// assert_eq!(numbers.get(999_999)?, 7);
/// assert_eq!(numbers.get(3)?, 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Paged<T: Pod> {
    column: Column<T>,
    blocks: Vec<Block<T>>,
    /// Items of a block.
    len: usize,
    _share: Reservation,
}

#[derive(Debug)]
struct Block<T> {
    number: usize,
    items: Vec<T>,
    is_changed: bool,
}

impl<T: Pod> Paged<T> {
    /// `len` zeroed items; `what` names the array in errors.
    ///
    /// # Errors
    /// As [`Column::zeroed`], and [`ExtmemError::Budget`] if there is no memory for the blocks at hand.
    pub fn zeroed(store: &Store, what: &'static str, len: usize) -> Result<Self, ExtmemError> {
        Self::new(store, what, Column::zeroed(store, what, len)?)
    }

    /// The items of a column.
    ///
    /// # Errors
    /// [`ExtmemError::Budget`] if there is no memory for the blocks at hand.
    pub fn new(store: &Store, what: &'static str, column: Column<T>) -> Result<Self, ExtmemError> {
        let count = if column.is_on_disk() { BLOCKS } else { 0 };
        let share = store.budget.reserve_work(what, (count * BLOCK) as u64)?;
        let none = || Block { number: usize::MAX, items: Vec::new(), is_changed: false };
        let blocks = std::iter::repeat_with(none).take(count).collect();
        Ok(Paged { column, blocks, len: BLOCK / size_of::<T>(), _share: share })
    }

    /// Number of items.
    pub fn len(&self) -> usize {
        self.column.len()
    }

    /// Whether there is no item.
    pub fn is_empty(&self) -> bool {
        self.column.is_empty()
    }

    /// The item at a place.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or [`ExtmemError::Io`] naming the work directory.
    pub fn get(&mut self, at: usize) -> Result<T, ExtmemError> {
        if let Some(all) = self.column.as_slice()
            && let Some(item) = all.get(at)
        {
            return Ok(*item);
        }
        let within = at % self.len;
        Ok(self.block(at)?.items[within])
    }

    /// Replaces the item at a place.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or [`ExtmemError::DiskFull`] or [`ExtmemError::Io`] naming the work directory.
    pub fn set(&mut self, at: usize, item: T) -> Result<(), ExtmemError> {
        if let Some(all) = self.column.as_mut_slice()
            && let Some(place) = all.get_mut(at)
        {
            *place = item;
            return Ok(());
        }
        let within = at % self.len;
        let block = self.block(at)?;
        block.items[within] = item;
        block.is_changed = true;
        Ok(())
    }

    /// The block of an item; what had its place before goes to disk if it was changed.
    fn block(&mut self, at: usize) -> Result<&mut Block<T>, ExtmemError> {
        if at >= self.column.len() || self.blocks.is_empty() {
            // It is out of range: the column says so.
            self.column.read(at..at.saturating_add(1), &mut Vec::new())?;
        }
        let number = at / self.len;
        let block = &mut self.blocks[number % BLOCKS];
        if block.number != number {
            if block.is_changed {
                self.column.write(block.number * self.len, &block.items)?;
                block.is_changed = false;
            }
            // A block that fails to be read must not be taken for one that was.
            block.number = usize::MAX;
            let end = self.column.len().min((number + 1) * self.len);
            self.column.read(number * self.len..end, &mut block.items)?;
            block.number = number;
        }
        Ok(block)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_on_disk_is_one_in_memory() {
        const LEN: usize = 3 * BLOCKS * BLOCK / 8 + 5;
        let folder = tempfile::tempdir().unwrap();
        for memory in [0, 1 << 30] {
            let store = Store::create(folder.path(), memory).unwrap();
            let mut paged = Paged::<u64>::zeroed(&store, "numbers", LEN).unwrap();
            assert_eq!(paged.column.is_on_disk(), memory == 0);
            let mut plain = vec![0; LEN];
            for i in 0..400_000usize {
                let (from, to) = (i.wrapping_mul(0x9e37_79b9) % LEN, i.wrapping_mul(0x85eb_ca6b) % LEN);
                assert_eq!(paged.get(from).unwrap(), plain[from], "{i}");
                plain[to] = plain[from] + 1;
                paged.set(to, plain[to]).unwrap();
            }
            assert!((0..LEN).all(|at| paged.get(at).unwrap() == plain[at]));
            assert!(paged.get(LEN).is_err() && paged.set(LEN, 1).is_err());
        }
    }
}
