//! Camera, and the error that it allows where.
//!
//! Quick-VDR 2: the error-bound of a cluster is the largest deviation, in object units, that covers at most the allowed pixels at
//! the cluster's nearest point to the viewer. A pixel is the angle of one in the middle of the image; perspective stretches what is
//! near the corners. So the bound depends on where the camera stands and not on where it looks, and turning it changes no mesh.

use crate::error::RefineError;
use chpm_mesh::{Aabb, Sphere, geom};
use nalgebra::{Point3, Vector3};

/// Where a picture is taken from. Coordinates are the source's, or relative to the origin of a file: see [`Camera::relative_to`].
///
/// ```
/// use chpm_mesh::Aabb;
/// use chpm_refine::Camera;
///
/// let bounds = Aabb::of_points(&[[0.0; 3], [2.0, 2.0, 2.0]]);
/// assert_eq!(Camera::framing(&bounds).target, [1.0; 3]);
/// ```
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Camera {
    /// The viewer.
    pub position: [f64; 3],
    /// Point in the middle of the image; any other than the position.
    pub target: [f64; 3],
    /// Roughly upward in the image. Along the line of sight, or zero, any direction across it serves.
    pub up: [f64; 3],
    /// Angle between the lower and the upper edge of the image, degrees.
    pub fov: f64,
    /// Nothing nearer than this is drawn, object units; 0 draws everything.
    pub near: f64,
}

impl Camera {
    /// The vertical field of view of a camera that is told none, degrees.
    pub const DEFAULT_FOV: f64 = 45.0;

    /// A camera with [`Camera::DEFAULT_FOV`], +y upward and no near plane.
    pub fn looking(position: [f64; 3], target: [f64; 3]) -> Self {
        Camera { position, target, up: [0.0, 1.0, 0.0], fov: Self::DEFAULT_FOV, near: 0.0 }
    }

    /// The fixed view of a whole model: against the z axis at the middle of its box, from where the sphere around the
    /// box just fits between the upper and the lower edge.
    pub fn framing(bounds: &Aabb) -> Self {
        let target = bounds.center();
        // A model that is a single point, or as good as one where it lies, is looked at as if it had a radius.
        let far = target.coords.amax();
        let radius =
            Some((0.5 * bounds.diagonal()).max(1e-9 * far)).filter(|radius| *radius > 0.0).unwrap_or(1.0);
        let away = radius / (0.5 * Self::DEFAULT_FOV.to_radians()).sin();
        Camera::looking([target.x, target.y, target.z + away], [target.x, target.y, target.z])
    }

    /// A camera that looks along `sight` at a point, from a distance of one unit.
    pub(crate) fn whole(target: Point3<f64>, sight: Vector3<f64>, up: Vector3<f64>, fov: f64) -> Self {
        // Far from zero, a step of length one is lost, and there is no direction left.
        let position = (target - sight * (1e-9 * target.coords.amax()).max(1.0)).into();
        Camera { position, target: target.into(), up: up.into(), fov, near: 0.0 }
    }

    /// The same camera turned about its sight, so that its picture turns by so many degrees counterclockwise.
    pub fn rolled(&self, degrees: f64) -> Self {
        let ([right, up, _], (sin, cos)) = (self.axes(), degrees.to_radians().sin_cos());
        let up = if degrees == 0.0 { self.up } else { (up * cos + right * sin).into() };
        Camera { up, ..*self }
    }

    /// The same camera in the coordinates of a file with this origin.
    pub fn relative_to(&self, origin: [f64; 3]) -> Self {
        fn less(point: [f64; 3], origin: &[f64; 3]) -> [f64; 3] {
            std::array::from_fn(|axis| point[axis] - origin[axis])
        }
        Camera { position: less(self.position, &origin), target: less(self.target, &origin), ..*self }
    }

