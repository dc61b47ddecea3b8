//! Directions in three bytes.
//!
//! A direction is a point of an octahedron, which is unfolded into a square: the upper half lies in the middle, the four faces of the
//! lower one at its corners. Each of the two coordinates has twelve bits.

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

/// A direction, at most 0.06 degrees from the one that it was made of; or none. FORMAT.md, "Octahedral normals", has its bits.
///
/// ```
/// use chpm_mesh::Octahedral;
///
/// assert_eq!(Octahedral::of([0.0, 0.0, 7.0]).vector(), [0.0, 0.0, 1.0]);
/// assert_eq!(Octahedral::of([0.0; 3]), Octahedral::NONE);
/// ```
#[derive(
    Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default, Pod, Zeroable, Serialize, Deserialize,
)]
#[repr(transparent)]
pub struct Octahedral([u8; 3]);

/// Code of 0, and the number of steps from there to 1.
const ZERO: u32 = 2048;
const STEPS: f64 = 2047.0;

impl Octahedral {
    /// No direction.
    pub const NONE: Octahedral = Octahedral([0; 3]);

    /// The direction of a vector of any length; none for zero, and for what is not finite.
    pub fn of(vector: [f64; 3]) -> Self {
        let Some(point) = square(vector) else { return Self::NONE };
        let [mut u, mut v] = point.map(|t| ((t * STEPS).round() + f64::from(ZERO)) as u32);
        // Where the square is folded, each direction is there twice: the larger number is taken.
        if u.abs_diff(ZERO) == STEPS as u32 {
            v = ZERO + v.abs_diff(ZERO);
        }
        if v.abs_diff(ZERO) == STEPS as u32 {
            u = ZERO + u.abs_diff(ZERO);
        }
        Self::from_steps([u, v])
    }

    /// The unit vector, or zero.
    pub fn vector(self) -> [f32; 3] {
        if self == Self::NONE {
            return [0.0; 3];
        }
        let [u, v] = self.steps().map(|steps| (f64::from(steps.max(1)) - f64::from(ZERO)) / STEPS);
        direction([u, v]).map(|t| t as f32)
    }

    /// Both numbers, each below 4096.
    pub fn steps(self) -> [u32; 2] {
        let [a, b, c] = self.0.map(u32::from);
        let all = a | b << 8 | c << 16;
        [all & 0xfff, all >> 12]
    }

    /// From both numbers, of which the lowest twelve bits count.
    pub fn from_steps([u, v]: [u32; 2]) -> Self {
        let [a, b, c, _] = (u & 0xfff | (v & 0xfff) << 12).to_le_bytes();
        Octahedral([a, b, c])
    }
}

/// The direction, of length 1, of a point of the unfolded octahedron.
pub fn direction([u, v]: [f64; 2]) -> [f64; 3] {
    let z = 1.0 - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    let (x, y) = (u - fold.copysign(u), v - fold.copysign(v));
    let length = (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|t| t / length)
}

/// The point of the unfolded octahedron in a direction, -1 to 1; none for zero, and for what is not finite.
pub fn square([x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
    // Divided by the largest first, so that neither sum nor quotient leaves the range of numbers.
    let largest = x.abs().max(y.abs()).max(z.abs());
    if !(largest > 0.0 && (x + y + z).is_finite()) {
        return None;
    }
    let [x, y, z] = [x, y, z].map(|t| t / largest);
    let sum = x.abs() + y.abs() + z.abs();
    let (u, v) = (x / sum, y / sum);
    fn fold(a: f64, b: f64) -> f64 {
        (1.0 - b.abs()).copysign(a)
    }
    Some(if z < 0.0 { [fold(u, v), fold(v, u)] } else { [u, v] })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn angle(a: [f64; 3], b: [f32; 3]) -> f64 {
        let (a, b) = (nalgebra::Vector3::from(a), nalgebra::Vector3::from(b.map(f64::from)));
        let a = a / a.amax();
        a.cross(&b).norm().atan2(a.dot(&b)).to_degrees()
    }

    #[test]
    fn axes_are_exact_and_zero_is_none() {
        for axis in 0..3 {
            for side in [1.0, -1.0, 1e-300, -1e300] {
                let mut vector = [0.0; 3];
                vector[axis] = side;
                let expected = vector.map(|x: f64| if x == 0.0 { 0.0 } else { x.signum() as f32 });
                assert_eq!(Octahedral::of(vector).vector(), expected);
            }
        }
        for nothing in [[0.0; 3], [-0.0; 3], [f64::NAN, 1.0, 0.0], [f64::INFINITY, 1.0, 0.0]] {
            assert_eq!(Octahedral::of(nothing), Octahedral::NONE);
        }
        assert_eq!((Octahedral::NONE.vector(), Octahedral::default()), ([0.0; 3], Octahedral::NONE));
    }

    /// Whatever a file says is a direction.
    #[test]
    fn every_code_is_a_unit_vector() {
        for u in (0..4096).step_by(5).chain([4095]) {
            for v in (0..4096).step_by(7).chain([4095]).filter(|v| (u, *v) != (0, 0)) {
                let vector = Octahedral::from_steps([u, v]).vector().map(f64::from);
                let length = vector.map(|x| x * x).iter().sum::<f64>().sqrt();
                assert!((length - 1.0).abs() < 1e-6, "{u} {v}: {vector:?}");
                let again = Octahedral::of(vector).vector();
                assert!(angle(vector, again) < 1e-4, "{u} {v}: {vector:?}, {again:?}");
            }
        }
    }

    /// Directions all over the sphere, of all lengths.
    fn directions() -> impl Iterator<Item = [f64; 3]> {
        let turn = |i: u32, by: f64| f64::from(i) * by * std::f64::consts::TAU;
        (0..40_000).map(move |i| {
            let z = 1.0 - f64::from(i) / 20_000.0;
            let (sin, cos) = turn(i, 0.618_033_988_75).sin_cos();
            let flat = (1.0 - z * z).max(0.0).sqrt();
            let length = 10f64.powi((i % 600) as i32 - 300);
            [cos * flat, sin * flat, z].map(|x| x * length)
        })
    }

    #[test]
    fn a_direction_is_kept() {
        let mut largest = 0.0f64;
        for vector in directions() {
            let code = Octahedral::of(vector);
            largest = largest.max(angle(vector, code.vector()));
            // What was rounded once stays.
            assert_eq!(Octahedral::of(code.vector().map(f64::from)), code, "{vector:?}");
            assert_eq!(Octahedral::from_steps(code.steps()), code);
        }
        assert!((0.04..0.06).contains(&largest), "{largest} degrees");
    }
}
