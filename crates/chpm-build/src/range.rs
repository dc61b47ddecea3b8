//! The range of errors that a file covers: what a build is told, in units or as a share of the model, becomes two lengths.

use crate::config::Settings;
use crate::error::BuildError;
use serde::{Deserialize, Serialize};

/// The errors to cover, object units. Rounded down, so that nothing is coarser than it was asked for.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub(crate) struct ErrorRange {
    /// Detail below this error is left out; none keeps the source's own triangles.
    pub(crate) finest: Option<f32>,
    /// No mesh of the file has a larger error.
    pub(crate) coarsest: f32,
}

impl ErrorRange {
    /// Everything.
    pub(crate) const ALL: ErrorRange = ErrorRange { finest: None, coarsest: f32::INFINITY };

    /// The range that the settings ask for, for a model of the given diagonal. Nothing is finer than `least`, the error that the
    /// leaves come with.
    pub(crate) fn of(settings: &Settings, diagonal: f64, least: f32) -> Result<Self, BuildError> {
        let [finest, coarsest] = [settings.finest_error, settings.target_error]
            .map(|length| length.map(|length| round_down(length.of(diagonal))));
        let finest = finest.map(|finest| finest.max(least));
        let range = ErrorRange { finest, coarsest: coarsest.unwrap_or(f32::INFINITY) };
        match finest {
            Some(finest) if finest > range.coarsest => {
                Err(BuildError::ErrorRange { finest, coarsest: range.coarsest })
            }
            _ => Ok(range),
        }
    }
}

/// The largest f32 that is not above `x`, which is at least 0.
fn round_down(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) > x { nearest.next_down() } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_never_grows() {
        for x in [0.0, 1.0, 0.1, 1e-50, 1e-45, 3.3e38, 1e300] {
            let down = round_down(x);
            assert!(f64::from(down) <= x && f64::from(down.next_up()) > x, "{x} became {down}");
        }
    }
}
