//! The reasons why a file could not be reported on.

use chpm_extmem::Cancelled;
use chpm_format::FormatError;
use chpm_mesh::ClusterId;
use chpm_refine::RefineError;

/// Why a file could not be reported on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The file is damaged where it had to be read.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A cut of the file could not be made.
    #[error(transparent)]
    Refine(#[from] RefineError),
    /// The image of a cluster's surface is damaged.
    #[error("the image of cluster {} is damaged: build the file anew", .0.0)]
    Image(ClusterId),
    /// It was asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A plot has no place for what it was given.
    #[error("a plot cannot be drawn: {0}")]
    Plot(String),
    /// A picture could not be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Picture(#[from] png::EncodingError),
    /// A page could not be filled in.
    #[error("a page cannot be written: {0}")]
    Page(#[from] askama::Error),
    /// A document is not what `chpm measure FILE --against SOURCE --json` prints.
    #[error("no document of `chpm measure FILE --against SOURCE --json`")]
    Measured,
    /// A document of `chpm measure` tells of a level that the file has not.
    #[error("of another file: this one has no such level {level}")]
    OtherFile {
        /// The level.
        level: u64,
    },
}

impl ReportError {
    /// The damage of the file that it is about, if that is what it is.
    pub fn damage(&self) -> Option<&FormatError> {
        match self {
            ReportError::Format(damage) | ReportError::Refine(RefineError::Format(damage)) => Some(damage),
            _ => None,
        }
    }
}
