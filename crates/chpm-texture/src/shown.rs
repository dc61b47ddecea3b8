//! Which tiles of images triangles show.

use crate::footprint::inside;
use crate::{Material, TexturedTriangle, Wrap};
use serde::{Deserialize, Serialize};

/// Texels about a triangle that are shown with it: samples are taken of a texel's whole width, and are cubic.
const MARGIN: f64 = 16.0;
/// The farthest place from zero, texels.
const FAR: f64 = (1u64 << 40) as f64;

/// The tiles of an image that something shows, numbered by rows.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Shown {
    size: [u32; 2],
    side: u32,
    /// A bit for each tile.
    bits: Vec<u64>,
    /// How many are shown before each of the words.
    before: Vec<u64>,
}

impl Shown {
    /// None, of an image that is cut into tiles of `side` texels.
    pub(crate) fn none(size: [u32; 2], side: u32) -> Self {
        let [columns, rows] = size.map(|texels| texels.div_ceil(side) as usize);
        Shown { size, side, bits: vec![0; (columns * rows).div_ceil(64)], before: Vec::new() }
    }

    /// Width and height of the image.
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Adds what a triangle of the image shows: what is about its corners, as the material wraps it.
    pub(crate) fn add(&mut self, triangle: &TexturedTriangle, material: &Material) {
        let [width, height] = self.size.map(f64::from);
        let places = triangle.uv.map(|[u, v]| [f64::from(u) * width, (1.0 - f64::from(v)) * height]);
        if places.as_flattened().iter().any(|place| !place.is_finite()) {
            return;
        }
        let [columns, rows] = [0, 1].map(|axis| {
            let of = places.map(|place| place[axis]);
            let low = of.iter().copied().fold(FAR, f64::min) - MARGIN;
            let high = of.iter().copied().fold(-FAR, f64::max) + MARGIN;
            self.along(axis, [low.max(-FAR) as i64, high.min(FAR) as i64], material.wrap[axis])
        });
        let all = u64::from(self.size[0].div_ceil(self.side));
        for row in rows {
            for column in &columns {
                let tile = u64::from(row) * all + u64::from(*column);
                self.bits[(tile / 64) as usize] |= 1 << (tile % 64);
            }
        }
    }

    /// Columns or rows of tiles that have texels from the first to the last.
    fn along(&self, axis: usize, [first, last]: [i64; 2], wrap: Wrap) -> Vec<u32> {
        let size = i64::from(self.size[axis]);
        let [first, last] = match wrap {
            Wrap::Clamp => [first, last].map(|at| at.clamp(0, size - 1)),
            // Twice is all of it.
            Wrap::Repeat | Wrap::Mirror => [first, last.min(first + 2 * size)],
        };
        let mut tiles: Vec<u32> =
            (first..=last).map(|at| inside(at, size, wrap) as u32 / self.side).collect();
        tiles.dedup();
        tiles
    }

    /// Ends adding.
    pub(crate) fn count(&mut self) {
        let mut sum = 0;
        self.before.clear();
        for word in &self.bits {
            self.before.push(sum);
            sum += u64::from(word.count_ones());
        }
    }

    /// How many shown tiles come before this one; none if it is not shown itself.
    pub(crate) fn place(&self, tile: u64) -> Option<u64> {
        let (word, bit) = ((tile / 64) as usize, tile % 64);
        let below = self.bits[word] & ((1 << bit) - 1);
        (self.bits[word] >> bit & 1 == 1).then(|| self.before[word] + u64::from(below.count_ones()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(size: [u32; 2], uv: [[f32; 2]; 3], wrap: Wrap) -> Vec<u64> {
        let mut shown = Shown::none(size, 64);
        let material = Material { image: Some(0), factor: [1.0; 4], wrap: [wrap; 2] };
        shown.add(&TexturedTriangle { vertices: [0; 3], uv, material: 0 }, &material);
        shown.count();
        let [columns, rows] = size.map(|texels| u64::from(texels.div_ceil(64)));
        let all: Vec<u64> = (0..columns * rows).filter(|tile| shown.place(*tile).is_some()).collect();
        // Their places are those in this list.
        assert!(all.iter().zip(0..).all(|(tile, place)| shown.place(*tile) == Some(place)));
        all
    }

    #[test]
    fn tiles_about_a_triangle_are_shown() {
        // Ten columns of tiles, seven rows, of which the last has 16 texels.
        let size = [640, 400];
        let at = |column: f32, row: f32| [column / 640.0, 1.0 - row / 400.0];
        let one = [at(100.0, 90.0), at(101.0, 90.0), at(100.0, 91.0)];
        assert_eq!(shown(size, one, Wrap::Repeat), [11]);
        let near_a_border = [at(120.0, 90.0), at(121.0, 90.0), at(120.0, 91.0)];
        assert_eq!(shown(size, near_a_border, Wrap::Repeat), [11, 12]);
        let corner = [at(1.0, 1.0), at(2.0, 1.0), at(1.0, 2.0)];
        assert_eq!(shown(size, corner, Wrap::Clamp), [0]);
        assert_eq!(shown(size, corner, Wrap::Mirror), [0]);
        assert_eq!(shown(size, corner, Wrap::Repeat), [0, 9, 60, 69]);
        // Three images to the right and one down.
        let away = [at(2020.0, 490.0), at(2021.0, 490.0), at(2020.0, 491.0)];
        assert_eq!(shown(size, away, Wrap::Repeat), [11]);
        assert_eq!(shown(size, away, Wrap::Clamp), [69]);
    }

    #[test]
    fn what_covers_an_image_or_more_shows_all_and_no_number_nothing() {
        let all: Vec<u64> = (0..70).collect();
        for far in [1.0, 3.5, 1e9, f32::MAX] {
            for wrap in [Wrap::Repeat, Wrap::Mirror] {
                assert_eq!(shown([640, 400], [[0.0; 2], [far, 0.0], [0.0, far]], wrap), all, "{far}");
            }
        }
        assert_eq!(shown([640, 400], [[-1e9; 2], [1e9, -1e9], [1e9; 2]], Wrap::Clamp), all);
        assert_eq!(shown([640, 400], [[0.0; 2], [1.0; 2], [f32::NAN, 0.0]], Wrap::Repeat), []);
        assert_eq!(shown([1, 1], [[0.5; 2]; 3], Wrap::Clamp), [0]);
    }
}