    /// Where this camera will be after so many frames if it goes on as it came from `before`, the frame before.
    pub fn onward(&self, before: &Camera, frames: f64) -> Self {
        fn ahead(now: [f64; 3], before: [f64; 3], frames: f64) -> [f64; 3] {
            std::array::from_fn(|axis| now[axis] + frames * (now[axis] - before[axis]))
        }
        let position = ahead(self.position, before.position, frames);
        Camera { position, target: ahead(self.target, before.target, frames), ..*self }
    }

    fn check(&self) -> Result<(), RefineError> {
        let numbers = [self.position, self.target, self.up];
        let finite = numbers.as_flattened().iter().all(|x| x.is_finite());
        require(finite, "camera", "finite numbers", format_args!("{numbers:?}"))?;
        let sight = Point3::from(self.target) - Point3::from(self.position);
        let near = sight.norm().is_finite();
        require(near, "camera", "numbers below 1e150", format_args!("{numbers:?}"))?;
        let apart = sight.norm() > 0.0;
        require(apart, "camera", "a target away from the position", format_args!("{:?}", self.target))?;
        require(0.0 < self.fov && self.fov < 180.0, "field of view", "0 < degrees < 180", self.fov)?;
        require(self.near >= 0.0 && self.near.is_finite(), "near plane", "at least 0", self.near)
    }

    /// To the right, upward and forward in the image, each of length 1.
    pub fn axes(&self) -> [Vector3<f64>; 3] {
        let forward = (Point3::from(self.target) - Point3::from(self.position)).normalize();
        let most_across = forward.iamin();
        let right = across(Vector3::from(self.up), &forward)
            .or_else(|| across(Vector3::ith(most_across, 1.0), &forward))
            .unwrap_or_else(Vector3::x);
        [right, right.cross(&forward), forward]
    }
}

fn across(up: Vector3<f64>, forward: &Vector3<f64>) -> Option<Vector3<f64>> {
    let right = forward.cross(&up);
    // Relative to both lengths: the sine of the angle between them.
    (right.norm() > 1e-9 * up.norm()).then(|| right.normalize())
}

/// A sphere and a box that a view is asked about: what lies in both. Asked for a sphere and a box inside them, a view never answers
/// with less error or with "visible" where it answered "not visible", in spite of rounding, as long as the sphere inside has
/// the smaller slack: by 1e-14 at least. Boxes need none: their distance is made of monotone steps.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Region {
    /// Centre, object units, relative to the file's origin.
    pub center: [f64; 3],
    /// Radius.
    pub radius: f64,
    /// By how much the answer is made safe, relative to the far side's distance; 1e-14 covers the rounding.
    pub slack: f64,
    /// Smallest corner of the box.
    pub low: [f64; 3],
    /// Largest corner of the box.
    pub high: [f64; 3],
}

impl Region {
    /// A sphere alone, with the least slack.
    pub fn sphere(center: [f64; 3], radius: f64) -> Self {
        Region { center, radius, slack: Region::SLACK, low: [f64::NEG_INFINITY; 3], high: [f64::INFINITY; 3] }
    }

    /// Slack from one nested region to the next larger one: some 40 times the rounding of a distance.
    pub const SLACK: f64 = 1e-14;

    /// Lets the box hold another one.
    pub(crate) fn widen(&mut self, low: [f64; 3], high: [f64; 3]) {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(low[axis]);
            self.high[axis] = self.high[axis].max(high[axis]);
        }
    }
}

/// A camera, the image it makes, and the error allowed in it.
///
/// ```
/// use chpm_refine::{Camera, Region, View};
///
/// let camera = Camera::looking([0.0, 0.0, 10.0], [0.0; 3]);
/// let view = View::new(&camera, [1920, 1080], 1.0)?;
/// // What is farther away may be coarser.
/// let [near, far] = [0.0, -90.0].map(|z| view.bound(&Region::sphere([0.0, 0.0, z], 1.0)));
/// assert!(near < far);
/// # Ok::<(), chpm_refine::RefineError>(())
/// ```
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct View {
    eye: Point3<f64>,
    near: f64,
    /// Object units that a pixel covers at distance 1.
    pixel: f64,
    /// Pixels of error.
    pixels: f64,
    culling: bool,
    /// Inner normals and offsets of the sides, the near plane and a clipping plane, for points relative to the eye.
    planes: [(Vector3<f64>, f64); 6],
}

