//! Errors of an export.

use chpm_format::FormatError;
use chpm_image::ImageError;
use chpm_mesh::{ClusterId, GroupId};
use std::io;

/// Why a mesh or a hierarchy could not be exported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The output could not be written.
    #[error("writing {format} failed: {source}")]
    Write {
        /// Format that was written.
        format: &'static str,
        /// Cause.
        source: io::Error,
    },
    /// More of something than the format has room for.
    #[error("{format} has room for {limit} {what}, and this mesh takes {got}; {remedy}")]
    TooLarge {
        /// Format that was to be written.
        format: &'static str,
        /// Name of the quantity that is too large.
        what: &'static str,
        /// How much there may be.
        limit: u64,
        /// How much there is.
        got: u64,
        /// Remedy, in words.
        remedy: &'static str,
    },
    /// A mesh that is not as it was announced.
    #[error("{what}: {expected} announced, {got} given")]
    Count {
        /// Name of the quantity.
        what: &'static str,
        /// How many were announced.
        expected: u64,
        /// How many came.
        got: u64,
    },
    /// A vertex buffer or an index buffer that could not be compressed.
    #[error("compressing a buffer of {bytes} bytes failed: {reason}")]
    Compression {
        /// Its length.
        bytes: usize,
        /// Message of the library.
        reason: String,
    },
    /// A mesh that could not be cut into meshlets.
    #[error("cutting {triangles} triangles into meshlets failed: {reason}")]
    Meshlets {
        /// How many there are.
        triangles: usize,
        /// Message of the library, or what is wrong with its result.
        reason: String,
    },
    /// A point that a system of coordinates does not have.
    #[error("the model is outside of {system}: it has no place for {place:?}")]
    Outside {
        /// The system.
        system: String,
        /// The point, in the model's coordinates.
        place: [f64; 3],
    },
    /// A sheet whose image cannot be used.
    #[error("sheet of {cluster}: {reason}; `chpm verify` tells more")]
    Sheet {
        /// The cluster.
        cluster: ClusterId,
        /// Name of what is wrong.
        reason: String,
    },
    /// An image that could not be made.
    #[error("making an image failed: {0}")]
    Image(#[from] ImageError),
    /// A page that is damaged.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A transform that takes the model farther than any number goes.
    #[error(
        "the transform takes the model's origin to {got:?}, which are no places; give one with smaller numbers"
    )]
    Transform {
        /// Where.
        got: [f64; 3],
    },
    /// A cluster of which no triangle is in what replaces it.
    #[error(
        "{cluster} has no triangle in common with the coarse clusters of {group}, which replaces it; expected some: \
         `chpm verify` tells what is wrong with the file"
    )]
    Orphan {
        /// The cluster.
        cluster: ClusterId,
        /// The group in which it is fine.
        group: GroupId,
    },
}

/// An error if these are not the same.
pub(crate) fn expect(what: &'static str, expected: u64, got: u64) -> Result<(), ExportError> {
    if expected == got { Ok(()) } else { Err(ExportError::Count { what, expected, got }) }
}
