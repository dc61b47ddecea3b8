//! An open file.

use crate::asked::{Amount, Asked};
use crate::camera::{Camera, From as Point};
use crate::cast::{self, Hits};
use crate::error::Failure;
use crate::page::Page;
use crate::section::{self, Section};
use crate::selection::{self, Selection};
use crate::view::row;
use chpm_extmem::{ExtmemError, MappedFile};
use chpm_format::{Chpm, ErrorKind};
use chpm_mesh::{ClusterId, Scalar};
use chpm_rays::Seek;
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

pyo3::import_exception!(chpm._errors, ShortfallWarning);

/// A file that is mapped, and its name as it was given.
pub(crate) struct Model {
    pub(crate) file: Chpm<MappedFile>,
    pub(crate) path: PathBuf,
}

impl Model {
    pub(crate) fn open(path: PathBuf) -> Result<Self, Failure> {
        let map = MappedFile::open(&path)?;
        let real = map.real_path();
        match Chpm::open_at(map, &real, MappedFile::open) {
            Ok(file) => Ok(Model { file, path }),
            Err(source) => Err(Failure::Open { path, source }),
        }
    }

    /// Whether the file and its volumes are as they were opened.
    pub(crate) fn check(&self) -> Result<(), ExtmemError> {
        self.file.parts().try_for_each(MappedFile::check_unchanged)
    }

    /// Does what reads the file. Where it was changed meanwhile, that is the error.
    pub(crate) fn reading<T>(
        &self,
        work: impl FnOnce(&Chpm<MappedFile>) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let result = work(&self.file);
        self.check()?;
        result.map_err(|failure| failure.of(&self.path))
    }
}

/// A ``.chpm`` file that is open: what it holds, and the meshes that can be taken out of it.
///
/// Opening reads the tables and no geometry. The file is mapped into memory and should not be changed while it is open; where it was,
/// that is an error of whatever reads it next. Use it in a ``with`` statement, or leave closing to the garbage collector.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
///     The file.
///
/// Raises
/// ------
/// MissingFileError
///     If there is no such file; a FileNotFoundError, too.
/// FileError
///     If it cannot be opened or mapped; an OSError, too.
/// DamagedError
///     If it is no ``.chpm`` file, or a damaged one; a ValueError, too.
#[pyclass(frozen, module = "chpm")]
pub(crate) struct File {
    path: PathBuf,
    open: RwLock<Option<Arc<Model>>>,
}

impl File {
    fn model(&self) -> Result<Arc<Model>, Failure> {
        // Nobody panics while holding it, and what it has is whole in any case.
        let open = self.open.read().unwrap_or_else(PoisonError::into_inner);
        open.clone().ok_or_else(|| Failure::Closed(self.path.clone()))
    }
}

