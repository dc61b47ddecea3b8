//! How far a face is from the surface that it stands for.

use crate::overlay::Sweep;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::geom::round_up;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

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
        Reach::of(self, &Sweep { lo, hi, share: 0.0 }).outward()
    }
}

/// A box of displacements in the making, in f64. Comparisons are written out: there are no NaNs, and each is one instruction. A
/// fourth lane that says nothing makes all of it whole registers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    lo: [f64; 4],
    hi: [f64; 4],
}

/// A direction, by the signs of its coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Along {
    up: [f64; 4],
    down: [f64; 4],
}

impl Along {
    pub(crate) fn new(direction: Vector3<f64>) -> Self {
        let [x, y, z] = direction.into();
        let all = [x, y, z, 0.0];
        Along { up: all.map(|x| x.max(0.0)), down: all.map(|x| x.min(0.0)) }
    }
}

impl Reach {
    pub(crate) const EMPTY: Reach = Reach { lo: [f64::INFINITY; 4], hi: [f64::NEG_INFINITY; 4] };

    /// A box after a slide, with what a sum with it can lose in f64.
    #[inline]
    pub(crate) fn of(of: &Displacement, slide: &Sweep) -> Reach {
        let mut reach = Reach { lo: [0.0; 4], hi: [0.0; 4] };
        for axis in 0..3 {
            let (lo, hi) = (f64::from(of.lo[axis]), f64::from(of.hi[axis]));
            reach.lo[axis] = (lo - LOST * lo.abs()) + slide.lo[axis];
            reach.hi[axis] = (hi + LOST * hi.abs()) + slide.hi[axis];
        }
        reach
    }

    /// Grows by a box after a further displacement along a direction, by `least` to `most`.
    #[inline]
    pub(crate) fn add(&mut self, of: &Reach, along: &Along, least: f64, most: f64) {
        for lane in 0..4 {
            let lo = of.lo[lane] + (along.up[lane] * least + along.down[lane] * most);
            let hi = of.hi[lane] + (along.up[lane] * most + along.down[lane] * least);
            self.lo[lane] = if lo < self.lo[lane] { lo } else { self.lo[lane] };
            self.hi[lane] = if hi > self.hi[lane] { hi } else { self.hi[lane] };
        }
    }

    /// The smallest box about it, and more than the last operation on it can have lost.
    #[inline]
    pub(crate) fn outward(&self) -> Displacement {
        let (lo, hi) = (self.lo, self.hi);
        let (down, up) = (|x: f64| step(x as f32, -1), |x: f64| step(x as f32, 1));
        Displacement { lo: [down(lo[0]), down(lo[1]), down(lo[2])], hi: [up(hi[0]), up(hi[1]), up(hi[2])] }
    }
}

/// The number `by` places further up among those of f32; the two zeros count as two. Without a branch.
#[inline]
fn step(x: f32, by: i32) -> f32 {
    // Numbers of one sign are in the order of their bits.
    fn ordered(bits: i32) -> i32 {
        bits ^ ((bits >> 31) as u32 >> 1) as i32
    }
    let infinity = f32::INFINITY.to_bits() as i32;
    let place = (ordered(x.to_bits() as i32) + by).clamp(-infinity - 1, infinity);
    f32::from_bits(ordered(place) as u32)
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
        for x in [1.0f32, -1.0, 3.7e-39, -3.7e-39, f32::MAX, f32::MIN, 1e-45, -1e-45, 0.1, -2e30] {
            assert_eq!((step(x, 1), step(x, -1)), (x.next_up(), x.next_down()), "{x}");
        }
        assert_eq!((step(0.0, 1), step(-0.0, -1)), (1e-45, -1e-45));
        assert_eq!((step(0.0, -1).to_bits(), step(-0.0, 1).to_bits()), ((-0.0f32).to_bits(), 0));
        assert_eq!((step(f32::INFINITY, 1), step(f32::NEG_INFINITY, -1)), (f32::INFINITY, f32::NEG_INFINITY));
    }

    #[test]
    fn the_empty_box_is_the_identity() {
        let mut all = Displacement::EMPTY;
        let one = Displacement::default().moved(Vector3::new(0.0, -2.0, 0.0), Vector3::new(1.0, 0.0, 0.5));
        all.merge(&one);
        assert_eq!(all, one);
    }
}
