//! How far a point is from a triangle: bounds that hold whatever rounding does.
//!
//! The nearest place of a triangle is found as well as f64 can, which for slivers may not be well. Any place of the triangle shows how far
//! the point is at most; and the triangle lies wholly behind the farthest of its corners along any direction, which shows how far it is at least. So
//! neither bound rests on how good the place is.

use chpm_mesh::geom;
use nalgebra::{Point3, Vector3};

/// Corners as they are stored.
pub(crate) type Corners = [[f32; 3]; 3];

/// Rounding error of everything that is computed here, relative to the largest coordinate that took part: 2048 times what f64 rounds by. A place on
/// a triangle takes 12 roundings and a distance 10 more, each of at most twice the largest coordinate by the root of 3; and the corners of a piece are off
/// their triangle by 14 roundings for each cut that it comes from, of which there are fewer than 96.
pub const LOSS: f64 = 1.0 / (1u64 << 42) as f64;

/// Times that a place is looked for from where it was found to be.
const REPAIRS: usize = 3;

/// Which part of a triangle is nearest.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Feature {
    Inside,
    /// From this corner to the next one.
    Edge(usize),
    Corner,
}

/// A place of a triangle, meant to be the nearest one to a point.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct NearestPoint {
    pub(crate) at: Point3<f64>,
    pub(crate) distance: f64,
    pub(crate) feature: Feature,
}

/// A triangle in f64.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Face {
    pub(crate) corners: [Point3<f64>; 3],
    /// Edges, each from its corner to the next one.
    pub(crate) edges: [Vector3<f64>; 3],
    /// Of twice the area; zero without one.
    pub(crate) normal: Vector3<f64>,
    /// The largest coordinate.
    pub(crate) largest: f64,
}

impl Face {
    pub(crate) fn new(corners: Corners) -> Self {
        let corners = corners.map(geom::to_f64);
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        // Of the two shortest edges, as nothing else is right for needles.
        let lengths = edges.map(|edge| edge.norm_squared());
        let longest = (0..3).fold(0, |best, i| if lengths[i] > lengths[best] { i } else { best });
        let normal = edges[(longest + 1) % 3].cross(&edges[(longest + 2) % 3]);
        let largest = corners.iter().map(|corner| corner.coords.amax()).fold(0.0, f64::max);
        Face { corners, edges, normal, largest }
    }

    /// Half the longest edge, at least: how wide the triangle is.
    pub(crate) fn radius(&self) -> f64 {
        0.5 * self.edges.iter().map(Vector3::norm).fold(0.0, f64::max)
    }

    /// The nearest place to a point, as well as it can be found. It is on the triangle, up to [`LOSS`], in any case.
    pub(crate) fn nearest(&self, point: Point3<f64>) -> NearestPoint {
        fn nearer(a: NearestPoint, b: NearestPoint) -> NearestPoint {
            if b.distance < a.distance { b } else { a }
        }
        let on_edges = || {
            let [a, b, c] = [0, 1, 2].map(|i| self.on_edge(i, point));
            nearer(nearer(a, b), c)
        };
        let weight = |i: usize, way: Vector3<f64>| self.edges[(i + 1) % 3].cross(&way).dot(&self.normal);
        let mut weights = [0, 1, 2].map(|i| weight(i, point - self.corners[(i + 1) % 3]));
        let sum: f64 = weights.iter().sum();
        if sum > 0.0 && sum.is_finite() && weights.iter().all(|weight| *weight >= 0.0) {
            weights.iter_mut().for_each(|weight| *weight /= sum);
            let mut place = self.inside(weights, point);
            // Along a needle, rounding may have missed the foot of the perpendicular by far more than across; what is missing is found by the same way.
            let most = 0.1 * LOSS * self.largest.max(point.coords.amax()) * self.normal.norm();
            for _ in 0..=REPAIRS {
                let way = point - place.at;
                if way.cross(&self.normal).norm() <= most {
                    return place;
                }
                let repaired = [0, 1, 2].map(|i| (weights[i] + weight(i, way) / sum).max(0.0));
                let all: f64 = repaired.iter().sum();
                weights = repaired.map(|weight| weight / all);
                let other = self.inside(weights, point);
                place = if other.distance < place.distance { other } else { place };
            }
            // It is beside an edge then, by less than can be told.
            return nearer(place, on_edges());
        }
        on_edges()
    }

    fn inside(&self, weights: [f64; 3], point: Point3<f64>) -> NearestPoint {
        let at = self.corners[0] + self.edges[0] * weights[1] - self.edges[2] * weights[2];
        NearestPoint { at, distance: (point - at).norm(), feature: Feature::Inside }
    }

    fn on_edge(&self, edge: usize, point: Point3<f64>) -> NearestPoint {
        let (from, along) = (self.corners[edge], self.edges[edge]);
        let length_squared = along.norm_squared();
        let part = along.dot(&(point - from)) / length_squared;
        let (at, feature) = match part {
            part if part > 0.0 && part < 1.0 => (from + along * part, Feature::Edge(edge)),
            part if part >= 1.0 => (self.corners[(edge + 1) % 3], Feature::Corner),
            _ => (from, Feature::Corner),
        };
        NearestPoint { at, distance: (point - at).norm(), feature }
    }

