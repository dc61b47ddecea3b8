//! Writing a file in one forward pass.

use crate::error::{FilePart, FormatError, require_eq};
use crate::header::page_align;
use crate::section::check_sum;
use crate::sheet::SheetRecord;
use crate::tables::Tables;
use crate::{PAGE_ALIGN, align_up};
use chpm_mesh::ClusterId;
use std::io::Write;

/// A file that is being written: tables first, then sheets, if there are any, and the pages in the order of the cluster table. Nothing is written
/// twice, so `W` need not seek. The file is complete only when [`ChpmWriter::finish`] has answered.
#[derive(Debug)]
pub struct ChpmWriter<W> {
    out: W,
    /// Place, length and checksum of every sheet, and where the first page is.
    sheets: Vec<(u64, u64, u64)>,
    first_page: u64,
    sheets_written: usize,
    /// Length and checksum of every page.
    pages: Vec<(u32, u64)>,
    written: usize,
    offset: u64,
    align: u64,
    file_len: u64,
}

impl<W: Write> ChpmWriter<W> {
    /// Completes and checks `tables` (see [`Tables`]), which want no volumes, and writes everything that comes before sheets and pages.
    ///
    /// # Errors
    /// [`FormatError::Value`] for tables that no file may have; [`FormatError::Write`].
    pub fn begin(mut out: W, tables: &mut Tables) -> Result<Self, FormatError> {
        let apart = tables.header.volume_size;
        require_eq(FilePart::File, "volumes of one output", 0, apart.map_or(0, |_| 1))?;
        let (head, file_len) = tables.head()?;
        out.write_all(&head)?;
        let pages = tables.clusters.iter().map(|c| (c.page_len, c.page_checksum)).collect();
        let align = page_align(tables.header.packed);
        let (first_sheet, first_page) = (tables.first_sheet_offset()?, tables.first_page_offset()?);
        let placed = |sheet: &SheetRecord| (first_sheet + sheet.offset, sheet.len(), sheet.checksum);
        let sheets = tables.sheets.iter().map(placed).collect();
        let (offset, written, sheets_written) = (head.len() as u64, 0, 0);
        Ok(ChpmWriter { out, sheets, first_page, sheets_written, pages, written, offset, align, file_len })
    }

    /// Writes the next sheet, layout and image.
    ///
    /// # Errors
    /// A sheet that is not the one that the table announces, by length or checksum; a sheet too many;
    /// [`FormatError::Write`].
    pub fn sheet(&mut self, payload: &[u8]) -> Result<(), FormatError> {
        let id = ClusterId(self.sheets_written as u32);
        let Some((place, len, checksum)) = self.sheets.get(self.sheets_written).copied() else {
            return require_eq(FilePart::File, "sheets written", self.sheets.len(), self.sheets_written + 1);
        };
        require_eq(FilePart::Sheet(id), "length", len, payload.len() as u64)?;
        check_sum(FilePart::Sheet(id), checksum, payload)?;
        self.pad(place)?;
        self.out.write_all(payload)?;
        self.offset += len;
        self.sheets_written += 1;
        Ok(())
    }

    /// Writes zeros up to an offset.
    fn pad(&mut self, place: u64) -> Result<(), FormatError> {
        self.out.write_all(&[0; PAGE_ALIGN as usize][..(place - self.offset) as usize])?;
        self.offset = place;
        Ok(())
    }

    /// Writes the next page and its padding.
    ///
    /// # Errors
    /// A page that is not the one that the table announces, by length or checksum; a page too many;
    /// [`FormatError::Write`].
    pub fn page(&mut self, payload: &[u8]) -> Result<(), FormatError> {
        let id = ClusterId(self.written as u32);
        let Some((len, checksum)) = self.pages.get(self.written).copied() else {
            return require_eq(FilePart::File, "pages written", self.pages.len(), self.written + 1);
        };
        require_eq(FilePart::Page(id), "length", u64::from(len), payload.len() as u64)?;
        check_sum(FilePart::Page(id), checksum, payload)?;
        require_eq(FilePart::File, "sheets written", self.sheets.len(), self.sheets_written)?;
        self.pad(self.offset.max(self.first_page))?;
        self.out.write_all(payload)?;
        self.offset += payload.len() as u64;
        self.pad(align_up(self.offset, self.align).unwrap_or(self.offset))?;
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
