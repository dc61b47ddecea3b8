//! The kinds of sections, which errors name.

use crate::{PAGE_ALIGN, TABLE_ALIGN};
use std::fmt;

/// Set in the kinds that a reader may skip without knowing them.
pub const OPTIONAL_KIND: u32 = 1 << 31;

/// The sections that are known: every file has each once, but for CHUNKS, SCALARS, REMNANTS, TEXTURES, TEXELS and VOLUMES, which may be absent.
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
    /// Names and ranges of the scalars that vertices have; only where they have any.
    Scalars = 7,
    /// Records of sheets, one a cluster; only where clusters have any.
    Textures = 8,
    /// The sheets themselves; there with TEXTURES.
    Texels = 9,
    /// Records of volumes; only where pages are in some.
    Volumes = 10,
    /// Checksums of the tables' chunks; the first section where it is there.
    Chunks = OPTIONAL_KIND | 1,
    /// Remnants of components that vanish; only where there are any.
    Remnants = OPTIONAL_KIND | 2,
}

/// Number of kinds that are known.
pub(crate) const KINDS: usize = SectionKind::ALL.len();

impl SectionKind {
    /// All of them, in the order in which the writer lays them out.
    pub const ALL: [SectionKind; 12] = [
        SectionKind::Chunks,
        SectionKind::Volumes,
        SectionKind::Clusters,
        SectionKind::Groups,
        SectionKind::Members,
        SectionKind::Levels,
        SectionKind::Metadata,
        SectionKind::Scalars,
        SectionKind::Remnants,
        SectionKind::Textures,
        SectionKind::Texels,
        SectionKind::Pages,
    ];

    /// Whether every file has it.
    pub(crate) fn is_needed(self) -> bool {
        use SectionKind::{Scalars, Texels, Textures, Volumes};
        self as u32 & OPTIONAL_KIND == 0 && !matches!(self, Scalars | Textures | Texels | Volumes)
    }

    /// Its place among the kinds, below [`KINDS`].
    pub(crate) fn slot(self) -> usize {
        match self {
            SectionKind::Chunks => 0,
            SectionKind::Remnants => KINDS - 1,
            kind => kind as usize,
        }
    }

    /// Alignment in the file; volumes begin as pages do, also with sheets.
    pub(crate) fn align(self, has_volumes: bool) -> u64 {
        let is_aligned = self == SectionKind::Pages || has_volumes && self == SectionKind::Texels;
        if is_aligned { PAGE_ALIGN } else { TABLE_ALIGN }
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
            SectionKind::Scalars => "SCALARS",
            SectionKind::Pages => "PAGES",
            SectionKind::Chunks => "CHUNKS",
            SectionKind::Remnants => "REMNANTS",
            SectionKind::Textures => "TEXTURES",
            SectionKind::Texels => "TEXELS",
            SectionKind::Volumes => "VOLUMES",
        })
    }
}
