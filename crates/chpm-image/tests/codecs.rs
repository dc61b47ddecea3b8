//! Images of all kinds against other decoders, and what is refused.

use chpm_image::{ImageError, ImageRows};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use png::BitDepth;
use std::io::Cursor;

const PLENTY: u64 = 64 << 20;

/// Makes a pixel of its samples.
type Pixel = fn(&[u8]) -> [u8; 4];

fn grey(v: u8) -> [u8; 4] {
    [v, v, v, 255]
}

/// Smooth colours with some noise.
fn picture(width: usize, height: usize, channels: usize) -> Vec<u8> {
    let mut noise = 1u32;
    let mut bytes = Vec::new();
    for y in 0..height {
        for x in 0..width {
            for channel in 0..channels {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let smooth = [x * 255 / width, y * 255 / height, (x + y) * 127 / (width + height), 200];
                bytes.push((smooth[channel] as u32 / 2 + 40 + (noise >> 28)) as u8);
            }
        }
    }
    bytes
}

/// All rows, some at a time.
fn read(bytes: &[u8], memory: u64) -> Result<([u32; 2], Vec<[u8; 4]>), ImageError> {
    let mut rows = ImageRows::open(Cursor::new(bytes.to_vec()), memory)?;
    let (mut all, mut some) = (Vec::new(), Vec::new());
    assert!(rows.memory() <= memory);
    while rows.read_rows(7, &mut some)? > 0 {
        all.extend_from_slice(&some);
    }
    assert_eq!(rows.read_rows(7, &mut some)?, 0, "no row after the last");
    let size = rows.size();
    assert_eq!(all.len(), size[0] as usize * size[1] as usize);
    Ok((size, all))
}

fn png(size: [usize; 2], color: png::ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size[0] as u32, size[1] as u32);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == png::ColorType::Indexed {
        encoder.set_palette((0..=255u8).flat_map(|i| [i, 255 - i, i / 2]).collect::<Vec<_>>());
        encoder.set_trns((0..100u8).collect::<Vec<_>>());
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    bytes
}

fn jpeg(size: [usize; 2], color: ColorType, change: impl FnOnce(&mut Encoder<&mut Vec<u8>>)) -> Vec<u8> {
    let channels = match color {
        ColorType::Luma => 1,
        ColorType::Rgb => 3,
        _ => 4,
    };
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 90);
    change(&mut encoder);
    encoder.encode(&picture(size[0], size[1], channels), size[0] as u16, size[1] as u16, color).unwrap();
    bytes
}

/// Pixels of a JPEG by another decoder.
fn others(bytes: &[u8]) -> Vec<[u8; 3]> {
    let options = zune_core::options::DecoderOptions::default()
        .jpeg_set_out_colorspace(zune_core::colorspace::ColorSpace::RGB);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(Cursor::new(bytes), options);
    decoder.decode().unwrap().as_chunks().0.to_vec()
}

/// Means of squares of differences.
fn difference(ours: &[[u8; 4]], theirs: &[[u8; 3]]) -> f64 {
    assert_eq!(ours.len(), theirs.len());
    let pairs = ours.iter().zip(theirs).flat_map(|(a, b)| (0..3).map(|i| f64::from(a[i]) - f64::from(b[i])));
    pairs.map(|d| d * d).sum::<f64>() / (3 * ours.len()) as f64
}

#[test]
fn every_png_is_read() {
    use png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
    let (w, h) = (37, 23);
    let bytes = |channels| picture(w, h, channels);
    let wide = |channels| -> Vec<u8> { bytes(channels).iter().flat_map(|&byte| [byte, !byte]).collect() };
    let cases: [(png::ColorType, usize, Pixel); 4] = [
        (Grayscale, 1, |p| grey(p[0])),
        (GrayscaleAlpha, 2, |p| [p[0], p[0], p[0], p[1]]),
        (Rgb, 3, |p| [p[0], p[1], p[2], 255]),
        (Rgba, 4, |p| [p[0], p[1], p[2], p[3]]),
    ];
    for (color, channels, pixel) in cases {
        let expected: Vec<[u8; 4]> = bytes(channels).chunks(channels).map(pixel).collect();
        for (depth, data) in [(BitDepth::Eight, bytes(channels)), (BitDepth::Sixteen, wide(channels))] {
            let (size, pixels) = read(&png([w, h], color, depth, &data), PLENTY).unwrap();
            assert_eq!(size, [w as u32, h as u32]);
            assert!(pixels == expected, "{color:?} {depth:?}");
        }
    }
    let (_, pixels) = read(&png([w, h], Indexed, BitDepth::Eight, &bytes(1)), PLENTY).unwrap();
    let alpha = |i: u8| if i < 100 { i } else { 255 };
    assert!(pixels.iter().zip(bytes(1)).all(|(pixel, i)| *pixel == [i, 255 - i, i / 2, alpha(i)]));
    let (_, pixels) = read(&png([16, 1], Grayscale, BitDepth::One, &[0b1010_0000, 1]), PLENTY).unwrap();
    assert_eq!([pixels[0], pixels[1], pixels[15]], [grey(255), grey(0), grey(255)]);
    assert_eq!(read(&png([1, 1], Rgb, BitDepth::Eight, &[1, 2, 3]), PLENTY).unwrap().1, [[1, 2, 3, 255]]);
}

