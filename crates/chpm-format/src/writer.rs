//! Writing a file in one forward pass.

use crate::error::{FilePart, FormatError, require_eq};
use crate::header::page_align;
use crate::section::check_sum;
use crate::tables::Tables;
use crate::{PAGE_ALIGN, align_up};
use chpm_mesh::ClusterId;
use std::io::Write;

/// A file that is being written: tables first, then the pages in the order of the cluster table. Nothing is written
/// twice, so `W` need not seek. The file is complete only when [`ChpmWriter::finish`] has answered.
#[derive(Debug)]
pub struct ChpmWriter<W> {
    out: W,
    /// Length and checksum of every page.
    pages: Vec<(u32, u64)>,
    written: usize,
    offset: u64,
    align: u64,
    file_len: u64,
}

impl<W: Write> ChpmWriter<W> {
    /// Completes and checks `tables` (see [`Tables`]) and writes everything that comes before the pages.
    ///
    /// # Errors
    /// [`FormatError::Value`] for tables that no file may have; [`FormatError::Write`].
    pub fn begin(mut out: W, tables: &mut Tables) -> Result<Self, FormatError> {
        let (head, file_len) = tables.head()?;
        out.write_all(&head)?;
        let pages = tables.clusters.iter().map(|c| (c.page_len, c.page_checksum)).collect();
        let align = page_align(tables.header.packed);
        Ok(ChpmWriter { out, pages, written: 0, offset: head.len() as u64, align, file_len })
    }

    /// Writes the next page and its padding.
    ///
    /// # Errors
    /// A page that is not the one that the table announces, by length or checksum; a page too many;
    /// [`FormatError::Write`].
    pub fn page(&mut self, payload: &[u8]) -> Result<(), FormatError> {
        let id = ClusterId(self.written as u32);
        let Some((len, checksum)) = self.pages.get(self.written) else {
            return require_eq(FilePart::File, "pages written", self.pages.len(), self.written + 1);
        };
        require_eq(FilePart::Page(id), "length", u64::from(*len), payload.len() as u64)?;
        check_sum(FilePart::Page(id), *checksum, payload)?;
        self.out.write_all(payload)?;
        let end = self.offset + payload.len() as u64;
        self.offset = align_up(end, self.align).unwrap_or(end);
        self.out.write_all(&[0; PAGE_ALIGN as usize][..(self.offset - end) as usize])?;
        self.written += 1;
        Ok(())
    }

    /// Checks that every page was written, flushes and gives the output back.
    ///
    /// # Errors
    /// Pages that are missing; [`FormatError::Write`].
    pub fn finish(mut self) -> Result<W, FormatError> {
        require_eq(FilePart::File, "pages written", self.pages.len(), self.written)?;
        require_eq(FilePart::File, "bytes written", self.file_len, self.offset)?;
        self.out.flush()?;
        Ok(self.out)
    }
}
