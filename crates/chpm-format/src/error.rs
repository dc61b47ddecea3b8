//! Errors of a file, or of the input of one.

use crate::section_kind::SectionKind;
use chpm_mesh::{ClusterId, GroupId};
use std::error::Error;
use std::fmt::{self, Display};
use std::path::PathBuf;

/// The part of a file that a message is about.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum FilePart {
    /// The bytes as a whole.
    File,
    /// The 256 bytes at the start.
    Header,
    /// The list of sections, or one entry of it.
    SectionTable,
    /// One section.
    Section(SectionKind),
    /// A record of the cluster table.
    Cluster(ClusterId),
    /// A record of the group table.
    Group(GroupId),
    /// A record of the level table.
    Level(u32),
    /// A cluster's page; [`ClusterId::NONE`] for a page that was parsed by itself.
    Page(ClusterId),
    /// A cluster's sheet.
    Sheet(ClusterId),
    /// A volume, by its number from 1.
    Volume(u32),
}

impl Display for FilePart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FilePart::File => f.write_str("file"),
            FilePart::Header => f.write_str("header"),
            FilePart::SectionTable => f.write_str("section table"),
            FilePart::Section(kind) => write!(f, "section {kind}"),
            FilePart::Cluster(id) => write!(f, "{id}"),
            FilePart::Group(id) => write!(f, "{id}"),
            FilePart::Level(level) => write!(f, "level {level}"),
            FilePart::Page(id) if id.is_some() => write!(f, "page of {id}"),
            FilePart::Page(_) => f.write_str("page"),
            FilePart::Sheet(id) => write!(f, "sheet of {id}"),
            FilePart::Volume(number) => write!(f, "volume {number}"),
        }
    }
}

/// Why bytes are not a legal CHPM file, or why a file could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// The magic number is not there.
    #[error("not a CHPM file: it starts with {}; {}", hexadecimal(got), magic_remedy(got))]
    Magic {
        /// The first bytes of the file.
        got: [u8; 8],
    },
    /// Written by a format that this reader does not know.
    #[error(
        "{place}: format version {got} is not supported (expected {expected}); use a newer chpm, or build the file again"
    )]
    Version {
        /// Header or page.
        place: FilePart,
        /// Version that this reader reads.
        expected: &'static str,
        /// Version of the file.
        got: String,
    },
    /// The file needs a feature that this reader does not know.
    #[error("{place}: unknown required feature {got:#x}; use a newer chpm")]
    Feature {
        /// Header (a flag) or section table (a section kind).
        place: FilePart,
        /// The flag bits or the section kind.
        got: u32,
    },
    /// There are fewer bytes than there must be.
    #[error(
        "{place}: {expected} bytes expected, {got} present; the file is cut short or was never finished, copy or build it again"
    )]
    Truncated {
        /// Part of the file.
        place: FilePart,
        /// Bytes needed.
        expected: u64,
        /// Bytes there.
        got: u64,
    },
    /// The bytes in memory do not start where records can be read in place.
    #[error(
        "{place}: bytes in memory must be aligned to {expected}; map the file, or read it into an aligned buffer"
    )]
    Alignment {
        /// File or page.
        place: FilePart,
        /// The alignment, bytes.
        expected: usize,
    },
    /// Bytes changed after they were written.
    #[error(
        "{place}: checksum {expected:016x} expected, {got:016x} found; the file is damaged, copy or build it again"
    )]
    Checksum {
        /// Part of the file.
        place: FilePart,
        /// Checksum in the file.
        expected: u64,
        /// Checksum of the bytes.
        got: u64,
    },
    /// A value that the format does not allow, or two values that contradict each other.
    #[error("{place}: {field}: expected {expected}, got {got}")]
    Value {
        /// Where.
        place: FilePart,
        /// The field or rule.
        field: &'static str,
        /// Values that the format allows here.
        expected: String,
        /// Found value.
        got: String,
    },
    /// The metadata section does not decode.
    #[error("metadata: {0}; the geometry may still be read")]
    Metadata(String),
    /// The file alone was opened, and its pages are in others.
    #[error(
        "its pages are in {count} volumes beside it; open it by its name, or join them: chpm relayout --volume-size one"
    )]
    Apart {
        /// Volumes that it has.
        count: usize,
    },
    /// A volume that is not what it should be.
    #[error("'{}' {fault}", path.display())]
    Volume {
        /// Name of the volume's file.
        path: PathBuf,
        /// Fault of it.
        fault: VolumeFault,
    },
    /// A volume that could not be opened.
    #[error("'{}', which has pages of it, cannot be read", path.display())]
    Unread {
        /// Name of the volume's file.
        path: PathBuf,
        /// Answer of whoever was to open it.
        source: Box<dyn Error + Send + Sync>,
    },
    /// Bytes that lie elsewhere could not be had.
    #[error("reading: {0}")]
    Read(#[source] std::io::Error),
    /// The output refused bytes.
    #[error("writing: {0}")]
    Write(#[from] std::io::Error),
}

/// Why a file is not the volume that its name says.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VolumeFault {
    /// There is none of that name.
    #[error(
        "is not there, and has pages of it; a model and its volumes have to be in one folder, named alike: copy or rename them together"
    )]
    Missing,
    /// It is another file.
    #[error("should be a volume of it, and is none; copy the one that was made with it, or build it again")]
    None,
    /// It is a volume of another build.
    #[error(
        "is a volume of another build; copy the one that was made with it, or build it again, as after a build that was stopped while it replaced this one"
    )]
    Foreign,
    /// It is another volume of the same build.
    #[error("should be volume {number}, and is volume {other}; give them their own names again")]
    Other {
        /// Number of the one that should be there, from 1.
        number: u32,
        /// Number of the one that is there.
        other: u32,
    },
    /// It is too short or too long.
    #[error("should have {expected} bytes, and has {got}; copy it again")]
    Len {
        /// Bytes that it has to have.
        expected: u64,
        /// Bytes that are there.
        got: u64,
    },
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
}

