//! The 256 bytes at the start of a file.

use crate::error::{FilePart, FormatError, require, require_eq};
use crate::{PACKED_ALIGN, PAGE_ALIGN, checksum};
use bytemuck::{Pod, Zeroable};
use chpm_mesh::{Aabb, Attributes};
use serde::{Deserialize, Serialize};
use std::{fmt, mem};

/// The first eight bytes; like PNG's they show a transfer that changed line ends or lost the eighth bit.
pub const MAGIC: [u8; 8] = [0x89, b'C', b'H', b'P', b'M', 0x0d, 0x0a, 0x1a];
/// Major version that this crate reads and writes.
pub const VERSION_MAJOR: u16 = 1;
/// The last minor version that this crate knows. It writes the first that has all that a file needs.
pub const VERSION_MINOR: u16 = 9;
/// Required flag: pages may be packed, and lie at multiples of [`PACKED_ALIGN`].
pub const PACKED_PAGES: u32 = 1;
/// Required flag: vertices have normals of three bytes.
pub const OCTAHEDRAL_NORMALS: u32 = 2;
/// Required flag: vertices have named scalars.
pub const NAMED_SCALARS: u32 = 4;
/// Required flag: clusters have sheets.
pub const SHEETS: u32 = 8;
/// Required flag: packed pages may be chained, each to one above, as version 1.7 had it, which was never released.
const OUTDATED_CHAINED_PAGES: u32 = 16;
/// Required flag: packed pages may be chained, each to one above.
pub const CHAINED_PAGES: u32 = 32;
/// Required flag: pages are in volumes.
pub const VOLUMES: u32 = 64;
/// Length of the header, bytes.
pub const HEADER_LEN: usize = 256;

/// The header as it lies in the file; see FORMAT.md, "Header".
#[derive(Clone, Copy, Pod, Zeroable, Debug)]
#[repr(C)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: [u8; 8],
    /// Readers refuse another major version.
    pub version_major: u16,
    /// Readers accept any minor version.
    pub version_minor: u16,
    /// [`HEADER_LEN`].
    pub header_len: u32,
    /// Features that a reader must know: [`PACKED_PAGES`], [`OCTAHEDRAL_NORMALS`], [`NAMED_SCALARS`], [`SHEETS`], [`CHAINED_PAGES`], [`VOLUMES`].
    pub required_flags: u32,
    /// Features that a reader may ignore; none are defined.
    pub optional_flags: u32,
    /// Length of the whole file with what is in volumes, bytes.
    pub file_len: u64,
    /// Entries of the section table.
    pub section_count: u32,
    /// Where the section table starts; [`HEADER_LEN`].
    pub section_table_offset: u32,
    /// [`PAGE_ALIGN`], or [`PACKED_ALIGN`] where pages are packed.
    pub page_align: u32,
    /// Bit 0: normals; bit 1: colours; bit 2: octahedral normals in place of those of bit 0; bits 8 to 15: words of named scalars.
    pub attributes: u32,
    /// Vertices that leaf triangles use, each counted once.
    pub source_vertex_count: u64,
    /// Triangles of all leaf clusters.
    pub source_triangle_count: u64,
    /// Records of the cluster table.
    pub cluster_count: u32,
    /// Records of the group table.
    pub group_count: u32,
    /// Records of the level table.
    pub level_count: u32,
    /// Clusters without a parent group.
    pub root_count: u32,
    /// Clusters of level 0.
    pub leaf_count: u32,
    /// A [`BoundaryMode`].
    pub boundary_mode: u32,
    /// An [`ErrorKind`].
    pub error_kind: u32,
    /// Number of shared vertex ids; the ids are all smaller.
    pub shared_vertex_count: u32,
    /// Stored positions are relative to this point.
    pub origin: [f64; 3],
    /// Smallest corner of the union of the clusters' boxes.
    pub aabb_min: [f32; 3],
    /// Largest corner of it.
    pub aabb_max: [f32; 3],
    /// Largest error of a base mesh.
    pub max_error: f32,
    /// Zero.
    pub reserved: [u8; 92],
    /// Checksum of the section table.
    pub section_table_checksum: u64,
    /// Checksum of all bytes before it.
    pub header_checksum: u64,
}

const _: () = assert!(mem::size_of::<Header>() == HEADER_LEN);
const _: () = assert!(mem::offset_of!(Header, origin) == 96 && mem::offset_of!(Header, max_error) == 144);
const _: () = assert!(mem::offset_of!(Header, section_table_checksum) == 240);

