//! Frustum of a frozen camera, as lines in the image of another camera.

use chpm_refine::Camera;
use nalgebra::{Point3, Vector3};

/// A line in an image: pixels from the left and from the top.
pub type Line = [[f64; 2]; 2];

/// Points nearer than this share of the distance to the camera's focus are cut away.
const NEAR: f64 = 1e-4;

/// The eye of `seen`, the four rays through the corners of its image (`aspect` is its width by its height), and that image as far away as
/// its focus, as `by` sees them in an image of `viewport` pixels.
pub fn lines(seen: &Camera, aspect: f64, by: &Camera, viewport: [u32; 2]) -> Vec<Line> {
    let eye = Point3::from(seen.position);
    let (axes, distance) = axes(seen);
    let rise = (0.5 * seen.fov.to_radians()).tan() * distance;
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|[x, y]| eye + axes[2] * distance + axes[0] * (x * rise * aspect) + axes[1] * (y * rise));
    let sides = (0..4).map(|n| [corners[n], corners[(n + 1) % 4]]);
    let rays = corners.map(|corner| [eye, corner]);
    sides.chain(rays).filter_map(|line| project(line, by, viewport)).collect()
}

/// A line as a camera sees it, if any of it is before the camera.
pub(super) fn project(line: [Point3<f64>; 2], by: &Camera, viewport: [u32; 2]) -> Option<Line> {
    let sight = Sight::of(by, viewport);
    sight.line(line.map(|point| sight.see(point)))
}

/// How a camera sees points in an image: first relative to its axes (to the right, upward, forward), then as pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    eye: Point3<f64>,
    axes: [Vector3<f64>; 3],
    near: f64,
    middle: [f64; 2],
    scale: f64,
}

impl Sight {
    pub(super) fn of(by: &Camera, viewport: [u32; 2]) -> Self {
        let (axes, distance) = axes(by);
        let [width, height] = viewport.map(f64::from);
        let scale = 0.5 * height / (0.5 * by.fov.to_radians()).tan();
        let middle = [0.5 * width, 0.5 * height];
        Sight { eye: by.position.into(), axes, near: NEAR * distance, middle, scale }
    }

    /// A point relative to the axes.
    pub(super) fn see(&self, point: Point3<f64>) -> Vector3<f64> {
        let way = point - self.eye;
        Vector3::new(way.dot(&self.axes[0]), way.dot(&self.axes[1]), way.dot(&self.axes[2]))
    }

    /// Whether a point relative to the axes is before the camera.
    pub(super) fn is_before(&self, seen: &Vector3<f64>) -> bool {
        seen.z >= self.near
    }

    /// Where a line leaves what is before the camera.
    pub(super) fn cut(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> Vector3<f64> {
        from + (to - from) * ((self.near - from.z) / (to.z - from.z))
    }

    /// Pixels of a point that is before the camera.
    pub(super) fn pixel(&self, seen: &Vector3<f64>) -> [f64; 2] {
        [self.middle[0] + self.scale * seen.x / seen.z, self.middle[1] - self.scale * seen.y / seen.z]
    }

    /// Pixels of the part of a line that is before the camera.
    pub(super) fn line(&self, [a, b]: [Vector3<f64>; 2]) -> Option<Line> {
        let ends = match [&a, &b].map(|end| self.is_before(end)) {
            [false, false] => return None,
            [true, true] => [a, b],
            [false, true] => [self.cut(&a, &b), b],
            [true, false] => [a, self.cut(&b, &a)],
        };
        let line = ends.map(|end| self.pixel(&end));
        line.as_flattened().iter().all(|x| x.is_finite()).then_some(line)
    }
}

/// To the right, upward, forward, and the distance to the focus.
fn axes(camera: &Camera) -> ([Vector3<f64>; 3], f64) {
    let sight = Point3::from(camera.target) - Point3::from(camera.position);
    let distance = sight.norm();
    let forward = sight / distance;
    let right = forward.cross(&Vector3::from(camera.up)).normalize();
    ([right, right.cross(&forward), forward], distance)
}

/// How far along the sight of a camera a point is.
pub fn depth(camera: &Camera, point: [f64; 3]) -> f64 {
    (Point3::from(point) - Point3::from(camera.position)).dot(&axes(camera).0[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { fov: 90.0, ..Camera::looking([0.0, 0.0, 10.0], [0.0; 3]) }
    }

    #[test]
    fn what_is_seen_from_the_same_place_is_the_border_of_the_image() {
        let lines = lines(&camera(), 2.0, &camera(), [200, 100]);
        assert_eq!(lines.len(), 8);
        for [a, b] in &lines[..4] {
            for [x, y] in [a, b] {
                assert!((x % 200.0).abs() < 1e-9 && (y % 100.0).abs() < 1e-9, "{x} {y}");
            }
            let length = (a[0] - b[0]).hypot(a[1] - b[1]);
            assert!((length - 200.0).abs() < 1e-9 || (length - 100.0).abs() < 1e-9);
        }
        // The rays are points in this image: each runs from its corner to the same corner.
        assert!(lines[4..].iter().all(|[a, b]| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-6));
    }

    #[test]
    fn what_lies_behind_is_cut_away() {
        let line = [Point3::new(0.0, 0.0, 0.0), Point3::new(0.0, 5.0, 30.0)];
        let [a, b] = project(line, &camera(), [100, 100]).unwrap();
        assert_eq!(a, [50.0, 50.0]);
        assert!(b[1] < -1e3, "upward, far out of the image: {b:?}");
        let behind = [Point3::new(0.0, 0.0, 11.0), Point3::new(1.0, 5.0, 30.0)];
        assert_eq!(project(behind, &camera(), [100, 100]), None);
    }

    #[test]
    fn depth_is_along_the_sight() {
        assert!((depth(&camera(), [3.0, 4.0, 8.0]) - 2.0).abs() < 1e-12);
        assert!(depth(&camera(), [0.0, 0.0, 11.0]) < 0.0);
    }
}
