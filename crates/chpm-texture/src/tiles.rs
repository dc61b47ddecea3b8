//! Images cut into tiles, of which those that triangles show are kept: on disk where there is no memory for them, to be read anywhere.

use crate::footprint::inside;
use crate::images::{OpenImage, open_size, open_within};
use crate::sheet::{Pixels, Region, rows};
use crate::shown::Shown;
use crate::texels::{Texel, texel};
use crate::{Material, TextureError, TexturedTriangle, Wrap};
use chpm_extmem::{Cancel, Column, ExtmemError, Spool, Store};
use serde::{Deserialize, Serialize};

/// Texels of a tile's side.
const SIDE: usize = 64;
const TEXELS: usize = SIDE * SIDE;
const BYTES: usize = TEXELS * size_of::<[u8; 4]>();
/// Triangles that are looked at together.
const AT_ONCE: usize = 1 << 12;
/// Tiles that a reader has at hand.
const AT_HAND: usize = 128;
const NO_TILE: u64 = u64::MAX;

/// Texels of some images, as far as triangles show them.
#[derive(Debug, Serialize, Deserialize)]
pub struct Tiles {
    images: Vec<Grid>,
    texels: Spool,
}

#[derive(Debug, Serialize, Deserialize)]
struct Grid {
    /// Tiles from its first row to the next, and tiles of images before.
    columns: usize,
    first: u64,
    shown: Shown,
    /// Colour of texels that nothing shows: the mean of those that are kept.
    mean: [u8; 4],
}

impl Tiles {
    /// Reads `count` images, one after the other, strip by strip, and keeps what `triangles` show through `materials`.
    ///
    /// # Errors
    /// [`TextureError`]: of images, of the disk, or that it was to stop.
    pub fn read(
        store: &Store,
        count: usize,
        open_image: &mut OpenImage<'_>,
        triangles: &Column<TexturedTriangle>,
        materials: &[Material],
        cancel: &Cancel,
    ) -> Result<Self, TextureError> {
        let sizes = (0..count as u32).map(|image| {
            cancel.check()?;
            open_size(image, open_image)
        });
        let sizes: Vec<[u32; 2]> = sizes.collect::<Result<_, TextureError>>()?;
        let shown = shown(&sizes, triangles, materials, cancel)?;

        let texels = Spool::named(store, "texels of images", "texels-of-images");
        let (mut images, mut first) = (Vec::new(), 0);
        let (mut pixels, mut tile) = (Vec::new(), vec![[0; 4]; TEXELS]);
        for (image, shown) in (0..).zip(shown) {
            let strip = |[width, _]: [u32; 2]| u64::from(width) * (SIDE * size_of::<[u8; 4]>()) as u64;
            let (mut rows, _memory) = open_within(store, image, strip, open_image)?;
            let width = rows.size()[0] as usize;
            let columns = width.div_ceil(SIDE);
            let (mut number, mut kept, mut sums) = (0, 0, [0u64; 5]);
            loop {
                cancel.check()?;
                let read = rows.read_rows(SIDE, &mut pixels);
                let height = read.map_err(|source| TextureError::Image { image, source })?;
                if height == 0 {
                    break;
                }
                for column in (0..width).step_by(SIDE) {
                    number += 1;
                    if shown.place(number - 1).is_none() {
                        continue;
                    }
                    for (row, out) in tile.chunks_exact_mut(SIDE).enumerate().take(height) {
                        let begin = row * width + column;
                        let some = &pixels[begin..begin + SIDE.min(width - column)];
                        out[..some.len()].copy_from_slice(some);
                        some.iter().for_each(|pixel| add(&mut sums, *pixel));
                    }
                    texels.append(bytemuck::cast_slice(&tile))?;
                    kept += 1;
                }
            }
            let mean = [0, 1, 2, 3].map(|part| (sums[part] / sums[4].max(1)) as u8);
            images.push(Grid { columns, first, shown, mean });
            first += kept;
        }
        Ok(Tiles { images, texels })
    }

    /// How many images there are.
    pub fn count(&self) -> usize {
        self.images.len()
    }

