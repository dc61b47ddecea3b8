//! A coarse mesh of a model, and the camera that just sees all of it.

use super::apart::specks;
use crate::cut::Cut;
use crate::error::RefineError;
use crate::extract::extract;
use crate::view::Camera;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, Level};
use nalgebra::{Point3, Rotation3, Unit, Vector3};
use std::f64::consts::TAU;

/// The part of an image that a model may take: the slopes of the rays through its borders, left, right, below, above.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Window {
    /// Tangents of the angles from the middle of the image to the left (negative) and to the right.
    pub across: [f64; 2],
    /// Tangents of the angles down (negative) and up.
    pub along: [f64; 2],
}

impl Window {
    /// Of the image that is left free around a model, by side.
    const MARGIN: f64 = 0.04;

    /// Nearly all of an image of this width by height, seen with this vertical angle in degrees.
    pub fn of_image(aspect: f64, fov: f64) -> Self {
        let rise = (0.5 * fov.to_radians()).tan() * (1.0 - 2.0 * Self::MARGIN);
        let run = rise * aspect;
        Window { across: [-run, run], along: [-rise, rise] }
    }
}

/// A coarse mesh of a model, in file coordinates.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Outline {
    points: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// The share of the surface that is left out, since it is next to nothing and far from the rest.
    left_out: f64,
}

/// The least way from a camera to a point: far from zero, less is lost beside the coordinates, and the camera looks nowhere.
fn least_way(point: &Point3<f64>) -> f64 {
    1e-9 * point.coords.amax()
}

/// Triangles of an outline, at most, where the file has a level that coarse.
const TRIANGLES: u64 = 40_000;

impl Outline {
    /// The finest level of a file that has few enough triangles, without specks. Reads its pages.
    ///
    /// # Errors
    /// [`RefineError::Format`] for a damaged page.
    pub fn of_file<D: AsRef<[u8]>>(file: &Chpm<D>) -> Result<Self, RefineError> {
        let clusters = file.clusters();
        let top = file.header().level_count.saturating_sub(1);
        let mut cuts = (0..=top).map(|level| Cut::at_level(file, Level(level)));
        let cut = cuts
            .find(|cut| {
                cut.members()
                    .iter()
                    .map(|member| u64::from(clusters[member.cluster.index()].triangle_count))
                    .sum::<u64>()
                    <= TRIANGLES
            })
            .unwrap_or_else(|| Cut::at_level(file, Level(top)));
        let mesh = extract(file, &cut)?;
        Ok(Outline::of_mesh(&mesh.positions, &mesh.triangles).without_specks())
    }

    /// Of any mesh; triangles of points that it does not have, or that are nowhere, are left out.
    pub fn of_mesh(points: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let points: Vec<Point3<f64>> = points.iter().map(|p| Point3::from(p.map(f64::from))).collect();
        let triangles = triangles
            .iter()
            .filter(|corners| {
                corners.iter().all(|corner| {
                    points.get(*corner as usize).is_some_and(|point| point.iter().all(|x| x.is_finite()))
                })
            })
            .copied()
            .collect();
        Outline { triangles, points, left_out: 0.0 }
    }

    /// The same without what is next to nothing and far from the rest, which would move a frame and shows nothing.
    pub fn without_specks(mut self) -> Self {
        let (is_speck, share) = specks(&self.points, &self.triangles);
        let mut is_speck = is_speck.into_iter();
        self.triangles.retain(|_| !is_speck.next().unwrap_or(false));
        Outline { left_out: self.left_out.max(share), ..self }
    }

    /// The share of the surface that is left out.
    pub(super) fn left_out(&self) -> f64 {
        self.left_out
    }

    /// The same, each point where it is put.
    pub fn moved(mut self, place: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        for point in &mut self.points {
            *point = place((*point).into()).into();
        }
        self
    }

    /// Both, as one.
    pub fn joined(mut self, other: &Outline) -> Self {
        let first = self.points.len() as u32;
        self.points.extend(&other.points);
        self.triangles.extend(other.triangles.iter().map(|corners| corners.map(|corner| first + corner)));
        self.left_out = self.left_out.max(other.left_out);
        self
    }

