//! How far a face is from the surface that it stands for.

use crate::overlay::Sweep;
use bytemuck::{Pod, Zeroable, cast};
use chpm_mesh::geom::round_up;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use wide::{f32x4, f64x2, i32x4, u32x4};

/// Relative rounding error of a sum of two f64 numbers, with room.
const LOST: f64 = 1.0 / (1u64 << 50) as f64;

/// The box of displacements of a face: the composed map of all collapses takes every point of the source surface to a point
/// of the current one, and for those that end in the face, target minus source lies in here. Signed, so that what a later
/// collapse takes back cancels. Object units, rounded outward.
///
/// ```
/// use chpm_qem::Displacement;
///
/// assert_eq!(Displacement::default().error(), 0.0);
/// assert!(Displacement::within(1.0).norm() >= 3.0_f64.sqrt());
/// ```
#[derive(Clone, Copy, PartialEq, Debug, Default, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub struct Displacement {
    lo: [f32; 3],
    hi: [f32; 3],
}

/// A face, and how far it is after a collapse.
pub(crate) type Displaced = (u32, Displacement);

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
        fn reach(axis: usize, self_lo: &[f32; 3], self_hi: &[f32; 3]) -> f64 {
            let (lo, hi) = (self_lo[axis].abs(), self_hi[axis].abs());
            f64::from(if lo > hi { lo } else { hi })
        }
        let [x, y, z] =
            [reach(0, &self.lo, &self.hi), reach(1, &self.lo, &self.hi), reach(2, &self.lo, &self.hi)];
        x * x + y * y + z * z
    }

    /// [`Self::norm`], rounded up: as an error is stored.
    pub fn error(&self) -> f32 {
        round_up(self.norm())
    }

    /// Its least and its greatest corner, exactly.
    pub(crate) fn reach(&self) -> (Vector3<f64>, Vector3<f64>) {
        (Vector3::from(self.lo).map(f64::from), Vector3::from(self.hi).map(f64::from))
    }

    /// Its least and its greatest corner.
    #[cfg(test)]
    pub(crate) fn ends(&self) -> [[f32; 3]; 2] {
        [self.lo, self.hi]
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
        let along = Along::new(Vector3::zeros());
        let slide = Reach::of_slide(&Sweep { lo, hi, share: 0.0 }, &along);
        Reach::of(self, &slide, &along).outward(&along)
    }
}

/// A direction, and with it a frame whose axes are turned so that none of its coordinates is negative.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Along {
    lengths: [f64x2; 3],
    is_turned: [bool; 3],
}

impl Along {
    pub(crate) fn new(direction: Vector3<f64>) -> Self {
        let all: [f64; 3] = direction.into();
        Along { lengths: all.map(|x| f64x2::splat(x.abs())), is_turned: all.map(|x| x < 0.0) }
    }

    /// The ends of an interval of an axis in the frame, the greater one with its sign turned.
    #[inline]
    fn ends(&self, axis: usize, lo: f64, hi: f64) -> f64x2 {
        if self.is_turned[axis] { f64x2::new([-hi, lo]) } else { f64x2::new([lo, -hi]) }
    }
}

/// A box of displacements in the making, in f64 and in the frame of a direction: by axis its least coordinate and, with its sign turned, the
/// greatest, so that the lesser of both counts and a register holds both.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach([f64x2; 3]);

impl Reach {
    pub(crate) const EMPTY: Reach = Reach([f64x2::new([f64::INFINITY; 2]); 3]);

    /// A slide.
    pub(crate) fn of_slide(slide: &Sweep, along: &Along) -> Reach {
        Reach([0, 1, 2].map(|axis| along.ends(axis, slide.lo[axis], slide.hi[axis])))
    }

    /// A box after a slide, with what a sum with it can lose in f64.
    #[inline]
    pub(crate) fn of(of: &Displacement, slide: &Reach, along: &Along) -> Reach {
        let mut reach = Reach::EMPTY;
        for axis in 0..3 {
            let ends = along.ends(axis, f64::from(of.lo[axis]), f64::from(of.hi[axis]));
            reach.0[axis] = (ends - LOST * ends.abs()) + slide.0[axis];
        }
        reach
    }

    /// Grows by a box after a further displacement along the direction. Of its length too the least and the greatest with its sign turned are
    /// given.
    #[inline]
    pub(crate) fn add(&mut self, of: &Reach, along: &Along, length: f64x2) {
        for axis in 0..3 {
            self.0[axis] = self.0[axis].fast_min(of.0[axis] + along.lengths[axis] * length);
        }
    }

    /// The smallest box about it, and more than the last operation on it can have lost.
    #[inline]
    pub(crate) fn outward(&self, along: &Along) -> Displacement {
        let ends = |axis: usize| {
            let [a, b] = self.0[axis].to_array();
            if along.is_turned[axis] { [b, a] } else { [a, b] }
        };
        let [[x, p], [y, q], [z, r]] = [ends(0), ends(1), ends(2)];
        // Zero has one sign only.
        let [x, y, z] = [x, y, z].map(|x| (x + 0.0) as f32);
        let [p, q, r] = [p, q, r].map(|x| (0.0 - x) as f32);
        let [lo_x, lo_y, lo_z, _] = step_down(f32x4::new([x, y, z, z])).to_array();
        let [hi_x, hi_y, hi_z, _] = step_up(f32x4::new([p, q, r, r])).to_array();
        Displacement { lo: [lo_x, lo_y, lo_z], hi: [hi_x, hi_y, hi_z] }
    }
}

/// The next lower numbers among those of f32; the two zeros count as two. Without a branch.
#[inline]
fn step_down(x: f32x4) -> f32x4 {
    let lower = ordered(cast(x)) - i32x4::splat(1);
    cast(ordered(lower.max(i32x4::splat(-INFINITY - 1))))
}

/// The next higher ones.
#[inline]
fn step_up(x: f32x4) -> f32x4 {
    let higher = ordered(cast(x)) + i32x4::splat(1);
    cast(ordered(higher.min(i32x4::splat(INFINITY))))
}

const INFINITY: i32 = f32::INFINITY.to_bits() as i32;

/// Numbers of one sign are in the order of their bits: the others are turned around, and back.
#[inline]
fn ordered(bits: i32x4) -> i32x4 {
    let negative: u32x4 = cast(bits >> 31);
    bits ^ cast::<u32x4, i32x4>(negative >> 1)
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
    fn steps_go_to_the_next_number() {
        let up = |x: f32| step_up(f32x4::new([0.0, x, 1.0, 2.0])).to_array()[1];
        let down = |x: f32| step_down(f32x4::new([0.0, x, 1.0, 2.0])).to_array()[1];
        for x in [1.0f32, -1.0, 3.7e-39, -3.7e-39, f32::MAX, f32::MIN, 1e-45, -1e-45, 0.1, -2e30] {
            assert_eq!((up(x), down(x)), (x.next_up(), x.next_down()), "{x}");
        }
        assert_eq!((up(0.0), down(-0.0)), (1e-45, -1e-45));
        assert_eq!((down(0.0).to_bits(), up(-0.0).to_bits()), ((-0.0f32).to_bits(), 0));
        assert_eq!((up(f32::INFINITY), down(f32::NEG_INFINITY)), (f32::INFINITY, f32::NEG_INFINITY));
    }

    #[test]
    fn the_empty_box_is_the_identity() {
        let mut all = Displacement::EMPTY;
        let one = Displacement::default().moved(Vector3::new(0.0, -2.0, 0.0), Vector3::new(1.0, 0.0, 0.5));
        all.merge(&one);
        assert_eq!(all, one);
    }
}
