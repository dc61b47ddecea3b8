//! Files held against their sources, and meshes against meshes, as dictionaries with the keys that the command's JSON has.

use crate::error::Failure;
use crate::file::Model;
use crate::job;
use crate::settings;
use chpm_extmem::{Progress, Store};
use chpm_measure::{Deviation, deviation_while};
use chpm_mesh::{Aabb, Bytes, TriMesh};
use chpm_verify::certify::{self, Certified, Which};
use chpm_verify::deviation::{LevelDeviation, Spread};
use chpm_verify::{Checks, Measures, Points, Verification, VerifyError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::path::{Path, PathBuf};
use std::sync::Once;

/// What all of this may use.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Means<'py> {
    memory: Bound<'py, PyAny>,
    threads: Option<u32>,
    work_dir: Option<PathBuf>,
}

/// The same, looked at.
struct Resources {
    memory: Bytes,
    pool: rayon::ThreadPool,
    scratch: PathBuf,
}

impl Means<'_> {
    fn resources(self) -> Result<Resources, Failure> {
        Ok(Resources {
            memory: settings::memory(&self.memory)?,
            pool: settings::pool(self.threads)?,
            scratch: self.work_dir.unwrap_or_else(std::env::temp_dir),
        })
    }
}

/// What `chpm_verify` is asked.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Asked {
    against: Option<PathBuf>,
    same_as: Option<PathBuf>,
    errors: bool,
    levels: Vec<u32>,
    positions: u32,
    effort: u32,
    cuts: Option<u32>,
    seed: u64,
}

/// Verifies a file; ``chpm.verify`` is what to call.
#[pyfunction]
pub(crate) fn verify(
    py: Python<'_>,
    path: PathBuf,
    asked: Asked,
    means: Means<'_>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Py<PyDict>> {
    let Resources { memory, pool, scratch } = means.resources()?;
    let Asked { against, same_as, errors, levels, positions, effort, cuts, seed } = asked;
    let checks = Checks { against, errors, levels, positions, effort, cuts, seed };
    let found = job::run(py, progress, |board, cancel| {
        let model = match Model::open(path) {
            Ok(model) => model,
            // A file that does not even open is what a verification is there to find.
            Err(Failure::Open { source, .. }) => return Ok(Verification::unopened(&source)),
            Err(other) => return Err(other),
        };
        let look = || chpm_verify::verify(&model.file, &checks, memory, &scratch, board, cancel);
        let mut found = model.reading(|_| Ok(pool.install(look)?))?;
        if let Some(other) = same_as.filter(|_| found.is_readable(&model.file)) {
            same(&model, other, &mut found)?;
        }
        Ok(found)
    })?;
    Ok(verification(py, &checks, &found)?.unbind())
}

fn same(model: &Model, other: PathBuf, found: &mut Verification) -> Result<(), Failure> {
    let other = Model::open(other)?;
    let compare = |file: &_| other.reading(|other| Ok(chpm_format::same::compare(file, other, || ())?));
    let differences = model.reading(compare)?;
    let name = other.path.display();
    let told = differences.told.iter().map(|told| format!("I9 not the same as '{name}': {told}"));
    found.add(&told.collect::<Vec<_>>(), differences.count);
    Ok(())
}

fn verification<'py>(py: Python<'py>, checks: &Checks, found: &Verification) -> PyResult<Bound<'py, PyDict>> {
    let told = PyDict::new(py);
    told.set_item("fault_count", found.fault_count)?;
    told.set_item("faults", &found.faults)?;
    told.set_item("clusters", found.checked.as_ref().map(|report| report.good_pages))?;
    told.set_item("triangles", found.checked.as_ref().map(|report| report.triangles))?;
    told.set_item("trimmed", found.trimmed)?;
    told.set_item("against", None::<u8>)?;
    told.set_item("errors", None::<u8>)?;
    told.set_item("cuts", None::<u8>)?;

    if let Some(compared) = &found.compared {
        let own = PyDict::new(py);
        own.set_item("source", checks.against.as_ref().map(|path| path.display().to_string()))?;
        own.set_item("equal", compared.is_equal())?;
        own.set_item("leaf_triangles", compared.leaf_triangles)?;
        own.set_item("source_triangles", compared.source_triangles)?;
        own.set_item("copies_left_out", compared.copies)?;
        own.set_item("small_components_left_out", compared.small_components)?;
        own.set_item("small_component_triangles_left_out", compared.small_component_triangles)?;
        told.set_item("against", own)?;
    }
    if let Some(errors) = &found.errors {
        told.set_item("errors", certified(py, errors, found.origin)?)?;
    }
    if let Some(cuts) = &found.cuts {
        let own = PyDict::new(py);
        own.set_item("count", cuts.count)?;
        own.set_item("seed", cuts.seed)?;
        own.set_item("triangles", cuts.triangles)?;
        own.set_item("fault_count", cuts.fault_count)?;
        told.set_item("cuts", own)?;
    }

    Ok(told)
}

