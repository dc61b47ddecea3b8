//! The pass that averages.

use crate::{Material, TextureError, TexturedTriangle, VertexColors};
use chpm_extmem::{BufferWriter, Cancel, Column, Store};
use chpm_image::ImageRows;
use std::io::{self, BufRead};

/// Opens an image by its number. An image may be opened twice: for its size, then for its pixels.
pub type OpenImage<'a> = dyn FnMut(u32) -> io::Result<Box<dyn BufRead + Send>> + 'a;

/// Colour of a vertex that no material says anything about.
const WHITE: [u8; 4] = [255; 4];

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

    /// Colours of all vertices. A corner without finite coordinates, or of a material without an image, has the material's factor; a vertex without
    /// any material is white.
    ///
    /// # Errors
    /// [`TextureError`]: of images, of a vertex that is not there, of the disk, or that it was to stop.
    pub fn finish(
        self,
        materials: &[Material],
        open_image: &mut OpenImage<'_>,
        vertex_count: usize,
        cancel: &Cancel,
    ) -> Result<VertexColors, TextureError> {
        let mut colors = Column::zeroed(&self.store, "colours of vertices", vertex_count)?;
        let triangles = self.triangles.finish()?;
        for start in 0..vertex_count {
            colors.write(start, &[WHITE])?;
        }
        for triangle in triangles.iter() {
            cancel.check()?;
            let Some(material) = materials.get(triangle.material as usize) else { continue };
            let mut color = material.factor.map(|part| (part.clamp(0.0, 1.0) * 255.0).round() as u8);
            if let Some(image) = material.image {
                color = first_pixel(image, open_image)?;
            }
            for vertex in triangle.vertices {
                if vertex as usize >= vertex_count {
                    return Err(TextureError::VertexOutOfRange { vertex, count: vertex_count });
                }
                colors.write(vertex as usize, &[color])?;
            }
        }
        Ok(VertexColors(colors))
    }
}

/// Placeholder until images are averaged.
fn first_pixel(image: u32, open_image: &mut OpenImage<'_>) -> Result<[u8; 4], TextureError> {
    let bytes = open_image(image).map_err(|source| TextureError::Open { image, source })?;
    let error = |source| TextureError::Image { image, source };
    let mut pixels = Vec::new();
    ImageRows::open(bytes, 64 << 20).map_err(error)?.read_rows(1, &mut pixels).map_err(error)?;
    Ok(pixels.first().copied().unwrap_or(WHITE))
}
