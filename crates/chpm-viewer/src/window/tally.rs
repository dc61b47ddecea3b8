//! Frame times of a script.

/// Follows the frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    /// Milliseconds from each frame to the next while the camera moved.
    moving: Vec<f64>,
    /// Seconds since the camera came to rest, and until then the picture was final.
    rest: f64,
    complete: Option<f64>,
}

impl Tally {
    /// So many seconds went by since the frame before; whether the camera moved, and whether the picture is final now.
    pub(super) fn take(&mut self, seconds: Option<f64>, moved: bool, is_final: bool) {
        if moved {
            self.moving.extend(seconds.map(|seconds| 1e3 * seconds));
            (self.rest, self.complete) = (0.0, None);
        } else {
            self.rest += seconds.unwrap_or(0.0);
            if is_final {
                self.complete.get_or_insert(self.rest);
            }
        }
    }

    /// Milliseconds of a frame in motion: the median, and what nineteen of twenty keep to. None if nothing moved.
    pub(super) fn moving(&self) -> Option<[f64; 2]> {
        let mut all = self.moving.clone();
        all.sort_by(f64::total_cmp);
        fn at(share: f64, all: &[f64]) -> Option<f64> {
            all.get(((all.len() as f64 * share).ceil() as usize).max(1) - 1).copied()
        }
        Some([at(0.5, &all)?, at(0.95, &all)?])
    }

    /// Seconds from the end of the motion to the complete picture.
    pub(super) fn complete(&self) -> Option<f64> {
        self.complete
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_and_rest_are_told_apart() {
        let mut tally = Tally::default();
        assert_eq!((tally.moving(), tally.complete()), (None, None));
        tally.take(None, true, false);
        (1..=20).for_each(|ms| tally.take(Some(1e-3 * f64::from(ms)), true, false));
        assert_eq!(tally.moving(), Some([10.0, 19.0]));
        tally.take(Some(0.5), false, false);
        tally.take(Some(0.25), false, true);
        tally.take(Some(9.0), false, true);
        assert_eq!(tally.complete(), Some(0.75));
        tally.take(Some(0.001), true, true);
        assert_eq!(tally.complete(), None, "it moves again");
    }
}
