//! How long one thread takes for rays in memory, in its own processor time: `benches/rays.py` has the peer beside it.
//!
//! Usage: `speed FILE.chpm RAYS`, where RAYS has six little-endian f64 for each ray: origin and direction, in the model's coordinates.

use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_rays::{Bound, Caster, Memory, Ray, Seek};
use std::error::Error;

/// Nanoseconds of this thread, as Linux counts them.
fn processor() -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    Ok(text.split(' ').next().unwrap_or_default().parse::<f64>()? * 1e-9)
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [path, rays] = words.as_slice() else { return Err("FILE.chpm RAYS".into()) };
    let file = Chpm::open(std::fs::read(path)?)?;
    let origin = file.header().origin;
    let bytes = std::fs::read(rays)?;
    let numbers = bytes.chunks_exact(8).map(|x| x.try_into().map_or(f64::NAN, f64::from_le_bytes));
    let numbers: Vec<f64> = numbers.collect();
    let rays: Vec<Ray> = numbers
        .chunks_exact(6)
        .map(|x| Ray::new([x[0] - origin[0], x[1] - origin[1], x[2] - origin[2]], [x[3], x[4], x[5]]))
        .collect();

    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build()?;
    let mut caster = Caster::new(&file, Memory::new(Bytes(1 << 34), 1 << 20));
    for (seek, name) in [(Seek::Nearest, "read"), (Seek::Nearest, "nearest"), (Seek::Any, "any")] {
        let before = processor()?;
        let (mut hits, mut sum) = (0, 0.0);
        pool.install(|| {
            caster.cast(&rays, &Bound::LEAVES, seek, &|| true, |hit, distance| {
                hits += u64::from(hit.is_some());
                sum += if hit.is_some() { distance } else { 0.0 };
            })
        })?;
        let seconds = processor()? - before;
        println!("{name},{},{hits},{sum},{seconds}", rays.len());
    }
    Ok(())
}
