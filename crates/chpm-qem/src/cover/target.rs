//! Distances from points to one triangle.

use nalgebra::{Point3, Vector3};

/// A triangle that points and pieces are held against.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target {
    pub(crate) corners: [Point3<f64>; 3],
    pub(crate) low: Vector3<f64>,
    pub(crate) high: Vector3<f64>,
    /// Factors from products with the edges at the first corner to weights of the other two; not a number where there is no area.
    weights: [f64; 3],
}

impl Target {
    pub(crate) fn new(corners: [Point3<f64>; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| corner.coords);
        let (ab, ac) = (b - a, c - a);
        let (bb, bc, cc) = (ab.dot(&ab), ab.dot(&ac), ac.dot(&ac));
        let area = bb * cc - bc * bc;
        let weights = if area > 0.0 { [cc / area, -bc / area, bb / area] } else { [f64::NAN; 3] };
        Target { corners, low: a.inf(&b).inf(&c), high: a.sup(&b).sup(&c), weights }
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

    /// The box around all that is over or under it, no farther than this from its plane.
    pub(crate) fn around(&self, far: f64) -> (Vector3<f64>, Vector3<f64>) {
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0);
        let beyond = normal.map_or(Vector3::zeros(), |normal| normal.abs() * far);
        (self.low - beyond, self.high + beyond)
    }

    /// The nearer of this one, whose number is `index`, and the best so far.
    #[inline]
    pub(crate) fn nearer(&self, index: u32, point: &Point3<f64>, best: (u32, f64)) -> (u32, f64) {
        if self.box_squared(point) >= best.1 {
            return best;
        }
        let squared = self.squared(point);
        if squared < best.1 { (index, squared) } else { best }
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
        let [bb, bc, cc] = self.weights;
        let (of_b, of_c) = (bb * along_b + bc * along_c, bc * along_b + cc * along_c);
        if of_b >= 0.0 && of_c >= 0.0 && of_b + of_c <= 1.0 {
            return a + ab * of_b + ac * of_c;
        }

        // Else on an edge that the foot on the plane is beyond.
        let mut best = (f64::INFINITY, a);
        let edges = [(of_c >= 0.0, a, ab), (of_b >= 0.0, a, ac), (of_b + of_c <= 1.0, b, c - b)];
        for (is_inside, from, edge) in edges {
            if !is_inside {
                let foot = foot(point, &from, &edge);
                let squared = (point - foot).norm_squared();
                if squared < best.0 {
                    best = (squared, foot);
                }
            }
        }
        best.1
    }
}

/// The point of an edge that is nearest.
#[inline]
fn foot(point: &Point3<f64>, from: &Point3<f64>, edge: &Vector3<f64>) -> Point3<f64> {
    let length = edge.norm_squared();
    let share = if length > 0.0 { (edge.dot(&(point - from)) / length).clamp(0.0, 1.0) } else { 0.0 };
    from + edge * share
}
