//! Error of a file that proves nothing.

/// Reason why nothing is known of how far a model's coarse meshes are from its source.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error(
    "{expected} expected, got {got}: nothing can be proven with it; build the file again with this version of chpm"
)]
pub struct Unproven {
    /// Expected form.
    pub expected: &'static str,
    /// Found form.
    pub got: &'static str,
}
