//! Parallel planes, and which side of them a point is on.

use crate::error::SectionError;
use chpm_mesh::Aabb;
use std::ops::Range;

/// Planes with one normal: the points whose product with it is one of some offsets.
#[derive(Clone, PartialEq, Debug)]
pub struct Planes {
    normal: [f64; 3],
    /// Ascending.
    offsets: Vec<f64>,
}

impl Planes {
    /// Planes at these distances from the zero point, along a normal of any length.
    ///
    /// # Errors
    /// [`SectionError::Plane`] for a normal without a direction or a number that is not finite.
    pub fn new(normal: [f64; 3], mut offsets: Vec<f64>) -> Result<Self, SectionError> {
        let largest = normal.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        if !normal.iter().all(|x| x.is_finite()) || largest == 0.0 {
            let got = format!("{}, {}, {}", normal[0], normal[1], normal[2]);
            return Err(SectionError::Plane { expected: "a normal with a direction", got });
        }
        if let Some(got) = offsets.iter().find(|offset| !offset.is_finite()) {
            return Err(SectionError::Plane { expected: "a finite distance", got: got.to_string() });
        }

        // Along an axis nothing is rounded: one component is 1, the others 0.
        let scaled = normal.map(|x| x / largest);
        let length = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
        offsets.sort_by(f64::total_cmp);
        Ok(Planes { normal: scaled.map(|x| x / length), offsets })
    }

    /// Their normal, of length 1.
    pub fn normal(&self) -> [f64; 3] {
        self.normal
    }

    /// Their distances from the zero point, ascending.
    pub fn offsets(&self) -> &[f64] {
        &self.offsets
    }

    /// Directions to the right and upward in a plane, for whoever looks against the normal. Up is z, or y where the plane is level.
    pub fn axes(&self) -> [[f64; 3]; 2] {
        let n = self.normal;
        let up = if n[2].abs() > 0.9 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        let along = dot(up, n);
        let v: [f64; 3] = std::array::from_fn(|axis| up[axis] - along * n[axis]);
        let length = dot(v, v).sqrt();
        let v = v.map(|x| x / length);
        [[v[1] * n[2] - v[2] * n[1], v[2] * n[0] - v[0] * n[2], v[0] * n[1] - v[1] * n[0]], v]
    }

    /// The same about another zero point, of which the old one is at `-origin`.
    pub(crate) fn about(&self, origin: [f64; 3]) -> Self {
        let less = dot(self.normal, origin);
        Planes { normal: self.normal, offsets: self.offsets.iter().map(|offset| offset - less).collect() }
    }

    /// How far along the normal a point is. Rounded sums grow with each coordinate as exact ones do, so those of a box's corners are bounds.
    pub(crate) fn height(&self, point: [f32; 3]) -> f64 {
        dot(self.normal, point.map(f64::from))
    }

    /// The planes that something between two heights crosses: which have it on both sides, where a plane itself counts as above.
    pub(crate) fn between(&self, low: f64, high: f64) -> Range<usize> {
        let start = self.offsets.partition_point(|offset| *offset <= low);
        let more = self.offsets[start..].partition_point(|offset| *offset <= high);
        start..start + more
    }

    /// The planes that cross a box.
    pub(crate) fn through(&self, Aabb { min, max }: &Aabb) -> Range<usize> {
        let corner =
            |wanted: f64| std::array::from_fn(|axis| pick(self.normal[axis] * wanted, min, max, axis));
        self.between(self.height(corner(-1.0)), self.height(corner(1.0)))
    }
}

fn pick(direction: f64, min: &[f32; 3], max: &[f32; 3], axis: usize) -> f32 {
    if direction < 0.0 { min[axis] } else { max[axis] }
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_itself_counts_as_above() {
        let planes = Planes::new([0.0, 0.0, 5.0], vec![3.0, 1.0, 2.0]).unwrap();
        assert_eq!((planes.normal(), planes.offsets()), ([0.0, 0.0, 1.0], &[1.0, 2.0, 3.0][..]));
        for (low, high, expected) in
            [(0.0, 0.9, 0..0), (0.0, 1.0, 0..1), (1.0, 1.9, 1..1), (1.0, 3.0, 1..3), (3.0, 4.0, 3..3)]
        {
            assert_eq!(planes.between(low, high), expected, "{low} {high}");
        }
        let boxed = Aabb { min: [-1.0, -1.0, 0.5], max: [1.0, 1.0, 2.5] };
        assert_eq!(planes.through(&boxed), 0..2);
        let down = Planes::new([0.0, 0.0, -1.0], vec![-1.0, -3.0]).unwrap();
        assert_eq!(down.through(&boxed), 1..2);
    }

    #[test]
    fn axes_are_those_of_who_looks_against_the_normal() {
        for (normal, u, v) in [
            ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
            ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0, 2.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
        ] {
            assert_eq!(Planes::new(normal, vec![]).unwrap().axes(), [u, v], "{normal:?}");
        }
        let planes = Planes::new([1.0, -2.0, 0.7], vec![]).unwrap();
        let [u, v] = planes.axes();
        let products = [dot(u, v), dot(u, planes.normal()), dot(v, planes.normal())];
        assert!(products.iter().all(|x| x.abs() < 1e-15), "{products:?}");
    }

    #[test]
    fn what_is_no_plane_is_refused() {
        for (normal, offset) in
            [([0.0; 3], 0.0), ([f64::NAN, 0.0, 1.0], 0.0), ([0.0, 0.0, 1.0], f64::INFINITY)]
        {
            assert!(matches!(Planes::new(normal, vec![offset]), Err(SectionError::Plane { .. })));
        }
        // No square of it is a number.
        assert_eq!(Planes::new([1e-300, 0.0, 0.0], vec![]).unwrap().normal(), [1.0, 0.0, 0.0]);
    }
}
