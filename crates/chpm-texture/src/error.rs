//! Errors of averaging.

use chpm_extmem::{Cancelled, ExtmemError};
use chpm_image::ImageError;
use std::io;

/// Everything that this crate can fail with.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TextureError {
    /// An image could not be opened.
    #[error("image {image}: {source}")]
    Open {
        /// Number of the image.
        image: u32,
        /// Cause.
        source: io::Error,
    },
    /// An image could not be read.
    #[error("image {image}: {source}")]
    Image {
        /// Number of the image.
        image: u32,
        /// Cause.
        source: ImageError,
    },
    /// A corner that is no vertex.
    #[error("vertex {vertex} of a textured triangle is out of range; there are {count}")]
    VertexOutOfRange {
        /// Number of the vertex.
        vertex: u32,
        /// Vertices that there are.
        count: usize,
    },
    /// Memory or disk.
    #[error(transparent)]
    Extmem(#[from] ExtmemError),
    /// A request to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
