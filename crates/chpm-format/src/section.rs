//! The section table: what lies where.

use crate::error::{FilePart, FormatError, invalid, require, require_eq};
use crate::header::{HEADER_LEN, Header, require_len};
use crate::records::{ClusterRecord, GroupRecord, LevelRecord};
use crate::remnant::Remnant;
use crate::section_kind::KINDS;
pub use crate::section_kind::{OPTIONAL_KIND, SectionKind};
use crate::sheet::SheetRecord;
use crate::volume::VolumeRecord;
use crate::{TABLE_ALIGN, align_up, checksum, chunks, scalars};
use bytemuck::{Pod, Zeroable};
use std::{mem, ops::Range};

/// Most entries of a section table.
pub const MAX_SECTIONS: u32 = 64;
impl SectionKind {
    /// Bytes of a record; 0 for a section that is no table.
    pub const fn record_len(self) -> u32 {
        match self {
            SectionKind::Clusters => mem::size_of::<ClusterRecord>() as u32,
            SectionKind::Groups => mem::size_of::<GroupRecord>() as u32,
            SectionKind::Members => mem::size_of::<u32>() as u32,
            SectionKind::Levels => mem::size_of::<LevelRecord>() as u32,
            SectionKind::Metadata | SectionKind::Scalars | SectionKind::Texels | SectionKind::Pages => 0,
            SectionKind::Textures => mem::size_of::<SheetRecord>() as u32,
            SectionKind::Volumes => mem::size_of::<VolumeRecord>() as u32,
            SectionKind::Chunks => chunks::WORD as u32,
            SectionKind::Remnants => mem::size_of::<Remnant>() as u32,
        }
    }
}

/// One entry of the section table; see FORMAT.md, "Section table".
#[derive(Clone, Copy, Pod, Zeroable, Debug)]
#[repr(C)]
pub struct SectionEntry {
    /// A [`SectionKind`], or a kind with [`OPTIONAL_KIND`] set.
    pub kind: u32,
    /// Bytes of a record; 0 where the section is no table.
    pub record_len: u32,
    /// First byte in the file.
    pub offset: u64,
    /// Bytes, without padding behind.
    pub len: u64,
    /// Records; 1 for METADATA, scalars for SCALARS, sheets for TEXELS, pages for PAGES.
    pub count: u64,
    /// Checksum of the bytes; 0 for TEXELS and PAGES, whose sheets and pages carry their own.
    pub checksum: u64,
}

const _: () = assert!(mem::size_of::<SectionEntry>() == 40);

/// Where the known sections are, checked: ranges lie in the file and do not overlap.
#[derive(Clone, Debug)]
pub(crate) struct Sections([Option<Placed>; KINDS]);

/// An entry of the section table, and where its bytes are.
#[derive(Clone, Debug)]
struct Placed {
    entry: SectionEntry,
    range: Range<usize>,
}

/// Where the section table is.
pub(crate) fn table_range(header: &Header) -> Result<Range<usize>, FormatError> {
    let count = header.section_count;
    let most = format_args!("at most {MAX_SECTIONS}");
    require(count <= MAX_SECTIONS, FilePart::SectionTable, "section_count", most, count)?;
    Ok(HEADER_LEN..table_end(header))
}

pub(crate) fn table_end(header: &Header) -> usize {
    HEADER_LEN + header.section_count as usize * mem::size_of::<SectionEntry>()
}

impl Sections {
    /// Where a section is; nowhere if it is absent.
    pub(crate) fn range(&self, kind: SectionKind) -> Range<usize> {
        self.0[kind.slot()].as_ref().map_or(0..0, |placed| placed.range.clone())
    }

    pub(crate) fn count(&self, kind: SectionKind) -> u64 {
        self.0[kind.slot()].as_ref().map_or(0, |placed| placed.entry.count)
    }

    pub(crate) fn has(&self, kind: SectionKind) -> bool {
        self.0[kind.slot()].is_some()
    }

    /// The checksum that a section must have.
    pub(crate) fn checksum(&self, kind: SectionKind) -> u64 {
        self.0[kind.slot()].as_ref().map_or(0, |placed| placed.entry.checksum)
    }

    /// Reads the section table of a file whose header was checked; checks bounds, order, padding and checksums. What is in volumes is not in `bytes`.
    pub(crate) fn read(header: &Header, bytes: &[u8]) -> Result<Sections, FormatError> {
        let range = table_range(header)?;
        let (place, expected, got) = (FilePart::SectionTable, range.end as u64, bytes.len() as u64);
        let table = bytes.get(range.clone()).ok_or(FormatError::Truncated { place, expected, got })?;
        let mut end = range.end;
        let sections = Self::place(header, table, |Placed { entry, range }| {
            let kind = entry.known();
            let padding = std::mem::replace(&mut end, range.end)..range.start;
            if header.has_volumes() && kind == Some(SectionKind::Pages) && padding.start > bytes.len() {
                return Ok(());
            }
            let here = |range: Range<usize>| {
                let expected = range.end as u64;
                bytes.get(range).ok_or(FormatError::Truncated { place, expected, got })
            };
            let zero = here(padding)?.iter().all(|b| *b == 0);
            require(zero, place, "padding between sections", "zeros", "other bytes")?;
            match kind {
                Some(SectionKind::Pages | SectionKind::Texels) => Ok(()),
                // A later minor version may have sections of other kinds; only their bytes are checked.
                kind => {
                    check_sum(kind.map_or(place, FilePart::Section), entry.checksum, here(range.clone())?)
                }
            }
        })?;
        if header.has_volumes() {
            require_len(sections.body().start, got)?;
        }
        Ok(sections)
    }

