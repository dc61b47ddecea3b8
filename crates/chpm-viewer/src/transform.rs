//! Where a model is put in a picture: a rotation, and then a translation; before them, heights may be stretched.

use crate::request::Clip;
use chpm_refine::Camera;
use nalgebra::{Matrix3, Vector3};

/// A rigid motion, from the coordinates of a model (its source's) to those of the picture. Where axes are stretched first, coordinates of
/// the file mean stretched ones in all that follows.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Transform {
    rotation: Matrix3<f64>,
    shift: Vector3<f64>,
    stretch: Vector3<f64>,
}

const IDENTITY: Matrix3<f64> = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);

impl Transform {
    /// Where its file has it.
    pub const STILL: Transform = Transform {
        rotation: IDENTITY,
        shift: Vector3::new(0.0, 0.0, 0.0),
        stretch: Vector3::new(1.0, 1.0, 1.0),
    };

    /// By the rows of a rotation, which nobody checks, and a translation.
    pub fn new(rows: [[f64; 3]; 3], shift: [f64; 3]) -> Self {
        let rotation = Matrix3::from_fn(|row, column| rows[row][column]);
        Transform { rotation, shift: shift.into(), ..Transform::STILL }
    }

    /// Where its file has it, each coordinate multiplied by a positive number.
    pub fn stretched(stretch: Vector3<f64>) -> Self {
        Transform { stretch, ..Transform::STILL }
    }

    /// Factor on each coordinate of the model.
    pub(crate) fn stretch(&self) -> Vector3<f64> {
        self.stretch
    }

    /// Whether it leaves everything where it is, to the last bit.
    pub fn is_still(&self) -> bool {
        *self == Transform::STILL
    }

    /// Where a point goes.
    pub fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        if self.is_still() { point } else { (self.way(point.into()) + self.shift).into() }
    }

    /// The way from one point of the model to another as the picture has it.
    pub(crate) fn way(&self, way: Vector3<f64>) -> Vector3<f64> {
        if self.is_still() { way } else { self.rotation * way.component_mul(&self.stretch) }
    }

    /// A direction of the picture as the model has it.
    pub(crate) fn turn_back(&self, direction: Vector3<f64>) -> Vector3<f64> {
        if self.is_still() { direction } else { self.rotation.transpose() * direction }
    }

    /// A camera of the picture in the coordinates of the model's file, which has this origin.
    pub(crate) fn camera(&self, camera: &Camera, origin: [f64; 3]) -> Camera {
        if self.is_still() {
            return camera.relative_to(origin);
        }
        // First from the file's origin, which may be as far away as the camera: less is lost.
        let near = camera.relative_to(self.apply(origin));
        let [position, target] =
            [near.position, near.target].map(|v| self.turn_back(Vector3::from(v)).into());
        // What is upward where none was told is decided in the picture, for all of its models.
        let up = self.turn_back(camera.axes()[1]).into();
        Camera { position, target, up, ..near }
    }

    /// A clipping plane of the picture in the coordinates of such a file: its normal, and its place along that.
    pub(crate) fn clip(&self, clip: &Clip, origin: [f64; 3]) -> ([f64; 3], f64) {
        (self.turn_back(clip.normal().into()).into(), clip.offset_from(self.apply(origin)))
    }

    /// The same plane in the coordinates of the model itself, which no factor stretches; none where it is none there.
    pub(crate) fn plane(&self, clip: &Clip) -> Option<Clip> {
        if self.is_still() {
            return Some(*clip);
        }
        let normal = self.turn_back(clip.normal().into()).component_mul(&self.stretch);
        Clip::new(normal.into(), clip.offset_from(self.shift.into()) / normal.norm())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_sees_the_same_from_within() {
        let (sin, cos) = 0.7_f64.sin_cos();
        let place = Transform::new([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]], [1e6, -3.0, 0.25]);
        let (origin, point) = ([4e6, 5.0, -6.0], [0.5, -0.25, 2.0]);
        let all = place.apply([0, 1, 2].map(|axis| origin[axis] + point[axis]));
        // Straight down, where the direction that was called up says nothing.
        for away in [[3.0, 4.0, 5.0], [0.0, 9.0, 0.0]] {
            let camera = Camera::looking([0, 1, 2].map(|axis| all[axis] + away[axis]), all);
            let within = place.camera(&camera, origin);
            let seen = |camera: &Camera, point: [f64; 3]| {
                let way = Vector3::from(point) - Vector3::from(camera.position);
                camera.axes().map(|axis| axis.dot(&way))
            };
            for (a, b) in seen(&camera, all).into_iter().zip(seen(&within, point)) {
                assert!((a - b).abs() < 1e-8, "{a} {b}");
            }
        }
        let clip = Clip::new([1.0, 2.0, 3.0], 7e5).unwrap();
        let (normal, offset) = place.clip(&clip, origin);
        let beyond = |normal: [f64; 3], point: [f64; 3], offset: f64| {
            Vector3::from(normal).dot(&Vector3::from(point)) - offset
        };
        let outside = beyond(clip.normal(), all, clip.offset_from([0.0; 3]));
        assert!((beyond(normal, point, offset) - outside).abs() < 1e-8);
    }

    #[test]
    fn a_plane_is_the_same_where_the_model_is_stretched() {
        let (sin, cos) = 0.7_f64.sin_cos();
        let turned = Transform::new([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]], [3.0, -4.0, 5.0]);
        let place = Transform { stretch: Vector3::new(2.0, 1.0, 0.25), ..turned };
        let clip = Clip::new([1.0, 2.0, 3.0], 7.0).unwrap();
        let own = place.plane(&clip).unwrap();
        let height = |clip: &Clip, point: [f64; 3]| {
            Vector3::from(clip.normal()).dot(&Vector3::from(point)) - clip.offset_from([0.0; 3])
        };
        // As far above the one as above the other, but for a factor.
        let points = [[0.0, 0.0, 0.0], [9.0, 1.0, -2.0], [-3.0, 40.0, 5.0]];
        let factors = points.map(|point| height(&clip, place.apply(point)) / height(&own, point));
        assert!(factors.iter().all(|x| *x > 0.0 && (x / factors[0] - 1.0).abs() < 1e-12), "{factors:?}");
        assert_eq!(Transform::STILL.plane(&clip), Some(clip));
    }

    #[test]
    fn what_stays_keeps_its_bits() {
        let camera = Camera { up: [0.0, 0.0, 3.0], ..Camera::looking([1.1, 2.2, 3.3], [0.1, 0.2, 0.3]) };
        let origin = [0.7, 0.9, 1e7];
        assert_eq!(Transform::STILL.camera(&camera, origin), camera.relative_to(origin));
        assert_eq!(Transform::STILL.apply([0.1, -0.0, 1e9]), [0.1, -0.0, 1e9]);
    }
}
