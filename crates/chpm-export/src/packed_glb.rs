//! glTF with `EXT_meshopt_compression`, in pieces. How long a piece becomes is known when it is compressed, and comes in front of all of them: so
//! a first pass over the mesh measures, and a second one writes.

use crate::container::Container;
use crate::error::{ExportError, expect};
use crate::gltf::{Facts, Part, document, padded};
use crate::grid::Grid;
use crate::vertex::{Interleave, Stride};
use bytemuck::Pod;
use chpm_mesh::{Aabb, Attributes, VertexSlices};
use std::io::Write;

/// Vertices that a piece has at most, so that its indices have 16 bits.
pub const PIECE_VERTICES: usize = 0xffff;

/// The extension knows the codec's first version only.
const CODEC: i32 = 0;

/// Measures the pieces of a mesh.
pub struct PackedGlb {
    facts: Facts,
    attributes: Attributes,
    parts: Vec<Vec<Part>>,
}

/// Writes the pieces that were measured.
pub struct PackedGlbWriter<W: Write> {
    container: Container<W>,
    attributes: Attributes,
    grid: Option<Grid>,
    parts: std::vec::IntoIter<Part>,
}

impl PackedGlb {
    /// No piece yet. Named scalars are left out: the codec packs vertices of few lengths.
    pub fn new(mut facts: Facts, attributes: Attributes) -> Self {
        facts.scalars.clear();
        PackedGlb { facts, attributes, parts: vec![Vec::new()] }
    }

    /// Takes the next piece into account.
    ///
    /// # Errors
    /// [`ExportError::Compression`].
    pub fn measure(&mut self, vertices: VertexSlices<'_>, triangles: &[[u32; 3]]) -> Result<(), ExportError> {
        let packed = compressed((self.attributes, self.facts.grid), vertices, triangles)?
            .map(|bytes| bytes.len() as u64);
        let level = self.parts.len() - 1;
        self.parts[level].push(part(vertices, triangles, packed));
        Ok(())
    }

    /// Goes on to the next level.
    pub fn next_level(&mut self) {
        self.parts.push(Vec::new());
    }

    /// Writes all that is in front of the pieces.
    ///
    /// # Errors
    /// [`ExportError::Count`] for other levels than the facts are of; [`ExportError::TooLarge`] beyond the 4 GiB that a GLB may have; [`ExportError::Write`].
    pub fn begin<W: Write>(self, mut container: Container<W>) -> Result<PackedGlbWriter<W>, ExportError> {
        expect("levels", self.facts.levels.len() as u64, self.parts.len() as u64)?;
        let (root, body) = document(&self.facts, self.attributes, &self.parts);
        container.begin(root, body)?;
        Ok(PackedGlbWriter {
            container,
            attributes: self.attributes,
            grid: self.facts.grid,
            parts: self.parts.concat().into_iter(),
        })
    }
}

impl<W: Write> PackedGlbWriter<W> {
    /// Writes the next piece of all levels, the same as it was measured.
    ///
    /// # Errors
    /// [`ExportError::Count`] if it is another one; [`ExportError::Compression`]; [`ExportError::Write`].
    pub fn write(&mut self, vertices: VertexSlices<'_>, triangles: &[[u32; 3]]) -> Result<(), ExportError> {
        let measured = self.parts.next().and_then(|part| part.packed).unwrap_or_default();
        let packed = compressed((self.attributes, self.grid), vertices, triangles)?;
        for (mut bytes, measured) in packed.into_iter().zip(measured) {
            expect("bytes of a piece", measured, bytes.len() as u64)?;
            bytes.resize(padded(measured) as usize, 0);
            self.container.write(&bytes)?;
        }
        Ok(())
    }

    /// Ends the file and gives the output back.
    ///
    /// # Errors
    /// [`ExportError::Count`] if pieces are missing; [`ExportError::Write`].
    pub fn finish(self) -> Result<Container<W>, ExportError> {
        expect("pieces", 0, self.parts.len() as u64)?;
        self.container.finish()
    }
}

/// A GLB of one piece, in memory.
pub(crate) fn whole(
    facts: &Facts,
    attributes: Attributes,
    vertices: VertexSlices<'_>,
    triangles: &[[u32; 3]],
) -> Result<Vec<u8>, ExportError> {
    let packed = compressed((attributes, facts.grid), vertices, triangles)?;
    let part = part(vertices, triangles, packed.each_ref().map(|bytes| bytes.len() as u64));
    let mut container = Container::Glb(Vec::new());
    let (root, body) = document(facts, attributes, &[vec![part]]);
    container.begin(root, body)?;
    for mut bytes in packed {
        bytes.resize(padded(bytes.len() as u64) as usize, 0);
        container.write(&bytes)?;
    }
    Ok(container.into_main())
}

fn part(vertices: VertexSlices<'_>, triangles: &[[u32; 3]], packed: [u64; 2]) -> Part {
    let bounds = Aabb::of_points(vertices.positions);
    let (vertices, triangles) = (vertices.positions.len() as u64, triangles.len() as u64);
    Part { vertices, triangles, low: bounds.min, high: bounds.max, packed: Some(packed) }
}

/// Vertices and indices.
fn compressed(
    (attributes, grid): (Attributes, Option<Grid>),
    vertices: VertexSlices<'_>,
    triangles: &[[u32; 3]],
) -> Result<[Vec<u8>; 2], ExportError> {
    let mut plain = Vec::new();
    Interleave::new(attributes, &[], grid).append(vertices, &mut plain);
    let packed = match Stride::of(attributes, 0, grid.is_some()).bytes {
        8 => packed_vertices(bytemuck::cast_slice::<u8, [u8; 8]>(&plain)),
        12 => packed_vertices(bytemuck::cast_slice::<u8, [u8; 12]>(&plain)),
        16 => packed_vertices(bytemuck::cast_slice::<u8, [u8; 16]>(&plain)),
        20 => packed_vertices(bytemuck::cast_slice::<u8, [u8; 20]>(&plain)),
        24 => packed_vertices(bytemuck::cast_slice::<u8, [u8; 24]>(&plain)),
        _ => packed_vertices(bytemuck::cast_slice::<u8, [u8; 32]>(&plain)),
    };
    Ok([packed?, packed_indices(triangles, vertices.positions.len())?])
}

/// Vertices, packed; an item of theirs has a multiple of four bytes.
pub(crate) fn packed_vertices<T: Pod>(items: &[T]) -> Result<Vec<u8>, ExportError> {
    named(size_of_val(items), meshopt::encode_vertex_buffer_level(items, 2, Some(CODEC)))
}

/// Triangles over so many vertices, packed.
pub(crate) fn packed_indices(triangles: &[[u32; 3]], vertices: usize) -> Result<Vec<u8>, ExportError> {
    named(size_of_val(triangles), meshopt::encode_index_buffer(triangles.as_flattened(), vertices))
}

fn named(bytes: usize, packed: meshopt::Result<Vec<u8>>) -> Result<Vec<u8>, ExportError> {
    packed.map_err(|error| ExportError::Compression { bytes, reason: error.to_string() })
}
