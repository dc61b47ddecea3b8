//! An image decoded, small enough, and halved as often as distant pictures need.

use super::halved;
use chpm_image::ImageRows;
use std::io::Cursor;

/// Sizes of an image, each half of the one before. Sides of sheets are multiples of 16, so that the last begins and ends with a whole texel.
pub const LEVELS: u32 = 5;
/// Rows that are decoded at a time where an image is to be smaller.
const STRIP: u32 = 1 << (LEVELS - 1);

/// An image in all its sizes.
#[derive(Clone, Debug)]
pub struct Sizes {
    /// Width, height and texels, red, green, blue and alpha; the largest size first.
    pub levels: Vec<([u32; 2], Vec<[u8; 4]>)>,
}

/// How often an image is halved until no side is longer than this, and its size then.
pub fn fitted(size: [u16; 2], longest: u32) -> (u32, [u32; 2]) {
    let (mut halvings, mut size) = (0, size.map(u32::from));
    while size.iter().any(|side| *side > longest.max(1)) {
        (halvings, size) = (halvings + 1, size.map(|side| side.div_ceil(2)));
    }
    (halvings, size)
}

impl Sizes {
    /// Bytes of all sizes.
    pub fn bytes_of(size: [u16; 2], longest: u32) -> u64 {
        let mut size = fitted(size, longest).1;
        let mut bytes = 0;
        for _ in 0..LEVELS {
            bytes += 4 * u64::from(size[0]) * u64::from(size[1]);
            size = size.map(|side| side.div_ceil(2));
        }
        bytes
    }

    /// Decodes an image, a strip at a time where it is to be smaller; none where it is damaged, or not of this size.
    pub fn decode(size: [u16; 2], image: &[u8], longest: u32) -> Option<Self> {
        let (halvings, _) = fitted(size, longest);
        let [width, height] = size.map(u32::from);
        let mut rows = ImageRows::open(Cursor::new(image.to_vec()), u64::MAX).ok()?;
        if rows.size() != [width, height] {
            return None;
        }
        let strip = if halvings == 0 { height } else { STRIP };
        let (mut pixels, mut size) = (Vec::new(), [width, 0]);
        let mut first = 0;
        while first < height {
            let count = strip.min(height - first);
            let mut some = Vec::with_capacity(width as usize * count as usize);
            rows.read_rows(count as usize, &mut some).ok()?;
            let mut part = [width, count];
            for _ in 0..halvings.min(STRIP.ilog2()) {
                (some, part) = halved(&some, part);
            }
            match pixels.is_empty() {
                true => pixels = some,
                false => pixels.extend(some),
            }
            size = [part[0], size[1] + part[1]];
            first += count;
        }
        for _ in STRIP.ilog2()..halvings {
            (pixels, size) = halved(&pixels, size);
        }
        let mut levels = vec![(size, pixels)];
        for _ in 1..LEVELS {
            let (size, pixels) = levels.last()?;
            let (pixels, size) = halved(pixels, *size);
            levels.push((size, pixels));
        }
        Some(Sizes { levels })
    }

    /// Red, green, blue and alpha of a place, 0 to 1, mixed of the four texels about it; `level` is that of the last size at most. The place is in texels of the
    /// largest size, from the upper left corner.
    pub fn at(&self, [x, y]: [f64; 2], level: usize) -> [f64; 4] {
        let level = level.min(self.levels.len() - 1);
        let ([width, height], texels) = &self.levels[level];
        let shrink = 1.0 / f64::from(1u32 << level);
        let (x, y) = (x * shrink - 0.5, y * shrink - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (right_share, lower_share) = (x - left, y - top);
        let texel = |column: f64, row: f64| {
            let column = column.clamp(0.0, f64::from(width - 1)) as usize;
            let row = row.clamp(0.0, f64::from(height - 1)) as usize;
            texels[row * *width as usize + column].map(f64::from)
        };
        let mut sum = [0.0; 4];
        for (row, share) in [(top, 1.0 - lower_share), (top + 1.0, lower_share)] {
            let (a, b) = (texel(left, row), texel(left + 1.0, row));
            for part in 0..4 {
                sum[part] += share * ((1.0 - right_share) * a[part] + right_share * b[part]) / 255.0;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> Vec<[u8; 4]> {
        (0..64 * 32).map(|at| [(at % 64 * 4) as u8, (at / 64 * 8) as u8, 9, 255]).collect()
    }

    #[test]
    fn images_are_halved_until_they_fit() {
        let size = [64, 32];
        assert_eq!(
            (fitted(size, 64), fitted(size, 63), fitted(size, 16)),
            ((0, [64, 32]), (1, [32, 16]), (2, [16, 8]))
        );
        let image = chpm_image::encode(&gradient(), size).unwrap().bytes;
        let decoded = Sizes::decode(size, &image, 32).unwrap();
        assert_eq!(decoded.levels.len(), LEVELS as usize);
        let sizes: Vec<[u32; 2]> = decoded.levels.iter().map(|(size, _)| *size).collect();
        assert_eq!(sizes, [[32, 16], [16, 8], [8, 4], [4, 2], [2, 1]]);
        let bytes: usize = decoded.levels.iter().map(|(_, texels)| 4 * texels.len()).sum();
        assert_eq!(bytes as u64, Sizes::bytes_of(size, 32));
        // The last is dark on the left and light on the right.
        let (_, last) = &decoded.levels[4];
        assert!(last[0][0] + 60 < last[1][0], "{last:?}");
        assert!(
            Sizes::decode([32, 32], &image, 64).is_none() && Sizes::decode(size, &image[..40], 64).is_none()
        );
    }

    /// Strips of rows make what the whole does, also where an image is halved more often than a strip can be.
    #[test]
    fn an_image_is_as_small_at_once_as_in_steps() {
        let size = [64, 32];
        let image = chpm_image::encode(&gradient(), size).unwrap().bytes;
        let whole = Sizes::decode(size, &image, 64).unwrap();
        for (halvings, longest) in [(1, 32), (2, 16), (4, 4)] {
            let small = Sizes::decode(size, &image, longest).unwrap();
            assert_eq!(small.levels[0], whole.levels[halvings], "{longest}");
        }
        assert_eq!(Sizes::decode(size, &image, 1).unwrap().levels[0].0, [1, 1]);
    }

    #[test]
    fn between_texels_they_are_mixed() {
        let texels = vec![[0, 0, 0, 255], [255, 51, 0, 255], [0, 0, 0, 0], [255, 51, 0, 0]];
        let sizes = Sizes { levels: vec![([2, 2], texels), ([1, 1], vec![[7, 7, 7, 7]])] };
        assert_eq!(sizes.at([0.5, 0.5], 0), [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(sizes.at([1.0, 1.0], 0), [0.5, 0.1, 0.0, 0.5]);
        assert_eq!(sizes.at([9.0, -9.0], 0), [1.0, 0.2, 0.0, 1.0], "beyond the edge");
        assert_eq!(sizes.at([1.0, 1.0], 9), [7.0 / 255.0; 4]);
    }
}
