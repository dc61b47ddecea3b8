//! The pass that averages.

use crate::footprint::Footprint;
use crate::images::{Images, Sizes, Strips};
use crate::piece::Piece;
use crate::shares::Shares;
use crate::{Material, TextureError, TexturedTriangle, VertexColors};
use chpm_extmem::{BufferWriter, Cancel, Sorted, Sorter, Store};

/// Triangles that are taken at once.
const AT_ONCE: usize = 1 << 12;
/// Texels that a triangle counts for whose material has no image, or that has no coordinates.
const PLAIN: f64 = 1.0;
const LOST: f64 = 1.0 / 256.0;

/// Gathers the triangles of a textured mesh and averages what they cover.
pub struct Averager {
    store: Store,
    triangles: BufferWriter<TexturedTriangle>,
}

impl Averager {
    /// Nothing yet; arrays and work are within the budget of `store`.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn new(store: &Store) -> Result<Self, TextureError> {
        let triangles = BufferWriter::new(store, "textured triangles", 0)?;
        Ok(Averager { store: store.clone(), triangles })
    }

    /// Takes a triangle.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn push(&mut self, triangle: &TexturedTriangle) -> Result<(), TextureError> {
        Ok(self.triangles.extend_from_slice(std::slice::from_ref(triangle))?)
    }

    /// Colours of all vertices. A triangle without finite coordinates, or of a material without an image, has the material's factor; a vertex
    /// without any material is white.
    ///
    /// # Errors
    /// [`TextureError`]: of images, of a vertex that is not there, of the disk, or that it was to stop.
    pub fn finish(
        self,
        materials: &[Material],
        images: &mut Images<'_, '_>,
        vertex_count: usize,
        cancel: &Cancel,
    ) -> Result<VertexColors, TextureError> {
        let store = self.store.clone();
        let mut shares = Shares::new(&store, vertex_count)?;
        let pieces = self.cut(materials, images, vertex_count, &mut shares, cancel)?;
        average(&store, pieces, materials, images, &mut shares, cancel)?;
        Ok(shares.finish()?)
    }

    /// Sorts what triangles cover by image and strip. Those that cover nothing of an image are done with.
    fn cut(
        self,
        materials: &[Material],
        images: &mut Images<'_, '_>,
        vertex_count: usize,
        shares: &mut Shares,
        cancel: &Cancel,
    ) -> Result<Sorted<Piece>, TextureError> {
        let mut pieces = Sorter::new(&self.store, "texels of triangles");
        let triangles = self.triangles.finish_column()?;
        let (mut sizes, mut scratch) = (Sizes::default(), Vec::new());
        for start in (0..triangles.len()).step_by(AT_ONCE) {
            cancel.check()?;
            let range = start..triangles.len().min(start + AT_ONCE);
            for triangle in triangles.read(range, &mut scratch)? {
                let TexturedTriangle { vertices, uv, material: number } = *triangle;
                let Some(material) = materials.get(number as usize) else { continue };
                if let Some(&vertex) = vertices.iter().find(|vertex| **vertex as usize >= vertex_count) {
                    return Err(TextureError::VertexOutOfRange { vertex, count: vertex_count });
                }
                let Some(image) = material.image else {
                    shares.add_to_all(vertices, &[material.plain_share(PLAIN); 3])?;
                    continue;
                };
                let size = sizes.get(image, images)?;
                let Some(footprint) = Footprint::new(uv, size, material.wrap) else {
                    shares.add_to_all(vertices, &[material.plain_share(LOST); 3])?;
                    continue;
                };
                let (corners, rows) = (footprint.corners, footprint.rows());
                let piece = Piece { image, strip: 0, corners, rows, vertices, material: number };
                piece.cut(size, material.wrap[1], |piece| pieces.push(piece))?;
            }
        }
        Ok(pieces.finish()?)
    }
}

/// Decodes images and gives texels to corners.
fn average(
    store: &Store,
    mut pieces: Sorted<Piece>,
    materials: &[Material],
    images: &mut Images<'_, '_>,
    shares: &mut Shares,
    cancel: &Cancel,
) -> Result<(), TextureError> {
    let mut next = pieces.next()?;
    while let Some(Piece { image, .. }) = next {
        let mut strips = Strips::open(store, image, images)?;
        while let Some(piece) = next.filter(|piece| piece.image == image) {
            strips.go_to(piece.strip, cancel)?;
            let material = &materials[piece.material as usize];
            let found = piece.footprint().shares(piece.rows, &strips, material);
            shares.add_to_all(piece.vertices, &found)?;
            next = pieces.next()?;
        }
    }
    Ok(())
}
