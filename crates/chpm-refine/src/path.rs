//! Camera paths: a text file of one camera a line, and ways to make them.

use crate::error::RefineError;
use crate::random::SplitMix;
use crate::view::Camera;
use chpm_mesh::Aabb;
use nalgebra::{Point3, Rotation3, Unit, Vector3};
use std::f64::consts::TAU;
use std::fmt;
use std::str::FromStr;

/// First line of a path file that is no comment.
const VERSION: &str = "chpm-path 1";
/// Frames from one camera of a random path to the next.
const LEG: usize = 30;

/// One camera for each frame. As text: a line `chpm-path 1`, then ten numbers a line (position, target, up, field of view in degrees)
/// in the source's coordinates; what follows a `#` is a comment. Numbers are written so that reading gives the same bits.
///
/// ```
/// use chpm_mesh::Aabb;
/// use chpm_refine::CameraPath;
///
/// let bounds = Aabb::of_points(&[[-1.0; 3], [1.0; 3]]);
/// let orbit = CameraPath::orbit(&bounds, 36);
/// let again: CameraPath = orbit.to_string().parse()?;
/// assert_eq!((orbit.cameras.len(), again), (36, orbit));
/// # Ok::<(), chpm_refine::RefineError>(())
/// ```
#[derive(Clone, PartialEq, Debug, Default)]
pub struct CameraPath {
    /// The cameras. Near planes are not written.
    pub cameras: Vec<Camera>,
}

impl CameraPath {
    /// Once around the y axis through the middle of a box, from its [`Camera::framing`] view on.
    pub fn orbit(bounds: &Aabb, frames: usize) -> Self {
        CameraPath::around(&Camera::framing(bounds), frames)
    }

    /// Once around what a camera looks at, about the direction that is up for it, from where it stands; each frame is further to the right.
    pub fn around(start: &Camera, frames: usize) -> Self {
        let center = Point3::from(start.target);
        let arm = Point3::from(start.position) - center;
        let [_, upward, _] = start.axes();
        let axis = Unit::try_new(Vector3::from(start.up), 0.0).unwrap_or(Unit::new_normalize(upward));
        CameraPath {
            cameras: (0..frames)
                .map(|frame| {
                    let turn = Rotation3::from_axis_angle(&axis, TAU * frame as f64 / frames as f64);
                    Camera { position: (center + turn * arm).into(), ..*start }
                })
                .collect(),
        }
    }

    /// From the [`Camera::framing`] view of a box straight towards a point; see [`CameraPath::towards`].
    pub fn dive(bounds: &Aabb, point: [f64; 3], frames: usize) -> Self {
        CameraPath::towards(&Camera::framing(bounds), point, frames)
    }

    /// From a camera straight towards a point, to 1/500 of the distance; every frame is nearer by the same factor. The camera first looks
    /// at what it looked at and turns to the point on the way.
    pub fn towards(start: &Camera, point: [f64; 3], frames: usize) -> Self {
        let (point, center) = (Point3::from(point), Point3::from(start.target));
        let away = Point3::from(start.position) - point;
        CameraPath {
            cameras: (0..frames)
                .map(|frame| {
                    let t = frame as f64 / (frames.max(2) - 1) as f64;
                    let target = center + (point - center) * smooth((3.0 * t).min(1.0));
                    Camera {
                        position: (point + away * 500_f64.powf(-t)).into(),
                        target: target.into(),
                        ..*start
                    }
                })
                .collect(),
        }
    }

    /// Smoothly between random cameras in and around a box; what follows from `seed` alone.
    pub fn random(bounds: &Aabb, seed: u64, frames: usize) -> Self {
        let start = Camera::framing(bounds);
        let center = Point3::from(start.target);
        // A single point is looked at from about one unit, as by the framing view.
        let reach = Some(0.5 * bounds.diagonal()).filter(|reach| *reach > 0.0).unwrap_or(1.0);
        let mut random = SplitMix(seed);
        let keys: Vec<_> = (0..frames.div_ceil(LEG) + 1)
            .map(|_| {
                let eye = center + way(&mut random, reach, [0.3, 6.0]);
                (eye, center + way(&mut random, reach, [0.02, 0.25]))
            })
            .collect();
        CameraPath {
            cameras: (0..frames)
                .map(|frame| {
                    let ((from, from_target), (to, to_target)) = (keys[frame / LEG], keys[frame / LEG + 1]);
                    let t = smooth((frame % LEG) as f64 / LEG as f64);
                    let (position, target) =
                        (from + (to - from) * t, from_target + (to_target - from_target) * t);
                    Camera { position: position.into(), target: target.into(), ..start }
                })
                .collect(),
        }
    }
}

/// In any direction, between two shares of `reach`: even over the orders of magnitude, as often near as far.
fn way(random: &mut SplitMix, reach: f64, [least, most]: [f64; 2]) -> Vector3<f64> {
    let direction = Vector3::from(std::array::from_fn(|_| 2.0 * random.unit() - 1.0));
    let direction = direction.try_normalize(0.0).unwrap_or_else(Vector3::z);
    direction * (reach * least * (most / least).powf(random.unit()))
}

/// From 0 to 1 with no speed at the ends.
fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

impl fmt::Display for CameraPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{VERSION}\n# position, target, up, vertical field of view in degrees")?;
        for camera in &self.cameras {
            for x in [camera.position, camera.target, camera.up].as_flattened() {
                write!(f, "{x} ")?;
            }
            writeln!(f, "{}", camera.fov)?;
        }
        Ok(())
    }
}

impl FromStr for CameraPath {
    type Err = RefineError;

    fn from_str(text: &str) -> Result<Self, RefineError> {
        fn wrong(line: usize, expected: &'static str, got: &str) -> RefineError {
            RefineError::Path { line, expected, got: got.to_owned() }
        }
        fn bare(line: &str) -> &str {
            line.split_once('#').map_or(line, |(bare, _)| bare).trim()
        }
        let lines = (1..).zip(text.lines().map(bare));
        let mut lines = lines.filter(|(_, line)| !line.is_empty());

        let first = lines.next().unwrap_or((1, ""));
        if !first.1.split_whitespace().eq(VERSION.split_whitespace()) {
            return Err(wrong(first.0, VERSION, first.1));
        }

        let cameras = lines.map(|(n, line)| camera(line).ok_or_else(|| wrong(n, "ten numbers", line)));
        Ok(CameraPath { cameras: cameras.collect::<Result<_, _>>()? })
    }
}

/// The camera of a line of ten numbers.
fn camera(line: &str) -> Option<Camera> {
    let numbers: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
    let Ok(&[px, py, pz, tx, ty, tz, ux, uy, uz, fov]) = numbers.as_deref() else { return None };
    Some(Camera { position: [px, py, pz], target: [tx, ty, tz], up: [ux, uy, uz], fov, near: 0.0 })
}
