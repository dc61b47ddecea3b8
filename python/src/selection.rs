//! A mesh that was selected.

use crate::asked::Asked;
use crate::error::Failure;
use crate::file::Model;
use crate::view::{row, rows, values};
use chpm_export::{Atlases, PartImage, TexturedPart};
use chpm_extmem::{Cancel, MappedFile, Progress};
use chpm_format::Chpm;
use chpm_mesh::{Attributes, Bytes, Scalar, TriMesh};
use chpm_refine::{Cut, Extraction, Shortfall};
use chpm_verify::certify::{self, FOUND, Goal, Proven};
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::ops::RangeInclusive;
use std::path::Path;
use std::time::{Duration, Instant};

/// One mesh without cracks, taken out of a file: what ``chpm extract`` writes for the same request.
#[pyclass(frozen, module = "chpm")]
pub(crate) struct Selection {
    /// Vertices, relative to :attr:`origin`: float32 of the shape (n, 3), in the model's units.
    #[pyo3(get)]
    vertices: Py<PyArray2<f32>>,
    /// Corners of triangles, as indices into the vertices: uint32 of the shape (m, 3).
    #[pyo3(get)]
    faces: Py<PyArray2<u32>>,
    /// Normals of the vertices, as the source or the build has made them: float32 of the shape (n, 3), or None.
    #[pyo3(get)]
    normals: Option<Py<PyArray2<f32>>>,
    /// Colours of the vertices, red, green, blue and alpha: uint8 of the shape (n, 4), or None.
    #[pyo3(get)]
    colors: Option<Py<PyArray2<u8>>>,
    /// Values of the named scalars of the vertices: dict of name and array of the shape (n,), float32 or, where that does not hold all values of
    /// the source's type, float64.
    #[pyo3(get)]
    scalars: Py<PyDict>,
    /// Places of the vertices in the images: float32 of the shape (n, 2), from the lower left corner, 1 being a whole side; or None. As OBJ, trimesh and
    /// PyVista have them.
    #[pyo3(get)]
    uv: Option<Py<PyArray2<f32>>>,
    /// Bytes of the images, each a JPEG or, where some of it is not opaque, a PNG: list of bytes.
    #[pyo3(get)]
    images: Vec<Py<PyBytes>>,
    /// Which image each triangle is in: uint32 of the shape (m,), or None.
    #[pyo3(get)]
    face_images: Option<Py<PyArray1<u32>>>,
    /// What the vertices are relative to: float64 of the shape (3,); zeros unless single precision would not do.
    #[pyo3(get)]
    origin: Py<PyArray1<f64>>,
    /// How far the mesh is from the source at most, but for components that lay apart and vanished; in the model's units.
    #[pyo3(get)]
    error: f32,
    /// How far any point of the source is from the mesh, or of the mesh from the source, at most; in the model's units. Nothing is
    /// exempt. None for files of version 1.0, which do not tell it.
    #[pyo3(get)]
    distance: Option<f32>,
    /// How many clusters the mesh is made of.
    #[pyo3(get)]
    cluster_count: usize,
    /// What was asked for and the file does not have, in a sentence; None where it has all.
    #[pyo3(get)]
    shortfall: Option<String>,
}

#[pymethods]
impl Selection {
    /// Vertices with the origin added: a new array, float64 of the shape (n, 3), in the model's units.
    fn absolute<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.vertices.bind(py).call_method1("astype", ("float64",))?.add(&self.origin)
    }

    /// Vertices of the mesh: int.
    #[getter]
    fn vertex_count(&self, py: Python<'_>) -> usize {
        self.vertices.bind(py).shape()[0]
    }

    /// Triangles of the mesh: int.
    #[getter]
    fn triangle_count(&self, py: Python<'_>) -> usize {
        self.faces.bind(py).shape()[0]
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let (vertices, triangles) = (self.vertex_count(py), self.triangle_count(py));
        format!("<chpm.Selection: {triangles} triangles, {vertices} vertices, error {}>", self.error)
    }
}

/// The same before Python has it.
pub(crate) struct Selected {
    mesh: TriMesh,
    carried: Attributes,
    scalars: Vec<Scalar>,
    error: f32,
    pub(crate) distance: Option<f32>,
    clusters: usize,
    pub(crate) shortfall: Option<String>,
    textured: Option<Textured>,
}

/// Where a mesh is in images.
#[derive(Default)]
struct Textured {
    uv: Vec<[f32; 2]>,
    images: Vec<Vec<u8>>,
    face_images: Vec<u32>,
}

