//! A textured source in memory: its colour near any point. Images are on disk where there is no memory for them.

use super::way::{Key, normal_of, parts_of};
use crate::error::VerifyError;
use chpm_extmem::{BufferWriter, Cancel, MappedFile, Progress, Reservation, Store};
use chpm_format::Chpm;
use chpm_import::ply::{Batch, BatchKind, Options};
use chpm_import::{Images, Input, Textures};
use chpm_measure::Bvh;
use chpm_mesh::geom;
use chpm_texture::sheet::{Pixels, Region};
use chpm_texture::{Material, TextureError, TexturedTriangle, TileReader, Tiles};
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;
use std::path::Path;

/// Bytes in memory for each triangle: its corners, its coordinates, and how it is found.
const OF_TRIANGLE: u64 = 260;

/// The source.
pub(super) struct Source {
    bvh: Bvh,
    /// By what triangles are found by, their places in the list of all.
    at: HashMap<Key, u32>,
    positions: Vec<[f32; 3]>,
    triangles: Vec<TexturedTriangle>,
    materials: Vec<Material>,
    tiles: Tiles,
    scale: f64,
    _memory: Reservation,
}

/// Reads images for one thread.
pub(super) struct Paint<'a>(TileReader<'a>);

impl<'a> Paint<'a> {
    pub(super) fn new(source: &'a Source) -> Self {
        Paint(TileReader::new(&source.tiles, &source.materials))
    }
}