fn certified<'py>(py: Python<'py>, found: &Certified, origin: [f64; 3]) -> PyResult<Bound<'py, PyDict>> {
    let side = |side: &certify::Side| -> PyResult<Bound<'py, PyDict>> {
        let own = PyDict::new(py);
        own.set_item("least", side.lower)?;
        own.set_item("at", side.at.map(|at| absolute(at, origin)))?;
        own.set_item("most", side.upper)?;
        own.set_item("violations", side.violations)?;
        own.set_item("undecided", side.undecided)?;
        Ok(own)
    };
    let row = |row: &certify::Row| -> PyResult<Bound<'py, PyDict>> {
        let own = which(py, row.which)?;
        own.set_item("clusters", row.clusters)?;
        own.set_item("triangles", row.triangles)?;
        own.set_item("stored_error", row.error)?;
        own.set_item("stored_distance", row.distance)?;
        own.set_item("of_mesh", side(&row.of_mesh)?)?;
        own.set_item("of_source", side(&row.of_source)?)?;
        Ok(own)
    };
    let rows = |rows: &[certify::Row]| PyList::new(py, rows.iter().map(row).collect::<PyResult<Vec<_>>>()?);
    let told = PyDict::new(py);
    told.set_item("slack", found.slack)?;
    told.set_item("rounding", found.rounding)?;
    told.set_item("levels", rows(&found.levels)?)?;
    told.set_item("cuts", rows(&found.cuts)?)?;
    told.set_item("within", rows(&found.within)?)?;
    Ok(told)
}

fn which(py: Python<'_>, which: Which) -> PyResult<Bound<'_, PyDict>> {
    let told = PyDict::new(py);
    match which {
        Which::Level { level, collapsed } => {
            told.set_item("level", level)?;
            told.set_item("collapsed", collapsed)?;
        }
        Which::Cut { seed } => told.set_item("seed", seed)?,
        Which::Within { distance } => told.set_item("within", distance)?,
    }
    Ok(told)
}

fn absolute(at: [f64; 3], origin: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| at[axis] + origin[axis])
}

/// What is to be measured of a file.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Wanted {
    levels: bool,
    positions: u32,
    cuts: u32,
    seed: u64,
    samples: u32,
}

/// Measures a file beside its source; ``chpm.measure`` is what to call.
#[pyfunction]
pub(crate) fn measure_file(
    py: Python<'_>,
    path: PathBuf,
    source: PathBuf,
    wanted: Wanted,
    means: Means<'_>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Py<PyDict>> {
    let Resources { memory, pool, scratch } = means.resources()?;
    let Wanted { levels, positions, cuts, seed, samples } = wanted;
    let measures = Measures { levels, positions, cuts, seed, samples };
    let (found, header) = job::run(py, progress, |board, cancel| {
        let model = Model::open(path)?;
        let file = &model.file;
        let look = || chpm_verify::measure(file, &source, &measures, memory, &scratch, board, cancel);
        let found = model.reading(|_| Ok(pool.install(look)?))?;
        let header = model.file.header();
        Ok((found, (header.aabb().diagonal(), header.origin)))
    })?;
    let (diagonal, origin) = header;
    let row = |(cut, found): &(Which, LevelDeviation)| level(py, *cut, found, origin);
    let rows = |rows: &[_]| PyList::new(py, rows.iter().map(row).collect::<PyResult<Vec<_>>>()?);
    let told = PyDict::new(py);
    told.set_item("diagonal", diagonal)?;
    told.set_item("slack", found.slack)?;
    told.set_item("levels", rows(&found.rows[..found.levels])?)?;
    told.set_item("cuts", rows(&found.rows[found.levels..])?)?;
    told.set_item("violations", found.violations())?;
    Ok(told.unbind())
}

