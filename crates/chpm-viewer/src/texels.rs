//! A sheet's image as the GPU is to have it: decoded, small enough, and halved as often as distant pictures need.

use chpm_format::SheetRecord;
use chpm_image::ImageRows;
use chpm_texture::sheet::halved;
use std::io::Cursor;

/// Sizes of an image, each half of the one before. Sides of sheets are multiples of 16, so that the last begins and ends with a whole texel.
pub const LEVELS: u32 = 5;

/// Texels of a sheet.
#[derive(Clone, Debug)]
pub struct Texels {
    /// Width, height and texels, red, green, blue and alpha; the largest size first.
    pub levels: Vec<([u32; 2], Vec<[u8; 4]>)>,
}

/// How often an image is halved until no side is longer than this, and its size then.
pub fn fitted(record: &SheetRecord, longest: u32) -> (u32, [u32; 2]) {
    let (mut halvings, mut size) = (0, record.size.map(u32::from));
    while size.iter().any(|side| *side > longest.max(1)) {
        (halvings, size) = (halvings + 1, size.map(|side| side.div_ceil(2)));
    }
    (halvings, size)
}

impl Texels {
    /// Bytes of all sizes.
    pub fn bytes_of(record: &SheetRecord, longest: u32) -> u64 {
        let mut size = fitted(record, longest).1;
        let mut bytes = 0;
        for _ in 0..LEVELS {
            bytes += 4 * u64::from(size[0]) * u64::from(size[1]);
            size = size.map(|side| side.div_ceil(2));
        }
        bytes
    }

    /// Decodes an image; none where it is damaged, or not of the record's size.
    pub fn decode(record: &SheetRecord, image: &[u8], longest: u32) -> Option<Self> {
        let mut size = record.size.map(u32::from);
        let mut rows = ImageRows::open(Cursor::new(image.to_vec()), u64::MAX).ok()?;
        if rows.size() != size {
            return None;
        }
        let mut pixels = Vec::with_capacity(size[0] as usize * size[1] as usize);
        rows.read_rows(size[1] as usize, &mut pixels).ok()?;
        let (halvings, _) = fitted(record, longest);
        for _ in 0..halvings {
            (pixels, size) = halved(&pixels, size);
        }
        let mut levels = vec![(size, pixels)];
        for _ in 1..LEVELS {
            let (size, pixels) = levels.last()?;
            let (pixels, size) = halved(pixels, *size);
            levels.push((size, pixels));
        }
        Some(Texels { levels })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_halved_until_they_fit() {
        let record = SheetRecord { size: [64, 32], ..SheetRecord::default() };
        assert_eq!(
            (fitted(&record, 64), fitted(&record, 63), fitted(&record, 16)),
            ((0, [64, 32]), (1, [32, 16]), (2, [16, 8]))
        );
        let texels: Vec<[u8; 4]> =
            (0..64 * 32).map(|at| [(at % 64 * 4) as u8, (at / 64 * 8) as u8, 9, 255]).collect();
        let image = chpm_image::encode(&texels, record.size).unwrap().bytes;
        let decoded = Texels::decode(&record, &image, 32).unwrap();
        assert_eq!(decoded.levels.len(), LEVELS as usize);
        let sizes: Vec<[u32; 2]> = decoded.levels.iter().map(|(size, _)| *size).collect();
        assert_eq!(sizes, [[32, 16], [16, 8], [8, 4], [4, 2], [2, 1]]);
        let bytes: usize = decoded.levels.iter().map(|(_, texels)| 4 * texels.len()).sum();
        assert_eq!(bytes as u64, Texels::bytes_of(&record, 32));
        // The last is dark on the left and light on the right.
        let (_, last) = &decoded.levels[4];
        assert!(last[0][0] + 60 < last[1][0], "{last:?}");
        let other = SheetRecord { size: [32, 32], ..record };
        assert!(
            Texels::decode(&other, &image, 64).is_none()
                && Texels::decode(&record, &image[..40], 64).is_none()
        );
    }
}