    /// Sheets and pages: the bytes that are in volumes, where there are any.
    pub(crate) fn body(&self) -> Range<u64> {
        let pages = self.range(SectionKind::Pages);
        let first = if self.has(SectionKind::Texels) { SectionKind::Texels } else { SectionKind::Pages };
        self.range(first).start as u64..pages.end as u64
    }

    /// As [`Sections::read`], by the section table alone: no bytes of sections are looked at.
    pub(crate) fn read_places(header: &Header, table: &[u8]) -> Result<Sections, FormatError> {
        Self::place(header, table, |_| Ok(()))
    }

    /// Hands each entry on once its place is known to be in the file.
    fn place(
        header: &Header,
        table: &[u8],
        mut placed: impl FnMut(&Placed) -> Result<(), FormatError>,
    ) -> Result<Sections, FormatError> {
        let place = FilePart::SectionTable;
        check_sum(place, header.section_table_checksum, table)?;
        let mut found = [const { None }; KINDS];
        let mut end = HEADER_LEN + table.len();
        let (mut last, mut before) = (None, None);
        for entry in table.chunks_exact(mem::size_of::<SectionEntry>()) {
            let entry: SectionEntry = bytemuck::pod_read_unaligned(entry);
            let range = entry.place_after(end, header)?;
            end = range.end;
            before = std::mem::replace(&mut last, entry.known());
            if let Some(kind) = last {
                entry.check_shape(kind)?;
            }
            let here = Placed { entry, range };
            placed(&here)?;
            let Some(kind) = last else { continue };
            let slot = &mut found[kind.slot()];
            require(slot.is_none(), place, "sections of a kind", "one", format_args!("two of {kind}"))?;
            *slot = Some(here);
        }

        require(last == Some(SectionKind::Pages), place, "last section", "PAGES", "another")?;
        require_eq(place, "end of the last section", header.file_len, end as u64)?;
        let lacks =
            SectionKind::ALL.into_iter().find(|kind| kind.is_needed() && found[kind.slot()].is_none());
        if let Some(kind) = lacks {
            return Err(invalid(place, "sections", kind, "none of that kind"));
        }
        for (kind, bit, is_flagged) in [
            (SectionKind::Textures, 3, header.has_sheets()),
            (SectionKind::Texels, 3, header.has_sheets()),
            (SectionKind::Volumes, 6, header.has_volumes()),
        ] {
            let told = format_args!("as bit {bit} of required_flags says of {kind}");
            let is_there = found[kind.slot()].is_some();
            require(is_there == is_flagged, place, "sections", told, is_there)?;
        }
        let goes_on = !header.has_volumes() || !header.has_sheets() || before == Some(SectionKind::Texels);
        require(goes_on, place, "section before PAGES", "TEXELS", "another")?;
        Ok(Sections(found))
    }
}

impl SectionEntry {
    fn known(&self) -> Option<SectionKind> {
        SectionKind::ALL.into_iter().find(|kind| *kind as u32 == self.kind)
    }

    /// The byte range of the section, which must start at the first aligned place after `previous_end`.
    fn place_after(&self, previous_end: usize, header: &Header) -> Result<Range<usize>, FormatError> {
        let place = FilePart::SectionTable;
        let known = self.known();
        if known.is_none() && self.kind & OPTIONAL_KIND == 0 {
            return Err(FormatError::Feature { place, got: self.kind });
        }
        let align = known.map_or(TABLE_ALIGN, |kind| kind.align(header.has_volumes()));
        let expected = align_up(previous_end as u64, align).unwrap_or(u64::MAX);
        require_eq(place, "offset of a section", expected, self.offset)?;
        let end = self.offset.saturating_add(self.len);
        if end > header.file_len {
            return Err(FormatError::Truncated { place, expected: end, got: header.file_len });
        }
        Ok(self.offset as usize..end as usize)
    }

    fn check_shape(&self, kind: SectionKind) -> Result<(), FormatError> {
        let place = FilePart::Section(kind);
        require_eq(place, "record_len", kind.record_len(), self.record_len)?;
        match kind {
            SectionKind::Metadata => require_eq(place, "count", 1, self.count),
            SectionKind::Scalars => {
                let most = scalars::MOST_LEN;
                require(self.len <= most, place, "len", format_args!("at most {most}"), self.len)
            }
            SectionKind::Pages | SectionKind::Texels => require_eq(place, "checksum", 0, self.checksum),
            _ => {
                let len = self.count.checked_mul(u64::from(self.record_len));
                require(len == Some(self.len), place, "len", "count * record_len", self.len)
            }
        }
    }
}

/// Compares a checksum with its bytes.
pub(crate) fn check_sum(place: FilePart, expected: u64, bytes: &[u8]) -> Result<(), FormatError> {
    let got = checksum(bytes);
    if expected == got { Ok(()) } else { Err(FormatError::Checksum { place, expected, got }) }
}
