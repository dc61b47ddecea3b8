//! The reasons why a file could not be judged. What is wrong with it is a finding, not an error.

use chpm_extmem::{Cancelled, ExtmemError};
use chpm_format::FormatError;
use chpm_import::SourceError;
use chpm_mesh::MemorySize;
use chpm_refine::RefineError;
use std::path::PathBuf;

/// Why a file could not be judged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VerifyError {
    /// Someone asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Memory, disk, or a file that was changed meanwhile.
    #[error(transparent)]
    Extmem(#[from] ExtmemError),
    /// The file is damaged where it had to be read.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A cut of the file could not be made.
    #[error(transparent)]
    Refine(#[from] RefineError),
    /// The source could not be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The system does not give threads.
    #[error("cannot start the worker threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The source is none that can be read from its beginning whenever it is needed.
    #[error("'{}' is a pipe or no file at all; save what is to be compared as a file and name that", path.display())]
    NotAFile {
        /// The source.
        path: PathBuf,
    },
    /// A mesh without triangles has no surface.
    #[error("'{}' has no triangles to measure", path.display())]
    NoTriangles {
        /// The mesh.
        path: PathBuf,
    },
    /// The source has more than can be numbered.
    #[error("the source has more than {most} {what}")]
    TooMany {
        /// Vertices or components.
        what: &'static str,
        /// How many there may be.
        most: u32,
    },
    /// The file tells a size of small components that is none.
    #[error("the file names '{got}' as its min-component, which is no size")]
    Size {
        /// Found value.
        got: String,
    },
    /// The leaves lack detail of the source on purpose, so that nothing can be held against it.
    #[error("'{}' was built without detail below an error, so its leaves are not {what}", path.display())]
    Trimmed {
        /// The file.
        path: PathBuf,
        /// Required leaves, and a remedy.
        what: String,
    },
    /// The leaves are not the source's triangles, so that distances to it cannot be measured.
    #[error(
        "the leaves of '{}' are not the triangles of '{}': {} differ; `chpm verify --against` names them",
        path.display(), source_path.display(), chpm_mesh::Thousands(*faults)
    )]
    Different {
        /// The file.
        path: PathBuf,
        /// The source.
        source_path: PathBuf,
        /// How many triangles differ at least.
        faults: u64,
    },
    /// There is no such level.
    #[error("'{}' has no level {level}: its levels are 0 to {highest}", path.display())]
    Level {
        /// The file.
        path: PathBuf,
        /// The level that was asked for.
        level: u32,
        /// The highest that there is.
        highest: usize,
    },
    /// The file has no sheets.
    #[error("'{}' has no sheets: it was built without images, or with another --texture than sheets", path.display())]
    NoSheets {
        /// The file.
        path: PathBuf,
    },
    /// The source has no images.
    #[error("'{}' has no image that could be read", path.display())]
    NoImages {
        /// The source.
        path: PathBuf,
    },
    /// An image could not be read.
    #[error("{image}: {reason}")]
    Image {
        /// Which.
        image: String,
        /// Cause.
        reason: String,
    },
    /// There is too little memory for the tables of a file.
    #[error("--memory {asked} is less than it takes to read '{}' so: give it {least} or more", path.display())]
    Memory {
        /// The file.
        path: PathBuf,
        /// Memory that is there.
        asked: MemorySize,
        /// Memory that would do.
        least: MemorySize,
    },
}

impl VerifyError {
    /// The damage of the file that it is about, if that is what it is.
    pub fn damage(&self) -> Option<&FormatError> {
        match self {
            VerifyError::Format(damage) | VerifyError::Refine(RefineError::Format(damage)) => Some(damage),
            _ => None,
        }
    }
}
