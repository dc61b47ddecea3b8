//! Errors of a section.

use chpm_format::FormatError;
use chpm_mesh::Bytes;

/// Why a file has no section.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SectionError {
    /// A page that is needed is damaged.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A normal without a direction, or a number that is none.
    #[error("plane: {expected} expected, got {got}")]
    Plane {
        /// Expected value.
        expected: &'static str,
        /// Found value.
        got: String,
    },
    /// The lines of a single plane do not fit.
    #[error(
        "the section at {offset} takes more than the {room} that the memory has left for lines; give more --memory, or cut a coarser mesh (--preview)"
    )]
    TooLarge {
        /// Which plane.
        offset: f64,
        /// Memory for lines.
        room: Bytes,
    },
    /// Whoever asked has had enough.
    #[error("stopped on request; nothing was written")]
    Stopped,
}
