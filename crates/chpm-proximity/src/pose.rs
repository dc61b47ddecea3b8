//! Where a model is: a rigid motion, and how far f64 can be wrong about it.

use crate::error::ProximityError;
use chpm_space::Model;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// A rotation, and then a translation.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Pose {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    /// How far the rotation is from what was given and from keeping lengths, as a share of a point's distance from zero.
    unsure: f64,
}

/// How far a matrix may be from a rotation. What it is off by widens every answer.
const RIGID: f64 = 1e-4;

impl Pose {
    /// The pose that leaves a model where it is.
    pub const IDENTITY: Pose =
        Pose { rotation: IDENTITY, translation: Vector3::new(0.0, 0.0, 0.0), unsure: 0.0 };

    /// By the rows of a matrix, and a translation.
    ///
    /// # Errors
    /// Numbers that are not finite, and a matrix that scales, shears or mirrors.
    pub fn of_matrix(rows: [[f64; 3]; 3], translation: [f64; 3]) -> Result<Self, ProximityError> {
        let given = Matrix3::from_fn(|row, column| rows[row][column]);
        finite(given.iter().chain(&translation))?;
        let off = (given.transpose() * given - IDENTITY).norm();
        if off > RIGID || given.determinant() < 0.0 {
            let got = match given.determinant() {
                det if off > RIGID => format!("one that changes lengths (of determinant {det})"),
                _ => "one that mirrors".to_owned(),
            };
            return Err(ProximityError::Pose { expected: "a rigid motion", got });
        }
        // Turned into a quaternion and back, a rotation that is one already would be rounded.
        let rotation = if off <= 1e-15 { given } else { nearest_rotation(&given) };
        Ok(Pose::near(rotation, translation, (rotation - given).norm()))
    }

    /// By a quaternion (x, y, z, w) of any length but zero, and a translation.
    ///
    /// # Errors
    /// Numbers that are not finite, and a quaternion of no length.
    pub fn of_quaternion([x, y, z, w]: [f64; 4], translation: [f64; 3]) -> Result<Self, ProximityError> {
        finite([x, y, z, w].iter().chain(&translation))?;
        let largest = [x, y, z, w].into_iter().fold(0.0, |upper: f64, x| upper.max(x.abs()));
        if largest <= 0.0 {
            let got = "a quaternion of length zero".to_owned();
            return Err(ProximityError::Pose { expected: "a rotation", got });
        }
        // First by a power of two, so that no square overflows or vanishes.
        let unit = Quaternion::new(w, x, y, z) / 2f64.powi(largest.log2() as i32);
        let rotation = *UnitQuaternion::new_normalize(unit).to_rotation_matrix().matrix();
        let is_identity = [x, y, z] == [0.0; 3];
        let lost = if is_identity { 0.0 } else { 32.0 * f64::EPSILON };
        Ok(Pose::near(if is_identity { IDENTITY } else { rotation }, translation, lost))
    }

    fn near(rotation: Matrix3<f64>, translation: [f64; 3], from_given: f64) -> Self {
        let off = (rotation.transpose() * rotation - IDENTITY).norm();
        let rounding = if off > 0.0 { 8.0 * f64::EPSILON } else { 0.0 };
        Pose { rotation, translation: translation.into(), unsure: from_given + 2.0 * (off + rounding) }
    }

    /// The rows of its rotation.
    pub fn rows(&self) -> [[f64; 3]; 3] {
        [0, 1, 2].map(|row| [0, 1, 2].map(|column| self.rotation[(row, column)]))
    }

    /// Its translation.
    pub fn translation(&self) -> [f64; 3] {
        self.translation.into()
    }

    /// Where a point that is the sum of two goes, and how far from there it may be: what the pose leaves open and the digits of f64.
    pub(crate) fn place(&self, point: [f64; 3]) -> ([f64; 3], f64) {
        let (far, placed) = (Vector3::from(point).norm(), self.apply(point));
        let moved = if *self == Pose::IDENTITY { 0.0 } else { 8.0 * (far + self.translation.norm()) };
        (placed, (self.unsure * far + f64::EPSILON * (far + moved)) * (1.0 + 1e-9))
    }

    /// Where a point goes.
    pub fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        (self.rotation * Vector3::from(point) + self.translation).into()
    }
}