#[pymethods]
impl File {
    #[new]
    pub(crate) fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let model = py.detach(|| Model::open(path.clone()))?;
        Ok(File { path, open: RwLock::new(Some(Arc::new(model))) })
    }

    /// The file's name as it was given: pathlib.Path.
    #[getter]
    fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it is closed: bool.
    #[getter]
    fn closed(&self) -> bool {
        self.model().is_err()
    }

    /// Closes the file. Arrays that look into it keep it mapped as long as they live. Closing twice does nothing.
    fn close(&self) {
        let closed = self.open.write().unwrap_or_else(PoisonError::into_inner).take();
        drop(closed);
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    #[pyo3(signature = (*_raised))]
    fn __exit__(&self, _raised: &Bound<'_, PyTuple>) {
        self.close();
    }

    fn __repr__(&self) -> String {
        let name = self.path.display();
        match self.model() {
            Ok(model) => {
                let header = model.file.header();
                let (triangles, levels) = (header.source_triangle_count, header.level_count);
                format!("<chpm.File '{name}': {triangles} triangles, {levels} levels>")
            }
            Err(_) => format!("<chpm.File '{name}': closed>"),
        }
    }

    /// Triangles of the finest mesh, which is the source's unless the build left detail out: int.
    #[getter]
    fn triangle_count(&self) -> Result<u64, Failure> {
        Ok(self.model()?.file.header().source_triangle_count)
    }

    /// Vertices of the finest mesh: int.
    #[getter]
    fn vertex_count(&self) -> Result<u64, Failure> {
        Ok(self.model()?.file.header().source_vertex_count)
    }

    /// Clusters of all levels, each with a page: int.
    #[getter]
    fn cluster_count(&self) -> Result<u32, Failure> {
        Ok(self.model()?.file.header().cluster_count)
    }

    /// Groups of clusters that are refined together: int.
    #[getter]
    fn group_count(&self) -> Result<u32, Failure> {
        Ok(self.model()?.file.header().group_count)
    }

    /// Clusters that nothing is coarser than: int.
    #[getter]
    fn root_count(&self) -> Result<u32, Failure> {
        Ok(self.model()?.file.header().root_count)
    }

    /// The levels, the finest first: list of Level.
    #[getter]
    fn levels(&self) -> Result<Vec<Level>, Failure> {
        Ok(self.model()?.file.levels().iter().map(Level::of).collect())
    }

    /// The box around the model, with the origin added: float64 of the shape (2, 3), the smallest corner and the largest, in the model's
    /// units. Zeros where the model is empty.
    #[getter]
    fn bounds(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let model = self.model()?;
        let header = model.file.header();
        let corner =
            |corner: [f32; 3]| std::array::from_fn(|axis| f64::from(corner[axis]) + header.origin[axis]);
        crate::view::rows::<f64, 3>(py, vec![corner(header.aabb_min), corner(header.aabb_max)])
    }

    /// The length of the box's diagonal, in the model's units, which shares like ``"0.1%"`` are of: float.
    #[getter]
    fn diagonal(&self) -> Result<f64, Failure> {
        Ok(self.model()?.file.header().aabb().diagonal())
    }

    /// What vertices are relative to, in the model's units: float64 of the shape (3,); zeros unless single precision would not do.
    #[getter]
    fn origin(&self, py: Python<'_>) -> Result<Py<PyArray1<f64>>, Failure> {
        Ok(row(py, self.model()?.file.header().origin.to_vec()))
    }

    /// The largest error of a base mesh, in the model's units: float.
    #[getter]
    fn max_error(&self) -> Result<f32, Failure> {
        Ok(self.model()?.file.header().max_error)
    }

    /// Whether errors are proven bounds, and not estimates: bool.
    #[getter]
    fn is_certified(&self) -> Result<bool, Failure> {
        Ok(self.model()?.file.header().error_kind() == Some(ErrorKind::Certified))
    }

    /// Whether vertices have normals: bool.
    #[getter]
    fn has_normals(&self) -> Result<bool, Failure> {
        Ok(self.model()?.file.header().attributes().has_normals())
    }

    /// Whether vertices have colours: bool.
    #[getter]
    fn has_colors(&self) -> Result<bool, Failure> {
        Ok(self.model()?.file.header().attributes().colors)
    }

    /// Named scalars of the vertices: dict of name and a dict of ``type``, as the source had it, ``low`` and ``high``, the range of its
    /// values, and ``count``, the vertices with a value that is a number.
    #[getter]
    fn scalars(&self, py: Python<'_>) -> PyResult<Py<PyDict>> {
        let all = PyDict::new(py);
        for Scalar { name, kind, range } in self.model()?.file.scalars() {
            let told = PyDict::new(py);
            told.set_item("type", kind.to_string())?;
            told.set_item("low", range.low)?;
            told.set_item("high", range.high)?;
            told.set_item("count", range.count)?;
            all.set_item(name, told)?;
        }
        Ok(all.unbind())
    }

    /// Whether pages may be packed, so that they have to be unpacked before they can be looked at: bool.
    #[getter]
    fn is_packed(&self) -> Result<bool, Failure> {
        Ok(self.model()?.file.header().is_packed())
    }

    /// The version of the file's format, major and minor: tuple of 2 ints.
    #[getter]
    fn version(&self) -> Result<(u16, u16), Failure> {
        let model = self.model()?;
        let header = model.file.header();
        Ok((header.version_major, header.version_minor))
    }

    /// Where the file comes from: dict with "generator" (str), "source" (dict: name, byte_len, hash, encoding, vertex_count, face_count,
    /// comments), "settings" (dict of str), "repairs" (dict of int) and "warnings" (list of str).
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let model = self.model()?;
        let told = model.reading(|file| Ok(file.metadata()?))?;
        let source = PyDict::new(py);
        source.set_item("name", told.source.name)?;
        source.set_item("byte_len", told.source.byte_len)?;
        source.set_item("hash", told.source.hash)?;
        source.set_item("encoding", told.source.encoding)?;
        source.set_item("vertex_count", told.source.vertex_count)?;
        source.set_item("face_count", told.source.face_count)?;
        source.set_item("comments", told.source.comments)?;
        let all = PyDict::new(py);
        all.set_item("generator", told.generator)?;
        all.set_item("source", source)?;
        all.set_item("settings", PyDict::from_sequence(told.settings.into_pyobject(py)?.as_any())?)?;
        all.set_item("repairs", PyDict::from_sequence(told.repairs.into_pyobject(py)?.as_any())?)?;
        all.set_item("warnings", told.warnings)?;
        Ok(all)
    }

    /// The camera that looks at the whole model along the z axis, which is used where none is given: Camera.
    fn camera(&self) -> Result<Camera, Failure> {
        Ok(Camera::whole(&self.model()?.file))
    }

    /// Says whether the file is still what was opened.
    ///
    /// Raises
    /// ------
    /// FileError
    ///     If somebody has cut it short or changed it: then arrays that look into it show the change, or zeros.
    fn check(&self) -> Result<(), Failure> {
        Ok(self.model()?.check()?)
    }

    /// Takes one mesh without cracks out of the file, the same that ``chpm extract`` writes.
    ///
    /// One of these is given; all by keyword:
    ///
    /// Parameters
    /// ----------
    /// error : float or str
    ///     The coarsest mesh that is nowhere farther from the source, nor the source from it: in the model's units or, as in ``"0.1%"``,
    ///     of the diagonal of its box. Nothing is exempt.
    /// triangles : int or str
    ///     The finest mesh of at most so many triangles, as in ``20000`` or ``"20k"``, or of a share of the model's, as in ``"1%"``: of the
    ///     least error everywhere or, with ``camera``, in the picture.
    /// level : int
    ///     All clusters of a level at their finest; 0 is the source.
    /// pixels : float
    ///     The coarsest mesh whose error covers at most so many pixels, wherever it is seen by the camera; 1 where there is only a camera.
    ///
    /// And with ``pixels`` or ``triangles``, or alone:
    ///
    /// camera : Camera or sequence of 6 or 7 floats
    ///     Where the picture is taken from: position, target and, perhaps, the field of view in degrees. :meth:`camera` if not given.
    /// viewport : tuple of 2 ints
    ///     Width and height of the image in pixels; 512 by 512 if not given.
    /// cull : bool
    ///     Leave what is outside the image as coarse as it gets.
    /// texture_size : int
    ///     Give the mesh the sheets of a file that has them, in images of at most so many texels a side; where one is
    ///     enough, its texels are as fine as fit. Vertices are there once for each chart that
    ///     shows them, and have no colours and no scalars then.
    /// strict : bool
    ///     Raise where the file gives less than was asked for, in place of a ShortfallWarning.
    ///
    /// Returns
    /// -------
    /// Selection
    ///     The mesh, as arrays.
    ///
    /// Raises
    /// ------
    /// SelectionError
    ///     If the request makes no sense, or the file does not have it; a ValueError, too.
    /// DamagedError, FileError
    ///     If the file is damaged, or was changed meanwhile.
    /// MemoryError
    ///     If the mesh does not fit into memory.
    #[pyo3(signature = (*, error=None, triangles=None, level=None, pixels=None, camera=None, viewport=None, cull=false, texture_size=None, strict=false))]
    #[expect(clippy::too_many_arguments, reason = "they are Python's keywords")]
    fn select(
        &self,
        py: Python<'_>,
        error: Option<Amount>,
        triangles: Option<Amount>,
        level: Option<i64>,
        pixels: Option<f64>,
        camera: Option<Point>,
        viewport: Option<[u32; 2]>,
        cull: bool,
        texture_size: Option<u32>,
        strict: bool,
    ) -> PyResult<Selection> {
        let model = self.model()?;
        let number = |level: i64| {
            u32::try_from(level)
                .map_err(|_| Failure::Asked(format!("level {level}: levels are numbered from 0, the source")))
        };
        let level = level.map(number).transpose()?;
        let asked = Asked { error, triangles, level, pixels, camera, viewport, cull, texture_size };
        let selected = py.detach(|| selection::select(&model, &asked))?;
        if let Some(told) = &selected.shortfall {
            if strict {
                return Err(Failure::Asked(told.clone()).into());
            }
            let told = std::ffi::CString::new(told.as_str())?;
            PyErr::warn(py, &py.get_type::<ShortfallWarning>(), &told, 1)?;
        }
        let origin = self.origin(py)?;
        Selection::new(py, selected, origin)
    }

    /// Cuts the finest mesh by a plane, exactly: what ``chpm section --plane`` writes.
    ///
    /// Parameters
    /// ----------
    /// plane : sequence of 4 floats
    ///     Its normal, of any length, and its distance from the zero point along it, in the model's units.
    /// error : float or str, optional
    ///     Cut the mesh that :meth:`select` gives for this in place of the finest. Its points are as near to the source, but nothing bounds how far the source's own lines are
    ///     from these.
    ///
    /// Returns
    /// -------
    /// Section
    ///     Lines, as arrays.
    ///
    /// Raises
    /// ------
    /// SelectionError
    ///     If the normal has no direction; a ValueError, too.
    /// DamagedError, FileError
    ///     If the file is damaged, or was changed meanwhile.
    #[pyo3(signature = (plane, *, error=None))]
    fn section(&self, py: Python<'_>, plane: [f64; 4], error: Option<Amount>) -> PyResult<Section> {
        let model = self.model()?;
        let found = py.detach(|| section::cut(&model, plane, error))?;
        Section::new(py, found, model.file.header().origin)
    }

    /// What rays meet: what ``chpm rays`` writes. All processors take part, and at most 512 MB of pages are kept; a page is read once for all rays that wait for it, so give many at a time.
    ///
    /// Parameters
    /// ----------
    /// origins : array_like
    ///     Where rays begin, of the shape (n, 3), in the model's units.
    /// directions : array_like
    ///     Where they go, of the shape (n, 3); of any length but zero.
    /// error : float or str
    ///     How far from the source the mesh may be that is met: in the model's units or, as in ``"0.1%"``, of the diagonal of its box. 0 is the source's own triangles: hits and misses are the
    ///     source's. Hits of a coarse mesh are not proven, but ``least`` is.
    /// any : bool
    ///     Only whether a ray meets anything: faster.
    /// reach : float, optional
    ///     How far rays go, in the model's units.
    ///
    /// Returns
    /// -------
    /// Hits
    ///     Arrays with a row for each ray.
    ///
    /// Raises
    /// ------
    /// SelectionError
    ///     If arrays have another shape, a number is masked or not finite, a direction has no length, or the file has no proven errors and ``error`` is above 0; a ValueError, too.
    /// DamagedError, FileError
    ///     If the file is damaged, or was changed meanwhile.
    #[pyo3(signature = (origins, directions, *, error=None, any=false, reach=None))]
    fn cast(
        &self,
        py: Python<'_>,
        origins: &Bound<'_, PyAny>,
        directions: &Bound<'_, PyAny>,
        error: Option<Amount>,
        any: bool,
        reach: Option<f64>,
    ) -> PyResult<Hits> {
        let model = self.model()?;
        let origin = model.file.header().origin;
        let rays = cast::rays(origins, directions, reach, origin)?;
        let seek = if any { Seek::Any } else { Seek::Nearest };
        Hits::new(py, cast::cast(py, &model, &rays, error.as_ref(), seek)?, any, origin)
    }

    /// The page of a cluster.
    ///
    /// Parameters
    /// ----------
    /// cluster : int
    ///     Its number, from 0; a negative one counts from the end.
    ///
    /// Returns
    /// -------
    /// Page
    ///     Its arrays look into the file, where the page is not packed.
    ///
    /// Raises
    /// ------
    /// IndexError
    ///     If the file has no such cluster.
    /// DamagedError, FileError
    ///     If the page is damaged, or the file was changed.
    fn page(&self, py: Python<'_>, cluster: i64) -> PyResult<Page> {
        let model = self.model()?;
        let count = i64::from(model.file.header().cluster_count);
        let at = if cluster < 0 { cluster + count } else { cluster };
        if !(0..count).contains(&at) {
            let name = self.path.display();
            let told = format!("'{name}' has no cluster {cluster}: there are {count}, from 0 on");
            return Err(PyIndexError::new_err(told));
        }
        Ok(py.detach(|| Page::read(&model, ClusterId(at as u32)))?)
    }

    /// The pages of all clusters, or of those of one level, in the order of the file.
    ///
    /// Parameters
    /// ----------
    /// level : int, optional
    ///     0 is the finest. All levels if not given.
    ///
    /// Returns
    /// -------
    /// iterator of Page
    ///     Each is read when it is asked for.
    #[pyo3(signature = (*, level=None))]
    fn pages(&self, level: Option<u32>) -> Result<Pages, Failure> {
        let model = self.model()?;
        let header = model.file.header();
        if let Some(got) = level.filter(|level| *level >= header.level_count) {
            let source = chpm_refine::RefineError::Level { got, highest: header.level_count - 1 };
            return Err(Failure::from(source).of(&self.path));
        }
        Ok(Pages { model, level, next: 0 })
    }

    fn __len__(&self) -> Result<usize, Failure> {
        Ok(self.model()?.file.clusters().len())
    }
}

