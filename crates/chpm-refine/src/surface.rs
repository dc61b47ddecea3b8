//! Triangles of one cluster as something to be near to.

use crate::lod::Lod;
use chpm_format::Page;
use chpm_mesh::Aabb;
use chpm_mesh::geom::to_f64;
use nalgebra::Point3;

/// Triangles that have a box together; a page's are in an order in which neighbours follow one another.
const RUN: usize = 32;
/// Rounding of a distance, as a share of the numbers that it is made of, with room.
const LOST: f64 = 1.0 / (1u64 << 44) as f64;

/// Triangles, in runs with boxes.
#[derive(Default)]
pub(crate) struct Surface {
    lod: Lod,
    corners: Vec<[u16; 3]>,
    triangles: Vec<[[f32; 3]; 3]>,
    boxes: Vec<Aabb>,
}

impl Surface {
    /// The mesh of `n` vertices of a page.
    pub(crate) fn fill(&mut self, page: &Page<'_>, n: usize) {
        self.lod.collect(&page.progressive_mesh(), n, &mut self.corners);
        let place = |corner: u16| page.positions[usize::from(corner)];
        self.triangles.clear();
        self.triangles.extend(self.corners.iter().map(|corners| corners.map(place)));
        self.enclose();
    }

    /// One triangle.
    pub(crate) fn fill_one(&mut self, triangle: [[f32; 3]; 3]) {
        self.triangles.clear();
        self.triangles.push(triangle);
        self.enclose();
    }

    fn enclose(&mut self) {
        self.boxes.clear();
        let runs = self.triangles.chunks(RUN);
        self.boxes.extend(runs.map(|run| Aabb::of_points(run.as_flattened())));
    }

    /// The box around all.
    pub(crate) fn bounds(&self) -> Aabb {
        Aabb::of_points(self.triangles.as_flattened())
    }

    /// How far a point is from a triangle that is no farther than `reach`, at most; none if there is no such triangle.
    pub(crate) fn within(&self, point: Point3<f64>, reach: f64) -> Option<f64> {
        if reach < 0.0 {
            return None;
        }
        let runs = self.triangles.chunks(RUN).zip(&self.boxes);
        let near = runs.filter(|(_, bounds)| squared_distance(point, bounds) <= reach * reach);
        let mut distances = near.flat_map(|(run, _)| run).map(|triangle| distance(point, triangle));
        distances.find(|distance| *distance <= reach)
    }
}

fn squared_distance(point: Point3<f64>, bounds: &Aabb) -> f64 {
    let away = |axis: usize| {
        (f64::from(bounds.min[axis]) - point[axis]).max(point[axis] - f64::from(bounds.max[axis])).max(0.0)
    };
    (0..3).map(|axis| away(axis) * away(axis)).sum()
}

/// The distance of a point from a triangle, or somewhat more: that of some place of the triangle, with what rounding can have lost.
fn distance(point: Point3<f64>, triangle: &[[f32; 3]; 3]) -> f64 {
    let [a, b, c] = triangle.map(to_f64);
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (dd, de, ee) = (ab.norm_squared(), ab.dot(&ac), ac.norm_squared());
    let (d, e) = (ab.dot(&ap), ac.dot(&ap));
    // Below the triangle's inside, if it is there.
    let det = dd * ee - de * de;
    let (s, t) = ((ee * d - de * e) / det, (dd * e - de * d) / det);
    let inside = s >= 0.0 && t >= 0.0 && s + t <= 1.0;
    let along = |from: Point3<f64>, to: Point3<f64>| {
        let way = to - from;
        let share = ((point - from).dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
        // An edge without length is its end.
        (from + way * if share.is_nan() { 0.0 } else { share } - point).norm()
    };
    let nearest = match inside {
        true => (a + ab * s + ac * t - point).norm(),
        false => along(a, b).min(along(b, c)).min(along(c, a)),
    };
    let largest = [a, b, c, point].iter().fold(0.0, |most: f64, p| most.max(p.coords.amax()));
    nearest + LOST * (largest + nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Never below the truth, and hardly above it: places all over the triangle are no nearer than what is told, by more than how far they
        /// are apart.
        #[test]
        fn a_distance_is_of_a_place_of_the_triangle(
            point in prop::array::uniform3(-4.0f64..4.0),
            triangle in prop::array::uniform3(prop::array::uniform3(-2i8..3)),
            offset in 0u8..3,
        ) {
            let offset = [0.0f32, 7.0, 4096.0][usize::from(offset)];
            let triangle = triangle.map(|corner| corner.map(|x| f32::from(x) + offset));
            let point = Point3::from(point.map(|x| x + f64::from(offset)));
            let told = distance(point, &triangle);
            let [a, b, c] = triangle.map(to_f64);
            let mut least = f64::INFINITY;
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (s, t) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                    least = least.min((a + (b - a) * s + (c - a) * t - point).norm());
                }
            }
            prop_assert!(told <= least + 1e-9, "{told} {least}");
            prop_assert!(told >= least - 0.3, "{told} {least}");
        }
    }

    #[test]
    fn what_is_near_is_found_in_any_run() {
        let row = (0..100).map(|x| [[x as f32, 0.0, 0.0], [x as f32, 1.0, 0.0], [x as f32, 0.0, 1.0]]);
        let mut surface = Surface { triangles: row.collect(), ..Surface::default() };
        surface.enclose();
        let at = |x: f64, reach: f64| surface.within(Point3::new(x, 0.25, 0.25), reach);
        assert!(at(77.25, 0.3).is_some_and(|found| (0.25..0.2501).contains(&found)));
        assert_eq!(at(77.25, 0.2), None);
        assert_eq!(at(5.0, -1.0), None);
        assert!(at(5.0, 1e-6).is_some());
    }
}
