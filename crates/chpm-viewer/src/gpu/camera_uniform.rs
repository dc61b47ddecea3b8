//! A camera as shaders have it.

use crate::request::{FrameRequest, Look};
use crate::transform::Transform;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::Aabb;
use chpm_refine::Camera;
use nalgebra::{Point3, Vector3};

/// The uniform that all shaders share, and how they look through it.
pub const WGSL: &str = include_str!("../shaders/camera_uniform.wgsl");

/// The uniform; see `camera_uniform.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    eye_high: [f32; 4],
    eye_low: [f32; 4],
    right: [f32; 4],
    up: [f32; 4],
    forward: [f32; 4],
    light: [f32; 4],
    size: [f32; 4],
    sky: [f32; 4],
    look: [u32; 4],
    clip: [f32; 4],
    stretch: [f32; 4],
}

/// A camera and its image. Depth is reversed and the far plane infinitely far: near / distance, which a float keeps to the same
/// relative precision everywhere.
#[derive(Clone, Copy, Debug)]
pub struct CameraUniform {
    eye: Point3<f64>,
    /// To the right, upward, forward.
    axes: [Vector3<f64>; 3],
    /// Tangents of half the angles across and up.
    slopes: [f64; 2],
    near: f64,
    viewport: [u32; 2],
    /// How far all of the image is moved, right and up, pixels.
    shift: [f64; 2],
    /// Upward direction of the model, and how far above the eye (below: negative) its lowest corner is along that.
    sky: (Vector3<f64>, f64),
    diagonal: f64,
    /// How far the farthest corner of the model is from the eye.
    reach: f64,
    /// Where the key light is, degrees to the right of the eye and above it.
    light: [f64; 2],
    /// The plane beyond which nothing is drawn, if that is asked for: its normal, and its place relative to the eye.
    clip: (Vector3<f64>, f64),
    /// Factor on coordinates of the file; those of the camera uniform have it already.
    stretch: Vector3<f64>,
}

impl CameraUniform {
    /// Nearest distance that is drawn for a camera without a near plane, relative to the diagonal of the model.
    const NEAR: f64 = 1e-6;

    /// A camera in file coordinates that a view can be made of.
    pub fn new(camera: &Camera, viewport: [u32; 2], bounds: &Aabb) -> Self {
        let rise = (0.5 * camera.fov.to_radians()).tan();
        let diagonal = Some(bounds.diagonal()).filter(|diagonal| *diagonal > 0.0).unwrap_or(1.0);
        CameraUniform {
            eye: Point3::from(camera.position),
            axes: camera.axes(),
            slopes: [rise * f64::from(viewport[0]) / f64::from(viewport[1]), rise],
            near: camera.near.max(Self::NEAR * diagonal),
            viewport,
            shift: [0.0; 2],
            sky: sky(camera, bounds),
            diagonal,
            reach: bounds
                .corners()
                .map(|corner| (corner - Point3::from(camera.position)).norm())
                .into_iter()
                .fold(0.0, f64::max),
            light: Look::LIGHT,
            clip: (Vector3::zeros(), 1.0),
            stretch: Vector3::from([1.0; 3]),
        }
    }

    /// The same with the light and the clipping plane of a request; `origin` is that of the file.
    pub fn of_request(self, request: &FrameRequest, origin: [f64; 3]) -> Self {
        let clip = request.clip.map(|clip| {
            let normal = Vector3::from(clip.normal());
            // What lies in the plane is kept, although singles of points between corners lie on either side.
            let margin = 8.0 * f64::from(f32::EPSILON) * self.reach;
            (normal, clip.offset_from(origin) - normal.dot(&self.eye.coords) + margin)
        });
        CameraUniform { light: request.look.light, clip: clip.unwrap_or(self.clip), ..self }
    }

    /// The same with nothing nearer than this drawn.
    pub fn with_near(self, near: f64) -> Self {
        CameraUniform { near, ..self }
    }

    /// The nearest distance that is drawn.
    pub fn near(&self) -> f64 {
        self.near
    }