const IDENTITY: Matrix3<f64> = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);

fn finite<'a>(numbers: impl IntoIterator<Item = &'a f64>) -> Result<(), ProximityError> {
    match numbers.into_iter().find(|x| x.is_nan() || x.abs() > 1e100) {
        None => Ok(()),
        Some(bad) => Err(ProximityError::Pose { expected: "numbers of at most 1e100", got: bad.to_string() }),
    }
}

/// By Newton's iteration, which squares what is wrong with each step.
fn nearest_rotation(given: &Matrix3<f64>) -> Matrix3<f64> {
    let mut rotation = *given;
    for _ in 0..4 {
        if let Some(inverse) = rotation.try_inverse() {
            rotation = (rotation + inverse.transpose()) * 0.5;
        }
    }
    rotation
}

/// A model's frame and how large it is in it, as far as a pose is concerned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// Origin of local positions.
    pub(crate) origin: [f64; 3],
    /// No local position is farther from zero.
    pub(crate) reach: f64,
    pub(crate) pose: Pose,
}

/// From the second model's local positions to the first one's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Between {
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) absolute: Matrix3<f64>,
    pub(crate) translation: Vector3<f64>,
    /// How far a distance computed in the first one's frame can be from the true one, all rounding included.
    pub(crate) margin: f64,
}

impl Frame {
    /// A model's, in its pose.
    pub(crate) fn of<D: AsRef<[u8]>>(model: &Model<'_, D>, pose: &Pose) -> Self {
        let header = model.file().header();
        let corner = Vector3::from_fn(|axis, _| {
            f64::from(header.aabb_min[axis].abs().max(header.aabb_max[axis].abs()))
        });
        let reach = corner.norm() * (1.0 + 1e-15);
        Frame { origin: header.origin, reach: reach + model.farthest(), pose: *pose }
    }
}

impl Between {
    pub(crate) fn new(a: &Frame, b: &Frame) -> Self {
        let (to_a, of_b) = (a.pose.rotation.transpose(), b.pose.rotation);
        let rotation = if a.pose.rotation == IDENTITY { of_b } else { to_a * of_b };
        // Origins may be far away and cancel: twice the digits.
        fn twofold(v: Vector3<f64>) -> [Twofold; 3] {
            [0, 1, 2].map(|i| Twofold(v[i], 0.0))
        }
        let mut place = transform(&of_b, twofold(b.origin.into()));
        for (axis, x) in place.iter_mut().enumerate() {
            *x = x.add(Twofold(b.pose.translation[axis], 0.0)).add(Twofold(-a.pose.translation[axis], 0.0));
        }
        let place = transform(&to_a, place);
        let translation = Vector3::from_fn(|axis, _| {
            let Twofold(high, low) = place[axis].add(Twofold(-a.origin[axis], 0.0));
            high + low
        });

        fn far(v: [f64; 3]) -> f64 {
            Vector3::from(v).norm()
        }
        let (x, y) = (a.reach + far(a.origin), b.reach + far(b.origin));
        let moved = a.pose.translation.norm() + b.pose.translation.norm();
        let unsure = a.pose.unsure * (2.0 * x + y + moved) + b.pose.unsure * y;
        let local = a.reach + b.reach + translation.norm();
        let margin = unsure + ROUNDING * local + 256.0 * f64::EPSILON.powi(2) * (x + y + moved);
        Between { rotation, absolute: rotation.abs(), translation, margin: margin * (1.0 + 1e-9) }
    }

    /// A position of the second model in the first one's frame.
    #[inline]
    pub(crate) fn apply(&self, point: [f32; 3]) -> Vector3<f64> {
        self.rotation * Vector3::from(point.map(f64::from)) + self.translation
    }
}

/// Rounding error of moving a point and of the distance of two triangles, relative to the largest position: three products and sums for each, with room.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// A number as the sum of two, the second below the last digit of the first.
#[derive(Clone, Copy, Debug)]
struct Twofold(f64, f64);

impl Twofold {
    fn add(self, other: Twofold) -> Twofold {
        let sum = self.0 + other.0;
        let part = sum - self.0;
        let lost = (self.0 - (sum - part)) + (other.0 - part);
        Twofold::tidy(sum, lost + self.1 + other.1)
    }

