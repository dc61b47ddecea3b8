//! Colours of vertices out of the images of a source.

use super::used::Used;
use crate::context::Context;
use crate::error::BuildError;
use chpm_extmem::{BufferWriter, Column, Store};
use chpm_import::{Supply, Textures};
use chpm_texture::{Averager, Images, TextureError, TexturedTriangle, Tiles, srgb_product};

/// Vertices that are coloured at once.
const WINDOW: usize = 1 << 14;

/// The tint that changes nothing.
const WHITE: [u8; 4] = [255; 4];

/// Textured triangles of a source, while they come.
pub(super) struct Texels {
    averager: Averager,
    /// Vertices that they have, where others may have colours of their own.
    painted: Option<Used>,
    /// All of them, where they are to be painted each by itself.
    kept: Option<BufferWriter<TexturedTriangle>>,
}

impl Texels {
    /// None yet, of a source whose vertices have colours of their own or not; they are kept if `keeps`.
    pub(super) fn new(store: &Store, has_colors: bool, keeps: bool) -> Result<Self, BuildError> {
        let painted = has_colors.then(|| Used::new(store)).transpose()?;
        let averager = Averager::new(store).map_err(|error| failed(error, |_| String::new()))?;
        let kept = keeps.then(|| BufferWriter::new(store, "textured triangles", 0)).transpose()?;
        Ok(Texels { averager, painted, kept })
    }

    /// Those that were kept, and what they show of all images; none where no material has one.
    pub(super) fn kept(
        &mut self,
        textures: &Textures,
        supply: &Supply,
        context: &Context<'_>,
    ) -> Result<Option<(Column<TexturedTriangle>, Tiles)>, BuildError> {
        let Some(kept) = self.kept.take().filter(|_| !textures.are_plain) else { return Ok(None) };
        let (kept, images) = (kept.finish_column()?, &textures.images);
        let mut open = |image: u32| images[image as usize].open();
        let materials = &textures.materials;
        let tiles = Tiles::read(&context.store, images.len(), &mut open, &kept, materials, &context.cancel);
        let tiles = tiles.map_err(|error| failed(error, |image| named(textures, supply, image)))?;
        Ok(Some((kept, tiles)))
    }

    /// Takes triangles of so many vertices up to now.
    pub(super) fn take(&mut self, triangles: &[TexturedTriangle], vertices: usize) -> Result<(), BuildError> {
        if let Some(kept) = &mut self.kept {
            kept.extend_from_slice(triangles)?;
        }
        for triangle in triangles {
            self.averager.push(triangle).map_err(|error| failed(error, |_| String::new()))?;
            if let Some(painted) = &mut self.painted {
                painted.add(&[triangle.vertices], vertices)?;
            }
        }
        Ok(())
    }

    /// Colours of all vertices; of texels that are there already, images are not decoded again. Their `own` stay where there is no texture, and tint it elsewhere if textures ask for it: how many
    /// do that is told.
    pub(super) fn finish(
        self,
        textures: &Textures,
        tiles: Option<&Tiles>,
        own: Option<&Column<[u8; 4]>>,
        vertices: usize,
        supply: &Supply,
        context: &Context<'_>,
    ) -> Result<(Column<[u8; 4]>, u64), BuildError> {
        let images = &textures.images;
        let mut open = |image: u32| images[image as usize].open();
        let mut images = tiles.map_or(Images::Files(&mut open), Images::Tiles);
        let averaged = self.averager.finish(&textures.materials, &mut images, vertices, &context.cancel);
        let averaged = averaged.map_err(|error| failed(error, |image| named(textures, supply, image)))?;

        let mut colors = BufferWriter::new(&context.store, "colours of vertices", vertices)?;
        let (mut scratch, mut own_scratch, mut tints) = (Vec::new(), Vec::new(), 0);
        for start in (0..vertices).step_by(WINDOW) {
            context.check()?;
            let range = start..vertices.min(start + WINDOW);
            let mut block = averaged.read(range.clone(), &mut scratch)?.to_vec();
            if let Some(own) = own {
                let own = own.read(range, &mut own_scratch)?;
                for (at, (color, own)) in block.iter_mut().zip(own).enumerate() {
                    let is_painted = self.painted.as_ref().is_some_and(|set| set.contains(start + at));
                    *color = match (is_painted, textures.tints) {
                        (false, _) => *own,
                        (true, false) if textures.are_plain => *own,
                        (true, true) => {
                            tints += u64::from(*own != WHITE);
                            tinted(*color, *own)
                        }
                        (true, false) => *color,
                    };
                }
            }
            colors.extend_from_slice(&block)?;
        }
        Ok((colors.finish_column()?, tints))
    }
}

fn named(textures: &Textures, supply: &Supply, image: u32) -> String {
    format!("{}: image '{}'", supply.path.display(), textures.images[image as usize].name)
}

fn failed(error: TextureError, name: impl Fn(u32) -> String) -> BuildError {
    match error {
        TextureError::Extmem(error) => error.into(),
        TextureError::Cancelled(stop) => stop.into(),
        TextureError::Open { image, source } => {
            BuildError::Image { image: name(image), reason: source.to_string() }
        }
        TextureError::Image { image, source } => {
            BuildError::Image { image: name(image), reason: source.to_string() }
        }
        error => BuildError::Image { image: name(0), reason: error.to_string() },
    }
}

/// The product of two colours as light; coverage goes by itself.
fn tinted(color: [u8; 4], tint: [u8; 4]) -> [u8; 4] {
    let coverage = (u32::from(color[3]) * u32::from(tint[3]) + 127) / 255;
    let [red, green, blue] = std::array::from_fn(|channel| srgb_product(color[channel], tint[channel]));
    [red, green, blue, coverage as u8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tints_multiply_light() {
        assert_eq!(tinted([255, 128, 7, 255], [9, 255, 255, 255]), [9, 128, 7, 255]);
        assert_eq!(tinted([188, 0, 188, 128], [188, 90, 0, 128]), [138, 0, 0, 64]);
    }
}
