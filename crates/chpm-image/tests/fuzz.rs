//! Images that were damaged: read or refused, without a panic and within the memory that was allowed.
//!
//! As a test it runs a fixed number of cases. For longer, or to repeat a case:
//!
//! ```text
//! cargo test --release -p chpm-image --test fuzz -- --seconds 3600 --seed 2
//! cargo test -p chpm-image --test fuzz -- --seed 1 --case 4711
//! ```

use chpm_extmem::process;
use chpm_image::{ImageError, ImageRows};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use png::BitDepth;
use std::io::Cursor;
use std::panic::catch_unwind;
use std::time::{Duration, Instant};

/// Cases of a plain test run.
const CASES: u64 = 20_000;
/// Bytes that a decoder may hold, and pixels that are looked at: a damaged size may be large.
const MEMORY: u64 = 8 << 20;
const PIXELS: usize = 1 << 16;
/// Bytes that all cases together may take beside: the images, and what is read of them.
const BESIDE: u64 = 24 << 20;

struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }
}

fn samples(count: usize) -> Vec<u8> {
    let mut random = Random(count as u64);
    (0..count).map(|i| (i / 7 % 200) as u8 + (random.next() % 40) as u8).collect()
}

/// Images of every kind that is read, and of some that are refused.
fn images() -> Vec<Vec<u8>> {
    let mut images = Vec::new();
    let [w, h] = [43, 29];
    for (color, depth, bytes) in [
        (png::ColorType::Grayscale, BitDepth::One, 6 * h),
        (png::ColorType::Grayscale, BitDepth::Eight, w * h),
        (png::ColorType::Indexed, BitDepth::Four, 22 * h),
        (png::ColorType::Rgb, BitDepth::Eight, 3 * w * h),
        (png::ColorType::Rgba, BitDepth::Sixteen, 8 * w * h),
    ] {
        let mut bytes_of_file = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes_of_file, w as u32, h as u32);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if color == png::ColorType::Indexed {
            encoder.set_palette(samples(48));
            encoder.set_trns(samples(9));
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&samples(bytes)).unwrap();
        writer.finish().unwrap();
        images.push(bytes_of_file);
    }
    for (color, channels) in [(ColorType::Luma, 1), (ColorType::Rgb, 3), (ColorType::Cmyk, 4)] {
        for sampling in [SamplingFactor::R_4_4_4, SamplingFactor::R_4_2_0, SamplingFactor::R_4_1_1] {
            for kind in 0..4 {
                let mut bytes = Vec::new();
                let mut encoder = Encoder::new(&mut bytes, 80);
                encoder.set_sampling_factor(sampling);
                encoder.set_progressive(kind >= 2);
                encoder.set_restart_interval(if kind % 2 == 0 { 0 } else { 2 });
                encoder.encode(&samples(channels * w * h), w as u16, h as u16, color).unwrap();
                images.push(bytes);
            }
        }
    }
    images
}

/// Damages an image in a few places.
fn spoil(image: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = image.to_vec();
    for _ in 0..1 + random.below(6) {
        let len = bytes.len();
        // Headers are short, and decide most.
        let at = if random.below(2) == 0 { random.below(len.min(700)) } else { random.below(len) };
        let some = random.below(20).min(len - at);
        match random.below(8) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.next() as u8,
            2 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][random.below(5)],
            3 => bytes.truncate(at.max(8)),
            4 => drop(bytes.drain(at..at + some)),
            5 => {
                let copy = bytes[at..at + some].to_vec();
                let to = random.below(len);
                bytes.splice(to..to, copy);
            }
            6 => bytes.splice(at..at, [0xff, 0xc0 + random.below(64) as u8]).for_each(drop),
            _ => bytes[at..at + some].fill(random.next() as u8),
        }
        if bytes.is_empty() {
            bytes.push(0);
        }
    }
    if random.below(4) > 0 {
        mend(&mut bytes);
    }
    bytes
}

/// Gives the chunks of a PNG the checksums that they should have.
fn mend(bytes: &mut [u8]) {
    let mut at = 8;
    while bytes.starts_with(b"\x89PNG")
        && let Some(length) = bytes.get(at..at + 4)
    {
        let end = at + 8 + u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        if end + 4 > bytes.len() {
            return;
        }
        let mut crc = flate2::Crc::new();
        crc.update(&bytes[at + 4..end]);
        bytes[end..end + 4].copy_from_slice(&crc.sum().to_be_bytes());
        at = end + 4;
    }
}

/// Reads an image as far as pixels are looked at.
fn read(bytes: Vec<u8>) -> Result<(), ImageError> {
    let mut rows = ImageRows::open(Cursor::new(bytes), MEMORY)?;
    let [width, height] = rows.size().map(|side| side as usize);
    assert!(width > 0 && height > 0 && rows.memory() <= MEMORY);
    let (mut left, mut some) = (PIXELS, Vec::new());
    while left > 0 {
        let count = rows.read_rows(1, &mut some)?;
        assert_eq!(some.len(), count * width);
        left = if count == 0 { 0 } else { left.saturating_sub(width) };
    }
    Ok(())
}

fn argument(name: &str) -> Option<u64> {
    let words: Vec<String> = std::env::args().collect();
    let at = words.iter().position(|word| word == name)?;
    words.get(at + 1)?.parse().ok()
}

fn main() {
    let images = images();
    let seed = argument("--seed").unwrap_or(1);
    let only = argument("--case");
    let seconds = argument("--seconds").map(Duration::from_secs);
    let before = process::peak_resident().unwrap_or(0);
    let (start, mut read_well, mut case) = (Instant::now(), 0, only.unwrap_or(0));
    let mut is_on = true;
    while is_on {
        let mut random = Random(seed << 40 ^ case);
        let kind = random.below(images.len());
        let bytes = spoil(&images[kind], &mut random);
        match catch_unwind(|| read(bytes)) {
            Ok(result) => read_well += u64::from(result.is_ok()),
            Err(_) => panic!("image {kind}: --seed {seed} --case {case}"),
        }
        case += 1;
        is_on = only.is_none()
            && match seconds {
                Some(most) => start.elapsed() < most,
                None => case < CASES,
            };
    }
    let more = process::peak_resident().unwrap_or(0).saturating_sub(before);
    println!("{case} cases of seed {seed}: {read_well} read all the same; {} MiB taken", more >> 20);
    assert!(more <= MEMORY + BESIDE, "{more} bytes");
}
