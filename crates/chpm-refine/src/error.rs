//! Errors of a selection.

use chpm_format::FormatError;
use chpm_mesh::{ClusterId, Counted};

/// Why a mesh could not be selected or extracted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RefineError {
    /// A page that the selection needs is damaged.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// An error bound that nothing can be compared with.
    #[error("error bound: a number that is at least 0 expected, got {got}")]
    Bound {
        /// The bound that was given, object units.
        got: f32,
    },
    /// A level that the file lacks.
    #[error("no level {got}: the highest is {highest}, the coarsest mesh")]
    Level {
        /// The level that was asked for.
        got: u32,
        /// The highest of the file.
        highest: u32,
    },
    /// No mesh has so few triangles.
    #[error("the coarsest mesh has {}; ask for at least as many", Counted(*least, "triangle"))]
    Coarsest {
        /// Size of the coarsest mesh.
        least: u64,
    },
    /// A view that nothing can be seen in.
    #[error("view: {what}: {expected} expected, got {got}")]
    View {
        /// Name of the wrong argument.
        what: &'static str,
        /// Expected value.
        expected: &'static str,
        /// Found value.
        got: String,
    },
    /// A camera path that cannot be read.
    #[error("camera path, line {line}: {expected} expected, got '{got}'")]
    Path {
        /// Line of the text, from 1.
        line: usize,
        /// Expected value.
        expected: &'static str,
        /// Found value.
        got: String,
    },
    /// The cut names a cluster that the file lacks.
    #[error(
        "cut: {cluster} expected to be one of {count} clusters; make the cut for the file that it is used with"
    )]
    Cluster {
        /// The cluster that the cut names.
        cluster: ClusterId,
        /// Clusters of the file.
        count: usize,
    },
    /// The cut puts a cluster at a position that its progressive mesh lacks.
    #[error("cut: {cluster}: a position of {min} to {max} vertices expected, got {got}")]
    Position {
        /// Where.
        cluster: ClusterId,
        /// The position that the cut names.
        got: u32,
        /// Vertices of the cluster's base mesh.
        min: u32,
        /// Vertices of its finest mesh.
        max: u32,
    },
    /// The cut covers a part of the surface twice or not at all, or splits a part of a dependency group.
    #[error(
        "cut: {cluster} expected {expected} times, got {got}: a cut covers every leaf once and splits groups whole"
    )]
    Illegal {
        /// The first cluster that is wrong.
        cluster: ClusterId,
        /// How often it must be there: 0 or 1.
        expected: usize,
        /// How often it is there.
        got: usize,
    },
    /// The cut names a remnant that the file lacks.
    #[error(
        "cut: remnant {number} expected to be one of {count}; make the cut for the file that it is used with"
    )]
    Remnant {
        /// The remnant that the cut names.
        number: u32,
        /// Remnants of the file.
        count: usize,
    },
    /// The mesh has more vertices than 32-bit indices tell apart.
    #[error("mesh: at most {limit} vertices expected, the cut has more; choose a coarser one")]
    TooManyVertices {
        /// Most vertices of a mesh.
        limit: u32,
    },
}