fn level<'py>(
    py: Python<'py>,
    cut: Which,
    found: &LevelDeviation,
    origin: [f64; 3],
) -> PyResult<Bound<'py, PyDict>> {
    let told = which(py, cut)?;
    told.set_item("clusters", found.clusters)?;
    told.set_item("triangles", found.triangles)?;
    told.set_item("stored_error", found.stored)?;
    told.set_item("stored_distance", found.distance)?;
    told.set_item("max", found.max())?;
    told.set_item("mean", found.mean())?;
    told.set_item("rms", found.rms())?;
    told.set_item("of_source", side(py, &found.of_source, origin)?)?;
    told.set_item("of_mesh", side(py, &found.of_mesh, origin)?)?;
    told.set_item("stored_by_measured", found.ratio.map(|ratio| spread(py, ratio)).transpose()?)?;
    told.set_item("vanished_samples", found.vanished.samples)?;
    told.set_item("violating_samples", found.violations.samples)?;
    Ok(told)
}

fn side<'py>(py: Python<'py>, side: &chpm_measure::Side, origin: [f64; 3]) -> PyResult<Bound<'py, PyDict>> {
    let told = PyDict::new(py);
    told.set_item("max", side.max)?;
    told.set_item("at", side.at.map(|at| absolute(at, origin)))?;
    told.set_item("mean", side.mean)?;
    told.set_item("rms", side.rms)?;
    told.set_item("samples", side.samples)?;
    Ok(told)
}

fn spread(py: Python<'_>, spread: Spread) -> PyResult<Bound<'_, PyDict>> {
    let told = PyDict::new(py);
    told.set_item("clusters", spread.count)?;
    told.set_item("min", spread.min)?;
    told.set_item("median", spread.median)?;
    told.set_item("p95", spread.p95)?;
    told.set_item("max", spread.max)?;
    Ok(told)
}

/// Measures two meshes; ``chpm.measure`` is what to call.
#[pyfunction]
pub(crate) fn measure_meshes(
    py: Python<'_>,
    first: PathBuf,
    second: PathBuf,
    samples: u32,
    means: Means<'_>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Py<PyDict>> {
    let Resources { memory, pool, scratch } = means.resources()?;
    let (found, origin, diagonal) = job::run(py, progress, |board, cancel| {
        let store = Store::create(&scratch, memory.0)?;
        let read = |path: &Path| -> Result<Points, Failure> {
            let points = Points::read(path, &store, board, cancel)?;
            match points.triangles.is_empty() {
                true => Err(VerifyError::NoTriangles { path: path.to_owned() }.into()),
                false => Ok(points),
            }
        };
        let (a, b) = (read(&first)?, read(&second)?);
        // What is far from zero would lose its detail in single precision.
        let is_single = a.is_single() && b.is_single();
        let origin = if is_single { [0.0; 3] } else { a.positions.first().copied().unwrap_or_default() };
        let (a, b) = (a.relative(origin), b.relative(origin));
        let found = pool.install(|| deviation(&a, &b, samples, board));
        let mut bounds = Aabb::of_points(&a.positions);
        bounds.merge(&Aabb::of_points(&b.positions));
        Ok((found, origin, bounds.diagonal()))
    })?;
    let told = PyDict::new(py);
    told.set_item("diagonal", diagonal)?;
    told.set_item("forward", side(py, &found.forward, origin)?)?;
    told.set_item("backward", side(py, &found.backward, origin)?)?;
    told.set_item("max", found.max())?;
    told.set_item("mean", found.mean())?;
    told.set_item("rms", found.rms())?;
    told.set_item("at", found.at().map(|at| absolute(at, origin)))?;
    Ok(told.unbind())
}

fn deviation(a: &TriMesh, b: &TriMesh, samples: u32, board: &job::Board) -> Deviation {
    // The number of parts is known with the first that is done.
    let started = Once::new();
    let progress = |done, all| {
        started.call_once(|| board.begin("measure", all));
        board.advance(done);
    };
    deviation_while(a, b, samples as usize, &progress, &|| true).unwrap_or_default()
}