impl Textured {
    /// Takes the parts of a mesh, which are one mesh afterwards.
    fn of(parts: Vec<TexturedPart>) -> (Self, TriMesh) {
        let (mut textured, mut mesh) = (Textured::default(), TriMesh::default());
        for (number, part) in parts.into_iter().enumerate() {
            let first = mesh.positions.len() as u32;
            textured.uv.extend(part.places.iter().map(|[u, v]| [*u, 1.0 - v]));
            textured.face_images.extend(part.triangles.iter().map(|_| number as u32));
            mesh.triangles.extend(part.triangles.iter().map(|corners| corners.map(|v| first + v)));
            mesh.positions.extend(part.positions);
            mesh.normals.extend(part.normals);
            if let PartImage::Inside(bytes) = part.image {
                textured.images.push(bytes);
            }
        }
        (textured, mesh)
    }
}

/// The mesh of a cut with its sheets.
fn textured(
    file: &Chpm<MappedFile>,
    cut: &Cut,
    side: u32,
    patience: &mut Patience,
) -> Result<(Textured, TriMesh), Failure> {
    if !SIDES.contains(&side) {
        return Err(Failure::Asked(format!(
            "texture_size: {} to {} expected, got {side}",
            SIDES.start(),
            SIDES.end()
        )));
    }
    if !file.header().has_sheets() {
        let told = "the file has no sheets; build it with texture=\"sheets\" from a source with images";
        return Err(Failure::Asked(told.to_owned()));
    }
    let atlases = Atlases::new(file, cut, side, true);
    Ok(Textured::of(atlases.parts(file, || patience.check(), || ())?))
}

/// Selects, without holding Python up; stops where Ctrl-C was pressed.
pub(crate) fn select(model: &Model, asked: &Asked) -> Result<Selected, Failure> {
    model.reading(|file| taken(file, &model.path, asked))
}

/// How long to look for a coarser mesh than is stored, and what that may use.
pub(crate) struct Further<'a> {
    /// That of ``--effort``.
    pub(crate) effort: u8,
    pub(crate) memory: u64,
    pub(crate) pool: &'a rayon::ThreadPool,
    pub(crate) progress: &'a dyn Progress,
    pub(crate) cancel: &'a Cancel,
}

/// Selects a mesh within a distance, or a coarser one that is proven to be.
pub(crate) fn simplified(model: &Model, asked: &Asked, further: &Further<'_>) -> Result<Selected, Failure> {
    model.reading(|file| {
        let request = asked.request(file)?;
        let distance = request.distance(file, 0.0).filter(|_| further.effort > 0);
        let Some(distance) = distance else { return taken(file, &model.path, asked) };
        let (mut patience, source) = (Patience::new(), file.header().source_triangle_count);
        let Further { effort, memory, pool, progress, cancel } = *further;

        let tiles = memory.saturating_sub(FOUND * file.clusters().len() as u64);
        let found = pool.install(|| certify::coarsest(file, distance, tiles, progress, cancel))?;
        let (cut, mut proven) = match found {
            Some(Proven { cut, distance }) => (cut, Some(distance)),
            None => (request.cut(file, 0.0, KEPT, || patience.check())?, None),
        };
        let (mut coarser, mut lack) = (None, None);
        if let Some(effort) = chpm_reduce::Effort::of(effort) {
            match certify::room(memory, source, cut.triangle_count(file)?) {
                Ok(tiles) => {
                    let collapse = |goal: &Goal<'_>| {
                        let source = (goal.source, goal.whole);
                        let left = chpm_reduce::reduce(goal.mesh, source, goal.distance, effort, &|| {
                            cancel.is_cancelled()
                        });
                        (left.vertices, left.triangles)
                    };
                    let look = || certify::further(file, (&cut, distance), tiles, progress, cancel, collapse);
                    coarser = pool.install(look)?;
                }
                Err(missing) => {
                    lack = Some(format!(
                        "going on vertex by vertex would take {} more memory: effort 1 it is",
                        Bytes(missing)
                    ));
                }
            }
        }

        let mut extraction = Extraction::keeping(file, &cut, KEPT, || patience.check())?;
        if let Some(certify::Further { mesh, distance }) = coarser {
            (extraction, proven) = (extraction.replaced(mesh, distance), Some(distance));
        }
        let nearest = |stored: f32| proven.map_or(stored, |proven| proven.min(stored));
        let distance = nearest(extraction.distance());
        let describe =
            |shortfall: Shortfall| shortfall.describe(model.path.display(), file.header().aabb().diagonal());
        Ok(Selected {
            mesh: mesh(&extraction, &mut patience)?,
            carried: extraction.attributes(),
            scalars: file.scalars().to_vec(),
            error: nearest(extraction.error()),
            distance: file.has_gaps().then_some(distance),
            clusters: cut.members().len(),
            shortfall: lack.or_else(|| request.shortfall(file, &cut, distance).map(describe)),
            textured: None,
        })
    })
}

