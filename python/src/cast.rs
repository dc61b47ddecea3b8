//! Rays of arrays, and what they meet.

use crate::asked::Amount;
use crate::error::Failure;
use crate::file::Model;
use crate::job;
use crate::settings;
use crate::view::{row, rows};
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_rays::{Bound, Caster, Hit, Memory, Ray, RayError, Seek};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLikeDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// What rays met, in their order: what ``chpm rays`` writes.
#[pyclass(frozen, module = "chpm")]
pub(crate) struct Hits {
    /// Whether each ray meets the mesh: bool of the shape (n,).
    #[pyo3(get)]
    hit: Py<PyArray1<bool>>,
    /// How far from its origin, in the model's units: float64 of the shape (n,); NaN for a miss, and with ``any``.
    #[pyo3(get)]
    distance: Py<PyArray1<f64>>,
    /// Where, in the model's units: float64 of the shape (n, 3); NaN for a miss, and with ``any``.
    #[pyo3(get)]
    points: Py<PyArray2<f64>>,
    /// Normals of the triangles, of length 1, on the side that their corners turn left for; zeros where one has no area: float64 of the shape (n, 3); NaN for a miss, and with ``any``.
    #[pyo3(get)]
    normals: Py<PyArray2<f64>>,
    /// Clusters of the triangles: int64 of the shape (n,); -1 for a miss, and with ``any``.
    #[pyo3(get)]
    clusters: Py<PyArray1<i64>>,
    /// Places of the triangles among those of their pages: int64 of the shape (n,); -1 for a miss, and with ``any``.
    #[pyo3(get)]
    triangles: Py<PyArray1<i64>>,
    /// With ``error``: a distance before which each ray certainly does not meet the source, in the model's units; infinite for a proven miss: float64 of the shape (n,). Otherwise None: hits and misses
    /// are the source's own.
    #[pyo3(get)]
    least: Option<Py<PyArray1<f64>>>,
    /// How far the mesh is from the source at most, in the model's units: float; None where the file does not know.
    #[pyo3(get)]
    within: Option<f64>,
    count: usize,
    hits: usize,
}

#[pymethods]
impl Hits {
    fn __repr__(&self) -> String {
        format!("<chpm.Hits: {} rays, {} hit>", self.count, self.hits)
    }

    fn __len__(&self) -> usize {
        self.count
    }
}

/// Numbers in rows of three.
type Rows<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

/// An array, unless something in it is masked: what is below a mask is no number.
fn unmasked<'py>(name: &str, given: &pyo3::Bound<'py, PyAny>) -> PyResult<Rows<'py>> {
    let is_masked = given.py().import("numpy")?.getattr("ma")?.call_method1("is_masked", (given,))?;
    if is_masked.is_truthy()? {
        let told = format!("{name}: an array without masked values expected; leave their rows out");
        return Err(Failure::Asked(told).into());
    }
    given.extract()
}

/// Memory for pages and rays.
const ROOM: Bytes = Bytes(512 << 20);

/// The rays of arrays, about the file's origin.
pub(crate) fn rays(
    origins: &pyo3::Bound<'_, PyAny>,
    directions: &pyo3::Bound<'_, PyAny>,
    reach: Option<f64>,
    origin: [f64; 3],
) -> PyResult<Vec<Ray>> {
    let (origins, directions) = (unmasked("origins", origins)?, unmasked("directions", directions)?);
    Ok(sound(&origins, &directions, reach, origin)?)
}

fn sound(
    origins: &Rows<'_>,
    directions: &Rows<'_>,
    reach: Option<f64>,
    origin: [f64; 3],
) -> Result<Vec<Ray>, Failure> {
    for (name, array) in [("origins", origins), ("directions", directions)] {
        if array.ndim() != 2 || array.shape()[1] != 3 {
            let shape = array.shape();
            return Err(Failure::Asked(format!(
                "{name}: an array of the shape (n, 3) expected, got {shape:?}"
            )));
        }
    }
    let [count, other] = [origins, directions].map(|array| array.shape()[0]);
    if count != other {
        return Err(Failure::Asked(format!(
            "as many directions as origins expected, got {other} and {count}"
        )));
    }
    let (origins, directions) = (origins.as_array(), directions.as_array());
    let reach = reach.unwrap_or(f64::INFINITY);
    (0..count)
        .map(|at| {
            let from = std::array::from_fn(|axis| origins[[at, axis]] - origin[axis]);
            let way = std::array::from_fn(|axis| directions[[at, axis]]);
            let ray = Ray { reach, ..Ray::new(from, way) };
            if ray.is_sound() {
                return Ok(ray);
            }
            let got: [f64; 3] = std::array::from_fn(|axis| origins[[at, axis]]);
            Err(Failure::Asked(format!(
                "ray {at}: finite numbers, a direction of some length and a reach of at least 0 expected, got {got:?}, {way:?}, {reach}"
            )))
        })
        .collect()
}

