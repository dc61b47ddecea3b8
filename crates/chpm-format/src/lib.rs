//! The CHPM file: reader, writer, verify, dump; no I/O.
//!
//! `FORMAT.md` beside this crate is the normative description; this crate is one implementation of it. The reader is
//! generic over bytes that are already in memory (a map, a vector), the writer over anything that takes bytes
//! forward. Nothing of a file is trusted before it was checked, and damage is answered by a [`FormatError`] that names it.
//!
//! 1. A file is a [`Header`], a table of [sections](SectionEntry), the tables, and a page for each cluster. [`Chpm::open`] checks all but the pages, in
//!    time proportional to the tables; [`Chpm::page`] checks one page when it is asked for.
//! 2. A [`ClusterRecord`] says where a cluster's page is, what it holds and where it is in space. A [`Page`] is a progressive mesh: vertices that stay first, then those
//!    that collapse, in such an order that a mesh of n vertices has the first n; each later one goes to its target. Errors grow as n falls.
//! 3. A [`GroupRecord`] names the coarse clusters that are replaced together and the fine ones that replace them. The groups are an acyclic graph.
//! 4. Selecting a mesh by these is `chpm-refine`'s; the rule itself is in `FORMAT.md`, some twenty lines.
//! 5. A writer hands over [`Tables`] with the lengths of all pages, and then the pages in order ([`ChpmWriter`]); [`verify()`] checks every invariant that a file
//!    alone can show.
//!
//! ```
//! use chpm_format::{Chpm, ChpmWriter, ClusterRecord, GroupRecord, LevelRecord, PageParts, Tables, verify};
//! use chpm_mesh::{ClusterId, GroupId, Level, VertexSlices};
//!
//! let parts = PageParts {
//!     vertices: VertexSlices::new(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]),
//!     triangles: &[[0, 1, 2], [1, 3, 2]],
//!     targets: &[1], // The last vertex collapses to vertex 1, which costs an error of 0.5.
//!     errors: &[0.5],
//!     ..PageParts::default()
//! };
//! let mut page = Vec::new();
//! parts.encode(&mut page)?;
//! let cluster = ClusterRecord::of_page(&page, Level(0), GroupId(0), GroupId::NONE)?;
//! let (center, radius) = (cluster.center, cluster.radius);
//! let group = GroupRecord { coarse_count: 1, max_error: 0.5, center, radius, ..Default::default() };
//!
//! let mut tables = Tables { clusters: vec![cluster], groups: vec![group], ..Tables::default() };
//! tables.members = vec![0];
//! tables.levels = vec![LevelRecord::default()];
//! tables.header.source_vertex_count = 4;
//! let mut writer = ChpmWriter::begin(Vec::new(), &mut tables)?;
//! writer.page(&page)?;
//!
//! let file = Chpm::open(writer.finish()?)?;
//! assert!(verify(&file, |_, _| ()).is_ok());
//! assert_eq!(file.page(ClusterId(0))?.view().vertices_for(0.5), 3);
//! # Ok::<(), chpm_format::FormatError>(())
//! ```
#![forbid(unsafe_code)]

#[cfg(target_endian = "big")]
compile_error!("chpm reads its little-endian records in place and supports little-endian hosts only");

mod chunks;
pub mod dump;
pub mod error;
pub mod error_code;
mod gaps;
pub mod header;
pub mod metadata;
pub mod packed;
pub mod page;
pub mod page_buf;
mod parents;
pub mod parts;
pub mod reader;
pub mod records;
mod remnant;
pub mod remote;
pub mod same;
mod scalars;
pub mod section;
mod section_kind;
pub mod sheet;
pub mod shown;
mod structure;
pub mod tables;
pub mod verify;
pub mod volume;
pub mod writer;

pub use dump::dump;
pub use error::{FilePart, FormatError, VolumeFault};
pub use gaps::Gaps;
pub use header::{BoundaryMode, ErrorKind, Header};
pub use metadata::{LATTICE_STEP, Metadata, Source};
pub use page::{Page, PageHeader};
pub use page_buf::PageBuf;
pub use parts::PageParts;
pub use reader::Chpm;
pub use records::{ClusterRecord, GroupRecord, LevelRecord};
pub use remnant::Remnant;
pub use remote::RemoteChpm;
pub use section::SectionEntry;
pub use section_kind::SectionKind;
pub use sheet::{ImageCodec, MAX_SIDE, Sheet, SheetLayout, SheetRecord};
pub use tables::{HeaderFields, Tables};
pub use verify::{Fault, Invariant, Report, verify, verify_within};
pub use volume::VolumeRecord;
pub use writer::ChpmWriter;

/// Alignment of cluster pages in the file, bytes.
pub const PAGE_ALIGN: u64 = 4096;
/// Alignment of cluster pages where they may be packed, bytes.
pub const PACKED_ALIGN: u64 = 8;
/// Alignment of the tables in the file, bytes.
pub const TABLE_ALIGN: u64 = 64;
/// Alignment that [`Chpm::open`] needs of the bytes in memory.
pub const MEMORY_ALIGN: usize = 8;
/// Most vertices of a cluster: local indices are 16 bits, and `n` itself must fit too.
pub const MAX_CLUSTER_VERTICES: u32 = 65_535;

/// The checksum of the format: XXH3, 64 bits, seed 0.
pub fn checksum(bytes: &[u8]) -> u64 {
    xxhash_rust::xxh3::xxh3_64(bytes)
}

/// `value` rounded up to a multiple of the power of two `align`; `None` where that overflows.
fn align_up(value: u64, align: u64) -> Option<u64> {
    Some(value.checked_add(align - 1)? & !(align - 1))
}