#[test]
fn every_jpeg_is_what_another_decoder_makes_of_it() {
    let samplings = [
        SamplingFactor::R_4_4_4,
        SamplingFactor::R_4_2_2,
        SamplingFactor::R_4_2_0,
        SamplingFactor::R_4_4_0,
        SamplingFactor::R_4_1_1,
    ];
    for size in [[1, 1], [8, 8], [17, 33], [200, 131]] {
        for sampling in samplings {
            // Where a unit has more than two rows or columns of blocks, this encoder writes one colour after another.
            let kinds: &[bool] = if sampling == SamplingFactor::R_4_1_1 { &[true] } else { &[false, true] };
            for &is_progressive in kinds {
                for restart in [0, 3] {
                    let bytes = jpeg(size, ColorType::Rgb, |encoder| {
                        encoder.set_sampling_factor(sampling);
                        encoder.set_progressive(is_progressive);
                        encoder.set_restart_interval(restart);
                        encoder.set_optimized_huffman_tables(is_progressive && restart == 0);
                    });
                    let (found, pixels) = read(&bytes, PLENTY).unwrap();
                    assert_eq!(found, size.map(|side| side as u32));
                    // Chroma between its samples is up to the decoder.
                    let off = difference(&pixels, &others(&bytes));
                    let most = if sampling == SamplingFactor::R_4_4_4 { 0.5 } else { 30.0 };
                    assert!(off <= most, "{size:?} {sampling:?} {is_progressive} {restart}: {off}");
                }
            }
        }
    }
}

#[test]
fn grey_jpegs_are_grey() {
    for is_progressive in [false, true] {
        let mut bytes = jpeg([50, 31], ColorType::Luma, |encoder| encoder.set_progressive(is_progressive));
        let pixels = read(&bytes, PLENTY).unwrap().1;
        assert!(pixels.iter().all(|p| p[0] == p[1] && p[1] == p[2] && p[3] == 255));
        assert!(difference(&pixels, &others(&bytes)) <= 0.5);
        // A sampling of the only component says nothing.
        let frame = bytes.windows(2).position(|pair| matches!(pair, [0xff, 0xc0 | 0xc2])).unwrap();
        assert_eq!(bytes[frame + 11], 0x11);
        bytes[frame + 11] = 0x22;
        assert!(read(&bytes, PLENTY).unwrap().1 == pixels);
    }
}

#[test]
fn what_is_not_read_is_told() {
    let message = |bytes: &[u8], memory| read(bytes, memory).unwrap_err().to_string();
    assert!(message(b"GIF89a, and more", PLENTY).contains("neither a PNG nor a JPEG"));
    assert!(message(b"", PLENTY).contains("neither"));
    let inks = jpeg([20, 20], ColorType::Cmyk, |_| {});
    assert!(message(&inks, PLENTY).contains("CMYK") && message(&inks, PLENTY).contains("save the image"));

    let apart = jpeg([20, 20], ColorType::Rgb, |encoder| encoder.set_optimized_huffman_tables(true));
    assert!(message(&apart, PLENTY).contains("one colour after another"));

    let big = jpeg([1000, 900], ColorType::Rgb, |encoder| encoder.set_progressive(true));
    let refused = message(&big, 3 << 20);
    assert!(refused.contains("baseline") && refused.contains("--memory"), "{refused}");
    assert!(read(&big, 10 << 20).is_ok());
    let plain = jpeg([1000, 900], ColorType::Rgb, |_| {});
    assert!(read(&plain, 3 << 20).is_ok());
}

#[test]
fn images_that_end_early_are_errors() {
    let images = [
        png([40, 40], png::ColorType::Rgb, BitDepth::Eight, &picture(40, 40, 3)),
        jpeg([40, 40], ColorType::Rgb, |_| {}),
        jpeg([40, 40], ColorType::Rgb, |encoder| encoder.set_progressive(true)),
    ];
    for bytes in images {
        for len in 0..bytes.len() * 3 / 4 {
            assert!(read(&bytes[..len], PLENTY).is_err(), "{len} of {}", bytes.len());
        }
    }
}

/// A chunk of a PNG.
fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let mut crc = u32::MAX;
    for byte in kind.iter().chain(data) {
        crc ^= u32::from(*byte);
        (0..8).for_each(|_| crc = if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 });
    }
    [&(data.len() as u32).to_be_bytes(), &kind[..], data, &(!crc).to_be_bytes()].concat()
}

/// The decoder panics at such, unless it is kept from it.
#[test]
fn palettes_that_are_none_are_errors() {
    let data = picture(9, 5, 1);
    let good = png([9, 5], png::ColorType::Indexed, BitDepth::Eight, &data);
    let at = good.windows(4).position(|four| four == b"PLTE").unwrap() - 4;
    let behind = at + chunk(b"PLTE", &[0; 768]).len();
    let with = |palette: &[u8]| [&good[..at], &chunk(b"PLTE", palette), &good[behind..]].concat();
    let all: Vec<u8> = (0..=255u8).flat_map(|i| [i, 255 - i, i / 2]).collect();
    assert_eq!(with(&all), good);
    assert!(read(&with(&all[..600]), PLENTY).is_ok());
    for len in [0, 1, 2, 4, 767, 769, 771, 3000] {
        let error = read(&with(&vec![7; len]), PLENTY).unwrap_err().to_string();
        assert!(error.contains("palette") || error.contains("PLTE"), "{len}: {error}");
    }
}
