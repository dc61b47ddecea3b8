//! Colours of vertices.

use chpm_extmem::{Column, ExtmemError};
use std::ops::Range;

/// A colour for each vertex, as sRGB has it, with straight alpha: in memory or on disk.
#[derive(Debug)]
pub struct VertexColors(pub(crate) Column<[u8; 4]>);

impl VertexColors {
    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Colours of a range of vertices; `scratch` holds those that come from disk.
    ///
    /// # Errors
    /// [`ExtmemError::OutOfRange`], or those of the disk.
    pub fn read<'a>(
        &'a self,
        vertices: Range<usize>,
        scratch: &'a mut Vec<[u8; 4]>,
    ) -> Result<&'a [[u8; 4]], ExtmemError> {
        self.0.read(vertices, scratch)
    }
}
