//! Boxes and spheres that only ever grow, and triangle helpers.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// How far from zero a coordinate of a mesh may be. Everything that is made of coordinates (diagonals, spheres about spheres,
/// bounds of errors, level upon level) then stays a factor of hundred below the greatest f32.
pub const FAR: f64 = 1e36;

/// An axis-aligned box in object units; empty until a point is added.
///
/// ```
/// use chpm_mesh::Aabb;
///
/// let bounds = Aabb::of_points(&[[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]);
/// assert_eq!(bounds.diagonal(), 5.0);
/// assert!(Aabb::EMPTY.is_empty());
/// ```
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Aabb {
    /// Smallest corner.
    pub min: [f32; 3],
    /// Largest corner.
    pub max: [f32; 3],
}

impl Default for Aabb {
    fn default() -> Self {
        Aabb::EMPTY
    }
}

impl Aabb {
    /// The box that holds nothing.
    pub const EMPTY: Aabb = Aabb { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    /// The smallest box around `points`.
    pub fn of_points<'a>(points: impl IntoIterator<Item = &'a [f32; 3]>) -> Self {
        let mut aabb = Aabb::EMPTY;
        for point in points {
            aabb.add(*point);
        }
        aabb
    }

    /// Grows to hold `point`.
    #[inline]
    pub fn add(&mut self, point: [f32; 3]) {
        for (axis, x) in point.into_iter().enumerate() {
            self.min[axis] = self.min[axis].min(x);
            self.max[axis] = self.max[axis].max(x);
        }
    }

    /// Grows to hold `other`.
    pub fn merge(&mut self, other: &Aabb) {
        for axis in 0..3 {
            self.min[axis] = self.min[axis].min(other.min[axis]);
            self.max[axis] = self.max[axis].max(other.max[axis]);
        }
    }

    /// Whether no point was ever added.
    pub fn is_empty(&self) -> bool {
        self.min[0] > self.max[0]
    }

    /// Whether every point of `other` is inside (an empty box is inside everything).
    pub fn contains(&self, other: &Aabb) -> bool {
        other.is_empty() || (0..3).all(|a| self.min[a] <= other.min[a] && other.max[a] <= self.max[a])
    }

    /// Its corners: bit `axis` of a corner's number is set on the upper side.
    pub fn corners(&self) -> [Point3<f64>; 8] {
        let sides = [self.min, self.max];
        std::array::from_fn(|corner| [0, 1, 2].map(|axis| sides[corner >> axis & 1][axis].into()).into())
    }

    /// The middle, in f64 so that far-away boxes keep it; the zero point for an empty box.
    pub fn center(&self) -> Point3<f64> {
        if self.is_empty() {
            return Point3::origin();
        }
        Point3::from(std::array::from_fn::<f64, 3, _>(|a| {
            0.5 * (f64::from(self.min[a]) + f64::from(self.max[a]))
        }))
    }

    /// Length of the diagonal; 0 for an empty box.
    pub fn diagonal(&self) -> f64 {
        if self.is_empty() {
            return 0.0;
        }
        Vector3::from(std::array::from_fn::<f64, 3, _>(|a| f64::from(self.max[a]) - f64::from(self.min[a])))
            .norm()
    }
}

/// A sphere in object units whose radius is always rounded outward.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sphere {
    /// Centre.
    pub center: [f32; 3],
    /// Radius; at least the distance to everything that the sphere was made around.
    pub radius: f32,
}

impl Sphere {
    /// A sphere about the middle of the points' box.
    pub fn of_points(points: &[[f32; 3]]) -> Self {
        let center = to_f32(Aabb::of_points(points).center());
        let radius = points.iter().map(|p| distance(center, *p)).fold(0.0, f64::max);
        Sphere { center, radius: round_up(radius) }
    }

    /// A sphere about the middle of `bounds` that holds all of `parts`.
    pub fn around(bounds: &Aabb, parts: impl IntoIterator<Item = Sphere>) -> Self {
        let center = to_f32(bounds.center());
        let reach = |s: Sphere| distance(center, s.center) + f64::from(s.radius);
        Sphere { center, radius: round_up(parts.into_iter().map(reach).fold(0.0, f64::max)) }
    }

    /// Whether `other` lies inside.
    pub fn contains(&self, other: &Sphere) -> bool {
        distance(self.center, other.center) + f64::from(other.radius) <= f64::from(self.radius)
    }
}

fn to_f32(point: Point3<f64>) -> [f32; 3] {
    [point.x as f32, point.y as f32, point.z as f32]
}

/// Distance of two points, computed in f64.
pub fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    (to_f64(a) - to_f64(b)).norm()
}

/// A stored position as an f64 point.
#[inline]
pub fn to_f64(point: [f32; 3]) -> Point3<f64> {
    Point3::new(f64::from(point[0]), f64::from(point[1]), f64::from(point[2]))
}

/// Cross product of two edges: twice the area, along the normal.
#[inline]
pub fn area_vector(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> Vector3<f64> {
    let a = to_f64(a);
    (to_f64(b) - a).cross(&(to_f64(c) - a))
}

/// The smallest f32 that is not below a non-negative `value`, with a relative slack for the f64 rounding before it.
#[inline]
pub fn round_up(value: f64) -> f32 {
    let value = value * (1.0 + 1e-12);
    let nearest = value as f32;
    if f64::from(nearest) < value { nearest.next_up() } else { nearest }
}

/// A value that [`round_up`] takes to `bound` at most, and so every smaller one.
#[inline]
pub fn before_round_up(bound: f32) -> f64 {
    f64::from(bound) * (1.0 - 2e-12)
}

/// The largest f32 that is not above a non-negative `value`.
#[inline]
pub fn round_down(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) > value { nearest.next_down() } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_goes_the_way_that_it_is_called() {
        for value in [0.0, 1.0, 0.1, 1e-30, 1e-45, 3.4e38, 16777217.0] {
            assert!(f64::from(round_up(value)) >= value, "{value}");
            let bound = value as f32;
            assert_eq!(round_up(before_round_up(bound)), bound, "{value}");
            let low = round_down(value);
            assert!(f64::from(low) <= value && f64::from(low.next_up()) > value, "{value}");
        }
    }

    #[test]
    fn spheres_nest() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 2.0, 0.1], [1e6, 1.0, 1.0]];
        let low = Sphere::of_points(&points[..3]);
        let all = Aabb::of_points(&points);
        let high = Sphere::around(&all, [low, Sphere::of_points(&points[3..])]);
        assert!(high.contains(&low) && !low.contains(&high));
        for p in points {
            assert!(distance(high.center, p) <= f64::from(high.radius));
        }
    }

    #[test]
    fn the_empty_box_is_inside_everything() {
        assert!(Aabb::EMPTY.is_empty() && Aabb::EMPTY.diagonal() == 0.0);
        let mut unit = Aabb::of_points(&[[0.0; 3], [1.0; 3]]);
        unit.merge(&Aabb::EMPTY);
        assert_eq!(unit, Aabb { min: [0.0; 3], max: [1.0; 3] });
        assert!(unit.contains(&Aabb::EMPTY));
    }
}