    /// Width and height of an image.
    pub fn size(&self, image: u32) -> [u32; 2] {
        self.images[image as usize].shown.size()
    }

    /// The rows of an image, from the top.
    pub(crate) fn rows(&self, image: u32) -> TileRows<'_> {
        TileRows {
            tiles: self,
            grid: &self.images[image as usize],
            done: 0,
            band: Vec::new(),
            tile: vec![0; BYTES],
        }
    }
}

fn add(sums: &mut [u64; 5], [r, g, b, a]: [u8; 4]) {
    for (sum, part) in sums.iter_mut().zip([r, g, b, a, 1]) {
        *sum += u64::from(part);
    }
}

/// By image, what triangles show of it.
fn shown(
    sizes: &[[u32; 2]],
    triangles: &Column<TexturedTriangle>,
    materials: &[Material],
    cancel: &Cancel,
) -> Result<Vec<Shown>, TextureError> {
    let mut shown: Vec<Shown> = sizes.iter().map(|size| Shown::none(*size, SIDE as u32)).collect();
    let mut scratch = Vec::new();
    for start in (0..triangles.len()).step_by(AT_ONCE) {
        cancel.check()?;
        let range = start..triangles.len().min(start + AT_ONCE);
        for triangle in triangles.read(range, &mut scratch)? {
            let Some(material) = materials.get(triangle.material as usize) else { continue };
            if let Some(of) = material.image.and_then(|image| shown.get_mut(image as usize)) {
                of.add(triangle, material);
            }
        }
    }
    shown.iter_mut().for_each(Shown::count);
    Ok(shown)
}

impl Grid {
    /// Which of the tiles that are kept the one at a column and row is; none if nothing shows it.
    fn tile(&self, [column, row]: [usize; 2]) -> Option<u64> {
        Some(self.first + self.shown.place((row * self.columns + column) as u64)?)
    }
}

/// Rows of an image out of its tiles.
pub(crate) struct TileRows<'a> {
    tiles: &'a Tiles,
    grid: &'a Grid,
    /// Rows that were handed out.
    done: usize,
    /// Rows of the tiles that the next one is of.
    band: Vec<[u8; 4]>,
    tile: Vec<u8>,
}

impl TileRows<'_> {
    /// Bytes that it holds.
    pub(crate) fn memory(&self) -> u64 {
        u64::from(self.grid.shown.size()[0]) * (SIDE * size_of::<[u8; 4]>()) as u64 + BYTES as u64
    }

    /// Replaces `out` by the next rows, at most `count` of them, and answers how many there are.
    pub(crate) fn read(&mut self, count: usize, out: &mut Vec<[u8; 4]>) -> Result<usize, ExtmemError> {
        let [width, height] = self.grid.shown.size().map(|side| side as usize);
        out.clear();
        let begin = self.done;
        while self.done < height.min(begin + count) {
            if self.done.is_multiple_of(SIDE) {
                self.read_band()?;
            }
            let row = self.done % SIDE * width;
            out.extend_from_slice(&self.band[row..row + width]);
            self.done += 1;
        }
        Ok(self.done - begin)
    }

    fn read_band(&mut self) -> Result<(), ExtmemError> {
        let width = self.grid.shown.size()[0] as usize;
        self.band.clear();
        self.band.resize(width * SIDE, self.grid.mean);
        for column in 0..self.grid.columns {
            let Some(number) = self.grid.tile([column, self.done / SIDE]) else { continue };
            self.tiles.texels.read_exact(number * BYTES as u64, &mut self.tile)?;
            let begin = column * SIDE;
            let count = SIDE.min(width - begin);
            for (row, texels) in self.tile.as_chunks().0.chunks_exact(SIDE).enumerate() {
                self.band[row * width + begin..][..count].copy_from_slice(&texels[..count]);
            }
        }
        Ok(())
    }
}

/// Reads images through the materials of triangles, whose numbers [`Pixels`] gets.
pub struct TileReader<'a> {
    tiles: &'a Tiles,
    materials: &'a [Material],
    /// By place at hand, which tile is there.
    which: Vec<u64>,
    texels: Vec<Texel>,
    bytes: Vec<u8>,
}

