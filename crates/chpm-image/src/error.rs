//! Errors of reading an image.

use std::io;

/// Reasons why an image cannot be read. Whoever has its name adds it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The first bytes are of no format that is read.
    #[error("neither a PNG nor a JPEG image by its first bytes; convert it to one of them")]
    Foreign,
    /// A format that is read, in a way that is not.
    #[error("{what} is not read; save the image as a plain PNG or a baseline JPEG")]
    Unsupported {
        /// Name of the way.
        what: &'static str,
    },
    /// Bytes that are not as the format wants them, or that end early.
    #[error("damaged {format}: {what}; make or copy the image again")]
    Damaged {
        /// Name of the format.
        format: &'static str,
        /// Name of what is wrong.
        what: String,
    },
    /// Sides that no image should have.
    #[error("{} x {} pixels; an image has 1 to 65,535 a side", size[0], size[1])]
    Size {
        /// Width and height.
        size: [u32; 2],
    },
    /// An image that can only be read as a whole, for which there is not enough memory.
    #[error(
        "a {what} of {} x {} pixels takes {} MiB to read, and {} MiB are left; save it as {instead}, or raise --memory",
        size[0], size[1], needed >> 20, limit >> 20
    )]
    Memory {
        /// Kind of image.
        what: &'static str,
        /// Kind that takes little memory.
        instead: &'static str,
        /// Width and height.
        size: [u32; 2],
        /// Bytes that it takes.
        needed: u64,
        /// Bytes that it may take.
        limit: u64,
    },
    /// The bytes could not be read.
    #[error("reading failed: {0}")]
    Read(#[from] io::Error),
}