/// Pages, one after the other.
#[pyclass(module = "chpm")]
pub(crate) struct Pages {
    model: Arc<Model>,
    level: Option<u32>,
    next: u32,
}

#[pymethods]
impl Pages {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__(&mut self, py: Python<'_>) -> PyResult<Option<Page>> {
        let model = self.model.clone();
        let rest = model.file.clusters().iter().enumerate().skip(self.next as usize);
        let wanted = |level: u32| self.level.is_none_or(|wanted| wanted == level);
        let Some((at, _)) = rest.into_iter().find(|(_, record)| wanted(record.level)) else {
            return Ok(None);
        };
        self.next = at as u32 + 1;
        Ok(Some(py.detach(|| Page::read(&model, ClusterId(at as u32)))?))
    }
}

/// What one level of a file has.
#[pyclass(frozen, get_all, module = "chpm")]
pub(crate) struct Level {
    /// Its number; 0 is the finest: int.
    level: u32,
    /// Its clusters: int.
    cluster_count: u32,
    /// Vertices of its clusters' finest meshes; those that several have count for each: int.
    vertex_count: u64,
    /// Triangles of its clusters' finest meshes: int.
    triangle_count: u64,
    /// Triangles of its clusters' base meshes, which are the finest meshes of the level above: int.
    base_triangle_count: u64,
    /// The smallest error of a finest mesh, in the model's units: float.
    min_error: f32,
    /// The largest error of a base mesh, in the model's units: float.
    max_error: f32,
}

impl Level {
    fn of(record: &chpm_format::LevelRecord) -> Self {
        Level {
            level: record.level,
            cluster_count: record.cluster_count,
            vertex_count: record.vertex_count,
            triangle_count: record.triangle_count,
            base_triangle_count: record.base_triangle_count,
            min_error: record.min_error,
            max_error: record.max_error,
        }
    }
}

#[pymethods]
impl Level {
    fn __repr__(&self) -> String {
        let Level { level, cluster_count, triangle_count, .. } = self;
        format!("<chpm.Level {level}: {cluster_count} clusters, {triangle_count} triangles>")
    }
}