impl<'a> TileReader<'a> {
    /// Bytes that a reader holds.
    pub const BYTES: u64 = (AT_HAND * TEXELS * size_of::<Texel>() + BYTES) as u64;

    /// A reader with nothing at hand.
    pub fn new(tiles: &'a Tiles, materials: &'a [Material]) -> Self {
        let texels = vec![[0; 4]; AT_HAND * TEXELS];
        TileReader { tiles, materials, which: vec![NO_TILE; AT_HAND], texels, bytes: vec![0; BYTES] }
    }

    /// Texels of a tile that is kept, which is at a column and row of tiles.
    fn tile(&mut self, number: u64, [column, row]: [usize; 2]) -> Result<&[Texel], ExtmemError> {
        let place = column % 16 + row % 8 * 16;
        let texels = &mut self.texels[place * TEXELS..][..TEXELS];
        if self.which[place] != number {
            self.which[place] = NO_TILE;
            self.tiles.texels.read_exact(number * BYTES as u64, &mut self.bytes)?;
            for (to, from) in texels.iter_mut().zip(self.bytes.as_chunks().0) {
                *to = texel(from);
            }
            self.which[place] = number;
        }
        Ok(texels)
    }

    fn texel(&mut self, grid: &Grid, [column, row]: [i64; 2], wrap: [Wrap; 2]) -> Result<Texel, ExtmemError> {
        let [x, y] = [(column, 0), (row, 1)]
            .map(|(at, axis)| inside(at, i64::from(grid.shown.size()[axis]), wrap[axis]) as usize);
        match grid.tile([x / SIDE, y / SIDE]) {
            Some(number) => Ok(self.tile(number, [x / SIDE, y / SIDE])?[y % SIDE * SIDE + x % SIDE]),
            None => Ok(texel(&grid.mean)),
        }
    }
}

