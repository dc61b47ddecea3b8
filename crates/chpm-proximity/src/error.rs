//! Errors of a question about two models.

use chpm_format::FormatError;

/// Why a question has no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProximityError {
    /// A page that is needed is damaged.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A motion that changes distances, or is none.
    #[error("pose: {expected} expected, got {got}; scale the model before it is built, not in the pose")]
    Pose {
        /// Expected value.
        expected: &'static str,
        /// Found value.
        got: String,
    },
    /// A length that nothing can be compared with.
    #[error("{what}: a number that is at least 0 expected, got {got}")]
    Length {
        /// Which.
        what: &'static str,
        /// Found value.
        got: f64,
    },
    /// More is in contact than there is memory for.
    #[error(
        "more than {limit} {what} are near, which the memory has no room for; ask for a smaller distance (--within) or a larger --error, or give more --memory"
    )]
    TooMany {
        /// Name of the quantity that is too large.
        what: &'static str,
        /// Most that fit.
        limit: usize,
    },
}