    fn times(self, factor: f64) -> Twofold {
        let product = self.0 * factor;
        let lost = self.0.mul_add(factor, -product);
        Twofold::tidy(product, self.1.mul_add(factor, lost))
    }

    fn tidy(high: f64, low: f64) -> Twofold {
        let sum = high + low;
        Twofold(sum, low - (sum - high))
    }
}

fn transform(matrix: &Matrix3<f64>, v: [Twofold; 3]) -> [Twofold; 3] {
    [0, 1, 2].map(|row| {
        let terms = [0, 1, 2].map(|column| v[column].times(matrix[(row, column)]));
        terms[0].add(terms[1]).add(terms[2])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(origin: [f64; 3], pose: Pose) -> Frame {
        Frame { origin, reach: 1.0, pose }
    }

    #[test]
    fn origins_far_away_cancel() {
        let far = [1e9, -3e8 + 0.25, 7e10];
        let a = frame(far, Pose::IDENTITY);
        let b = frame([far[0] + 0.5, far[1], far[2]], Pose::IDENTITY);
        let between = Between::new(&a, &b);
        assert_eq!(between.translation, Vector3::new(0.5, 0.0, 0.0));
        assert!(between.margin < 1e-13, "{}", between.margin);
        // A turn by 90 degrees is exact, too.
        let turn = Pose::of_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]).unwrap();
        let between = Between::new(&frame(far, turn), &frame([far[0], far[1] + 0.5, far[2]], turn));
        assert_eq!(between.translation, Vector3::new(0.0, 0.5, 0.0));
        assert!(between.margin < 1e-13, "{}", between.margin);
        // One that no f64 holds is uncertain by what its digits leave open.
        let turn = Pose::of_quaternion([0.1, 0.2, 0.3, 0.4], [0.0; 3]).unwrap();
        assert!(Between::new(&frame(far, turn), &frame(far, turn)).margin > 1e-7);
    }

    #[test]
    fn a_matrix_and_a_quaternion_of_one_turn_agree() {
        let (sin, cos) = 0.3_f64.sin_cos();
        let matrix =
            Pose::of_matrix([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]], [1.0, 2.0, 3.0]).unwrap();
        let quaternion =
            Pose::of_quaternion([0.0, 0.0, 5.0 * 0.15_f64.sin(), 5.0 * 0.15_f64.cos()], [1.0, 2.0, 3.0])
                .unwrap();
        assert!((matrix.rotation - quaternion.rotation).norm() < 1e-15);
        let again = Pose::of_matrix(quaternion.rows(), quaternion.translation()).unwrap();
        assert_eq!(again.apply([1.0, 2.0, 3.0]), quaternion.apply([1.0, 2.0, 3.0]));
        assert!(matrix.unsure < 1e-13 && quaternion.unsure < 1e-13);
        assert_eq!(Pose::of_quaternion([0.0, 0.0, 0.0, 2.0], [0.0; 3]).unwrap(), Pose::IDENTITY);
        assert_eq!(Pose::of_quaternion([0.0, 0.0, 0.0, 1e-300], [0.0; 3]).unwrap(), Pose::IDENTITY);
    }

    #[test]
    fn digits_that_are_missing_widen_the_answer() {
        let rounded =
            Pose::of_matrix([[0.8, -0.600_001, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]).unwrap();
        let off = rounded.rotation - Matrix3::new(0.8, -0.600_001, 0.0, 0.6, 0.8, 0.0, 0.0, 0.0, 1.0);
        assert!(rounded.unsure >= off.norm() && rounded.unsure < 4e-6 && off.norm() > 1e-7);
    }

    #[test]
    fn what_is_not_rigid_is_refused() {
        let told = |rows: [[f64; 3]; 3]| Pose::of_matrix(rows, [0.0; 3]).unwrap_err().to_string();
        assert!(told([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]).contains("changes lengths"));
        assert!(told([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).contains("changes lengths"));
        assert!(told([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]).contains("mirrors"));
        assert!(told([[f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).contains("1e100"));
        assert!(Pose::of_quaternion([0.0; 4], [0.0; 3]).is_err());
        assert!(Pose::of_quaternion([0.0, 0.0, 0.0, f64::INFINITY], [0.0; 3]).is_err());
    }
}