    /// The corners of every triangle.
    pub(super) fn triangles(&self) -> impl Iterator<Item = [Point3<f64>; 3]> + '_ {
        self.triangles.iter().map(|corners| corners.map(|corner| self.points[corner as usize]))
    }

    /// The points of all triangles.
    pub(super) fn corners(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        self.triangles().flatten()
    }

    /// The box around it.
    pub(super) fn bounds(&self) -> (Point3<f64>, Vector3<f64>) {
        let (mut low, mut high) = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
        for point in self.corners() {
            low = low.inf(&point);
            high = high.sup(&point);
        }
        if low.x > high.x { (Point3::origin(), Vector3::zeros()) } else { (low, high - low) }
    }

    /// The camera nearest to the model that looks along `sight` and has all of it in a window of its image; what is in the middle
    /// of the image lies in the middle of the model's depth. `bounds` is what is looked at where there is no outline.
    pub fn fit(
        &self,
        bounds: &Aabb,
        sight: Vector3<f64>,
        up: Vector3<f64>,
        fov: f64,
        window: Window,
    ) -> Camera {
        let center = self.middle(bounds);
        let camera = Camera::whole(center, sight, up, fov);
        let [right, up, ahead] = camera.axes();
        let points = || self.seen(bounds, &camera);

        // A point is on the inner side of a border with slope s if x - c <= (z + d) s: the largest x - z s decides.
        let most = |of: &dyn Fn([f64; 3]) -> f64| points().map(of).fold(f64::NEG_INFINITY, f64::max);
        let place = |axis: usize, slopes: [f64; 2]| {
            let high = most(&|p| p[axis] - p[2] * slopes[1]);
            let low = most(&|p| p[2] * slopes[0] - p[axis]);
            (high, low, (high + low) / (slopes[1] - slopes[0]))
        };
        let (x, y) = (place(0, window.across), place(1, window.along));
        let (near, far) = (-most(&|p| -p[2]), most(&|p| p[2]));
        if !(near.is_finite() && far.is_finite()) {
            return camera;
        }

        // Never among the points, and not at the one point that there may be. Borders lean, so that what they enclose tells no size.
        let extent = |axis: usize| most(&|p| p[axis]) + most(&|p| -p[axis]);
        let size = (0..3).map(extent).fold(0.0, f64::max);
        let size = if size > 0.0 { size } else { 1.0 }.max(least_way(&center));
        let away = x.2.max(y.2).max(0.1 * size - near);
        let middle = |(high, low, _): (f64, f64, f64), slopes: [f64; 2]| {
            0.5 * (high - low - away * (slopes[0] + slopes[1]))
        };
        let eye = center + right * middle(x, window.across) + up * middle(y, window.along) - ahead * away;
        let target = eye + ahead * (away + 0.5 * (near + far));
        Camera { position: eye.into(), target: target.into(), ..camera }
    }

    /// All points; without triangles, the corners of the box.
    pub(super) fn framed<'a>(&'a self, bounds: &'a Aabb) -> impl Iterator<Item = Point3<f64>> + use<'a> {
        let is_box = self.triangles.is_empty() && !bounds.is_empty();
        self.corners().chain(is_box.then(|| bounds.corners()).into_iter().flatten())
    }

    /// The middle of all that is framed.
    fn middle(&self, bounds: &Aabb) -> Point3<f64> {
        let (low, size) = self.bounds();
        if self.triangles.is_empty() { bounds.center() } else { low + 0.5 * size }
    }

    /// The same points as a camera sees them that looks at the middle of the model: right, up and ahead of it.
    fn seen<'a>(&'a self, bounds: &'a Aabb, camera: &Camera) -> impl Iterator<Item = [f64; 3]> + use<'a> {
        let (axes, center) = (camera.axes(), Point3::from(camera.target));
        self.framed(bounds).map(move |point| axes.map(|axis| (point - center).dot(&axis)))
    }

    /// The least distance from which a camera that looks at the middle of the model has all of it in a window around its image's middle.
    fn away(&self, bounds: &Aabb, camera: &Camera, window: Window) -> f64 {
        let (run, rise) = (window.across[1], window.along[1]);
        let points = self.seen(bounds, camera);
        points.map(|[x, y, z]| (x.abs() / run).max(y.abs() / rise) - z).fold(0.0, f64::max)
    }

    /// So many cameras around a model, the first of them looking along `sight` and each one further to the right: all look at one point
    /// from one distance, at which each has all of the model in the middle of its window.
    pub fn turn(
        &self,
        bounds: &Aabb,
        sight: Vector3<f64>,
        up: Vector3<f64>,
        fov: f64,
        window: Window,
        count: u32,
    ) -> Vec<Camera> {
        let center = self.middle(bounds);
        let sights = (0..count).map(move |n| {
            let angle = TAU * f64::from(n) / f64::from(count.max(1));
            Rotation3::from_axis_angle(&Unit::new_normalize(up), angle) * sight
        });
        let cameras: Vec<Camera> = sights.map(|sight| Camera::whole(center, sight, up, fov)).collect();
        let away = cameras.iter().map(|camera| self.away(bounds, camera, window)).fold(0.0, f64::max);
        let away = if away > 0.0 { away } else { 1.0 }.max(least_way(&center));
        cameras
            .into_iter()
            .map(|camera| {
                let [_, _, ahead] = camera.axes();
                Camera { position: (center - ahead * away).into(), ..camera }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: Aabb = Aabb { min: [-1.0, -2.0, -3.0], max: [1.0, 2.0, 3.0] };

    /// Where the points of a model are in the image, from -1 to 1 across the window.
    fn extent(points: &[[f32; 3]], camera: &Camera, window: Window) -> [f64; 4] {
        let [right, up, ahead] = camera.axes();
        let mut extent = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        for point in points {
            let way = Point3::from(point.map(f64::from)) - Point3::from(camera.position);
            let (x, y) = (way.dot(&right) / way.dot(&ahead), way.dot(&up) / way.dot(&ahead));
            assert!(way.dot(&ahead) > 0.0);
            let share = |x: f64, [low, high]: [f64; 2]| 2.0 * (x - low) / (high - low) - 1.0;
            let (x, y) = (share(x, window.across), share(y, window.along));
            extent = [extent[0].min(x), extent[1].max(x), extent[2].min(y), extent[3].max(y)];
        }
        extent
    }

    /// However small a model is beside how far it is, cameras look at something.
    #[test]
    fn cameras_are_apart_from_what_they_look_at() {
        let far = [[1e20, 0.0, 0.0], [1e20, 1e-20, 0.0], [1e20, 0.0, 1e-20]];
        for points in [far, [[1e20; 3]; 3]] {
            let outline = Outline::of_mesh(&points, &[[0, 1, 2]]);
            let (bounds, window) = (Aabb::of_points(&points), Window::of_image(1.0, 45.0));
            let (sight, up) = (Vector3::new(-1.0, 0.0, 0.0), Vector3::y());
            let turned = outline.turn(&bounds, sight, up, 45.0, window, 4);
            for camera in turned.into_iter().chain([outline.fit(&bounds, sight, up, 45.0, window)]) {
                assert!(camera.axes().iter().flatten().all(|x| x.is_finite()), "{camera:?}");
                assert_ne!(camera.position, camera.target);
            }
        }
    }

    /// Whatever the shape and the direction, the model touches the window from within, in its middle.
    #[test]
    fn a_model_just_fits_its_window() {
        let tetrahedron = [[0.0, 0.0, 0.0], [3.0, 0.1, 0.2], [0.3, 4.0, -0.4], [0.2, 0.5, 1.0]];
        let needle = [[0.0; 3], [1e-3, 0.0, 0.0], [0.0, 0.0, 100.0], [1e-3, 1e-3, 100.0]];
        for points in [tetrahedron, needle] {
            let outline = Outline::of_mesh(&points, &[[0, 1, 2], [0, 1, 3]]);
            let bounds = Aabb::of_points(&points);
            for sight in [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.3, -0.8, 0.2]] {
                for window in
                    [Window::of_image(1.5, 45.0), Window { across: [-0.1, 0.5], along: [-0.4, 0.4] }]
                {
                    let (sight, up) = (Vector3::from(sight).normalize(), Vector3::y());
                    let camera = outline.fit(&bounds, sight, up, 45.0, window);
                    let [left, right, low, high] = extent(&points, &camera, window);
                    let most = [-left, right, -low, high].into_iter().fold(0.0, f64::max);
                    assert!(most < 1.0 + 1e-9, "{most}");
                    // From a tip the camera keeps away.
                    assert!(most > 0.95 || points == needle, "{most}");
                    let is_across = (sight.y.abs() + sight.z.abs()) < 1e-9;
                    assert!(most > 1.0 - 1e-9 || !is_across, "{most}");
                }
            }
        }
    }

    /// However wide or high a window is, the camera comes as near.
    #[test]
    fn a_model_fills_windows_of_any_shape() {
        let corners = BOX.corners().map(|corner| corner.map(|x| x as f32).into());
        let outline = Outline::of_mesh(&corners, &[[0, 1, 2], [3, 4, 5], [5, 6, 7]]);
        for (across, along) in [(50.0, 1.0), (1000.0, 0.4), (0.4, 1000.0), (0.4, 8e-3)] {
            let window = Window { across: [-across, across], along: [-along, along] };
            let camera = outline.fit(&BOX, -Vector3::z(), Vector3::y(), 45.0, window);
            let reached = extent(&corners, &camera, window);
            let most = reached.into_iter().map(f64::abs).fold(0.0, f64::max);
            assert!((most - 1.0).abs() < 1e-9, "{across} by {along}: {reached:?}");
        }
    }

    /// From every side, from one distance, and from one of them as near as it can.
    #[test]
    fn a_model_turns_within_its_window() {
        let points = [[0.0, 0.0, 0.0], [3.0, 0.1, 0.2], [0.3, 4.0, -0.4], [0.2, 0.5, 1.0]];
        let outline = Outline::of_mesh(&points, &[[0, 1, 2], [0, 1, 3]]);
        let (bounds, window) = (Aabb::of_points(&points), Window::of_image(0.7, 45.0));
        let cameras = outline.turn(&bounds, -Vector3::z(), Vector3::y(), 45.0, window, 12);
        let away = |camera: &Camera| (Point3::from(camera.position) - bounds.center()).norm();
        assert!(
            cameras.len() == 12
                && cameras.iter().all(|camera| (away(camera) - away(&cameras[0])).abs() < 1e-9)
        );
        let most = cameras.iter().map(|camera| {
            let [left, right, low, high] = extent(&points, camera, window);
            [-left, right, -low, high].into_iter().fold(0.0, f64::max)
        });
        let most = most.fold(0.0, f64::max);
        assert!((most - 1.0).abs() < 1e-9, "{most}");
        // A quarter to the right: from the front to the right side.
        let sight = cameras[3].axes()[2];
        assert!((sight + Vector3::x()).norm() < 1e-9, "{sight}");
    }

    #[test]
    fn a_point_and_nothing_have_a_camera_too() {
        let window = Window::of_image(1.0, 45.0);
        for bounds in [Aabb::of_points(&[[5.0; 3]]), Aabb::EMPTY, BOX] {
            let camera = Outline::default().fit(&bounds, -Vector3::z(), Vector3::y(), 45.0, window);
            let numbers = [camera.position, camera.target];
            assert!(numbers.as_flattened().iter().all(|x| x.is_finite()) && camera.position != camera.target);
        }
        let outline = Outline::of_mesh(&[[0.0; 3], [f32::NAN; 3]], &[[0, 0, 1], [0, 0, 9]]);
        assert_eq!(outline.corners().count(), 0);
    }
}
