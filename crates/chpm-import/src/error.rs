//! Errors of reading: in a mesh, and with the file that it is in.

use crate::foreign::Foreign;
use crate::location::SourceLocation;
use crate::ply::PlyError;
use chpm_extmem::ExtmemError;
use chpm_mesh::FAR;
use std::io;
use std::path::PathBuf;

/// Reasons why the bytes of a mesh cannot be read. [`SourceError`] adds which file they are in.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// There is no reader for this.
    #[error("{0}")]
    Foreign(Foreign),
    /// The input could not be read.
    #[error("reading failed at byte {offset}: {source}")]
    Read {
        /// Bytes that were read before.
        offset: u64,
        /// Cause.
        source: io::Error,
    },
    /// A line that no sensible file has.
    #[error("line {line} is longer than {limit} bytes; this is most likely a binary or damaged file")]
    LineTooLong {
        /// Line from 1.
        line: u64,
        /// Bytes that a line may have.
        limit: usize,
    },
    /// A text that is not what must be there.
    #[error("{place}: expected {expected}, got '{got}'")]
    Text {
        /// Where the text is.
        place: SourceLocation,
        /// Expected text.
        expected: &'static str,
        /// Found text, shortened.
        got: String,
    },
    /// A coordinate that is NaN or infinite.
    #[error(
        "{place}: a coordinate is {value}; expected a finite number; repair the file, or leave out what has none with --drop-invalid"
    )]
    NotFinite {
        /// The vertex or facet.
        place: SourceLocation,
        /// The coordinate.
        value: f64,
    },
    /// A coordinate that is a number, and too large a one.
    #[error("{place}: coordinate {value:e} is farther from zero than {FAR:e}; scale the model down")]
    TooFar {
        /// The facet.
        place: SourceLocation,
        /// The coordinate.
        value: f64,
    },
    /// A corner that is no vertex. Indices count from 1, or back from the last vertex if they are negative.
    #[error("{place}: vertex index {index} is out of range; there are {vertices} vertices")]
    IndexOutOfRange {
        /// Where the index is.
        place: SourceLocation,
        /// The index as written.
        index: i64,
        /// Vertices of the file, or those up to here if the index is negative.
        vertices: u64,
    },
    /// More vertices or corners than indices can tell apart.
    #[error("{place}: more than {limit} {what}; split the model")]
    TooMany {
        /// The first that is too much.
        place: SourceLocation,
        /// Name of the quantity that is too large.
        what: &'static str,
        /// How many there may be.
        limit: u64,
    },
    /// The input ends too early.
    #[error("{place}: the file ends here; expected {expected}; copy the file again")]
    Truncated {
        /// Part that is cut off, and the length of the file.
        place: SourceLocation,
        /// Expected bytes.
        expected: String,
    },
    /// A list of range scans without one.
    #[error("no 'bmesh' line: this list names no range scan")]
    NoScans,
    /// A list of tiles without one.
    #[error("no line below the first: this list names no tile")]
    NoTiles,
    /// A text that is no JSON, or not that of a glTF.
    #[error("its JSON is not that of a glTF: {0}")]
    Json(String),
    /// A file of a format that is read, in a variant of it that is not.
    #[error("{0}")]
    Unsupported(String),
    /// The stream was asked for more after it had failed.
    #[error("an earlier error has ended this stream")]
    Ended,
    /// A PLY is not valid.
    #[error(transparent)]
    Ply(#[from] PlyError),
    /// Memory or disk.
    #[error(transparent)]
    Extmem(#[from] ExtmemError),
    /// Another file, which the mesh names, cannot be read; or one that has its name in the error already.
    #[error(transparent)]
    Source(Box<SourceError>),
}

impl From<SourceError> for ImportError {
    fn from(error: SourceError) -> Self {
        ImportError::Source(Box::new(error))
    }
}

/// Reasons why a source cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// The source could not be opened or read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The source file.
        path: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// A source that is no file cannot be read twice, or has no end.
    #[error("{path} is {what}, where a file is needed; save it as one and name that")]
    NotAFile {
        /// The path as given.
        path: PathBuf,
        /// Kind of thing that it is.
        what: &'static str,
    },
    /// The source came through a pipe and names files that lie beside it.
    #[error("{path} is {what}, which names files beside it; give it as a file")]
    NamesFiles {
        /// The pipe.
        path: PathBuf,
        /// Name of its content.
        what: &'static str,
    },
    /// A file that a list names cannot be read.
    #[error("{list}: its mesh {index}: {error}")]
    Member {
        /// The list.
        list: PathBuf,
        /// Which of its meshes, from 0.
        index: usize,
        /// Cause.
        error: Box<SourceError>,
    },
    /// A coordinate is beyond what errors and spheres can be stored for.
    #[error("{path}: {place}: coordinate {value:e} is farther from zero than {FAR:e}; scale the model down")]
    TooFar {
        /// The source file.
        path: PathBuf,
        /// The vertex.
        place: SourceLocation,
        /// Its coordinate.
        value: f64,
    },
    /// The source is no valid mesh.
    #[error("{path}: {source}")]
    Import {
        /// The source file.
        path: PathBuf,
        /// Cause, and where.
        source: Box<ImportError>,
    },
    /// Memory or disk.
    #[error(transparent)]
    Extmem(#[from] ExtmemError),
    /// Someone asked to stop.
    #[error("stopped on request; nothing was written")]
    Cancelled,
}

impl SourceError {
    /// Names the file in which something is wrong.
    pub(crate) fn of(path: &std::path::Path, error: impl Into<ImportError>) -> Self {
        match error.into() {
            ImportError::Source(error) => *error,
            ImportError::Extmem(error) => error.into(),
            error => SourceError::Import { path: path.to_owned(), source: Box::new(error) },
        }
    }
}
