//! A column that is read element by element: those near the last ones are likely to be asked for again.

use crate::{Column, ExtmemError};
use bytemuck::Pod;
use std::borrow::Borrow;

/// Elements of a block that is read at once where not all are in memory, and how many blocks are kept.
const BLOCK: usize = 256;
const BLOCKS: usize = 1 << 10;

/// A column with some of its blocks in memory, if it is on disk.
pub struct Cached<T: Pod, C: Borrow<Column<T>> = Column<T>> {
    column: C,
    /// Which block is held where, and its elements.
    blocks: Vec<(usize, Vec<T>)>,
}

impl<T: Pod, C: Borrow<Column<T>>> Cached<T, C> {
    /// Nothing is read yet.
    pub fn new(column: C) -> Self {
        let mut blocks = Vec::new();
        if column.borrow().is_on_disk() {
            blocks.resize_with(BLOCKS, || (usize::MAX, Vec::new()));
        }
        Cached { column, blocks }
    }

    /// An element; none behind the last.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn get(&mut self, at: usize) -> Result<Option<T>, ExtmemError> {
        let column = self.column.borrow();
        if at >= column.len() {
            return Ok(None);
        }
        if let Some(all) = column.as_slice() {
            return Ok(Some(all[at]));
        }
        let block = at / BLOCK;
        let (held, elements) = &mut self.blocks[block % BLOCKS];
        if *held != block {
            // A block that fails to be read must not be taken for one that was.
            *held = usize::MAX;
            let range = block * BLOCK..column.len().min((block + 1) * BLOCK);
            column.read(range, elements)?;
            *held = block;
        }
        Ok(Some(elements[at % BLOCK]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BufferWriter, Store};

    #[test]
    fn elements_are_the_same_in_any_budget() {
        let items: Vec<u32> = (0..700_000u32).map(|i| i.wrapping_mul(0x9e37_79b9)).collect();
        let dir = tempfile::tempdir().unwrap();
        for limit in [0, 1 << 30] {
            let store = Store::create(dir.path(), limit).unwrap();
            let mut writer = BufferWriter::new(&store, "test", 0).unwrap();
            writer.extend_from_slice(&items).unwrap();
            let mut cached = Cached::new(writer.finish_column().unwrap());
            for step in 0..10_000 {
                let at = step * 7_919 % items.len();
                assert_eq!(cached.get(at).unwrap(), Some(items[at]));
            }
            assert_eq!(cached.get(items.len()).unwrap(), None);
        }
    }
}
