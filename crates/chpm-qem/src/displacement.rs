//! How far a face is from the surface that it stands for.

use bytemuck::{Pod, Zeroable};
use chpm_mesh::geom::round_up;
use nalgebra::Vector3;

/// What a sum of two numbers can lose in f64, as a share of either, and more.
const LOST: f64 = 1.0 / (1u64 << 50) as f64;

/// The box of displacements of a face: the composed map of all collapses takes every point of the source surface to a point
/// of the current one, and for those that end in the face, target minus source lies in here. Signed, so that what a later
/// collapse takes back cancels. Object units, rounded outward.
#[derive(Clone, Copy, PartialEq, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Displacement {
    lo: [f32; 3],
    hi: [f32; 3],
}

impl Displacement {
    /// Holds nothing; the identity of [`Self::merge`].
    pub(crate) const EMPTY: Displacement =
        Displacement { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3] };

    /// Any displacement of coordinates by at most `reach` each.
    pub fn within(reach: f64) -> Displacement {
        Displacement::default().moved(Vector3::repeat(-reach), Vector3::repeat(reach))
    }

    /// The length of the longest displacement in the box: a bound on the distance of any of its points.
    pub fn norm(&self) -> f64 {
        self.norm_squared().sqrt()
    }

    /// The square of [`Self::norm`].
    pub(crate) fn norm_squared(&self) -> f64 {
        let reach = |axis: usize| f64::from(self.lo[axis].abs().max(self.hi[axis].abs()));
        (0..3).map(|axis| reach(axis).powi(2)).sum()
    }

    /// [`Self::norm`], rounded up: as an error is stored.
    pub fn error(&self) -> f32 {
        round_up(self.norm())
    }

    /// Grows to hold `other`.
    #[inline]
    pub(crate) fn merge(&mut self, other: &Displacement) {
        for axis in 0..3 {
            self.lo[axis] = self.lo[axis].min(other.lo[axis]);
            self.hi[axis] = self.hi[axis].max(other.hi[axis]);
        }
    }

    /// The box after a further displacement of any vector between `lo` and `hi`.
    pub(crate) fn moved(&self, lo: Vector3<f64>, hi: Vector3<f64>) -> Displacement {
        if lo == hi && lo == Vector3::zeros() {
            return *self;
        }
        Displacement::outward(self.low() + lo, self.high() + hi)
    }

    /// The least corner, less what a sum with it can lose in f64.
    #[inline]
    pub(crate) fn low(&self) -> Vector3<f64> {
        Vector3::from(self.lo.map(|x| f64::from(x) - LOST * f64::from(x.abs())))
    }

    /// The largest corner, and what a sum with it can lose in f64.
    #[inline]
    pub(crate) fn high(&self) -> Vector3<f64> {
        Vector3::from(self.hi.map(|x| f64::from(x) + LOST * f64::from(x.abs())))
    }

    /// The smallest box about the given one, and more than the last operation on it can have lost.
    #[inline]
    pub(crate) fn outward(low: Vector3<f64>, high: Vector3<f64>) -> Displacement {
        Displacement {
            lo: [0, 1, 2].map(|axis| (low[axis] as f32).next_down()),
            hi: [0, 1, 2].map(|axis| (high[axis] as f32).next_up()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_back_cancels() {
        let up = Displacement::default().moved(Vector3::new(0.0, 0.0, 1.0), Vector3::new(0.0, 0.0, 2.0));
        assert!(up.norm() >= 2.0 && up.norm() < 2.000001);
        let back = up.moved(Vector3::new(0.0, 0.0, -2.0), Vector3::new(0.0, 0.0, -1.0));
        assert!(back.norm() >= 1.0 && back.norm() < 1.000001);
    }

    #[test]
    fn nothing_moved_is_exactly_zero() {
        assert_eq!(Displacement::default().moved(Vector3::zeros(), Vector3::zeros()).norm(), 0.0);
        let far = Displacement::default().moved(Vector3::new(0.0, 0.0, -4.0), Vector3::new(3.0, 0.0, 0.0));
        assert!(far.norm() >= 5.0 && far.norm() < 5.00001);
    }

    #[test]
    fn the_empty_box_is_the_identity() {
        let mut all = Displacement::EMPTY;
        let one = Displacement::default().moved(Vector3::new(0.0, -2.0, 0.0), Vector3::new(1.0, 0.0, 0.5));
        all.merge(&one);
        assert_eq!(all, one);
    }
}