impl Source {
    /// Reads a source as the file has it: relative to its origin, in single precision, on its lattice.
    pub(super) fn read(
        file: &Chpm<MappedFile>,
        path: &Path,
        store: &Store,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Source, VerifyError> {
        let options = Options { normals: false, colors: false, images: Images::Grey, ..Options::default() };
        let mut input = Input::open(path, options, store, cancel)?;
        let (origin, step) = (file.header().origin, file.metadata().unwrap_or_default().lattice_step()?);
        let stored = |p: [f64; 3]| -> [f32; 3] {
            std::array::from_fn(|axis| crate::against::stored(p[axis] - origin[axis], step))
        };
        let (mut batch, mut before, mut positions) = (Batch::default(), 0, Vec::new());
        let mut textured: Vec<TexturedTriangle> = Vec::new();
        progress.begin("read", path.metadata().map_or(0, |metadata| metadata.len()));
        loop {
            let kind = input.next_batch(&mut batch)?;
            positions.extend(batch.vertices.positions.iter().map(|p| stored(p.map(f64::from))));
            positions.extend(batch.positions_f64.drain(..).map(stored));
            textured.append(&mut batch.textured);
            progress.advance(input.bytes_read() - before);
            before = input.bytes_read();
            if kind == BatchKind::End {
                break;
            }
        }
        progress.end();
        let textures = input.finish()?.textures;
        let textures = textures.filter(|textures| !textures.images.is_empty() && !textured.is_empty());
        let Some(textures) = textures else { return Err(VerifyError::NoImages { path: path.to_owned() }) };
        textured
            .retain(|triangle| triangle.vertices.iter().all(|vertex| (*vertex as usize) < positions.len()));
        let memory =
            store.budget.reserve_work("a source, to be measured", OF_TRIANGLE * textured.len() as u64)?;
        let tiles = tiles(&textures, &textured, path, store, progress, cancel)?;

        let corners: Vec<[u32; 3]> = textured.iter().map(|triangle| triangle.vertices).collect();
        let bvh = Bvh::new(&positions, &corners);
        let mut at = HashMap::with_capacity(textured.len());
        for (number, corners) in (0..).zip(&corners) {
            at.entry(Key::of(corners.map(|vertex| positions[vertex as usize]))).or_insert(number);
        }
        let scale = positions.iter().flatten().fold(0.0, |most: f32, x| most.max(x.abs())).into();
        let (triangles, materials) = (textured, textures.materials);
        Ok(Source { bvh, at, positions, triangles, materials, tiles, scale, _memory: memory })
    }

    /// The largest coordinate.
    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    /// The triangle that is nearest to a point; of two sides of one, that which faces as `normal` does.
    fn nearest(&self, point: Point3<f64>, normal: Vector3<f64>) -> Option<&TexturedTriangle> {
        let [a, b, c] = self.bvh.corners_of(&self.bvh.nearest(point, None))?;
        let along = normal_of([a, b, c].map(geom::to_f64)).dot(&normal);
        let sides = if along >= 0.0 { [[a, b, c], [a, c, b]] } else { [[a, c, b], [a, b, c]] };
        let number = sides.iter().find_map(|corners| self.at.get(&Key::of(*corners)))?;
        Some(&self.triangles[*number as usize])
    }

    /// The colour of the source where it is nearest to a point of a surface with this normal, of 255; none where it has no image.
    pub(super) fn color_near(
        &self,
        point: Point3<f64>,
        normal: Vector3<f64>,
        paint: &mut Paint<'_>,
    ) -> Result<Option<[f64; 3]>, VerifyError> {
        let Some(&TexturedTriangle { vertices, uv, material }) = self.nearest(point, normal) else {
            return Ok(None);
        };
        let Some(Material { image: Some(image), factor, .. }) = self.materials.get(material as usize) else {
            return Ok(None);
        };
        let corners = vertices.map(|vertex| geom::to_f64(self.positions[vertex as usize]));
        let parts = inside(parts_of(corners, point).unwrap_or([1.0, 0.0, 0.0]));
        let sides = self.tiles.size(*image).map(f64::from);
        let [u, v] = [0, 1].map(|axis| (0..3).map(|i| parts[i] * f64::from(uv[i][axis])).sum::<f64>());
        let place = [u * sides[0], (1.0 - v) * sides[1]];
        if !place.iter().all(|x| x.is_finite()) {
            return Ok(None);
        }
        let mut room = Region::default();
        let low = place.map(|x| (x - 0.5).floor() as i64);
        let region = paint.0.region(material, low[0], low[1], &mut room).map_err(failed)?;
        let light = mixed(place, |column, row| {
            let [r, g, b, shown] = region[(row - low[1]) as usize][(column - low[0]) as usize].map(f64::from);
            let whole = 255.0 * 256.0;
            [r, g, b].map(|part| part * whole / shown.max(1.0) / 65_535.0)
        });
        let tint = [0, 1, 2].map(|part| light_of(f64::from(factor[part].clamp(0.0, 1.0))));
        Ok(Some([0, 1, 2].map(|part| 255.0 * srgb(light[part] * tint[part]))))
    }
}

/// The images, as far as triangles show them.
fn tiles(
    textures: &Textures,
    triangles: &[TexturedTriangle],
    path: &Path,
    store: &Store,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Tiles, VerifyError> {
    let mut column = BufferWriter::new(store, "textured triangles", 0)?;
    column.extend_from_slice(triangles)?;
    let images = &textures.images;
    let mut open = |image: u32| images[image as usize].open();
    progress.begin("read images", images.len() as u64);
    let tiles =
        Tiles::read(store, images.len(), &mut open, &column.finish_column()?, &textures.materials, cancel);
    progress.end();
    tiles.map_err(|error| match error {
        TextureError::Open { image, .. } | TextureError::Image { image, .. } => VerifyError::Image {
            image: format!("{}: image '{}'", path.display(), images[image as usize].name),
            reason: error.to_string(),
        },
        error => failed(error),
    })
}

fn failed(error: TextureError) -> VerifyError {
    match error {
        TextureError::Extmem(error) => error.into(),
        TextureError::Cancelled(stop) => stop.into(),
        error => VerifyError::Image { image: "an image".to_owned(), reason: error.to_string() },
    }
}

/// Parts of corners that are of a point of the triangle.
fn inside(parts: [f64; 3]) -> [f64; 3] {
    let parts = parts.map(|part| part.clamp(0.0, 1.0));
    let sum: f64 = parts.iter().sum();
    parts.map(|part| part / sum)
}

/// The mean of the four about a place, by how near they are.
fn mixed(place: [f64; 2], at: impl Fn(i64, i64) -> [f64; 3]) -> [f64; 3] {
    let low = place.map(|x| (x - 0.5).floor());
    let [right, down] = [0, 1].map(|axis| place[axis] - 0.5 - low[axis]);
    let mut sum = [0.0; 3];
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let weight = if dx == 1 { right } else { 1.0 - right } * if dy == 1 { down } else { 1.0 - down };
        let light = at(low[0] as i64 + dx, low[1] as i64 + dy);
        (0..3).for_each(|part| sum[part] += weight * light[part]);
    }
    sum
}

/// The colour at a place of an image, mixed as light, of 255.
pub(super) fn bilinear(place: [f64; 2], at: impl Fn(i64, i64) -> [u8; 4]) -> [f64; 3] {
    let light = mixed(place, |column, row| {
        let [r, g, b, _] = at(column, row);
        [r, g, b].map(|part| light_of(f64::from(part) / 255.0))
    });
    light.map(|light| 255.0 * srgb(light))
}

fn light_of(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn srgb(light: f64) -> f64 {
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_comes_back_and_middles_are_texels() {
        for value in 0..=255u8 {
            let at = |column: i64, _: i64| [if column == 3 { value } else { 255 - value }, value, 9, 255];
            let color = bilinear([3.5, 7.5], at);
            assert!((color[0] - f64::from(value)).abs() < 1e-6 && (color[2] - 9.0).abs() < 1e-6, "{color:?}");
        }
        let half = bilinear([1.0, 0.5], |column, _| [if column == 0 { 0 } else { 255 }, 0, 0, 255]);
        assert!((half[0] - 187.5).abs() < 0.1, "half the light is {}", half[0]);
    }

    #[test]
    fn points_beside_a_triangle_are_taken_to_it() {
        assert_eq!(inside([0.25, 0.25, 0.5]), [0.25, 0.25, 0.5]);
        assert_eq!(inside([-0.5, 0.5, 1.0]), [0.0, 1.0 / 3.0, 2.0 / 3.0]);
    }
}
