//! A mesh of any format in memory, as it is in its file: for what compares whole meshes.

use crate::error::VerifyError;
use chpm_extmem::{Cancel, Progress, Store};
use chpm_import::ply::{Batch, BatchKind, Options};
use chpm_import::{Input, Triangulator, polygon};
use chpm_mesh::TriMesh;
use std::path::Path;

/// Positions in double precision, and triangles.
pub struct Points {
    /// Where vertices are.
    pub positions: Vec<[f64; 3]>,
    /// Corners of triangles, as indices of positions.
    pub triangles: Vec<[u32; 3]>,
}

impl Points {
    /// Reads a file; `store` is where the corners of an STL are joined.
    ///
    /// # Errors
    /// [`VerifyError::Source`], or those of the store.
    pub fn read(
        path: &Path,
        store: &Store,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Self, VerifyError> {
        let options = Options { normals: false, colors: false, ..Options::default() };
        let mut input = Input::open(path, options, store, cancel)?;
        let (mut batch, mut before) = (Batch::default(), 0);
        let mut points = Points { positions: Vec::new(), triangles: Vec::new() };
        let mut polygons = Vec::new();
        progress.begin("read", path.metadata().map_or(0, |metadata| metadata.len()));
        while input.next_batch(&mut batch)? != BatchKind::End {
            points.positions.extend(batch.vertices.positions.iter().map(|p| p.map(f64::from)));
            points.positions.append(&mut batch.positions_f64);
            points.triangles.append(&mut batch.triangles);
            polygons.extend_from_slice(batch.polygons.as_words());
            progress.advance(input.bytes_read() - before);
            before = input.bytes_read();
        }
        let (mut triangulator, mut places) = (Triangulator::default(), Vec::new());
        for corners in polygon::each(&polygons) {
            places.clear();
            places.extend(corners.iter().filter_map(|corner| points.positions.get(*corner as usize)));
            if places.len() == corners.len() {
                triangulator.cut(corners, &places, &mut points.triangles);
            }
        }
        progress.end();
        Ok(points)
    }

    /// In single precision, relative to `origin`.
    pub fn relative(self, origin: [f64; 3]) -> TriMesh {
        let positions =
            self.positions.iter().map(|p| std::array::from_fn(|axis| (p[axis] - origin[axis]) as f32));
        TriMesh::new(positions.collect(), self.triangles)
    }

    /// Whether single precision holds all of it.
    pub fn is_single(&self) -> bool {
        self.positions.iter().flatten().all(|x| f64::from(*x as f32) == *x)
    }
}
