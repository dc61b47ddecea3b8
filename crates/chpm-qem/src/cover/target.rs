//! Distances from points to one triangle.

use chpm_mesh::Aabb;
use nalgebra::{Point3, Vector3};

/// A triangle that points and pieces are held against.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target {
    pub(crate) corners: [Point3<f64>; 3],
    pub(crate) low: Vector3<f64>,
    pub(crate) high: Vector3<f64>,
}

impl Target {
    pub(crate) fn new(corners: [Point3<f64>; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| corner.coords);
        Target { corners, low: a.inf(&b).inf(&c), high: a.sup(&b).sup(&c) }
    }

    /// The square of the distance from the box around it, at most.
    #[inline]
    pub(crate) fn box_squared(&self, point: &Point3<f64>) -> f64 {
        let mut sum = 0.0;
        for axis in 0..3 {
            let beyond = (self.low[axis] - point[axis]).max(point[axis] - self.high[axis]).max(0.0);
            sum += beyond * beyond;
        }
        sum
    }

    /// The box around it and all that is within a distance, about.
    pub(crate) fn aabb(&self, far: f64) -> Aabb {
        let grown = |corner: Vector3<f64>, far: f64| corner.add_scalar(far).map(|x| x as f32).into();
        Aabb { min: grown(self.low, -far), max: grown(self.high, far) }
    }

    /// The square of the distance to a point of the triangle that is nearest but for rounding.
    #[inline]
    pub(crate) fn squared(&self, point: &Point3<f64>) -> f64 {
        (point - self.nearest(point)).norm_squared()
    }

    /// A point of the triangle, nearest but for rounding: its weights are never negative and never more than one together.
    #[inline]
    pub(crate) fn nearest(&self, point: &Point3<f64>) -> Point3<f64> {
        let [a, b, c] = self.corners;
        let (ab, ac, to) = (b - a, c - a, point - a);
        let (along_b, along_c) = (ab.dot(&to), ac.dot(&to));
        let (bb, bc, cc) = (ab.dot(&ab), ab.dot(&ac), ac.dot(&ac));

        // Weights of b and c where the foot on the plane is inside.
        let area = bb * cc - bc * bc;
        let (of_b, of_c) = (cc * along_b - bc * along_c, bb * along_c - bc * along_b);
        if area > 0.0 && of_b >= 0.0 && of_c >= 0.0 && of_b + of_c <= area {
            return a + ab * (of_b / area) + ac * (of_c / area);
        }

        // Else on an edge.
        let edges = [(a, ab), (a, ac), (b, c - b)];
        let feet = edges.map(|(from, edge)| foot(point, &from, &edge));
        let squares = feet.map(|foot| (point - foot).norm_squared());
        let least = if squares[0] <= squares[1] && squares[0] <= squares[2] {
            0
        } else {
            1 + usize::from(squares[2] < squares[1])
        };
        feet[least]
    }
}

/// The point of an edge that is nearest.
#[inline]
fn foot(point: &Point3<f64>, from: &Point3<f64>, edge: &Vector3<f64>) -> Point3<f64> {
    let length = edge.norm_squared();
    let share = if length > 0.0 { (edge.dot(&(point - from)) / length).clamp(0.0, 1.0) } else { 0.0 };
    from + edge * share
}

/// Whether two boxes have a point in common.
#[inline]
pub(crate) fn meet(a: &Aabb, b: &Aabb) -> bool {
    (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis])
}
