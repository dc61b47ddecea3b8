//! Unpacks all pages of a file of chained pages again and again, each with the one above at hand: processor time of this thread alone; and what one leaf alone takes.
//!
//! `cargo run --release -p chpm-format --example chain_speed -- scan.chpm`. Processor time is counted in steps of a hundredth of a second.

mod measured;

use chpm_format::{Chpm, Page, packed};
use chpm_mesh::ClusterId;
use measured::{TRIANGLES, named, user_time};
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let (_, words, len) = named()?;
    let file = Chpm::open(&bytemuck::cast_slice(&words)[..len])?;
    let ids = || (0..file.header().cluster_count).map(ClusterId);
    let triangles: u64 = file.clusters().iter().map(|cluster| u64::from(cluster.triangle_count)).sum();

    let start = user_time()?;
    let pages = ids().map(|id| file.page(id)).collect::<Result<Vec<_>, _>>()?;
    let walking = user_time()? - start;
    let mut raw = vec![0; ids().map(|id| file.page_len(id)).max().unwrap_or(0) as usize];
    let times = TRIANGLES.div_ceil(triangles.max(1));
    let start = user_time()?;
    for id in (0..times).flat_map(|_| ids()) {
        let (bytes, raw) = (file.page_bytes(id), &mut raw[..file.page_len(id) as usize]);
        match file.above(id, bytes)? {
            Some(above) => packed::unchain(bytes, &pages[above.index()].view(), raw)?,
            None if file.is_packed(id) => packed::unpack(bytes, raw)?,
            None => Page::view(bytes).map(|_| ())?,
        }
    }
    let unpacking = (user_time()? - start) / times as f64;

    let leaf = ids().rfind(|id| file.clusters()[id.index()].level == 0).ok_or("no leaf")?;
    let (mut chain, mut at, mut read) = (0, leaf, 0);
    while let Some(above) = file.above(at, file.page_bytes(at))? {
        (chain, read, at) = (chain + 1, read + file.page_bytes(at).len(), above);
    }
    let fresh = Chpm::open(file.bytes())?;
    let start = Instant::now();
    fresh.page(leaf)?;
    let alone = start.elapsed().as_secs_f64() * 1e3;

    println!("unpacking {:.1} million stored triangles a second", triangles as f64 / unpacking / 1e6);
    println!(
        "all pages in the order of the file: {walking:.2} s, {:.1} times that of unpacking each once, checks included",
        walking / unpacking
    );
    println!(
        "one leaf alone: {} pages, {} bytes, {alone:.2} ms",
        chain + 1,
        read + file.page_bytes(at).len()
    );
    Ok(())
}
