//! Surface at a pixel, refined there to the source's own triangles: for measuring.

use super::Viewer;
use super::model::Model;
use crate::error::ViewerError;
use crate::headless::TriangleId;
use crate::request::{Accuracy, FrameRequest};
use chpm_refine::{Camera, Member};
use nalgebra::{Point3, Vector3};

/// A point on what is drawn, and how far that is from the source at most.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Spot {
    /// In the picture's coordinates.
    pub point: [f64; 3],
    /// In its units.
    pub error: f64,
}

/// Half of the last digit of a single, as a share of its value, in each of three coordinates.
const ROUNDED: f64 = 1.04e-7;

impl Viewer {
    /// The point of the models that a pixel of a frame shows, as fine as budgets and the file allow, whatever that frame is drawn with; `None`
    /// where nothing is. What was drawn last is gone: the next frame is drawn anew.
    ///
    /// # Errors
    /// As [`Viewer::frame`].
    pub fn exact(&mut self, request: &FrameRequest, pixel: [u32; 2]) -> Result<Option<Spot>, ViewerError> {
        let camera = through(&request.camera, pixel, request.viewport);
        let narrow = FrameRequest {
            camera,
            viewport: [1; 2],
            accuracy: Accuracy::PoE(0.0),
            frustum_culling: true,
            occlusion_culling: true,
            select_from: None,
            wait: true,
            samples: 1,
            kept: false,
            ..*request
        };
        let (ids, _) = self.ids(&narrow)?;
        let Some(seen) = ids.pixels.first().copied().flatten() else { return Ok(None) };
        let (Some(picked), Some((member, _))) =
            (self.pick([0; 2])?, self.drawn(seen.model as usize, seen.cluster))
        else {
            return Ok(None);
        };
        let model = &self.models[seen.model as usize];
        let way = Vector3::from(camera.target) - Vector3::from(camera.position);
        let met = model.met(&seen, member, Point3::from(camera.position), way);
        let point = met.unwrap_or(picked);
        // Of a coarser triangle, the picture knows where it is to a part of a pixel.
        let away = (Point3::from(picked) - Point3::from(camera.position)).norm();
        let seen = if met.is_some() { 0.0 } else { away * camera.fov.to_radians() };
        Ok(model.differs(member).map(|error| Spot { point, error: error + seen }))
    }
}

/// The camera whose whole image is one pixel of another one's.
fn through(camera: &Camera, pixel: [u32; 2], viewport: [u32; 2]) -> Camera {
    let [right, up, forward] = camera.axes();
    let [width, height] = viewport.map(f64::from);
    let slope = (0.5 * camera.fov.to_radians()).tan() / height;
    let [x, y] = [0, 1].map(|axis| 2.0 * (f64::from(pixel[axis]) + 0.5));
    let way = forward + right * ((x - width) * slope) - up * ((y - height) * slope);
    let distance = (Point3::from(camera.target) - Point3::from(camera.position)).norm();
    let target = Point3::from(camera.position) + way * distance;
    Camera { target: target.into(), up: up.into(), fov: 2.0 * slope.atan().to_degrees(), ..*camera }
}

impl Model {
    /// How far a cluster as it is drawn is from the source at most, as the file tells it of this cluster: by its own error, and by what has
    /// vanished where something has.
    fn differs(&self, member: Member) -> Option<f64> {
        let file = self.scene.file();
        let record = &file.clusters()[member.cluster.index()];
        let error = self.scene.page(member.cluster)?.page().error_at(member.vertices as usize);
        let is_source = record.is_leaf() && !record.is_trimmed() && member.vertices == record.vertex_count;
        let told =
            if is_source || !file.has_gaps() { error } else { file.gaps(record.group()).distance(error) };
        let header = file.header();
        let largest =
            header.aabb_min.iter().chain(&header.aabb_max).fold(0.0, |most: f32, x| most.max(x.abs()));
        let step = file.metadata().ok().and_then(|it| it.lattice_step().ok().flatten()).unwrap_or(0.0);
        Some(f64::from(told) + (ROUNDED * f64::from(largest)).max(0.87 * step))
    }

    /// Where a way from the eye, in the picture, meets a triangle that is drawn as its page has it.
    fn met(
        &self,
        seen: &TriangleId,
        member: Member,
        eye: Point3<f64>,
        way: Vector3<f64>,
    ) -> Option<[f64; 3]> {
        let page = self.scene.page(seen.cluster)?;
        let page = page.page();
        let corners = page.triangles.get(seen.triangle as usize)?;
        if corners.iter().any(|corner| u32::from(*corner) >= member.vertices) {
            return None;
        }
        let zero = Point3::from(self.zero()) - eye;
        let from_eye = corners.map(|corner| {
            let position = page.positions[usize::from(corner)].map(f64::from);
            self.place.way(position.into()) + zero
        });
        let [a, b, c] = from_eye;
        // Shares of the corners; one that is seen from beside is met at its edge.
        let shares = Vector3::new(way.dot(&b.cross(&c)), way.dot(&c.cross(&a)), way.dot(&a.cross(&b)));
        let shares = (shares / shares.sum()).map(|share| share.max(0.0));
        let at = (a * shares.x + b * shares.y + c * shares.z) / shares.sum();
        at.iter().all(|x| x.is_finite()).then(|| (eye + at).into())
    }
}