impl Pixels for TileReader<'_> {
    fn region<'a>(
        &'a mut self,
        material: u32,
        column: i64,
        row: i64,
        room: &'a mut Region,
    ) -> Result<[&'a [Texel; 4]; 4], TextureError> {
        let Material { image: Some(image), wrap, .. } = self.materials[material as usize] else {
            return Ok(room.each_ref());
        };
        let tiles = self.tiles;
        let grid = &tiles.images[image as usize];
        let [width, height] = grid.shown.size().map(i64::from);
        let in_one = |at: i64, side: i64| at >= 0 && at + 4 <= side && at as usize % SIDE <= SIDE - 4;
        if in_one(column, width) && in_one(row, height) {
            let (x, y) = (column as usize, row as usize);
            if let Some(number) = grid.tile([x / SIDE, y / SIDE]) {
                let tile = self.tile(number, [x / SIDE, y / SIDE])?;
                return Ok(rows(tile, y % SIDE * SIDE + x % SIDE, SIDE));
            }
        }
        for (line, out) in (row..).zip(room.iter_mut()) {
            for (at, out) in (column..).zip(out) {
                *out = self.texel(grid, [at, line], wrap)?;
            }
        }
        Ok(room.each_ref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Alpha, OpenedImage};
    use chpm_extmem::BufferWriter;
    use std::io::{self, Cursor};

    fn image(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgb);
        let pixels: Vec<u8> =
            (0..width * height).flat_map(|at| [(at % width) as u8, (at / width) as u8, 9]).collect();
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        bytes
    }

    fn opened(bytes: Vec<u8>) -> io::Result<OpenedImage> {
        Ok(OpenedImage { bytes: Box::new(Cursor::new(bytes)), alpha: Alpha::Kept })
    }

    /// Triangles of one material after the other, with the corners of their coordinates' boxes.
    fn triangles(store: &Store, boxes: &[[[f32; 2]; 2]]) -> Column<TexturedTriangle> {
        let mut column = BufferWriter::new(store, "triangles", 0).unwrap();
        for (material, [[u0, v0], [u1, v1]]) in (0..).zip(boxes) {
            let uv = [[*u0, *v0], [*u1, *v0], [*u0, *v1]];
            column.extend_from_slice(&[TexturedTriangle { vertices: [0; 3], uv, material }]).unwrap();
        }
        column.finish_column().unwrap()
    }

    #[test]
    fn what_nothing_shows_is_not_kept_and_has_the_mean_of_the_rest() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), 64 << 20).unwrap();
        let mut open = |_: u32| opened(image(250, 130));
        let materials = [Material { image: Some(0), factor: [1.0; 4], wrap: [Wrap::Clamp; 2] }];
        // In the second tile of the first row, and far from its sides.
        let shown =
            triangles(&store, &[[[90.0 / 250.0, 1.0 - 30.0 / 130.0], [92.0 / 250.0, 1.0 - 32.0 / 130.0]]]);
        let tiles = Tiles::read(&store, 1, &mut open, &shown, &materials, &Cancel::default()).unwrap();
        assert_eq!(tiles.texels.len(), BYTES as u64);
        let mean = [95, 31, 9, 255];
        let mut reader = TileReader::new(&tiles, &materials);
        let mut room = Region::default();
        let mut at =
            |column: i64, row: i64| reader.region(0, column, row, &mut room).unwrap().map(|row| *row);
        assert_eq!(at(90, 30)[1][2], texel(&[92, 31, 9, 255]));
        assert_eq!(at(190, 30), [[texel(&mean); 4]; 4]);
        // Over the side of a tile that is there.
        assert_eq!(
            at(126, 9)[0],
            [[126, 9, 9, 255], [127, 9, 9, 255], mean, mean].map(|pixel| texel(&pixel))
        );

        let (mut rows, mut all) = (tiles.rows(0), Vec::new());
        assert_eq!(rows.read(200, &mut all).unwrap(), 130);
        assert_eq!(
            (all[20 * 250 + 64], all[20 * 250 + 63], all[100 * 250 + 90]),
            ([64, 20, 9, 255], mean, mean)
        );
    }

    #[test]
    fn any_texel_is_found_in_memory_and_on_disk() {
        let sizes = [[200, 130], [5, 3], [64, 64]];
        let mut open = |number: u32| {
            let [width, height] = sizes[number as usize];
            opened(image(width, height))
        };
        let wrap = [Wrap::Repeat, Wrap::Clamp];
        let materials: Vec<Material> =
            (0..3).map(|image| Material { image: Some(image), factor: [1.0; 4], wrap }).collect();
        for limit in [0, 64 << 20] {
            let dir = tempfile::tempdir().unwrap();
            let store =
                Store::with_budget(dir.path(), chpm_extmem::MemoryBudget::with_work_limit(limit, 64 << 20))
                    .unwrap();
            let shown = triangles(&store, &[[[0.0; 2], [1.0; 2]]; 3]);
            let tiles = Tiles::read(&store, 3, &mut open, &shown, &materials, &Cancel::default()).unwrap();
            let mut reader = TileReader::new(&tiles, &materials);
            let mut room = Region::default();
            for (number, [width, height]) in (0..).zip(sizes) {
                assert_eq!(tiles.size(number), [width, height]);
                let (mut rows, mut all, mut some) = (tiles.rows(number), Vec::new(), Vec::new());
                while rows.read(37, &mut some).unwrap() > 0 {
                    all.append(&mut some);
                }
                let at = (0..height).flat_map(|y| (0..width).map(move |x| [x as u8, y as u8, 9, 255]));
                assert!(all.into_iter().eq(at));
                let [width, height] = [width, height].map(i64::from);
                for (column, row) in
                    (-9..height + 9).flat_map(|row| (-9..width + 9).map(move |column| (column, row)))
                {
                    let region = reader.region(number, column, row, &mut room).unwrap();
                    let expected = |x: i64, y: i64| {
                        let (x, y) = ((column + x).rem_euclid(width), (row + y).clamp(0, height - 1));
                        texel(&[x as u8, y as u8, 9, 255])
                    };
                    for (x, y) in [(0, 0), (3, 0), (1, 2), (3, 3)] {
                        assert_eq!(region[y][x], expected(x as i64, y as i64), "{number} {column} {row}");
                    }
                }
            }
        }
    }
}
