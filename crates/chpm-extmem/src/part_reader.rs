//! Arrays that lie one after another in a part, as their writer appended them.

use crate::error::byte_len;
use crate::{Column, ExtmemError, PartFile};
use bytemuck::Pod;
use std::sync::Arc;

/// A place in a part, which moves on with each array.
#[derive(Debug)]
pub struct PartReader {
    part: Arc<PartFile>,
    offset: u64,
}

impl PartReader {
    /// At `offset` of the part's blobs, bytes.
    pub fn at(part: &Arc<PartFile>, offset: u64) -> Self {
        PartReader { part: Arc::clone(part), offset }
    }

    /// The next `len` elements, read.
    ///
    /// # Errors
    /// As [`PartFile::read_items`].
    pub fn items<T: Pod>(&mut self, len: usize) -> Result<Vec<T>, ExtmemError> {
        let items = self.part.read_items(self.offset, len)?;
        self.offset += size_of_val(&items[..]) as u64;
        Ok(items)
    }

    /// The next `len` elements, which stay where they are; `what` names them in errors.
    ///
    /// # Errors
    /// As [`Column::in_part`].
    pub fn column<T: Pod>(&mut self, what: &'static str, len: usize) -> Result<Column<T>, ExtmemError> {
        let column = Column::in_part(what, Arc::clone(&self.part), self.offset, len)?;
        self.offset += byte_len::<T>(what, len)? as u64;
        Ok(column)
    }
}
