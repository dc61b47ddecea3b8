//! An indexed triangle mesh in core, with optional per-vertex attributes.

use serde::{Deserialize, Serialize};

/// Which per-vertex attributes a mesh carries; an attribute that is not there takes no bytes.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct Attributes {
    /// Unit (or as-given) normals, three f32 each.
    pub normals: bool,
    /// Colours, four bytes each: red, green, blue, alpha.
    pub colors: bool,
}

impl Attributes {
    /// Positions only.
    pub const NONE: Attributes = Attributes { normals: false, colors: false };

    /// Bytes of a vertex: its position and what it carries.
    pub fn vertex_len(self) -> usize {
        12 + if self.normals { 12 } else { 0 } + if self.colors { 4 } else { 0 }
    }
}

/// Triangles over shared vertices. `normals` and `colors` are empty or as long as `positions`.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct TriMesh {
    /// Vertex positions, object units.
    pub positions: Vec<[f32; 3]>,
    /// Vertex normals, or empty.
    pub normals: Vec<[f32; 3]>,
    /// Vertex colours (RGBA), or empty.
    pub colors: Vec<[u8; 4]>,
    /// Corner indices into the vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// A mesh of positions and triangles alone.
    pub fn new(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Self {
        TriMesh { positions, triangles, ..TriMesh::default() }
    }

    /// What the vertices carry.
    pub fn attributes(&self) -> Attributes {
        Attributes { normals: !self.normals.is_empty(), colors: !self.colors.is_empty() }
    }

    /// The three corner positions of a triangle.
    pub fn corners(&self, triangle: [u32; 3]) -> [[f32; 3]; 3] {
        triangle.map(|v| self.positions[v as usize])
    }
}
