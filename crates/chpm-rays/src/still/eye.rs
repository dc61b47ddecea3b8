//! Where a picture is taken from: rays of its pixels, in the picture's coordinates, which are those of the file with each axis stretched.

use crate::bound::Bound;
use crate::ray::Ray;
use chpm_mesh::Aabb;
use chpm_refine::{Camera, RefineError, View};
use nalgebra::Vector3;

pub(super) type Vector = Vector3<f64>;

/// A camera and its image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Eye {
    pub(super) at: Vector,
    axes: [Vector; 3],
    /// Half of the image at distance 1, right and up.
    half: [f64; 2],
    size: [u32; 2],
    /// The error that is allowed at distance 1; none where the leaves are asked for.
    slope: Option<f64>,
    stretch: Vector,
    /// Beyond this plane nothing is seen, and nothing throws shadows.
    clip: Option<(Vector, f64)>,
}

impl Eye {
    pub(super) fn new(
        camera: &Camera,
        size: [u32; 2],
        poe: f64,
        stretch: [f64; 3],
        clip: Option<([f64; 3], f64)>,
    ) -> Result<Self, RefineError> {
        View::new(camera, size, poe)?;
        let up = (0.5 * camera.fov.to_radians()).tan();
        // Errors say nothing of what is stretched.
        let is_exact = poe == 0.0 || stretch != [1.0; 3];
        Ok(Eye {
            at: camera.position.into(),
            axes: camera.axes(),
            half: [up * f64::from(size[0]) / f64::from(size[1]), up],
            size,
            slope: (!is_exact).then(|| poe * 2.0 * up / f64::from(size[1])),
            stretch: stretch.into(),
            clip: clip.map(|(normal, offset)| (normal.into(), offset)),
        })
    }

    /// The error that is allowed from place to place: what covers the allowed pixels, as pictures of the GPU have it.
    pub(super) fn bound(&self) -> Bound {
        self.slope.map_or(Bound::LEAVES, |slope| Bound::from_eye(self.at.into(), slope))
    }

    /// The direction, of length 1, that is seen in the middle of a pixel of an image that is moved right and up, in pixels.
    pub(super) fn sight(&self, pixel: u64, shift: [f64; 2]) -> Vector {
        let [width, height] = self.size.map(u64::from);
        let right = (pixel % width) as f64 + 0.5 - shift[0];
        let down = (pixel / width) as f64 + 0.5 + shift[1];
        let across = (2.0 * right / width as f64 - 1.0) * self.half[0];
        let above = (1.0 - 2.0 * down / height as f64) * self.half[1];
        (self.axes[2] + self.axes[0] * across + self.axes[1] * above).normalize()
    }

    /// The direction of a light, by its degrees to the right of the eye and above it.
    pub(super) fn light(&self, light: [f64; 2]) -> Vector {
        let [right, up, forward] = self.axes;
        let [(aside, toward), (above, level)] = light.map(|angle| angle.to_radians().sin_cos());
        (right * aside - forward * toward) * level + up * above
    }

    /// The camera's own upward direction.
    pub(super) fn up(&self) -> Vector {
        self.axes[1]
    }

    /// A ray of the file from a point of the picture in a direction of length 1, but for what is clipped; none where all of it is.
    pub(super) fn ray(&self, from: Vector, way: Vector, reach: f64) -> Option<Ray> {
        let (mut begin, mut end) = (0.0, reach);
        if let Some((normal, offset)) = self.clip {
            let (beyond, slope) = (normal.dot(&from) - offset, normal.dot(&way));
            if slope > 0.0 {
                end = f64::min(end, -beyond / slope);
            } else if slope < 0.0 {
                begin = f64::max(begin, -beyond / slope);
            } else if beyond > 0.0 {
                return None;
            }
            if begin > end {
                return None;
            }
        }
        let own = way.component_div(&self.stretch);
        let origin = (from + way * begin).component_div(&self.stretch);
        Some(Ray { reach: (end - begin) * own.norm(), ..Ray::new(origin.into(), own.into()) })
    }

    /// A point of the file in the picture.
    pub(super) fn point(&self, point: [f64; 3]) -> Vector {
        Vector::from(point).component_mul(&self.stretch)
    }

    /// How wide a ray is at a point of the file, in its units: as a pixel there that faces the eye.
    pub(super) fn width(&self, point: [f64; 3]) -> f64 {
        let pixel = 2.0 * self.half[1] / f64::from(self.size[1]);
        (self.point(point) - self.at).norm() * pixel / self.stretch.amax()
    }

