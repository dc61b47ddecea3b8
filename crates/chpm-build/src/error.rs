//! What can stop a build.

use crate::progress::Stage;
use std::path::PathBuf;

/// What can stop a build; nothing is left behind when it does.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The source could not be opened or read.
    #[error("cannot read {path}: {source}")]
    Source {
        /// The source file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The source is no valid PLY.
    #[error("{path}: {source}")]
    Ply {
        /// The source file.
        path: PathBuf,
        /// What is wrong, and where.
        source: chpm_mesh::ply::PlyError,
    },
    /// The source is no valid STL, OBJ or list of range scans.
    #[error("{path}: {source}")]
    Import {
        /// The source file.
        path: PathBuf,
        /// What is wrong, and where.
        source: Box<chpm_mesh::import::ImportError>,
    },
    /// The source has no triangle that could be built.
    #[error("{path} has no triangle to build from ({faces} faces declared): nothing was written")]
    Empty {
        /// The source file.
        path: PathBuf,
        /// Faces that the header declares.
        faces: u64,
    },
    /// Memory, disk or file system.
    #[error(transparent)]
    Extmem(#[from] chpm_extmem::ExtmemError),
    /// The partitioner failed.
    #[error("cannot partition: {0}")]
    Partition(#[from] chpm_partition::PartitionError),
    /// The file that is being written would not be valid.
    #[error("cannot write the file: {0}")]
    Format(#[from] chpm_format::FormatError),
    /// The threads could not be started.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// Why not.
        reason: String,
    },
    /// The finest error that is asked for is above the coarsest.
    #[error(
        "detail below an error of {finest} is to be left out, and everything above {coarsest}: nothing would be left; raise the target error or lower the finest"
    )]
    ErrorRange {
        /// The error below which detail is left out, object units.
        finest: f32,
        /// The largest error that a mesh may have, object units.
        coarsest: f32,
    },
    /// Someone asked to stop.
    #[error("stopped on request; nothing was written")]
    Cancelled,
    /// A limit of the format is exceeded.
    #[error("{stage}: {what} is {got}, more than the format's {limit}")]
    Limit {
        /// Where it was found.
        stage: Stage,
        /// What there is too much of.
        what: &'static str,
        /// How much there is.
        got: u64,
        /// How much there may be.
        limit: u64,
    },
}