    /// The same camera as a model has it that was put somewhere, in the coordinates of its file.
    pub fn within(self, place: &Transform, camera: &Camera) -> Self {
        CameraUniform {
            eye: Point3::from(camera.position),
            axes: self.axes.map(|axis| place.turn_back(axis)),
            // How far above the eye the ground is, and where the plane is, are the same from wherever.
            sky: (place.turn_back(self.sky.0), self.sky.1),
            clip: (place.turn_back(self.clip.0), self.clip.1),
            stretch: place.stretch(),
            ..self
        }
    }

    /// The same with its image moved by a part of a pixel, right and up.
    pub fn shifted(self, shift: [f64; 2]) -> Self {
        CameraUniform { shift, ..self }
    }

    /// The uniform, with how it looks (see `camera_uniform.wgsl`).
    pub fn uniform(&self, look: [u32; 4]) -> FrameUniform {
        let eye = Point3::from(self.eye.coords.component_div(&self.stretch));
        let high = eye.map(|x| x as f32);
        let low = eye - high.map(f64::from);
        let [right, up, forward] = self.axes;
        let light = self.toward_light();
        // Moved by what grows with the distance, so that it is the same everywhere in the image.
        let across = [0, 1].map(|axis| 2.0 * self.shift[axis] / f64::from(self.viewport[axis]));
        fn four(v: Vector3<f64>, w: f64) -> [f32; 4] {
            [v.x as f32, v.y as f32, v.z as f32, w as f32]
        }
        FrameUniform {
            eye_high: [high.x, high.y, high.z, 0.0],
            eye_low: four(low, 0.0),
            right: four(right / self.slopes[0] + forward * across[0], 0.0),
            up: four(up / self.slopes[1] + forward * across[1], 0.0),
            forward: four(forward, self.near),
            light: four(light, 0.0),
            size: [
                self.viewport[0] as f32,
                self.viewport[1] as f32,
                self.diagonal as f32,
                self.shift[0] as f32,
            ],
            sky: four(self.sky.0, self.sky.1),
            look,
            clip: four(self.clip.0, self.clip.1),
            stretch: four(self.stretch, 0.0),
        }
    }

    /// Axes of the key light: to the right and upward across it, and toward it. Those of a model that was put somewhere are the same in the
    /// picture.
    pub fn light_axes(&self) -> [Vector3<f64>; 3] {
        let [right, up, _] = self.axes;
        let light = self.toward_light();
        let across = right - light * light.dot(&right);
        // A light from the side has the image's height across it.
        let across = if across.norm() > 0.1 { across } else { up - light * light.dot(&up) }.normalize();
        [across, light.cross(&across), light]
    }

    fn toward_light(&self) -> Vector3<f64> {
        let [right, up, forward] = self.axes;
        let [(aside, toward), (above, level)] = self.light.map(|angle| angle.to_radians().sin_cos());
        (right * aside - forward * toward) * level + up * above
    }

    /// The uniform of a map of shadows, which is seen by these rows: right, up, toward the light, each with what is added.
    pub fn cast(&self, [right, up, forward]: [[f32; 4]; 3]) -> FrameUniform {
        FrameUniform { right, up, forward, ..self.uniform([0; 4]) }
    }

    /// The eye.
    pub fn eye(&self) -> Point3<f64> {
        self.eye
    }

    /// To the right, upward, forward.
    pub fn axes(&self) -> &[Vector3<f64>; 3] {
        &self.axes
    }

    /// Tangents of half the angles across and up.
    pub fn slopes(&self) -> [f64; 2] {
        self.slopes
    }

    /// Factor on coordinates of the file.
    pub fn stretch(&self) -> Vector3<f64> {
        self.stretch
    }

    /// The point at the middle of a pixel with this depth; `None` for the background.
    pub fn point(&self, pixel: [u32; 2], depth: f32) -> Option<[f64; 3]> {
        fn across(axis: usize, pixel: &[u32; 2], viewport: &[u32; 2]) -> f64 {
            2.0 * (f64::from(pixel[axis]) + 0.5) / f64::from(viewport[axis]) - 1.0
        }
        let [right, up, forward] = self.axes;
        let ray = forward + right * (across(0, &pixel, &self.viewport) * self.slopes[0])
            - up * (across(1, &pixel, &self.viewport) * self.slopes[1]);
        (depth > 0.0).then(|| (self.eye + ray * (self.near / f64::from(depth))).into())
    }