impl View {
    /// A view in file coordinates: `viewport` is width and height in pixels, `pixels` the allowed error (PoE). Nothing is
    /// culled unless [`View::with_culling`] says so.
    ///
    /// # Errors
    /// [`RefineError::View`] for a camera or an image that none can be.
    pub fn new(camera: &Camera, viewport: [u32; 2], pixels: f64) -> Result<Self, RefineError> {
        camera.check()?;
        let [width, height] = viewport;
        require(width > 0 && height > 0, "viewport", "at least 1x1", format_args!("{width}x{height}"))?;
        require(pixels >= 0.0 && pixels.is_finite(), "pixels of error", "at least 0", pixels)?;
        let [right, up, forward] = camera.axes();
        let rise = (0.5 * camera.fov.to_radians()).tan();
        let run = rise * f64::from(width) / f64::from(height);
        fn side(across: Vector3<f64>, slope: f64, forward: &Vector3<f64>) -> (Vector3<f64>, f64) {
            ((*forward * slope + across).normalize(), 0.0)
        }
        Ok(View {
            eye: Point3::from(camera.position),
            near: camera.near,
            pixel: 2.0 * rise / f64::from(height),
            pixels,
            culling: false,
            planes: [
                side(right, run, &forward),
                side(-right, run, &forward),
                side(up, rise, &forward),
                side(-up, rise, &forward),
                (forward, -camera.near),
                // None, until there is one.
                (Vector3::zeros(), f64::INFINITY),
            ],
        })
    }

    /// The same view, in which what is outside the image needs no accuracy (or does).
    pub fn with_culling(self, culling: bool) -> Self {
        View { culling, ..self }
    }

    /// The same view, in which what is beyond a plane is outside: where `normal` (of length 1) times a point is above `offset`.
    pub fn clipped(mut self, normal: [f64; 3], offset: f64) -> Self {
        let normal = Vector3::from(normal);
        self.planes[5] = (-normal, offset - normal.dot(&self.eye.coords));
        self
    }

    /// The same view of a file whose coordinates are multiplied by these positive numbers to be looked at, of which the camera and a clipping
    /// plane knew. Errors, which know nothing of that, say nothing of such a picture: it is as fine as the file.
    pub fn stretched(mut self, stretch: [f64; 3]) -> Self {
        let stretch = Vector3::from(stretch);
        if stretch == Vector3::from([1.0; 3]) {
            return self;
        }
        self.pixels = 0.0;
        self.eye = Point3::from(self.eye.coords.component_div(&stretch));
        for (normal, offset) in &mut self.planes {
            let across = normal.component_mul(&stretch);
            let length = Some(across.norm()).filter(|length| *length > 0.0).unwrap_or(1.0);
            (*normal, *offset) = (across / length, *offset / length);
        }
        self
    }

    /// The same view with other pixels of error, which are not checked.
    pub(crate) fn with_pixels(self, pixels: f64) -> Self {
        View { pixels, ..self }
    }

    /// Whether what is outside the image needs no accuracy.
    pub fn is_culling(&self) -> bool {
        self.culling
    }

    /// The allowed pixels of error.
    pub fn pixels(&self) -> f64 {
        self.pixels
    }

    /// The error that the view allows in a region, object units: at most what covers the allowed pixels at its nearest
    /// point, which is taken no nearer than the near plane. Inside the region that is 0 if the near plane is. Infinite for what
    /// is culled.
    pub fn bound(&self, region: &Region) -> f32 {
        if self.culls(region) {
            return f32::INFINITY;
        }
        geom::round_down(self.pixels * self.pixel * self.reach(region))
    }

