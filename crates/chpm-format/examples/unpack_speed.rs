//! Packs all pages of a file in memory, and unpacks them again and again: what packing costs and gives, in this thread's time alone, beside the codecs of
//! meshoptimizer (version 1), which keep triangles and positions, and neither the order of the vertices nor at which corner a triangle starts.
//!
//! `cargo run --release -p chpm-format --example unpack_speed -- scan.chpm`, a file of raw pages. Processor time is counted, not time on the wall, in steps of a
//! hundredth of a second.

mod measured;

use chpm_format::{Chpm, Page, packed};
use chpm_mesh::ClusterId;
use measured::{TRIANGLES, named, user_time};
use std::error::Error;
use std::hint::black_box;

/// A page's triangles and its vertices in the order in which those meet them, as meshoptimizer's codecs have them.
struct Baseline {
    triangles: Vec<u8>,
    positions: Vec<u8>,
    counts: [usize; 2],
}

impl Baseline {
    fn of(page: &Page<'_>) -> meshopt::Result<Self> {
        let mut ranks = vec![u32::MAX; page.vertex_count()];
        let mut met = Vec::new();
        let mut rank = |vertex: u16| {
            let rank = &mut ranks[usize::from(vertex)];
            if *rank == u32::MAX {
                *rank = met.len() as u32;
                met.push(page.positions[usize::from(vertex)]);
            }
            *rank
        };
        let corners: Vec<u32> = page.triangles.as_flattened().iter().map(|vertex| rank(*vertex)).collect();
        Ok(Baseline {
            triangles: meshopt::encode_index_buffer(&corners, met.len())?,
            positions: meshopt::encode_vertex_buffer_level(&met, 3, Some(1))?,
            counts: [page.triangles.len(), met.len()],
        })
    }

    fn decode(&self) -> meshopt::Result<()> {
        let [triangles, vertices] = self.counts;
        black_box(meshopt::decode_index_buffer::<u16>(&self.triangles, 3 * triangles)?);
        black_box(meshopt::decode_vertex_buffer::<[f32; 3]>(&self.positions, vertices)?);
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let (name, words, len) = named()?;
    let file = Chpm::open(&bytemuck::cast_slice(&words)[..len])?;
    let ids = || (0..file.header().cluster_count).map(ClusterId);
    let source = file.header().source_triangle_count as f64;
    let triangles: u64 = file.clusters().iter().map(|cluster| u64::from(cluster.triangle_count)).sum();

    let start = user_time()?;
    let mut pages = Vec::new();
    for id in ids() {
        let mut page = Vec::new();
        if packed::pack(file.page_bytes(id), &mut page)? {
            pages.push((id, page));
        }
    }
    let packing = user_time()? - start;

    let mut raw = vec![0; ids().map(|id| file.page_len(id)).max().unwrap_or(0) as usize];
    for (id, page) in &pages {
        let raw = &mut raw[..file.page_len(*id) as usize];
        packed::unpack(page, raw)?;
        assert_eq!(raw, file.page_bytes(*id), "every bit comes back");
    }
    let mut parts = [0; packed::PARTS.len()];
    for id in ids() {
        let sizes = packed::sizes(file.page_bytes(id))?;
        parts.iter_mut().zip(sizes).for_each(|(sum, bits)| *sum += bits);
    }
    let times = TRIANGLES.div_ceil(triangles.max(1));
    let start = user_time()?;
    for (id, page) in (0..times).flat_map(|_| &pages) {
        packed::unpack(page, &mut raw[..file.page_len(*id) as usize])?;
    }
    let unpacking = (user_time()? - start) / times as f64;

    let baselines = ids().map(|id| Baseline::of(&file.page(id)?.view()).map_err(Into::into));
    let baselines = baselines.collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    let start = user_time()?;
    (0..times).flat_map(|_| &baselines).try_for_each(Baseline::decode)?;
    let decoding = (user_time()? - start) / times as f64;

    let of = |bytes: usize| bytes as f64 / source;
    let before = of(ids().map(|id| file.page_bytes(id).len()).sum());
    let after = of(pages.iter().map(|(_, page)| page.len()).sum());
    println!("{name}: {} of {} pages packed", pages.len(), ids().count());
    println!("pages: {before:.2} bytes a source triangle, packed {after:.2}");
    let told = packed::PARTS
        .iter()
        .zip(parts)
        .map(|(part, bits)| format!("{part} {:.3}", bits as f64 / 8.0 / source));
    println!("parts: {}", told.collect::<Vec<_>>().join(", "));
    println!(
        "packing: {packing:.2} s, {:.1} million stored triangles a second",
        triangles as f64 / packing / 1e6
    );
    println!("unpacking: {unpacking:.3} s, {:.1} million", triangles as f64 / unpacking / 1e6);
    let bytes = |part: fn(&Baseline) -> &[u8]| of(baselines.iter().map(|b| part(b).len()).sum());
    println!(
        "meshoptimizer: positions {:.3}, connectivity {:.3}; decoding {decoding:.3} s, {:.1} million",
        bytes(|b| &b.positions),
        bytes(|b| &b.triangles),
        triangles as f64 / decoding / 1e6
    );
    Ok(())
}
