//! The page of one cluster.

use crate::error::Failure;
use crate::file::Model;
use crate::view::{look, look_rows, row, rows, values};
use chpm_format::Page as Parsed;
use chpm_mesh::{ClusterId, Places};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// One cluster: a progressive mesh, from its base mesh of ``base_vertex_count`` vertices to its finest of ``vertex_count``.
///
/// The mesh of n vertices has the first n. Every later vertex, from the last on, goes to its target, one that comes before it. Arrays
/// that lie in the file as they are look into it, cannot be written, and keep it mapped; those of a packed page are memory of their own,
/// which cannot be written either.
#[pyclass(frozen, module = "chpm")]
pub(crate) struct Page {
    held: Arc<Held>,
}

/// A page that was checked, and what keeps its bytes.
struct Held {
    model: Arc<Model>,
    cluster: ClusterId,
    /// The page in words, if it was packed.
    unpacked: Option<Vec<u32>>,
}

impl Held {
    fn page(&self) -> Result<Parsed<'_>, Failure> {
        let file = &self.model.file;
        let page = match &self.unpacked {
            Some(words) => {
                let len = file.page_len(self.cluster) as usize;
                Parsed::view(&bytemuck::cast_slice(words)[..len])
            }
            None => Parsed::view(file.page_bytes(self.cluster)),
        };
        // It was checked once; where the file was cut short since, it is all zeros.
        page.map_err(|error| match self.model.check() {
            Ok(()) => Failure::from(error).of(&self.model.path),
            Err(changed) => changed.into(),
        })
    }
}

impl Page {
    /// Reads a page, checks it and its checksum, and unpacks it if it is packed.
    pub(crate) fn read(model: &Arc<Model>, cluster: ClusterId) -> Result<Self, Failure> {
        let unpacked = model.reading(|file| Ok(file.page_checked(cluster)?.into_words()))?;
        Ok(Page { held: Arc::new(Held { model: model.clone(), cluster, unpacked }) })
    }

    fn record(&self) -> &chpm_format::ClusterRecord {
        &self.held.model.file.clusters()[self.held.cluster.index()]
    }
}

#[pymethods]
impl Page {
    /// The number of the cluster: int.
    #[getter]
    fn cluster(&self) -> u32 {
        self.held.cluster.0
    }

    /// Its level; 0 is the finest: int.
    #[getter]
    fn level(&self) -> u32 {
        self.record().level
    }

    /// The group that it is refined with: int.
    #[getter]
    fn group(&self) -> u32 {
        self.record().group().0
    }

    /// Whether it lies packed in the file, so that its arrays are not the file's own: bool.
    #[getter]
    fn is_packed(&self) -> bool {
        self.held.unpacked.is_some()
    }

    /// Vertices of the finest mesh, V: int.
    #[getter]
    fn vertex_count(&self) -> u32 {
        self.record().vertex_count
    }

    /// Vertices of the base mesh, B: int.
    #[getter]
    fn base_vertex_count(&self) -> u32 {
        self.record().base_vertex_count
    }

    /// Triangles of the finest mesh, T: int.
    #[getter]
    fn triangle_count(&self) -> u32 {
        self.record().triangle_count
    }

    /// Triangles of the base mesh: int.
    #[getter]
    fn base_triangle_count(&self) -> u32 {
        self.record().base_triangle_count
    }

    /// The error of the finest mesh, in the model's units: float.
    #[getter]
    fn min_error(&self) -> f32 {
        self.record().min_error
    }

    /// The error of the base mesh, in the model's units: float.
    #[getter]
    fn max_error(&self) -> f32 {
        self.record().max_error
    }

    /// Vertices, relative to the file's origin: float32 of the shape (V, 3), in the model's units.
    #[getter]
    fn vertices(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        look_rows(py, &self.held, self.held.page()?.positions)
    }