fn magic_remedy(got: &[u8; 8]) -> &'static str {
    let damaged = &got[1..4] == b"CHP";
    if &got[1..5] == b"CHPV" {
        "it has pages of a model of several files, give the .chpm that it belongs to"
    } else if damaged {
        "a transfer in text mode damaged it, copy it in binary mode"
    } else {
        "give a file that chpm built"
    }
}

impl FormatError {
    /// The same error, with the page it was found in.
    pub(crate) fn in_page(mut self, id: ClusterId) -> Self {
        match &mut self {
            FormatError::Version { place, .. }
            | FormatError::Truncated { place, .. }
            | FormatError::Alignment { place, .. }
            | FormatError::Checksum { place, .. }
            | FormatError::Feature { place, .. }
            | FormatError::Value { place, .. } => {
                if *place == FilePart::Page(ClusterId::NONE) {
                    *place = FilePart::Page(id);
                }
            }
            FormatError::Magic { .. }
            | FormatError::Metadata(_)
            | FormatError::Apart { .. }
            | FormatError::Volume { .. }
            | FormatError::Unread { .. }
            | FormatError::Read(_)
            | FormatError::Write(_) => {}
        }
        self
    }
}

/// `Ok` if `ok`; the texts are made only where it is not.
pub(crate) fn require(
    ok: bool,
    place: FilePart,
    field: &'static str,
    expected: impl Display,
    got: impl Display,
) -> Result<(), FormatError> {
    if ok { Ok(()) } else { Err(invalid(place, field, expected, got)) }
}

/// A value that is not allowed.
pub(crate) fn invalid(
    place: FilePart,
    field: &'static str,
    expected: impl Display,
    got: impl Display,
) -> FormatError {
    FormatError::Value { place, field, expected: expected.to_string(), got: got.to_string() }
}

/// `Ok` if the two are equal.
pub(crate) fn require_eq<T: PartialEq + Display>(
    place: FilePart,
    field: &'static str,
    expected: T,
    got: T,
) -> Result<(), FormatError> {
    require(expected == got, place, field, &expected, &got)
}