/// How boundaries between clusters were treated (chpm.md's modes; the reader need not care).
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[repr(u32)]
pub enum BoundaryMode {
    /// Shared vertices never collapse.
    Lock = 0,
    /// Shared vertices of a dependency group collapse in all its members alike.
    #[default]
    Dependencies = 1,
    /// Clusters are partitioned again after every merge.
    VPartition = 2,
}

/// Meaning of the stored errors.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[repr(u32)]
pub enum ErrorKind {
    /// A quadric estimate of the deviation: no bound.
    Quadric = 0,
    /// At least the symmetric Hausdorff distance to the original surface, apart from what has vanished; see [`crate::Gaps`].
    #[default]
    Certified = 1,
}

impl fmt::Display for BoundaryMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            BoundaryMode::Lock => "lock",
            BoundaryMode::Dependencies => "dependencies",
            BoundaryMode::VPartition => "vpartition",
        })
    }
}

impl fmt::Display for ErrorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ErrorKind::Quadric => "quadric estimate",
            ErrorKind::Certified => "certified bound",
        })
    }
}

/// The attribute bits of a header or page.
pub(crate) fn attribute_bits(attributes: Attributes) -> u32 {
    let Attributes { normals, octahedral, colors, scalar_words } = attributes;
    u32::from(normals)
        | u32::from(colors) << 1
        | u32::from(octahedral) << 2
        | u32::from(scalar_words) << SCALAR_BITS.start
}

/// Attributes of these bits; `None` for a bit that means nothing, and for normals of both kinds.
pub(crate) fn attributes_of(bits: u32) -> Option<Attributes> {
    let bit = |place: u32| bits >> place & 1 == 1;
    let scalar_words = (bits >> SCALAR_BITS.start) as u8;
    let attributes = Attributes { normals: bit(0), octahedral: bit(2), colors: bit(1), scalar_words };
    let is_known = attribute_bits(attributes) == bits;
    (is_known && !(attributes.normals && attributes.octahedral)).then_some(attributes)
}

/// The attribute bits that are a number: words of a vertex's scalars.
const SCALAR_BITS: std::ops::Range<u32> = 8..16;

/// Allowed attribute bits, for a message.
pub(crate) const ATTRIBUTE_BITS: &str = "bits 0 to 2 and 8 to 15, and not both of bits 0 and 2";

/// Alignment of pages.
pub(crate) fn page_align(packed: bool) -> u64 {
    if packed { PACKED_ALIGN } else { PAGE_ALIGN }
}

/// Compares a file's length with the bytes that there are.
pub(crate) fn require_len(expected: u64, got: u64) -> Result<(), FormatError> {
    if expected > got {
        return Err(FormatError::Truncated { place: FilePart::File, expected, got });
    }
    require_eq(FilePart::Header, "file_len", got, expected)
}

impl Header {
    /// Attributes of the vertices.
    pub fn attributes(&self) -> Attributes {
        attributes_of(self.attributes).unwrap_or_default()
    }

    /// How boundaries were treated; `None` for a code that [`crate::Chpm::open`] would have refused.
    pub fn boundary_mode(&self) -> Option<BoundaryMode> {
        [BoundaryMode::Lock, BoundaryMode::Dependencies, BoundaryMode::VPartition]
            .get(self.boundary_mode as usize)
            .copied()
    }

    /// Meaning of the errors; `None` for a code that [`crate::Chpm::open`] would have refused.
    pub fn error_kind(&self) -> Option<ErrorKind> {
        [ErrorKind::Quadric, ErrorKind::Certified].get(self.error_kind as usize).copied()
    }

    /// Whether groups tell what has vanished, so that errors and gaps together are distances to the whole source.
    pub fn has_gaps(&self) -> bool {
        self.version_minor >= 1
    }

    /// Whether pages may be packed.
    pub fn is_packed(&self) -> bool {
        self.required_flags & PACKED_PAGES != 0
    }

    /// Whether packed pages may be chained: told by a page above.
    pub fn is_chained(&self) -> bool {
        self.required_flags & CHAINED_PAGES != 0
    }

    /// Whether clusters have sheets: images of their surface.
    pub fn has_sheets(&self) -> bool {
        self.required_flags & SHEETS != 0
    }

