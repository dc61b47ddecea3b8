//! Cubic samples of images, in linear light.

use crate::TextureError;
use crate::srgb::encode;
use crate::texels::Texel;
use std::sync::LazyLock;

/// Parts of a texel that places are rounded to.
const PARTS: f64 = 256.0;
/// The farthest place from zero, texels.
const FAR: f64 = (1u64 << 40) as f64;

/// Texels about a place: four rows of four.
pub type Region = [[Texel; 4]; 4];

/// Something to take samples of: images by number.
pub trait Pixels {
    /// Four rows of four texels, beginning at a column and a row, which may be outside; in `room` where they do not lie so.
    ///
    /// # Errors
    /// What keeps the texels from being read.
    fn region<'a>(
        &'a mut self,
        image: u32,
        column: i64,
        row: i64,
        room: &'a mut Region,
    ) -> Result<[&'a [Texel; 4]; 4], TextureError>;
}

/// Four rows of four texels of an image that lie in it, from the first on.
pub fn rows(texels: &[Texel], first: usize, width: usize) -> [&[Texel; 4]; 4] {
    static NONE: [Texel; 4] = [[0; 4]; 4];
    let part = texels.get(first..first + 3 * width + 4).unwrap_or_default();
    std::array::from_fn(|row| part.get(row * width..).and_then(|row| row.first_chunk()).unwrap_or(&NONE))
}

/// Catmull and Rom's weights of four texels, for each part of the way from the second to the third.
static WEIGHTS: LazyLock<[[f32; 4]; 256]> = LazyLock::new(|| {
    std::array::from_fn(|part| {
        let x = part as f64 / PARTS;
        let exact = [
            ((-0.5 * x + 1.0) * x - 0.5) * x,
            (1.5 * x - 2.5) * x * x + 1.0,
            ((-1.5 * x + 2.0) * x + 0.5) * x,
            (0.5 * x - 0.5) * x * x,
        ];
        exact.map(|weight| weight as f32)
    })
});

/// Sums of samples.
#[derive(Clone, Copy, Default)]
pub(super) struct Samples {
    sums: [f32; 4],
}

impl Samples {
    /// Adds a sample at a place, in texels from the upper left corner.
    pub(super) fn add<P: Pixels + ?Sized>(
        &mut self,
        pixels: &mut P,
        image: u32,
        place: [f64; 2],
    ) -> Result<(), TextureError> {
        let parts = place.map(|x| nearest((x.clamp(-FAR, FAR) - 0.5) * PARTS));
        let weights = &*WEIGHTS;
        let [columns, rows] = parts.map(|part| &weights[(part & 255) as usize]);
        let mut room = Region::default();
        let region = pixels.region(image, (parts[0] >> 8) - 1, (parts[1] >> 8) - 1, &mut room)?;
        for (texels, row) in region.into_iter().zip(rows) {
            let mut line = [0f32; 4];
            for (texel, column) in texels.iter().zip(columns) {
                for (sum, part) in line.iter_mut().zip(texel) {
                    *sum += f32::from(*part) * column;
                }
            }
            for (sum, part) in self.sums.iter_mut().zip(line) {
                *sum += part * row;
            }
        }
        Ok(())
    }

    /// The mean colour of so many samples, times a factor: of light, and of alpha.
    pub(super) fn color(&self, count: u32, factor: [f32; 4]) -> [u8; 4] {
        let [r, g, b, shown] = self.sums.map(f64::from);
        let whole = 255.0 * f64::from(count);
        let alpha = (shown / whole - 1.0).clamp(0.0, 255.0) * f64::from(factor[3]);
        let scale = 255.0 * 256.0 / shown.max(whole);
        let [r, g, b] = [(r, 0), (g, 1), (b, 2)].map(|(part, i)| encode(part * scale * f64::from(factor[i])));
        [r, g, b, (alpha + 0.5) as u8]
    }
}

/// The nearest whole number, of less than 2^51: where numbers have no digits behind the point, adding rounds.
fn nearest(x: f64) -> i64 {
    const NO_DIGITS: f64 = (3u64 << 51) as f64;
    ((x + NO_DIGITS).to_bits() as i64).wrapping_sub(NO_DIGITS.to_bits() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texels::texel;

    /// A slope in light from left to right, clamped.
    struct Slope(Vec<[u8; 4]>);

    impl Pixels for Slope {
        fn region<'a>(
            &'a mut self,
            _: u32,
            column: i64,
            _: i64,
            room: &'a mut Region,
        ) -> Result<[&'a [Texel; 4]; 4], TextureError> {
            for row in room.iter_mut() {
                *row = std::array::from_fn(|i| {
                    texel(&self.0[(column + i as i64).clamp(0, self.0.len() as i64 - 1) as usize])
                });
            }
            Ok(room.each_ref())
        }
    }

    fn at(pixels: &mut Slope, place: [f64; 2]) -> [u8; 4] {
        let mut samples = Samples::default();
        samples.add(pixels, 0, place).unwrap();
        samples.color(1, [1.0; 4])
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
    fn whole_numbers_are_the_nearest() {
        for x in [0.0, 0.49, -0.49, 0.51, -0.51, 7.0, -7.0, 1e6 + 0.7, -1e6 - 0.7, FAR * PARTS, -FAR * PARTS]
        {
            assert_eq!(nearest(x) as f64, x.round(), "{x}");
        }
    }

    #[test]
    fn one_colour_is_that_colour_anywhere() {
        let mut pixels = Slope(vec![[9, 77, 254, 255]; 3]);
        for place in [-1e300, -7.3, 0.0, 1.26, 5.999, 1e18, f64::INFINITY] {
            assert_eq!(at(&mut pixels, [place, -place]), [9, 77, 254, 255], "{place}");
        }
        assert!(WEIGHTS.iter().all(|weights| (weights.iter().sum::<f32>() - 1.0).abs() < 1e-6));
    }
}
