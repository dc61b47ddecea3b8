//! Writing images: JPEG where all is opaque, else PNG. Whole numbers only, so that the same pixels give the same bytes everywhere.

use crate::ImageError;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

/// Quality of JPEG, of 100.
const QUALITY: u8 = 90;

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
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    let failed = |error| ImageError::Damaged { format: "JPEG", what: format!("{error}") };
    encoder.encode(pixels.as_flattened(), width, height, ColorType::Rgba).map_err(failed)?;
    Ok(bytes)
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
