//! Where a picture is taken from.

use crate::error::Failure;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::Camera as Seen;
use pyo3::prelude::*;

/// Where a picture is taken from, in the model's own coordinates (the origin added).
///
/// Parameters
/// ----------
/// position : sequence of 3 floats
///     The viewer, in the model's units.
/// target : sequence of 3 floats
///     What is in the middle of the image; not the position.
/// up : sequence of 3 floats
///     Roughly upward in the image.
/// fov : float
///     Angle between the lower and the upper edge of the image, degrees.
/// near : float
///     Nothing nearer than this is drawn, in the model's units; 0 draws everything.
#[pyclass(frozen, from_py_object, module = "chpm")]
#[derive(Clone, Copy)]
pub(crate) struct Camera(pub(crate) Seen);

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (position, target, *, up=[0.0, 1.0, 0.0], fov=Seen::DEFAULT_FOV, near=0.0))]
    fn new(position: [f64; 3], target: [f64; 3], up: [f64; 3], fov: f64, near: f64) -> Self {
        Camera(Seen { position, target, up, fov, near })
    }

    /// The viewer: 3 floats, in the model's units.
    #[getter]
    fn position(&self) -> (f64, f64, f64) {
        self.0.position.into()
    }

    /// What is in the middle of the image: 3 floats, in the model's units.
    #[getter]
    fn target(&self) -> (f64, f64, f64) {
        self.0.target.into()
    }

    /// Roughly upward in the image: 3 floats.
    #[getter]
    fn up(&self) -> (f64, f64, f64) {
        self.0.up.into()
    }

    /// Angle between the lower and the upper edge of the image, degrees.
    #[getter]
    fn fov(&self) -> f64 {
        self.0.fov
    }

    /// Nothing nearer than this is drawn, in the model's units.
    #[getter]
    fn near(&self) -> f64 {
        self.0.near
    }

    fn __repr__(&self) -> String {
        let Seen { position, target, up, fov, near } = self.0;
        let tuple = |[x, y, z]: [f64; 3]| format!("({x:?}, {y:?}, {z:?})");
        let (position, target, up) = (tuple(position), tuple(target), tuple(up));
        format!("chpm.Camera({position}, {target}, up={up}, fov={fov:?}, near={near:?})")
    }
}

impl Camera {
    /// The camera that looks at a whole model, as that of the command does.
    pub(crate) fn whole(file: &Chpm<MappedFile>) -> Self {
        let header = file.header();
        Camera(Seen::framing(&header.aabb()).relative_to(header.origin.map(|x| -x)))
    }
}

/// What stands for a camera.
#[derive(FromPyObject)]
pub(crate) enum From {
    Camera(Camera),
    /// Position, target and, perhaps, the field of view.
    Numbers(Vec<f64>),
}

impl From {
    pub(crate) fn camera(&self) -> Result<Camera, Failure> {
        let numbers = match self {
            From::Camera(camera) => return Ok(*camera),
            From::Numbers(numbers) => &numbers[..],
        };
        let (ends, fov) = match numbers {
            [ends @ .., fov] if ends.len() == 6 => (ends, *fov),
            ends => (ends, Seen::DEFAULT_FOV),
        };
        let &[px, py, pz, tx, ty, tz] = ends else {
            let told = format!(
                "camera: a chpm.Camera, or 6 or 7 numbers (position, target, field of view) expected, got {}",
                numbers.len()
            );
            return Err(Failure::Asked(told));
        };
        Ok(Camera(Seen { fov, ..Seen::looking([px, py, pz], [tx, ty, tz]) }))
    }
}
