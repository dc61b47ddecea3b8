//! How fast pages come: reads all pages of a file, in its order and at random, within a budget.
//!
//! `cargo run --release -p chpm-viewer --features internals --example fetch_pass -- FILE.chpm [THREADS] [BUDGET]`

use chpm_extmem::{MappedFile, process};
use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId};
use chpm_viewer::internals::Fetch;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("give it a .chpm file")?;
    let threads = args.next().map_or(Ok(2), |n| n.parse())?;
    let budget: Bytes = args.next().map_or(Ok(Bytes::mib(64)), |n| n.parse())?;
    let file = Arc::new(Chpm::open(MappedFile::open(Path::new(&path))?)?);
    let count = file.clusters().len() as u64;
    // A step that has no divisor in common with the count visits every page, far from the last one.
    let step = (count * 618 / 1000..).find(|step| gcd(*step, count) == 1).unwrap_or(1);
    for (order, step) in [("in order", 1), ("at random", step)] {
        let mut fetch = Fetch::new(Arc::clone(&file), threads, budget)?;
        let start = Instant::now();
        for n in 0..count {
            fetch.request(ClusterId((n * step % count) as u32));
        }
        let (mut bytes, mut pages) = (0, 0);
        while fetch.pending() > 0 {
            for (_, page) in fetch.wait_arrived() {
                bytes += page?.len_bytes();
                pages += 1;
            }
        }
        let seconds = start.elapsed().as_secs_f64();
        let rate = bytes as f64 / seconds / f64::from(1 << 20);
        println!("{order}: {pages} pages, {} in {seconds:.2} s, {rate:.0} MiB/s", Bytes(bytes));
        println!("  at most {} at once of {budget}", fetch.peak());
    }
    if let Some(peak) = process::peak_resident() {
        println!("resident at most: {}", Bytes(peak));
    }
    Ok(())
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}
