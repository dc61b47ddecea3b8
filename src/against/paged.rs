//! An array in any order: in memory if the budget has room, else on disk, of which some blocks are at hand.

use anyhow::Result;
use bytemuck::Pod;
use chpm_extmem::{Column, Reservation, Store};

/// Bytes of a block, and how many are at hand.
const BLOCK: usize = 1 << 12;
const BLOCKS: usize = 1 << 9;

/// An array of zeros, to be changed.
pub(super) struct Paged<T: Pod> {
    column: Column<T>,
    blocks: Vec<Block<T>>,
    /// Items of a block.
    len: usize,
    _share: Reservation,
}

struct Block<T> {
    number: usize,
    items: Vec<T>,
    is_changed: bool,
}

impl<T: Pod> Paged<T> {
    pub(super) fn zeroed(store: &Store, what: &'static str, len: usize) -> Result<Self> {
        let column = Column::<T>::zeroed(store, what, len)?;
        let count = if column.is_on_disk() { BLOCKS } else { 0 };
        let share = store.budget.reserve_work(what, (count * BLOCK) as u64)?;
        let none = || Block { number: usize::MAX, items: Vec::new(), is_changed: false };
        let blocks = std::iter::repeat_with(none).take(count).collect();
        Ok(Paged { column, blocks, len: BLOCK / size_of::<T>(), _share: share })
    }

    pub(super) fn get(&mut self, at: usize) -> Result<T> {
        if let Some(all) = self.column.as_slice() {
            return Ok(all[at]);
        }
        let within = at % self.len;
        Ok(self.block(at)?.items[within])
    }

    pub(super) fn set(&mut self, at: usize, item: T) -> Result<()> {
        if let Some(all) = self.column.as_mut_slice() {
            all[at] = item;
            return Ok(());
        }
        let within = at % self.len;
        let block = self.block(at)?;
        block.items[within] = item;
        block.is_changed = true;
        Ok(())
    }

    /// The block of an item; what had its place before goes to disk if it was changed.
    fn block(&mut self, at: usize) -> Result<&mut Block<T>> {
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
        }
    }
}
