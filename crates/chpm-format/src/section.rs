//! The section table: what lies where.

use crate::error::{FormatError, Place, invalid, require, require_eq};
use crate::header::{HEADER_LEN, Header};
use crate::records::{ClusterRecord, GroupRecord, LevelRecord};
use crate::{PAGE_ALIGN, TABLE_ALIGN, align_up, checksum};
use bytemuck::{Pod, Zeroable};
use std::{fmt, mem, ops::Range};

/// Most entries of a section table.
pub const MAX_SECTIONS: u32 = 64;
/// Set in the kinds that a reader may skip without knowing them.
pub const OPTIONAL_KIND: u32 = 1 << 31;

/// The sections that every file has, each once.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u32)]
pub enum SectionKind {
    /// Cluster records.
    Clusters = 1,
    /// Group records.
    Groups = 2,
    /// Cluster ids, `u32`, named by ranges in the group records.
    Members = 3,
    /// Level records.
    Levels = 4,
    /// Provenance and settings.
    Metadata = 5,
    /// Cluster pages; the last section.
    Pages = 6,
}

impl SectionKind {
    /// All of them, in the order in which the writer lays them out.
    pub const ALL: [SectionKind; 6] = [
        SectionKind::Clusters,
        SectionKind::Groups,
        SectionKind::Members,
        SectionKind::Levels,
        SectionKind::Metadata,
        SectionKind::Pages,
    ];

    /// Bytes of a record; 0 for a section that is no table.
    pub const fn record_len(self) -> u32 {
        match self {
            SectionKind::Clusters => mem::size_of::<ClusterRecord>() as u32,
            SectionKind::Groups => mem::size_of::<GroupRecord>() as u32,
            SectionKind::Members => mem::size_of::<u32>() as u32,
            SectionKind::Levels => mem::size_of::<LevelRecord>() as u32,
            SectionKind::Metadata | SectionKind::Pages => 0,
        }
    }

    fn slot(self) -> usize {
        self as usize - 1
    }
}

impl fmt::Display for SectionKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SectionKind::Clusters => "CLUSTERS",
            SectionKind::Groups => "GROUPS",
            SectionKind::Members => "MEMBERS",
            SectionKind::Levels => "LEVELS",
            SectionKind::Metadata => "METADATA",
            SectionKind::Pages => "PAGES",
        })
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
    /// Records; 1 for METADATA, pages for PAGES.
    pub count: u64,
    /// Checksum of the bytes; 0 for PAGES, whose pages carry their own.
    pub checksum: u64,
}

const _: () = assert!(mem::size_of::<SectionEntry>() == 40);

/// Where the known sections are, checked: ranges lie in the file and do not overlap.
#[derive(Clone, Debug)]
pub(crate) struct Sections([(Range<usize>, u64); 6]);

impl Sections {
    pub(crate) fn range(&self, kind: SectionKind) -> Range<usize> {
        self.0[kind.slot()].0.clone()
    }

    pub(crate) fn count(&self, kind: SectionKind) -> u64 {
        self.0[kind.slot()].1
    }

    /// Reads the section table of a file whose header was checked; checks bounds, order, padding and checksums.
    pub(crate) fn read(header: &Header, bytes: &[u8]) -> Result<Sections, FormatError> {
        let place = Place::SectionTable;
        let count = header.section_count;
        require(
            count <= MAX_SECTIONS,
            place,
            "section_count",
            format_args!("at most {MAX_SECTIONS}"),
            count,
        )?;
        let table_end = HEADER_LEN + count as usize * mem::size_of::<SectionEntry>();
        let got = bytes.len() as u64;
        let table = bytes.get(HEADER_LEN..table_end).ok_or(FormatError::Truncated {
            place,
            expected: table_end as u64,
            got,
        })?;
        check_sum(place, header.section_table_checksum, table)?;

        let mut found: [Option<(Range<usize>, u64)>; 6] = [const { None }; 6];
        let mut end = table_end;
        let mut last = None;
        for entry in table.chunks_exact(mem::size_of::<SectionEntry>()) {
            let entry: SectionEntry = bytemuck::pod_read_unaligned(entry);
            let range = entry.place_after(end, bytes)?;
            end = range.end;
            last = entry.known();
            // A later minor version may have sections of other kinds; only their bytes are checked.
            let Some(kind) = last else {
                check_sum(place, entry.checksum, &bytes[range])?;
                continue;
            };

            entry.check_shape(kind)?;
            match kind {
                SectionKind::Pages => require_eq(Place::Section(kind), "checksum", 0, entry.checksum)?,
                _ => check_sum(Place::Section(kind), entry.checksum, &bytes[range.clone()])?,
            }
            let slot = &mut found[kind.slot()];
            require(slot.is_none(), place, "sections of a kind", "one", format_args!("two of {kind}"))?;
            *slot = Some((range, entry.count));
        }

        require(last == Some(SectionKind::Pages), place, "last section", "PAGES", "another")?;
        require_eq(place, "end of the last section", got, end as u64)?;

        let mut sections = [const { (0..0, 0) }; 6];
        for (kind, found) in SectionKind::ALL.into_iter().zip(found) {
            sections[kind.slot()] =
                found.ok_or_else(|| invalid(place, "sections", kind, "none of that kind"))?;
        }
        Ok(Sections(sections))
    }
}

impl SectionEntry {
    fn known(&self) -> Option<SectionKind> {
        SectionKind::ALL.into_iter().find(|kind| *kind as u32 == self.kind)
    }

    /// The byte range of the section, which must start at the first aligned place after `previous_end`.
    fn place_after(&self, previous_end: usize, bytes: &[u8]) -> Result<Range<usize>, FormatError> {
        let place = Place::SectionTable;
        let known = self.known();
        if known.is_none() && self.kind & OPTIONAL_KIND == 0 {
            return Err(FormatError::Feature { place, got: self.kind });
        }
        let align = if known == Some(SectionKind::Pages) { PAGE_ALIGN } else { TABLE_ALIGN };
        let expected = align_up(previous_end as u64, align).unwrap_or(u64::MAX);
        require_eq(place, "offset of a section", expected, self.offset)?;
        let got = bytes.len() as u64;
        let end = self.offset.saturating_add(self.len);
        if end > got {
            return Err(FormatError::Truncated { place, expected: end, got });
        }
        let range = self.offset as usize..end as usize;
        let zero = bytes[previous_end..range.start].iter().all(|b| *b == 0);
        require(zero, place, "padding between sections", "zeros", "other bytes")?;
        Ok(range)
    }

    fn check_shape(&self, kind: SectionKind) -> Result<(), FormatError> {
        let place = Place::Section(kind);
        require_eq(place, "record_len", kind.record_len(), self.record_len)?;
        match kind {
            SectionKind::Metadata => require_eq(place, "count", 1, self.count),
            SectionKind::Pages => Ok(()),
            _ => {
                let len = self.count.checked_mul(u64::from(self.record_len));
                require(len == Some(self.len), place, "len", "count * record_len", self.len)
            }
        }
    }
}

/// Compares a checksum with its bytes.
pub(crate) fn check_sum(place: Place, expected: u64, bytes: &[u8]) -> Result<(), FormatError> {
    let got = checksum(bytes);
    if expected == got { Ok(()) } else { Err(FormatError::Checksum { place, expected, got }) }
}
