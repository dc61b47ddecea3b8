//! What can be wrong with a mesh that is no PLY, and where.

use crate::foreign::Foreign;
use crate::ply::Place;
use chpm_mesh::FAR;
use std::io;

/// Why an STL, an OBJ or a list of range scans cannot be read.
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
        /// What the input said.
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
        place: Place,
        /// What may be there.
        expected: &'static str,
        /// What is there, shortened.
        got: String,
    },
    /// A coordinate that is NaN or infinite.
    #[error(
        "{place}: a coordinate is {value}; expected a finite number; repair the file, or leave out what has none with --drop-invalid"
    )]
    NotFinite {
        /// The vertex or facet.
        place: Place,
        /// The coordinate.
        value: f64,
    },
    /// A coordinate that is a number, and too large a one.
    #[error("{place}: coordinate {value:e} is farther from zero than {FAR:e}; scale the model down")]
    TooFar {
        /// The facet.
        place: Place,
        /// The coordinate.
        value: f64,
    },
    /// A corner that is no vertex. Indices count from 1, or back from the last vertex if they are negative.
    #[error("{place}: vertex index {index} is out of range; there are {vertices} vertices")]
    IndexOutOfRange {
        /// Where the index is.
        place: Place,
        /// The index as written.
        index: i64,
        /// Vertices of the file, or those up to here if the index is negative.
        vertices: u64,
    },
    /// More vertices or corners than indices can tell apart.
    #[error("{place}: more than {limit} {what}; split the model")]
    TooMany {
        /// The first that is too much.
        place: Place,
        /// What there is too much of.
        what: &'static str,
        /// How many there may be.
        limit: u64,
    },
    /// The input ends too early.
    #[error("{place}: the file ends here; expected {expected}; copy the file again")]
    Truncated {
        /// What is not whole, and the length of the file.
        place: Place,
        /// What should have come.
        expected: String,
    },
    /// A list of range scans without one.
    #[error("no 'bmesh' line: this list names no range scan")]
    NoScans,
    /// The stream was asked for more after it had failed.
    #[error("an earlier error has ended this stream")]
    Ended,
}
