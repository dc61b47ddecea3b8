//! Planes between two sets of triangles whose boxes overlap.

use chpm_mesh::{Aabb, geom};
use nalgebra::{Point3, Vector3};

/// Two sets of triangles side by side along a direction that is none of the axes: long triangles that lie askew have boxes which are
/// nearly all in one another, however narrow they are.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Parting {
    /// Not longer than one.
    across: [f32; 3],
    /// From where to where either set is.
    ranges: [[f32; 2]; 2],
}

/// Two sets are in one another where they have this part of the smaller one in common, along every axis.
const IN_ONE_ANOTHER: f64 = 0.5;

/// They are apart where it is no more than this.
const APART: f64 = 0.125;

/// Rounding error of a sum of products, relative to the largest coordinate, with room.
const LOST: f64 = 1.0 / (1u64 << 48) as f64;

impl Parting {
    /// Whether two boxes say little about which set a point is near.
    pub(crate) fn is_needed(boxes: [&Aabb; 2]) -> bool {
        fn ranges(axis: usize, boxes: &[&Aabb; 2]) -> [[f64; 2]; 2] {
            boxes.map(|b| [b.min[axis], b.max[axis]].map(f64::from))
        }
        (0..3).all(|axis| common(ranges(axis, &boxes)) >= IN_ONE_ANOTHER)
    }

    /// Looks for a direction among those upright on `between`, a triangle where the sets meet, and on its sides. `corners` hands out those
    /// of either set.
    pub(crate) fn find(
        between: [[f32; 3]; 3],
        corners: impl Fn(usize, &mut dyn FnMut([f32; 3])),
    ) -> Option<Parting> {
        let [a, b, c] = between.map(geom::to_f64);
        let normal = (b - a).cross(&(c - a));
        [normal, normal.cross(&(b - a)), normal.cross(&(c - b)), normal.cross(&(a - c))]
            .into_iter()
            .filter_map(|across| Parting::along(across, &corners))
            .find(|parting| common(parting.ranges.map(|range| range.map(f64::from))) <= APART)
    }

    fn along(across: Vector3<f64>, corners: impl Fn(usize, &mut dyn FnMut([f32; 3]))) -> Option<Parting> {
        let across = across.try_normalize(0.0)?.map(|x| (x * (1.0 - 1e-6)) as f32);
        let ranges = [0, 1].map(|set| {
            let (mut low, mut high, mut largest) = (f64::INFINITY, f64::NEG_INFINITY, 0.0f64);
            corners(set, &mut |corner| {
                let point = geom::to_f64(corner);
                let at = dot(across.into(), point);
                (low, high, largest) = (low.min(at), high.max(at), largest.max(point.coords.amax()));
            });
            let lost = LOST * largest;
            [((low - lost) as f32).next_down(), ((high + lost) as f32).next_up()]
        });
        Some(Parting { across: across.into(), ranges })
    }

    /// Hands out the corners of sets of triangles, for [`Parting::find`].
    pub(crate) fn corners_of<'a>(
        triangles: &'a [[[f32; 3]; 3]],
        sets: [&'a [u32]; 2],
    ) -> impl Fn(usize, &mut dyn FnMut([f32; 3])) + 'a {
        move |set, visit| {
            sets[set].iter().flat_map(|t| triangles[*t as usize]).for_each(&mut *visit);
        }
    }

    /// Squared distances from a point to the two sets, at least.
    pub(crate) fn squared_distances(&self, point: Point3<f64>) -> [f64; 2] {
        let (at, lost) = (dot(self.across, point), LOST * point.coords.amax());
        self.ranges.map(|[low, high]| {
            let excess = (f64::from(low) - at).max(at - f64::from(high)) - lost;
            excess.max(0.0) * excess.max(0.0)
        })
    }
}

fn dot(across: [f32; 3], point: Point3<f64>) -> f64 {
    let [x, y, z] = across;
    f64::from(x) * point.x + f64::from(y) * point.y + f64::from(z) * point.z
}

