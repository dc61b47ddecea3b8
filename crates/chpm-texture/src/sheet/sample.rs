//! Cubic samples of images, in linear light.

use crate::TextureError;
use crate::srgb::encode;
use crate::texels::Texel;
use std::sync::LazyLock;

/// Parts of a texel that places are rounded to.
const PARTS: f64 = 256.0;
/// Bits of the weights of a row.
const BITS: i32 = 14;
/// The farthest place from zero, texels.
const FAR: f64 = (1u64 << 40) as f64;

/// Texels about a place: four rows of four.
pub type Region = [[Texel; 4]; 4];

/// Something to take samples of: images by number.
pub trait Pixels {
    /// Reads four rows of four texels, beginning at a column and a row, which may be outside.
    ///
    /// # Errors
    /// What keeps the texels from being read.
    fn region(&mut self, image: u32, column: i64, row: i64, out: &mut Region) -> Result<(), TextureError>;
}

/// Catmull and Rom's weights of four texels, for each part of the way from the second to the third; of whole numbers, 2^14 together.
static WEIGHTS: LazyLock<[[i32; 4]; 256]> = LazyLock::new(|| {
    std::array::from_fn(|part| {
        let x = part as f64 / PARTS;
        let exact = [
            ((-0.5 * x + 1.0) * x - 0.5) * x,
            (1.5 * x - 2.5) * x * x + 1.0,
            ((-1.5 * x + 2.0) * x + 0.5) * x,
            (0.5 * x - 0.5) * x * x,
        ];
        let mut weights = exact.map(|weight| (weight * f64::from(1 << BITS) + 0.5).floor() as i32);
        let largest = if x < 0.5 { 1 } else { 2 };
        weights[largest] += (1 << BITS) - weights.iter().sum::<i32>();
        weights
    })
});

/// Sums of samples.
#[derive(Clone, Copy, Default)]
pub(super) struct Samples {
    sums: [i64; 4],
}

impl Samples {
    /// Adds a sample at a place, in texels from the upper left corner.
    pub(super) fn add<P: Pixels + ?Sized>(
        &mut self,
        pixels: &mut P,
        image: u32,
        place: [f64; 2],
    ) -> Result<(), TextureError> {
        let parts = place.map(|x| ((x.clamp(-FAR, FAR) - 0.5) * PARTS + 0.5).floor() as i64);
        let [columns, rows] = parts.map(|part| &WEIGHTS[(part & 255) as usize]);
        let mut region = Region::default();
        pixels.region(image, (parts[0] >> 8) - 1, (parts[1] >> 8) - 1, &mut region)?;
        for (texels, row) in region.iter().zip(rows) {
            let mut line = [0i32; 4];
            for (texel, column) in texels.iter().zip(columns) {
                for (sum, part) in line.iter_mut().zip(texel) {
                    *sum += i32::from(*part) * column;
                }
            }
            for (sum, part) in self.sums.iter_mut().zip(line) {
                *sum += i64::from(part) * i64::from(*row);
            }
        }
        Ok(())
    }

    /// The mean colour.
    pub(super) fn color(&self, count: i64) -> [u8; 4] {
        let [r, g, b, shown] = self.sums;
        let whole = (count << (2 * BITS)) as f64;
        let alpha = (shown as f64 / (whole * 255.0) - 1.0 + 0.5).floor().clamp(0.0, 255.0) as u8;
        let shown = (shown as f64).max(whole * 255.0);
        let [r, g, b] = [r, g, b].map(|part| encode(part as f64 * (255.0 * 256.0) / shown));
        [r, g, b, alpha]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texels::texel;

    /// A slope in light from left to right, clamped.
    struct Slope(Vec<[u8; 4]>);

    impl Pixels for Slope {
        fn region(&mut self, _: u32, column: i64, _: i64, out: &mut Region) -> Result<(), TextureError> {
            for row in out {
                *row = std::array::from_fn(|i| {
                    texel(&self.0[(column + i as i64).clamp(0, self.0.len() as i64 - 1) as usize])
                });
            }
            Ok(())
        }
    }

    fn at(pixels: &mut Slope, place: [f64; 2]) -> [u8; 4] {
        let mut samples = Samples::default();
        samples.add(pixels, 0, place).unwrap();
        samples.color(1)
    }

    #[test]
    fn middles_of_texels_are_the_texels() {
        let colors: Vec<[u8; 4]> =
            (0..=255).map(|v| [v, 255 - v, 7, if v % 3 == 0 { 255 } else { v / 2 + 90 }]).collect();
        let mut pixels = Slope(colors.clone());
        for (column, color) in colors.iter().enumerate() {
            let found = at(&mut pixels, [column as f64 + 0.5, 3.5]);
            assert_eq!(found[3], color[3], "{column}");
            // Light times alpha is rounded to 16 bits.
            let off = found.iter().zip(color).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(off <= Some(1), "{column}: {found:?} {color:?}");
        }
    }

    #[test]
    fn one_colour_is_that_colour_anywhere() {
        let mut pixels = Slope(vec![[9, 77, 254, 255]; 3]);
        for place in [-1e300, -7.3, 0.0, 1.26, 5.999, 1e18, f64::INFINITY] {
            assert_eq!(at(&mut pixels, [place, -place]), [9, 77, 254, 255], "{place}");
        }
        assert!(WEIGHTS.iter().all(|weights| weights.iter().sum::<i32>() == 1 << BITS));
    }
}
