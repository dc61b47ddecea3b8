//! An indexed triangle mesh in core, with optional per-vertex attributes.

use crate::vertices::Vertices;
use std::ops::{Deref, DerefMut};

/// Triangles over shared vertices, whose arrays are reached as the mesh's own: `mesh.positions`.
///
/// ```
/// use chpm_mesh::TriMesh;
///
/// let mesh = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
/// assert_eq!(mesh.corners(mesh.triangles[0])[1], [1.0, 0.0, 0.0]);
/// ```
#[derive(Clone, PartialEq, Debug, Default)]
pub struct TriMesh {
    /// Positions and what else the vertices carry.
    pub vertices: Vertices,
    /// Corner indices into the vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// A mesh of positions and triangles alone.
    pub fn new(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Self {
        TriMesh { vertices: Vertices::new(positions), triangles }
    }

    /// The three corner positions of a triangle.
    pub fn corners(&self, triangle: [u32; 3]) -> [[f32; 3]; 3] {
        triangle.map(|v| self.positions[v as usize])
    }
}

impl Deref for TriMesh {
    type Target = Vertices;

    #[inline]
    fn deref(&self) -> &Vertices {
        &self.vertices
    }
}

impl DerefMut for TriMesh {
    #[inline]
    fn deref_mut(&mut self) -> &mut Vertices {
        &mut self.vertices
    }
}