    /// A distance that the point has from the triangle at least; what rounding may do is taken off.
    pub(crate) fn lower_bound(&self, point: Point3<f64>) -> f64 {
        let place = self.nearest(point);
        let away = point - place.at;
        // Straight away from the plane or the edge; to a needle, that the place is found a little beside the nearest would make a difference.
        let away = match place.feature {
            Feature::Inside => self.normal * self.normal.dot(&away).signum(),
            Feature::Edge(i) => {
                let along = self.edges[i];
                away - along * (along.dot(&away) / along.norm_squared())
            }
            Feature::Corner => away,
        };
        let length = away.norm();
        if length == 0.0 {
            return 0.0;
        }
        let direction = away / length;
        let lower =
            self.corners.iter().map(|corner| direction.dot(&(point - corner))).fold(f64::INFINITY, f64::min);
        (lower - LOSS * self.largest.max(point.coords.amax())).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::squared_distance;
    use proptest::prelude::*;

    #[test]
    fn parts_of_a_triangle_are_told_apart() {
        let face = Face::new([[0.0; 3], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]]);
        for (point, distance, feature) in [
            ([1.0, 1.0, 2.0], 2.0, Feature::Inside),
            ([1.0, 1.0, 0.0], 0.0, Feature::Inside),
            ([2.0, -1.0, 0.0], 1.0, Feature::Edge(0)),
            ([4.0, 3.0, 0.0], 2.4, Feature::Edge(1)),
            ([-5.0, 1.0, 0.0], 5.0, Feature::Edge(2)),
            ([-3.0, -4.0, 0.0], 5.0, Feature::Corner),
            ([6.0, 0.0, 0.0], 2.0, Feature::Corner),
        ] {
            let place = face.nearest(point.into());
            assert!((place.distance - distance).abs() < 1e-14, "{point:?}: {place:?}");
            assert_eq!(place.feature, feature, "{point:?}");
            let lower = face.lower_bound(point.into());
            assert!(lower <= distance && lower > distance - 1e-11, "{point:?}: {lower}");
        }
    }

    #[test]
    fn a_point_of_a_needle_is_on_it() {
        // A point inside is a combination of corners up to rounding.
        for width in [1.0, 1e-3, 1e-6] {
            let corners: Corners = [[65537.0, 3.0, 0.0], [2.0, 1.0, 7.0], [2.0 - width, 1.0, 7.0 + width]];
            let face = Face::new(corners);
            for [a, b] in [[0.3, 0.3], [0.9, 0.05], [0.01, 0.4], [1e-5, 0.5]] {
                let point = face.corners[0] + face.edges[0] * a - face.edges[2] * b;
                let distance = face.nearest(point).distance;
                assert!(distance <= 0.1 * LOSS * face.largest, "{width} {a} {b}: {distance}");
                let beside = point + face.normal.normalize() * 0.01;
                let lower = face.lower_bound(beside);
                assert!(
                    (0.01 - 2.0 * LOSS * face.largest..=0.01).contains(&lower),
                    "{width} {a} {b}: {lower}"
                );
            }
        }
    }

    #[test]
    fn a_point_beside_the_edge_of_a_cap_is_on_it() {
        let face = Face::new([[1.4, 0.8, 0.0], [1.5, 0.9, 0.0], [1.1, 0.5, 0.0]]);
        let mut asked = 0;
        for edge in 0..3 {
            for step in 1..200 {
                let on = face.corners[edge] + face.edges[edge] * (f64::from(step) / 200.0);
                for off in [-1e-16, 0.0, 1e-16] {
                    let distance = face.nearest(on + Vector3::new(off, -off, 0.0)).distance;
                    assert!(distance <= 0.2 * LOSS * face.largest, "{edge} {step} {off}: {distance}");
                    asked += 1;
                }
            }
        }
        assert_eq!(asked, 3 * 199 * 3);
    }

    #[test]
    fn what_has_no_area_is_its_edges_or_its_corner() {
        let line = Face::new([[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
        assert_eq!(line.nearest([1.5, 2.0, 0.0].into()).distance, 2.0);
        let point = Face::new([[1.0; 3]; 3]);
        assert_eq!(point.nearest([1.0, 4.0, 5.0].into()).distance, 5.0);
        assert!(point.lower_bound([1.0, 4.0, 5.0].into()) > 5.0 - 1e-10);
    }

    proptest! {
        /// Slivers of any thinness, near and far: the truth, known to f64, is between both bounds.
        #[test]
        fn bounds_enclose_the_distance(
            corners in prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)),
            flatness in prop::array::uniform3(0u32..40),
            scale in -120i32..120,
            point in prop::array::uniform3(-2.0f64..2.0),
        ) {
            let size = f64::from(scale).exp2();
            let thin = |c: [f32; 3]| std::array::from_fn(|a| {
                (f64::from(c[a]) * (-f64::from(flatness[a])).exp2() * size) as f32
            });
            let corners: Corners = corners.map(thin);
            let point = Point3::from(point.map(|x| x * size));
            let face = Face::new(corners);
            let loss = LOSS * face.largest.max(point.coords.amax());
            let (upper, lower) = (face.nearest(point).distance, face.lower_bound(point));
            prop_assert!(lower <= upper, "{lower} {upper}");
            // The other way to find it is right for triangles that are not too flat.
            let area = face.normal.norm() / face.radius().powi(2).max(f64::MIN_POSITIVE);
            if area > 1e-3 {
                let truth = squared_distance(point, corners).sqrt();
                prop_assert!(lower <= truth + loss && truth <= upper + loss, "{lower} {truth} {upper}");
                prop_assert!(upper - lower <= 1e-6 * size, "{lower} {upper}");
            }
        }
    }
}
