//! Errors of rays.

use chpm_format::FormatError;
use chpm_mesh::ClusterId;
use chpm_refine::RefineError;

/// Why rays have no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RayError {
    /// A page that is needed is damaged.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// An image that cannot be decoded.
    #[error("the image of cluster {} is damaged: build the file anew", .0.0)]
    Image(ClusterId),
    /// Nothing is known of how far coarse meshes are from the source.
    #[error("{0}; or take the leaves (--error 0)")]
    Unproven(#[from] chpm_space::Unproven),
    /// A camera or an image that none can be.
    #[error(transparent)]
    View(#[from] RefineError),
    /// Whoever asked has had enough.
    #[error("stopped on request; nothing was written")]
    Stopped,
}
