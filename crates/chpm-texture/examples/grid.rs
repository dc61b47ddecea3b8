//! `grid IMAGE SIDE MIB`: averages an image into the vertices of a grid of `SIDE` squares each way that covers it,
//! and tells time of the processor and the peak of memory.

use chpm_extmem::{Cancel, MemoryBudget, Store, process};
use chpm_texture::{Alpha, Averager, Images, Material, OpenedImage, TexturedTriangle, Wrap};
use std::error::Error;
use std::fs::File;
use std::io::BufReader;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().collect();
    let [_, image, side, mebibytes] = &words[..] else { return Err("grid IMAGE SIDE MIB".into()) };
    let (side, memory): (u32, u64) = (side.parse()?, mebibytes.parse::<u64>()? << 20);
    let store = Store::with_budget(&std::env::temp_dir(), MemoryBudget::with_work_limit(memory / 2, memory))?;

    let mut averager = Averager::new(&store)?;
    for y in 0..side {
        for x in 0..side {
            let place =
                |x: u32, y: u32| (y * (side + 1) + x, [x as f32 / side as f32, y as f32 / side as f32]);
            let [a, b, c, d] = [place(x, y), place(x + 1, y), place(x + 1, y + 1), place(x, y + 1)];
            for corners in [[a, b, c], [c, d, a]] {
                let (vertices, uv) = (corners.map(|corner| corner.0), corners.map(|corner| corner.1));
                averager.push(&TexturedTriangle { vertices, uv, material: 0 })?;
            }
        }
    }
    let material = Material { image: Some(0), factor: [1.0; 4], wrap: [Wrap::Repeat; 2] };
    let mut open =
        |_: u32| Ok(OpenedImage { bytes: Box::new(BufReader::new(File::open(image)?)), alpha: Alpha::Kept });
    let count = (side as usize + 1).pow(2);
    let colors = averager.finish(&[material], &mut Images::Files(&mut open), count, &Cancel::default())?;

    let mut sum = 0u64;
    let mut scratch = Vec::new();
    for start in (0..count).step_by(1 << 16) {
        let some = colors.read(start..count.min(start + (1 << 16)), &mut scratch)?;
        sum =
            some.iter().fold(sum, |sum, color| sum.wrapping_mul(31) ^ u64::from(u32::from_le_bytes(*color)));
    }
    println!("colours {sum:016x}, budget at most {} MiB", store.budget.peak() >> 20);
    let seconds = process::process_time().unwrap_or_default().as_secs_f64();
    println!("{seconds:.2} s of processor, peak {} MiB", process::peak_resident().unwrap_or(0) >> 20);
    Ok(())
}