    /// Whether pages are in volumes: files of their own.
    pub fn has_volumes(&self) -> bool {
        self.required_flags & VOLUMES != 0
    }

    /// The box around everything, relative to the origin.
    pub fn aabb(&self) -> Aabb {
        Aabb { min: self.aabb_min, max: self.aabb_max }
    }

    /// The checksum that the header must carry.
    pub(crate) fn own_checksum(&self) -> u64 {
        checksum(&bytemuck::bytes_of(self)[..mem::offset_of!(Header, header_checksum)])
    }

    /// Reads the header of a file of `got` bytes, of which these are the first, and checks what can be checked without the rest of the file.
    pub(crate) fn read(bytes: &[u8], got: u64) -> Result<Header, FormatError> {
        let mut magic = [0; 8];
        let known = bytes.len().min(8);
        magic[..known].copy_from_slice(&bytes[..known]);
        // What is empty, or begins as it should and ends, was cut short.
        if !MAGIC.starts_with(&magic[..known]) {
            return Err(FormatError::Magic { got: magic });
        }
        let head = bytes.get(..HEADER_LEN).ok_or(FormatError::Truncated {
            place: FilePart::Header,
            expected: HEADER_LEN as u64,
            got,
        })?;
        let header: Header = bytemuck::pod_read_unaligned(head);
        header.check(got)?;
        Ok(header)
    }

    fn check(&self, got: u64) -> Result<(), FormatError> {
        let place = FilePart::Header;
        if self.version_major != VERSION_MAJOR {
            let version = format!("{}.{}", self.version_major, self.version_minor);
            return Err(FormatError::Version { place, expected: "1.x", got: version });
        }

        let (expected, found) = (self.own_checksum(), self.header_checksum);
        if expected != found {
            return Err(FormatError::Checksum { place, expected: found, got: expected });
        }

        let is_outdated = self.required_flags & OUTDATED_CHAINED_PAGES != 0;
        let expected = "chained pages of version 1.8, not of 1.7; build the file again";
        require(!is_outdated, place, "required_flags", expected, self.required_flags)?;
        let unknown = self.required_flags
            & !(PACKED_PAGES | OCTAHEDRAL_NORMALS | NAMED_SCALARS | SHEETS | CHAINED_PAGES | VOLUMES);
        if unknown != 0 {
            return Err(FormatError::Feature { place, got: unknown });
        }

        require_eq(place, "header_len", HEADER_LEN as u32, self.header_len)?;
        require_eq(place, "section_table_offset", HEADER_LEN as u32, self.section_table_offset)?;
        require_eq(place, "page_align", page_align(self.is_packed()), self.page_align.into())?;
        // Where volumes begin, the section table says.
        if !self.has_volumes() {
            require_len(self.file_len, got)?;
        }

        // Chained pages are packed, and have triangles in an order that no sheet knows.
        let alone = !self.is_chained() || self.is_packed() && !self.has_sheets();
        require(alone, place, "required_flags", "32 with 1 and without 8", self.required_flags)?;
        let attributes = attributes_of(self.attributes);
        require(attributes.is_some(), place, "attributes", ATTRIBUTE_BITS, self.attributes)?;
        let flagged = self.required_flags & OCTAHEDRAL_NORMALS != 0;
        require_eq(place, "flag of octahedral normals", self.attributes().octahedral, flagged)?;
        let flagged = self.required_flags & NAMED_SCALARS != 0;
        require_eq(place, "flag of named scalars", self.attributes().scalar_words > 0, flagged)?;
        require(self.boundary_mode().is_some(), place, "boundary_mode", "0, 1 or 2", self.boundary_mode)?;
        require(self.error_kind().is_some(), place, "error_kind", "0 or 1", self.error_kind)?;

        let finite = self.origin.iter().all(|x| x.is_finite());
        require(finite, place, "origin", "finite numbers", format_args!("{:?}", self.origin))?;
        let (min, max) = (self.aabb_min, self.aabb_max);
        let boxed = min.iter().zip(max).all(|(min, max)| min.is_finite() && max.is_finite() && *min <= max);
        require(boxed, place, "box", "finite, min <= max", format_args!("{min:?} {max:?}"))?;
        let (legal, error) = (self.max_error.is_finite() && self.max_error >= 0.0, self.max_error);
        require(legal, place, "max_error", "finite, at least 0", error)
    }
}