    /// A normal of the file in the picture; zero stays zero.
    pub(super) fn normal(&self, normal: [f64; 3]) -> Vector {
        let normal = Vector::from(normal).component_div(&self.stretch);
        normal.try_normalize(0.0).unwrap_or(normal)
    }

    /// A direction along a surface of the file in the picture.
    pub(super) fn line(&self, line: [f64; 3]) -> Vector {
        let line = Vector::from(line).component_mul(&self.stretch);
        line.try_normalize(0.0).unwrap_or(line)
    }

    /// The most that a ray from a point that is seen may be allowed, so that its shadow is right where it falls: no more than the eye allows there. A ray all of which is nearer to the eye meets
    /// nothing that is allowed more, and needs no limit.
    pub(super) fn cap(&self, from: Vector, way: Vector, bounds: &Aabb) -> f64 {
        let Some(slope) = self.slope else { return f64::INFINITY };
        let away = (from - self.at).norm();
        let mut leave = f64::INFINITY;
        for axis in 0..3 {
            let side = f64::from(if way[axis] > 0.0 { bounds.max[axis] } else { bounds.min[axis] });
            if way[axis] != 0.0 {
                leave = leave.min(((side - from[axis]) / way[axis]).max(0.0));
            }
        }
        // Distance from the eye is convex along the ray: it is largest at an end.
        let is_nearer = (from + way * leave - self.at).norm() <= away;
        if is_nearer { f64::INFINITY } else { slope * away }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eye(clip: Option<([f64; 3], f64)>, stretch: [f64; 3]) -> Eye {
        let camera = Camera::looking([0.0, 0.0, 10.0], [0.0; 3]);
        Eye::new(&camera, [200, 100], 2.0, stretch, clip).unwrap()
    }

    #[test]
    fn pixels_are_seen_where_they_are() {
        let eye = eye(None, [1.0; 3]);
        let edge = (22.5_f64.to_radians()).tan();
        let corner = eye.sight(0, [0.5, -0.5]);
        let expected = Vector::new(-2.0 * edge, edge, -1.0).normalize();
        assert!((corner - expected).norm() < 1e-12);
        let middle = eye.sight(50 * 200 + 100, [0.5, -0.5]);
        assert!((middle - Vector::new(0.0, 0.0, -1.0)).norm() < 1e-12);
    }

    #[test]
    fn what_is_clipped_is_no_part_of_a_ray() {
        let eye = eye(Some(([0.0, 0.0, 1.0], 3.0)), [1.0; 3]);
        let down = eye.ray(Vector::new(0.0, 0.0, 10.0), -Vector::z(), f64::INFINITY).unwrap();
        assert_eq!((down.origin, down.reach), ([0.0, 0.0, 3.0], f64::INFINITY));
        let up = eye.ray(Vector::zeros(), Vector::z(), f64::INFINITY).unwrap();
        assert_eq!((up.origin, up.reach), ([0.0; 3], 3.0));
        assert!(eye.ray(Vector::new(0.0, 0.0, 5.0), Vector::x(), 9.0).is_none());
        assert!(eye.ray(Vector::new(0.0, 0.0, 5.0), -Vector::z(), 1.0).is_none());
    }

    #[test]
    fn a_stretched_file_is_met_in_its_own_coordinates() {
        let eye = eye(None, [1.0, 1.0, 0.5]);
        assert_eq!(eye.bound(), Bound::LEAVES);
        let ray = eye.ray(Vector::new(0.0, 0.0, 10.0), -Vector::z(), 4.0).unwrap();
        assert_eq!((ray.origin, ray.reach), ([0.0, 0.0, 20.0], 8.0));
        assert_eq!(eye.point([1.0, 2.0, 4.0]), Vector::new(1.0, 2.0, 2.0));
        assert!((eye.normal([0.6, 0.0, 0.8]) - Vector::new(0.6, 0.0, 1.6).normalize()).norm() < 1e-12);
    }

    #[test]
    fn rays_toward_the_eye_need_no_limit() {
        let eye = eye(None, [1.0; 3]);
        let bounds = Aabb { min: [-1.0; 3], max: [1.0; 3] };
        let from = Vector::new(0.5, 0.0, 0.0);
        assert_eq!(eye.cap(from, Vector::z(), &bounds), f64::INFINITY);
        let away = eye.cap(from, -Vector::z(), &bounds);
        assert!((away - eye.slope.unwrap() * (100.25_f64).sqrt()).abs() < 1e-12);
    }
}