/// Sides that images may have, texels.
const SIDES: RangeInclusive<u32> = 256..=16384;

/// Bytes of what is known of clusters while they are chosen, and then of unpacked pages while a mesh is counted and copied.
const KEPT: u64 = 256 << 20;

fn taken(file: &Chpm<MappedFile>, path: &Path, asked: &Asked) -> Result<Selected, Failure> {
    let request = asked.request(file)?;
    let mut patience = Patience::new();
    let cut = request.cut(file, 0.0, KEPT, || patience.check())?;
    let extraction = Extraction::keeping(file, &cut, KEPT, || patience.check())?;
    request.check(file, &extraction)?;
    let (mut carried, mut scalars) = (extraction.attributes(), file.scalars().to_vec());
    let (textured, mesh) = match asked.texture_size {
        None => (None, mesh(&extraction, &mut patience)?),
        Some(side) => {
            (carried.colors, carried.scalar_words) = (false, 0);
            scalars.clear();
            let (textured, mesh) = textured(file, &cut, side, &mut patience)?;
            (Some(textured), mesh)
        }
    };
    let (error, distance) = (extraction.error(), extraction.distance());
    let describe = |shortfall: Shortfall| shortfall.describe(path.display(), file.header().aabb().diagonal());
    Ok(Selected {
        mesh,
        carried,
        scalars,
        textured,
        error,
        distance: file.has_gaps().then_some(distance),
        clusters: cut.members().len(),
        shortfall: request.shortfall(file, &cut, distance).map(describe),
    })
}

fn mesh(extraction: &Extraction<'_, MappedFile>, patience: &mut Patience) -> Result<TriMesh, Failure> {
    let (vertices, triangles) = (extraction.vertex_count() as usize, extraction.triangle_count() as usize);
    let mut mesh = TriMesh::default();
    let carried = extraction.attributes();
    let memory = |_| Failure::Memory(format!("{triangles} triangles and {vertices} vertices"));
    mesh.positions.try_reserve_exact(vertices).map_err(memory)?;
    mesh.triangles.try_reserve_exact(triangles).map_err(memory)?;
    if carried.has_normals() {
        mesh.normals.try_reserve_exact(vertices).map_err(memory)?;
    }
    if carried.colors {
        mesh.colors.try_reserve_exact(vertices).map_err(memory)?;
    }
    mesh.scalars.try_reserve_exact(vertices * usize::from(carried.scalar_words)).map_err(memory)?;
    extraction.both(|vertices, triangles| {
        mesh.extend_from_slices(vertices);
        mesh.triangles.extend_from_slice(triangles);
        patience.check()
    })?;
    Ok(mesh)
}

/// Looks every now and then whether Ctrl-C was pressed.
struct Patience {
    looked: Instant,
}

impl Patience {
    fn new() -> Self {
        Patience { looked: Instant::now() }
    }

    fn check(&mut self) -> Result<(), Failure> {
        if self.looked.elapsed() < Duration::from_millis(100) {
            return Ok(());
        }
        self.looked = Instant::now();
        Ok(Python::attach(|py| py.check_signals())?)
    }
}

impl Selection {
    pub(crate) fn new(py: Python<'_>, selected: Selected, origin: Py<PyArray1<f64>>) -> PyResult<Self> {
        let Selected { mesh, carried, scalars, error, distance, clusters, shortfall, textured } = selected;
        let (uv, images, face_images) = match textured {
            Some(Textured { uv, images, face_images }) => {
                let images = images.iter().map(|bytes| PyBytes::new(py, bytes).unbind()).collect();
                (Some(rows(py, uv)?), images, Some(row(py, face_images)))
            }
            None => (None, Vec::new(), None),
        };
        let TriMesh { vertices, triangles } = mesh;
        Ok(Selection {
            normals: carried.has_normals().then(|| rows(py, vertices.normals)).transpose()?,
            scalars: values(py, &scalars, &vertices.scalars)?,
            colors: carried.colors.then(|| rows(py, vertices.colors)).transpose()?,
            vertices: rows(py, vertices.positions)?,
            faces: rows(py, triangles)?,
            uv,
            images,
            face_images,
            origin,
            error,
            distance,
            cluster_count: clusters,
            shortfall,
        })
    }
}