    /// The pixels that an error covers at the nearest point of a sphere; 0 for what is culled.
    pub fn pixels_of(&self, error: f32, region: &Region) -> f64 {
        // The first also keeps 0 / 0 away.
        if error <= 0.0 || self.culls(region) {
            0.0
        } else {
            f64::from(error) / (self.pixel * self.reach(region))
        }
    }

    /// Distance to the sphere or to the box, whichever is larger, never too large; that of the near plane if it is nearer.
    fn reach(&self, region: &Region) -> f64 {
        let center = (Point3::from(region.center) - self.eye).norm();
        let sphere = center - region.radius - region.slack * (center + region.radius);
        let outside = [0, 1, 2]
            .map(|axis| (region.low[axis] - self.eye[axis]).max(self.eye[axis] - region.high[axis]).max(0.0));
        let to_box = Vector3::from(outside).norm() * (1.0 - Region::SLACK);
        sphere.max(to_box).max(self.near)
    }

    pub(crate) fn culls(&self, region: &Region) -> bool {
        self.culling && self.misses(region)
    }

    /// Whether a region's sphere or its box is wholly on the outer side of one plane of the frustum, or of the clipping plane. What is not
    /// may be outside nevertheless.
    pub fn misses(&self, region: &Region) -> bool {
        let center = Point3::from(region.center) - self.eye;
        let margin = region.radius + region.slack * (center.norm() + region.radius);
        self.planes.iter().any(|plane| {
            let (normal, offset) = plane;
            normal.dot(&center) + offset + margin < 0.0 || self.box_misses(region, plane)
        })
    }

    /// Whether all of a region is beyond the clipping plane: it is not seen wherever the camera turns.
    pub fn clips(&self, region: &Region) -> bool {
        self.box_misses(region, &self.planes[5])
    }

    /// Whether a region's box is on the outer side of a plane. Each step is monotone in the box, so that one inside it is, too.
    fn box_misses(&self, region: &Region, (normal, offset): &(Vector3<f64>, f64)) -> bool {
        let (mut farthest, mut reach) = (*offset, 0.0);
        for axis in 0..3 {
            let (low, high) = (region.low[axis] - self.eye[axis], region.high[axis] - self.eye[axis]);
            farthest += normal[axis] * if normal[axis] > 0.0 { high } else { low };
            reach += normal[axis].abs() * low.abs().max(high.abs());
        }
        // A sphere alone has a box without end, which misses nothing.
        farthest + Region::SLACK * reach < 0.0
    }

    /// Whether a sphere is well inside all planes: then nothing in it is outside. For less than a test of a box.
    pub fn holds(&self, sphere: &Sphere) -> bool {
        let center = geom::to_f64(sphere.center) - self.eye;
        let radius = f64::from(sphere.radius);
        self.planes.iter().all(|(normal, offset)| normal.dot(&center) + offset > radius)
    }

    /// Whether a box is wholly on the outer side of one plane of the frustum; an empty one is.
    pub fn misses_box(&self, bounds: &Aabb) -> bool {
        bounds.is_empty()
            || self.planes.iter().any(|(normal, offset)| {
                let corner = farthest(bounds, normal) - self.eye;
                normal.dot(&corner) + offset + Region::SLACK * corner.norm() < 0.0
            })
    }
}

/// The corner of a box that is farthest along a direction.
fn farthest(bounds: &Aabb, direction: &Vector3<f64>) -> Point3<f64> {
    let sides = [0, 1, 2].map(|a| if direction[a] > 0.0 { bounds.max[a] } else { bounds.min[a] });
    geom::to_f64(sides)
}

fn require(
    ok: bool,
    what: &'static str,
    expected: &'static str,
    got: impl ToString,
) -> Result<(), RefineError> {
    if ok { Ok(()) } else { Err(RefineError::View { what, expected, got: got.to_string() }) }
}