    /// Width and height.
    pub fn viewport(&self) -> [u32; 2] {
        self.viewport
    }
}

/// Upward direction, and the ground's height above the eye.
fn sky(camera: &Camera, bounds: &Aabb) -> (Vector3<f64>, f64) {
    let up = Vector3::from(camera.up);
    let up = if up.norm() > 0.0 { up.normalize() } else { camera.axes()[1] };
    let lowest = [0, 1, 2]
        .map(|axis| up[axis] * f64::from(if up[axis] > 0.0 { bounds.min[axis] } else { bounds.max[axis] }));
    let ground = if bounds.is_empty() { 0.0 } else { lowest.into_iter().sum() };
    (up, ground - up.dot(&Vector3::from(camera.position)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_projected_comes_back() {
        let bounds = Aabb { min: [-1.0; 3], max: [1.0; 3] };
        let camera = Camera::looking([3.0, 2.0, 5.0], [0.1, 0.2, 0.3]);
        let camera_uniform = CameraUniform::new(&camera, [200, 100], &bounds);
        let uniform = camera_uniform.uniform([0; 4]);
        for point in [[0.0, 0.0, 0.0], [0.5, -0.5, 0.25], [-0.9, 0.1, 0.0]] {
            let at = Point3::from(point) - camera_uniform.eye;
            let dot = |v: [f32; 4]| at.x * f64::from(v[0]) + at.y * f64::from(v[1]) + at.z * f64::from(v[2]);
            let w = dot(uniform.forward);
            let x = (0.5 * dot(uniform.right) / w + 0.5) * 200.0;
            let y = (0.5 - 0.5 * dot(uniform.up) / w) * 100.0;
            let depth = f64::from(uniform.forward[3]) / w;
            let back = camera_uniform.point([x as u32, y as u32], depth as f32).unwrap();
            let off = (Point3::from(back) - Point3::from(point)).norm();
            // Half a pixel's diagonal at that distance.
            assert!(off < 0.75 * w * 2.0 * camera_uniform.slopes[1] / 100.0, "{point:?} {back:?}");
        }
        assert_eq!(camera_uniform.point([0, 0], 0.0), None);
    }

    #[test]
    fn a_shift_moves_everything_alike() {
        let bounds = Aabb { min: [-1.0; 3], max: [1.0; 3] };
        let camera_uniform =
            CameraUniform::new(&Camera::looking([3.0, 2.0, 5.0], [0.0; 3]), [200, 100], &bounds);
        let (still, moved) =
            (camera_uniform.uniform([0; 4]), camera_uniform.shifted([0.25, -0.5]).uniform([0; 4]));
        for point in [[0.0, 0.0, 0.0], [0.5, -0.5, 0.25], [-90.0, 3.0, -70.0]] {
            let at = Point3::from(point) - camera_uniform.eye;
            let dot = |v: [f32; 4]| at.x * f64::from(v[0]) + at.y * f64::from(v[1]) + at.z * f64::from(v[2]);
            let image = |of: &FrameUniform| [dot(of.right), dot(of.up)].map(|x| x / dot(of.forward));
            let (from, to) = (image(&still), image(&moved));
            assert!(
                ((to[0] - from[0]) * 100.0 - 0.25).abs() < 1e-3
                    && ((to[1] - from[1]) * 50.0 + 0.5).abs() < 1e-3
            );
        }
    }

    #[test]
    fn the_eye_keeps_more_than_a_float() {
        let camera = Camera::looking([1e7 + 0.123456, 0.0, 0.0], [0.0; 3]);
        let uniform = CameraUniform::new(&camera, [1, 1], &Aabb::of_points(&[[0.0; 3]])).uniform([0; 4]);
        let x = f64::from(uniform.eye_high[0]) + f64::from(uniform.eye_low[0]);
        assert!((x - camera.position[0]).abs() < 1e-7);
    }
}
