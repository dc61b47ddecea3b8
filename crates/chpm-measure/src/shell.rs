//! Lower bound on the distance of a point and a triangle, in a few operations: most triangles that come near a search are not the nearest one.

use crate::proof::Corners;
use chpm_mesh::geom;
use nalgebra::{Point3, Vector3};

/// Directions, and how far a triangle reaches along them: upright on its plane first, then outward in its plane, one for each edge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shell {
    /// By axis, so that all four are done at once.
    directions: [[f32; 4]; 3],
    /// From the first corner.
    most: [f32; 4],
    /// Along the first direction, the other way.
    below: f32,
}

/// Lost of a sum of products, as a share of these, and more.
const LOST: f32 = 1.0 / (1u32 << 20) as f32;
/// Factor that keeps a square a lower bound: directions are off unit length and a right angle by a few roundings.
const SAFE: f64 = 1.0 - 1e-6;

impl Shell {
    pub(crate) fn new(corners: Corners) -> Self {
        let [a, b, c] = corners.map(geom::to_f64);
        let edges = [b - a, c - b, a - c];
        let longest = (0..3).fold(0, |best, i| if edges[i].norm() > edges[best].norm() { i } else { best });
        fn unit(v: Vector3<f64>) -> Option<Vector3<f64>> {
            v.try_normalize(f64::MIN_POSITIVE)
        }
        // Of the two shortest edges, as for needles nothing else is right.
        let up = unit(
            unit(edges[(longest + 1) % 3])
                .unwrap_or_default()
                .cross(&unit(edges[(longest + 2) % 3]).unwrap_or_default()),
        );
        let along = unit(edges[longest]).unwrap_or(Vector3::x());
        let directions = match up {
            Some(up) => {
                let outward = |i: usize| unit(edges[i].cross(&up)).unwrap_or(along);
                [up, outward(0), outward(1), outward(2)]
            }
            // Without a plane, any that holds the longest edge.
            None => {
                let axis =
                    (0..3).fold(0, |least, i| if along[i].abs() < along[least].abs() { i } else { least });
                let up = along.cross(&Vector3::ith(axis, 1.0)).normalize();
                let beside = along.cross(&up);
                [up, beside, -beside, along]
            }
        };
        let directions = directions.map(|direction| direction.map(|x| x as f32));
        Shell {
            directions: std::array::from_fn(|axis| directions.map(|direction| direction[axis])),
            most: directions.map(|direction| reach(direction, &b, &a, &c).next_up()),
            below: reach(-directions[0], &b, &a, &c).next_up(),
        }
    }

    /// Squared distance of a point at least, `first` being the triangle's first corner.
    #[inline]
    pub(crate) fn squared_distance_at_least(&self, point: Point3<f64>, first: [f32; 3]) -> f64 {
        let way = [
            (point.x - f64::from(first[0])) as f32,
            (point.y - f64::from(first[1])) as f32,
            (point.z - f64::from(first[2])) as f32,
        ];
        let [x, y, z] = &self.directions;
        let (mut along, mut lost) = ([0.0f32; 4], [0.0f32; 4]);
        // All four at once.
        for i in 0..4 {
            let (a, b, c) = (x[i] * way[0], y[i] * way[1], z[i] * way[2]);
            along[i] = a + b + c;
            lost[i] = LOST * (a.abs() + b.abs() + c.abs() + self.most[i].abs()) + f32::MIN_POSITIVE;
        }
        let mut excess = [0.0f32; 4];
        for i in 0..4 {
            excess[i] = along[i] - self.most[i] - lost[i];
        }
        fn larger(a: f32, b: f32) -> f32 {
            if a > b { a } else { b }
        }
        let under = -along[0] - self.below - lost[0] - LOST * self.below;
        let upright = f64::from(larger(larger(excess[0], under), 0.0));
        let beside = f64::from(larger(larger(larger(excess[1], excess[2]), excess[3]), 0.0));
        (upright * upright + beside * beside) * SAFE
    }
}

fn reach(direction: Vector3<f32>, b: &Point3<f64>, a: &Point3<f64>, c: &Point3<f64>) -> f32 {
    let direction = direction.map(f64::from);
    let ways = [Vector3::zeros(), *b - *a, *c - *a];
    let lost = 1e-15 * ways.iter().map(|way| way.amax()).fold(0.0, f64::max);
    (ways.iter().map(|way| direction.dot(way)).fold(0.0, f64::max) + lost) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::squared_distance;
    use proptest::prelude::*;

    #[test]
    fn over_the_inside_and_beside_an_edge_the_bound_is_the_distance() {
        let corners: Corners = [[0.0; 3], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        let shell = Shell::new(corners);
        for point in [[1.0, 1.0, 2.0], [1.0, 1.0, -2.0], [2.0, -1.0, 0.5], [4.0, 3.0, 0.1], [1.0, 1.0, 0.0]] {
            let (truth, told) = (
                squared_distance(point.into(), corners),
                shell.squared_distance_at_least(point.into(), corners[0]),
            );
            assert!(told <= truth && told >= 0.9999 * truth - 1e-9, "{point:?}: {told} {truth}");
        }
    }

    proptest! {
        /// Triangles of any thinness, points and lines among them, near and far.
        #[test]
        fn distances_are_not_overstated(
            corners in prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)),
            flatness in prop::array::uniform3(0i32..40),
            twin in 0usize..9,
            point in prop::array::uniform3(-2.0f64..2.0),
            away in prop::sample::select(vec![0.0f32, 1e3, 1e6, 1e15]),
            scale in -110i32..110,
        ) {
            let scale = 2f32.powi(scale);
            let thin = |c: [f32; 3]| std::array::from_fn(|i| (c[i] * 2f32.powi(-flatness[i]) + away) * scale);
            let mut corners: Corners = corners.map(thin);
            corners[twin % 3] = corners[twin / 3];
            let point = Point3::from(point.map(|x| (x + f64::from(away)) * f64::from(scale)));
            prop_assume!(corners.as_flattened().iter().all(|x| x.abs() < 1e36));
            let truth = squared_distance(point, corners).sqrt();
            let told = Shell::new(corners).squared_distance_at_least(point, corners[0]).sqrt();
            let rounding = 1e-15 * f64::from(scale) * f64::from(away).max(2.0);
            prop_assert!(told <= truth + rounding, "{} {}", told, truth);
        }
    }
}