/// Answers, before Python has them.
pub(crate) struct Answers {
    hits: Vec<Option<Hit>>,
    least: Option<Vec<f64>>,
    within: Option<f64>,
}

/// Casts, without holding Python up.
pub(crate) fn cast(
    py: Python<'_>,
    model: &Model,
    rays: &[Ray],
    error: Option<&Amount>,
    seek: Seek,
) -> PyResult<Answers> {
    let error = error.map(Amount::length).transpose()?;
    let error = error.map_or(0.0, |error| error.of(model.file.header().aabb().diagonal()));
    let bound = if error > 0.0 { Bound::within(error) } else { Bound::LEAVES };
    let pool = settings::pool(None)?;
    job::run(py, None, |_, cancel| {
        model.reading(|file| pool.install(|| found(file, rays, &bound, seek, cancel)))
    })
}

fn found(
    file: &Chpm<MappedFile>,
    rays: &[Ray],
    bound: &Bound,
    seek: Seek,
    cancel: &Cancel,
) -> Result<Answers, Failure> {
    let mut caster = Caster::new(file, Memory::divide(ROOM, rayon::current_num_threads()));
    let within = match caster.distance(bound) {
        Err(error) if !bound.is_leaves() => {
            return Err(Failure::Asked(format!("no coarse mesh proves anything: {error}")));
        }
        within => within.ok(),
    };
    let go_on = || !Cancel::is_cancelled(cancel);
    let mut hits = Vec::with_capacity(rays.len());
    caster.cast(rays, bound, seek, &go_on, |hit, _| hits.push(hit)).map_err(failure)?;
    let mut least = None;
    if let Some(within) = within.filter(|_| !bound.is_leaves()) {
        let mut all = Vec::with_capacity(rays.len());
        caster
            .cast(rays, bound, Seek::Within(within), &go_on, |_, least| all.push(least))
            .map_err(failure)?;
        least = Some(all);
    }
    Ok(Answers { hits, least, within })
}

fn failure(error: RayError) -> Failure {
    match error {
        RayError::Format(error) => error.into(),
        error => Failure::Asked(error.to_string()),
    }
}

impl Hits {
    pub(crate) fn new(py: Python<'_>, answers: Answers, any: bool, origin: [f64; 3]) -> PyResult<Self> {
        let Answers { hits, least, within } = answers;
        let (count, met) = (hits.len(), hits.iter().flatten().count());
        let hit = hits.iter().map(Option::is_some).collect::<Vec<bool>>();
        let told = || hits.iter().map(|hit| hit.as_ref().filter(|_| !any));
        let point = |hit: &Hit| std::array::from_fn(|axis| hit.point[axis] + origin[axis]);
        let number = |hit: Option<&Hit>, of: fn(&Hit) -> u32| hit.map_or(-1, |hit| i64::from(of(hit)));
        Ok(Hits {
            hit: row(py, hit),
            distance: row(py, told().map(|hit| hit.map_or(f64::NAN, |hit| hit.distance)).collect()),
            points: rows(py, told().map(|hit| hit.map_or([f64::NAN; 3], point)).collect())?,
            normals: rows(py, told().map(|hit| hit.map_or([f64::NAN; 3], |hit| hit.normal)).collect())?,
            clusters: row(py, told().map(|hit| number(hit, |hit| hit.cluster.0)).collect()),
            triangles: row(py, told().map(|hit| number(hit, |hit| hit.triangle)).collect()),
            least: least.map(|least| row(py, least)),
            within,
            count,
            hits: met,
        })
    }
}
