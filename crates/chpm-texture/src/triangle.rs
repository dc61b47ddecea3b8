//! Triangles with texture coordinates.

use bytemuck::{Pod, Zeroable};

/// A triangle of a source.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct TexturedTriangle {
    /// Numbers of its vertices.
    pub vertices: [u32; 3],
    /// Coordinates of its corners in the image, the second one upwards: row `(1 - v) * height` is there. NaN where a corner has none.
    pub uv: [[f32; 2]; 3],
    /// Number of its material; [`Self::NO_MATERIAL`] or any other that there is not for none.
    pub material: u32,
}

impl TexturedTriangle {
    /// Material of a triangle without one: it leaves the colours of its vertices as they are.
    pub const NO_MATERIAL: u32 = u32::MAX;
}
