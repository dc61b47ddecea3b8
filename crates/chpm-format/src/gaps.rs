//! Dropped components of a group: how far they are from what the group draws.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

/// How far the points of the source that have vanished are from the nearest vertex that is drawn, at most, object units. Components that
/// lie apart vanish at a price by their size, so that the errors of a group do not tell of them; with its gaps they are distances.
#[derive(Clone, Copy, PartialEq, Pod, Zeroable, Debug, Default, Serialize, Deserialize)]
#[repr(C)]
pub struct Gaps {
    /// At positions of an error below [`Self::from`], where nothing is missing but what has vanished below the group.
    pub fine: f32,
    /// At all positions.
    pub base: f32,
    /// At most the least error at which more is missing than below the group.
    pub from: f32,
}

impl Gaps {
    /// The gap at a position of the given error.
    pub fn at(&self, error: f32) -> f32 {
        if error < self.from { self.fine } else { self.base }
    }

    /// How far the source is from a mesh of the given error, and that from the source.
    pub fn distance(&self, error: f32) -> f32 {
        error.max(self.at(error))
    }

    /// The largest error with which positions keep to a distance. If even the finest does not, it is 0.
    pub fn error_within(&self, distance: f32) -> f32 {
        if distance >= self.base {
            distance
        } else if distance >= self.fine {
            distance.min(self.from.next_down())
        } else {
            0.0
        }
    }

    /// Whether these are numbers that gaps can have.
    pub(crate) fn are_legal(&self) -> bool {
        self.fine >= 0.0
            && self.fine <= self.base
            && self.base.is_finite()
            && (0.0..=f32::MAX).contains(&self.from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distance_is_kept_by_the_errors_that_are_within_it() {
        let gaps = Gaps { fine: 2.0, base: 8.0, from: 3.0 };
        assert_eq!([0.0, 2.9, 3.0, 9.0].map(|error| gaps.distance(error)), [2.0, 2.9, 8.0, 9.0]);
        for distance in [0.0, 1.9, 2.0, 2.5, 3.0, 7.9, 8.0, 9.0] {
            let error = gaps.error_within(distance);
            assert!(distance < gaps.fine || gaps.distance(error) <= distance, "{distance}");
            assert!(distance < gaps.fine || gaps.distance(error.next_up()) > distance, "{distance}");
        }
        assert_eq!(gaps.error_within(1.9), 0.0);
        let none = Gaps::default();
        assert_eq!(
            [0.0, 5.0].map(|error| (none.distance(error), none.error_within(error))),
            [(0.0, 0.0), (5.0, 5.0)]
        );
    }
}
