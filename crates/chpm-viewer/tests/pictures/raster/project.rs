//! From space into the image.

use chpm_refine::{Camera, View};
use chpm_viewer::ViewerError;
use nalgebra::{Point3, Vector3};

/// A corner in the image: column and row in pixels from the upper left corner, and one over depth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) at: [f64; 2],
    pub(super) near: f64,
}

/// A camera and its image.
#[derive(Clone, Debug)]
pub(super) struct Projection {
    eye: Point3<f64>,
    /// To the right, upward, forward.
    axes: [Vector3<f64>; 3],
    /// Pixels by slope.
    scale: f64,
    near: f64,
    pub(super) viewport: [u32; 2],
}

/// Depth relative to a triangle's farthest corner below which it is not drawn.
const TOUCHING: f64 = 1e-9;

/// Guard band in images: geometry farther aside is cut off, so that no coordinate is large.
const BAND: f64 = 4.0;

/// The corners of a triangle that five planes may have cut.
#[derive(Clone, Copy)]
struct Outline {
    points: [Vector3<f64>; 8],
    len: usize,
}

impl Outline {
    fn push(&mut self, point: Vector3<f64>) {
        self.points[self.len] = point;
        self.len += 1;
    }

    /// Part on the side of a plane that its normal points to.
    fn cut(self, normal: Vector3<f64>, offset: f64) -> Outline {
        let height = |point: Vector3<f64>| normal.dot(&point) - offset;
        let mut rest = Outline { len: 0, ..self };
        for i in 0..self.len {
            let (here, next) = (self.points[i], self.points[(i + 1) % self.len]);
            let (low, high) = (height(here), height(next));
            if low >= 0.0 {
                rest.push(here);
            }
            if (low >= 0.0) != (high >= 0.0) {
                rest.push(here + (next - here) * (low / (low - high)));
            }
        }
        rest
    }
}

impl Projection {
    pub(super) fn new(camera: &Camera, viewport: [u32; 2], near: f64) -> Result<Self, ViewerError> {
        // Refuses what cannot be.
        View::new(camera, viewport, 0.0)?;
        let rise = (0.5 * camera.fov.to_radians()).tan();
        Ok(Projection {
            eye: Point3::from(camera.position),
            axes: camera.axes(),
            scale: 0.5 * f64::from(viewport[1]) / rise,
            near: camera.near.max(near),
            viewport,
        })
    }

    /// A triangle's outline in the image, as far as it lies behind the near plane: no corners, or three and more.
    pub(super) fn project(&self, corners: [[f64; 3]; 3], out: &mut Vec<Corner>) {
        out.clear();
        let mut outline = Outline { points: [Vector3::zeros(); 8], len: 0 };
        for corner in corners {
            let away = Point3::from(corner) - self.eye;
            outline.push(Vector3::from(self.axes.map(|axis| axis.dot(&away))));
        }
        let farthest = outline.points[..3].iter().map(|point| point.z).fold(0.0, f64::max);
        if farthest <= self.near {
            return;
        }
        // What reaches the eye is cut where no picture shows it any more.
        let near = self.near.max(TOUCHING * farthest);
        outline = outline.cut(Vector3::z(), near);
        let [width, height] = self.viewport.map(|side| BAND * 0.5 * f64::from(side) / self.scale);
        for side in [[1.0, 0.0, width], [-1.0, 0.0, width], [0.0, 1.0, height], [0.0, -1.0, height]] {
            outline = outline.cut(Vector3::from(side), 0.0);
        }
        out.extend(outline.points[..outline.len].iter().map(|point| self.corner(*point)));
    }

    fn corner(&self, point: Vector3<f64>) -> Corner {
        let [width, height] = self.viewport.map(|side| 0.5 * f64::from(side));
        let at = [width + self.scale * point.x / point.z, height - self.scale * point.y / point.z];
        Corner { at, near: 1.0 / point.z }
    }
}
