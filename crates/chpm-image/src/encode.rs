//! Writing images: JPEG where all is opaque, else PNG. Whole numbers only, so that the same pixels give the same bytes everywhere.

use crate::ImageError;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

/// Quality of JPEG, of 100.
const QUALITY: u8 = 90;

/// Mean square of what hues of 2 x 2 pixels differ from their mean, from which on these are not enough.
const VIVID: u64 = 24;

/// An image as it is stored.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Encoded {
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// Whether it is PNG, and not JPEG.
    pub is_png: bool,
}

/// Encodes rows of pixels, from the top.
///
/// ```
/// let white = vec![[255, 255, 255, 255]; 32 * 16];
/// assert!(!chpm_image::encode(&white, [32, 16])?.is_png);
/// # Ok::<(), chpm_image::ImageError>(())
/// ```
///
/// # Errors
/// [`ImageError`]: sides that no image has, or another number of pixels.
pub fn encode(pixels: &[[u8; 4]], size: [u16; 2]) -> Result<Encoded, ImageError> {
    let [width, height] = size.map(usize::from);
    if width * height != pixels.len() || pixels.is_empty() {
        return Err(ImageError::Size { size: size.map(u32::from) });
    }
    let is_png = pixels.iter().any(|pixel| pixel[3] != 255);
    let bytes = if is_png { png(pixels, size)? } else { jpeg(pixels, size)? };
    Ok(Encoded { bytes, is_png })
}

/// With tables of the standard: with others, the encoder writes one colour after another, which takes whoever reads it all coefficients.
fn jpeg(pixels: &[[u8; 4]], [width, height]: [u16; 2]) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, QUALITY);
    let vivid = is_vivid(pixels, width.into());
    encoder.set_sampling_factor(if vivid { SamplingFactor::F_1_1 } else { SamplingFactor::F_2_2 });
    let failed = |error| ImageError::Damaged { format: "JPEG", what: format!("{error}") };
    encoder.encode(pixels.as_flattened(), width, height, ColorType::Rgba).map_err(failed)?;
    Ok(bytes)
}

/// Whether hues change from pixel to pixel, as those of photographs do not and those of palettes do: then half of the columns and rows of hues would blur them.
fn is_vivid(pixels: &[[u8; 4]], width: usize) -> bool {
    let (mut sum, mut count) = (0u64, 0u64);
    for two in pixels.chunks_exact(2 * width) {
        let (above, below) = two.split_at(width);
        for square in above.as_chunks::<2>().0.iter().zip(below.as_chunks::<2>().0) {
            let four = [square.0[0], square.0[1], square.1[0], square.1[1]];
            for part in [0, 2] {
                let hues = four.map(|pixel| i64::from(pixel[part]) - i64::from(pixel[1]));
                let squares: i64 = hues.iter().map(|hue| hue * hue).sum();
                // Sixteen times their variance.
                sum += (4 * squares - hues.iter().sum::<i64>().pow(2)) as u64;
            }
            count += 2;
        }
    }
    sum > 16 * VIVID * count
}

fn png(pixels: &[[u8; 4]], [width, height]: [u16; 2]) -> Result<Vec<u8>, ImageError> {
    let failed = |error| ImageError::Damaged { format: "PNG", what: format!("{error}") };
    // What has no order gets no shorter; room that is not written to takes no memory.
    let mut bytes = Vec::with_capacity(pixels.as_flattened().len());
    let mut encoder = png::Encoder::new(&mut bytes, width.into(), height.into());
    encoder.set_color(png::ColorType::Rgba);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(pixels.as_flattened()).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ImageRows;
    use std::io::Cursor;

    fn decoded(bytes: Vec<u8>) -> Vec<[u8; 4]> {
        let mut rows = ImageRows::open(Cursor::new(bytes), 64 << 20).unwrap();
        let mut pixels = Vec::new();
        rows.read_rows(1 << 16, &mut pixels).unwrap();
        pixels
    }

    /// Of a palette, neighbours have nothing to do with each other; of a photograph, hues change slowly and light does not.
    #[test]
    fn hues_that_change_from_pixel_to_pixel_are_kept() {
        let noise =
            |at: u32, part: u32| (at.wrapping_mul(747_796_405) ^ part.wrapping_mul(277_803_737)) >> 7 & 127;
        let hues = |at: u32| [0, 1, 2].map(|part| 64 + noise(at, part) as u8);
        let gray = |at: u32| [noise(at, 0) as u8, 20 + noise(at, 0) as u8, 40 + noise(at, 0) as u8];
        for (name, color) in [("hues", &hues as &dyn Fn(u32) -> [u8; 3]), ("light", &gray)] {
            let pixels: Vec<[u8; 4]> = (0..64 * 64).map(color).map(|[r, g, b]| [r, g, b, 255]).collect();
            assert_eq!(is_vivid(&pixels, 64), name == "hues", "{name}");
            let found = decoded(encode(&pixels, [64, 64]).unwrap().bytes);
            let off = |(a, b): (&[u8; 4], &[u8; 4])| {
                (0..3).map(|i| u64::from(a[i].abs_diff(b[i])).pow(2)).sum::<u64>()
            };
            let mean = found.iter().zip(&pixels).map(off).sum::<u64>() as f64 / (3.0 * 4096.0);
            assert!(mean < 100.0, "{name}: {mean}");
        }
    }

    #[test]
    fn pixels_come_back() {
        let smooth = |alpha: u8| -> Vec<[u8; 4]> {
            (0..64 * 48u32).map(|at| [(at % 64 * 3) as u8, (at / 64 * 4) as u8, 90, alpha]).collect()
        };
        let opaque = encode(&smooth(255), [64, 48]).unwrap();
        assert!(!opaque.is_png);
        let worst = decoded(opaque.bytes)
            .into_iter()
            .zip(smooth(255))
            .map(|(a, b)| (0..4).map(|i| a[i].abs_diff(b[i])).max().unwrap());
        assert!(worst.max().unwrap() <= 12);

        let veiled = encode(&smooth(200), [64, 48]).unwrap();
        assert!(veiled.is_png);
        assert_eq!(decoded(veiled.bytes), smooth(200));
        assert!(encode(&smooth(255), [64, 47]).is_err() && encode(&[], [0, 0]).is_err());
    }
}