/// Overlap of two ranges, as a part of the smaller one; 1 where that is a point in the other.
fn common([[a, b], [c, d]]: [[f64; 2]; 2]) -> f64 {
    let (both, least) = (b.min(d) - a.max(c), (b - a).min(d - c));
    match (least > 0.0, both >= 0.0) {
        (true, _) => both / least,
        (false, true) => 1.0,
        (false, false) => -1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::squared_distance;
    use proptest::prelude::*;

    #[test]
    fn boxes_in_one_another_are_told_from_others() {
        let unit = Aabb { min: [0.0; 3], max: [1.0; 3] };
        let moved = |by: f32| Aabb { min: [by, 0.0, 0.0], max: [1.0 + by, 1.0, 1.0] };
        assert!(Parting::is_needed([&unit, &moved(0.4)]) && !Parting::is_needed([&unit, &moved(0.6)]));
        let flat = |z: f32| Aabb { min: [0.0, 0.0, z], max: [1.0, 1.0, z] };
        assert!(Parting::is_needed([&unit, &flat(1.0)]) && !Parting::is_needed([&unit, &flat(1.1)]));
        assert!(Parting::is_needed([&flat(0.0), &flat(0.0)]));
    }

    #[test]
    fn pages_of_a_book_and_blades_of_a_fan_are_apart() {
        let turned = |degrees: f32| [degrees.to_radians().cos(), degrees.to_radians().sin(), 0.3];
        let page = |i: u32| [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], turned(40.0 + i as f32)];
        let blade = |i: u32| [[0.0, 0.0, 1.0], turned(40.0 + i as f32), turned(41.0 + i as f32)];

        for triangles in [(0..8).map(page).collect::<Vec<_>>(), (0..8).map(blade).collect()] {
            let found =
                Parting::find(triangles[4], Parting::corners_of(&triangles, [&[0, 1, 2, 3], &[4, 5, 6, 7]]))
                    .unwrap();

            let middle = |i: usize| {
                nalgebra::Point3::from(
                    triangles[i].iter().fold(Vector3::zeros(), |sum, c| sum + geom::to_f64(*c).coords / 3.0),
                )
            };
            let [low, high] = [found.squared_distances(middle(0)), found.squared_distances(middle(7))];
            assert!(low[0] == 0.0 && low[1] > 1e-4 && high[0] > 1e-4 && high[1] == 0.0, "{low:?} {high:?}");
        }

        let sheet = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let sheets = [sheet; 4];
        let corners = Parting::corners_of(&sheets, [&[0, 1], &[2, 3]]);
        assert_eq!(Parting::find(sheet, &corners), None);
        assert_eq!(Parting::find([[1.0; 3]; 3], &corners), None);
    }

    proptest! {
        /// No set is nearer than the distance that is told, far from the origin, too.
        #[test]
        fn distances_are_not_overstated(
            corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)), 8),
            point in prop::array::uniform3(-2.0f64..2.0),
            across in prop::array::uniform3(-1.0f64..1.0),
            away in prop::sample::select(vec![0.0f32, 1e3, 1e6, 1e15]),
            scale in prop::sample::select(vec![1.0f32, 1e-3, 1e20]),
        ) {
            let triangles: Vec<_> = corners.iter().map(|t| t.map(|c| c.map(|x| scale * x + away))).collect();
            let point = Point3::from(point.map(|x| f64::from(scale) * x + f64::from(away)));
            let sets: [&[u32]; 2] = [&[0, 1, 2, 3], &[4, 5, 6, 7]];
            let Some(parting) = Parting::along(Vector3::from(across), Parting::corners_of(&triangles, sets)) else { return Ok(()) };
            for (set, told) in sets.iter().zip(parting.squared_distances(point)) {
                let least = set.iter().map(|t| squared_distance(point, triangles[*t as usize]));
                let least = least.fold(f64::INFINITY, f64::min).sqrt();
                prop_assert!(told.sqrt() <= least * (1.0 + 1e-9), "{} {}", told.sqrt(), least);
            }
        }
    }
}