    /// Corners of the finest mesh's triangles, as indices into the vertices: uint16 of the shape (T, 3).
    #[getter]
    fn faces(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        look_rows(py, &self.held, self.held.page()?.triangles)
    }

    /// Normals of the vertices: float32 of the shape (V, 3), or None. Those that are stored in three bytes each are a new array.
    #[getter]
    fn normals(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let page = self.held.page()?;
        if !page.octahedral.is_empty() {
            let normals: Vec<_> = page.octahedral.iter().map(|code| code.vector()).collect();
            return Ok(Some(rows(py, normals)?.into_any()));
        }
        let there = self.held.model.file.header().attributes().normals;
        there.then(|| look_rows(py, &self.held, page.normals)).transpose()
    }

    /// Colours of the vertices, red, green, blue and alpha: uint8 of the shape (V, 4), or None.
    #[getter]
    fn colors(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let page = self.held.page()?;
        let there = self.held.model.file.header().attributes().colors;
        there.then(|| look_rows(py, &self.held, page.colors)).transpose()
    }

    /// Values of the named scalars of the vertices: dict of name and a new array of the shape (V,), float32 or, where that does not hold all
    /// values of the source's type, float64.
    #[getter]
    fn scalars(&self, py: Python<'_>) -> PyResult<Py<PyDict>> {
        values(py, self.held.model.file.scalars(), self.held.page()?.scalars)
    }

    /// Where the vertices B, B + 1, ... go: uint16 of the shape (V - B,), indices of vertices.
    #[getter]
    fn targets(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        look(py, &self.held, self.held.page()?.targets)
    }

    /// Ids of the vertices that other clusters have, too, the same in all of them: uint32 of the shape (S,), in the order of
    /// :attr:`shared_vertices`.
    #[getter]
    fn shared_ids(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        look(py, &self.held, self.held.page()?.shared_ids)
    }

    /// Which vertices other clusters have, too: uint16 of the shape (S,), ascending indices of vertices. A new array.
    #[getter]
    fn shared_vertices(&self, py: Python<'_>) -> Result<Py<PyArray1<u16>>, Failure> {
        Ok(row(py, self.held.page()?.shared().map(|(vertex, _)| vertex).collect()))
    }

    /// The errors of the meshes of B, B + 1, ..., V vertices: float32 of the shape (V - B + 1,), in the model's units, falling. A new
    /// array.
    #[getter]
    fn errors(&self, py: Python<'_>) -> Result<Py<PyArray1<f32>>, Failure> {
        let page = self.held.page()?;
        let errors = (page.base_vertex_count..=page.vertex_count()).map(|n| page.error_at(n));
        Ok(row(py, errors.collect()))
    }

    /// The triangles of the mesh of n vertices.
    ///
    /// Parameters
    /// ----------
    /// n : int
    ///     From ``base_vertex_count`` to ``vertex_count``.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray
    ///     uint16 of the shape (t, 3): corners, all less than n.
    fn faces_at(&self, py: Python<'_>, n: u32) -> PyResult<Py<PyArray2<u16>>> {
        let (least, most) = (self.base_vertex_count(), self.vertex_count());
        if !(least..=most).contains(&n) {
            let cluster = self.held.cluster;
            let told = format!("{cluster} has meshes of {least} to {most} vertices, and none of {n}");
            return Err(Failure::Asked(told).into());
        }
        let faces = py.detach(|| {
            let page = self.held.page()?;
            let mut places = Places::default();
            places.go_to(&page.progressive_mesh(), n as usize);
            Ok::<Vec<_>, Failure>(places.triangles(page.triangles).collect())
        })?;
        rows(py, faces)
    }

    fn __repr__(&self) -> String {
        let (cluster, level) = (self.cluster(), self.level());
        let (vertices, triangles) = (self.vertex_count(), self.triangle_count());
        format!("<chpm.Page {cluster}: level {level}, {vertices} vertices, {triangles} triangles>")
    }
}
