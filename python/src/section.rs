//! Sections of a file by a plane.

use crate::asked::{Amount, Asked};
use crate::error::Failure;
use crate::file::Model;
use crate::settings;
use crate::view::rows;
use chpm_mesh::{Bytes, Level};
use chpm_refine::Cut;
use chpm_section::{Line, Planes, SectionError, Slicer};
use numpy::PyArray2;
use pyo3::prelude::*;

/// Lines of a plane, exact or, with ``error``, of a coarse mesh: what ``chpm section`` writes.
#[pyclass(frozen, module = "chpm")]
pub(crate) struct Section {
    /// The points of each line, float64 of the shape (n, 3), in the model's units. A closed one does not repeat its first point.
    #[pyo3(get)]
    lines: Vec<Py<PyArray2<f64>>>,
    /// Whether each line is closed: list of bool.
    #[pyo3(get)]
    closed: Vec<bool>,
    /// How many closed lines each lies in: list of int. What is filled is inside lines of an even depth. Of lines that cross others it is that of one of their points.
    #[pyo3(get)]
    depths: Vec<u32>,
    /// Area that is filled, in the model's units: float; None where closed lines cross each other, as those of solids do that overlap.
    #[pyo3(get)]
    area: Option<f64>,
    /// Length of all lines, in the model's units: float.
    #[pyo3(get)]
    length: f64,
    /// Ends of lines that are not closed, where the surface has a boundary: int.
    #[pyo3(get)]
    open_ends: u64,
}

#[pymethods]
impl Section {
    fn __repr__(&self) -> String {
        let Section { lines, area, length, open_ends, .. } = self;
        let area = area.map_or("None".to_owned(), |area| area.to_string());
        format!("<chpm.Section: {} lines, length {length}, area {area}, {open_ends} open ends>", lines.len())
    }
}

impl Section {
    pub(crate) fn new(py: Python<'_>, found: chpm_section::Section, origin: [f64; 3]) -> PyResult<Self> {
        let (area, length, open_ends) = (found.area(), found.length(), found.open_ends());
        let (mut lines, mut closed, mut depths) = (Vec::new(), Vec::new(), Vec::new());
        for Line { mut points, is_closed, depth, .. } in found.lines {
            for point in &mut points {
                *point = std::array::from_fn(|axis| point[axis] + origin[axis]);
            }
            lines.push(rows(py, points)?);
            closed.push(is_closed);
            depths.push(depth);
        }
        Ok(Section { lines, closed, depths, area, length, open_ends })
    }
}

/// Cuts, without holding Python up.
pub(crate) fn cut(
    model: &Model,
    [x, y, z, offset]: [f64; 4],
    error: Option<Amount>,
) -> Result<chpm_section::Section, Failure> {
    let pool = settings::pool(None)?;
    model.reading(|file| {
        let planes = Planes::new([x, y, z], vec![offset]).map_err(failure)?;
        let mesh = match error {
            None => Cut::at_level(file, Level(0)),
            Some(_) => {
                let asked = Asked { error, ..Asked::default() };
                asked.request(file)?.cut(file, 0.0, 0, || Ok::<_, Failure>(()))?
            }
        };
        let slice = || Slicer::new(file, &mesh, &planes).next_sections(Bytes(u64::MAX), || true);
        let found = pool.install(slice).map_err(failure)?;
        found.into_iter().next().ok_or_else(|| Failure::Asked("there is no plane".to_owned()))
    })
}

fn failure(error: SectionError) -> Failure {
    match error {
        SectionError::Format(error) => error.into(),
        error => Failure::Asked(error.to_string()),
    }
}
