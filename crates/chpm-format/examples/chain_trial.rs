//! Chains all pages of a file in memory, from the top, and reads them again: bytes by part, and processor time.
//!
//! `cargo run --release -p chpm-format --example chain_trial -- scan.chpm`, a file of raw pages.

use chpm_format::{Chpm, Page, packed};
use chpm_mesh::ClusterId;
use std::error::Error;
use std::fs;

fn user_time() -> Result<f64, Box<dyn Error>> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    let behind_name = stat.rsplit(") ").next().unwrap_or_default();
    Ok(behind_name.split(' ').nth(11).unwrap_or_default().parse::<f64>()? / 100.0)
}

fn words_of(bytes: &[u8]) -> Vec<u64> {
    let mut words = vec![0u64; bytes.len().div_ceil(8)];
    bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
    words
}

/// Sorted triangles of three corner positions at a position of the mesh.
fn mesh(page: &Page<'_>, n: usize) -> Vec<[[u32; 3]; 3]> {
    let b = page.base_vertex_count;
    let map = |mut v: u16| {
        while usize::from(v) >= n {
            v = page.targets[usize::from(v) - b];
        }
        v
    };
    let mut all: Vec<[[u32; 3]; 3]> = Vec::new();
    for t in page.triangles {
        let [x, y, z] = t.map(map);
        if x == y || y == z || z == x {
            continue;
        }
        let mut t = [x, y, z].map(|v| page.positions[usize::from(v)].map(f32::to_bits));
        let turn = (0..3).min_by_key(|i| [t[*i], t[(i + 1) % 3], t[(i + 2) % 3]]).unwrap_or(0);
        t.rotate_left(turn);
        all.push(t);
    }
    all.sort_unstable();
    all
}

fn main() -> Result<(), Box<dyn Error>> {
    let name = std::env::args().nth(1).ok_or("name a .chpm file")?;
    let bytes = fs::read(&name)?;
    let words = words_of(&bytes);
    let file = Chpm::open(&bytemuck::cast_slice(&words)[..bytes.len()])?;
    let mut ids: Vec<ClusterId> = (0..file.header().cluster_count).map(ClusterId).collect();
    ids.sort_by_key(|id| std::cmp::Reverse(file.clusters()[id.index()].level));
    let source = file.header().source_triangle_count as f64;
    let triangles: u64 = file.clusters().iter().map(|c| u64::from(c.triangle_count)).sum();
    let mut pages: Vec<(Vec<u64>, Vec<u8>, Option<ClusterId>)> = vec![Default::default(); ids.len()];
    let (mut chained, mut refused) = (0, 0);
    let mut parts = [0u64; packed::PARTS.len()];
    let mut largest = 0;
    let start = user_time()?;
    for id in &ids {
        let record = &file.clusters()[id.index()];
        let raw = file.page_bytes(*id);
        let mut out = Vec::new();
        let mut entry = None;
        if !record.is_root() {
            for (place, above) in (0..).zip(file.coarse(record.parent_group())) {
                let above = ClusterId(*above);
                let len = file.page_len(above) as usize;
                let parent = Page::view(&bytemuck::cast_slice(&pages[above.index()].0)[..len])?;
                if let Some(found) = packed::chain(raw, &parent, place, &mut out)? {
                    entry = Some((words_of(&found.raw), Some(above)));
                    let sizes = packed::chained_sizes(&found.raw, &parent)?.ok_or("again")?;
                    parts.iter_mut().zip(sizes).for_each(|(sum, bits)| *sum += bits);
                    let mut again = Vec::new();
                    let twice = packed::chain(&found.raw, &parent, place, &mut again)?.ok_or("twice")?;
                    if !(again == out && twice.raw == found.raw) {
                        let at = |a: &[u8], b: &[u8]| a.iter().zip(b).position(|(a, b)| a != b);
                        println!(
                            "{id:?} {} {} {:?} {:?} vertices {:?}",
                            again.len(),
                            out.len(),
                            at(&again, &out),
                            at(&twice.raw, &found.raw),
                            twice
                                .vertices
                                .iter()
                                .enumerate()
                                .filter(|(i, v)| *i != usize::from(**v))
                                .take(5)
                                .collect::<Vec<_>>()
                        );
                        let (a, b) = (Page::view(&twice.raw)?, Page::view(&found.raw)?);
                        println!(
                            "{:?} V {} B {}",
                            a.triangles
                                .iter()
                                .zip(b.triangles)
                                .enumerate()
                                .filter(|(_, (a, b))| a != b)
                                .take(6)
                                .collect::<Vec<_>>(),
                            a.vertex_count(),
                            a.base_vertex_count
                        );
                        return Err("differs".into());
                    }
                    let (old, new) = (
                        Page::view(raw)?,
                        Page::parse(&bytemuck::cast_slice(&entry.as_ref().unwrap().0)[..raw.len()])?,
                    );
                    for n in [
                        new.base_vertex_count,
                        (new.base_vertex_count + new.vertex_count()) / 2,
                        new.vertex_count(),
                    ] {
                        let (a, b) = (mesh(&old, n), mesh(&new, n));
                        if a != b {
                            let only = |a: &Vec<[[u32; 3]; 3]>, b: &Vec<[[u32; 3]; 3]>| {
                                a.iter().filter(|t| !b.contains(t)).cloned().collect::<Vec<_>>()
                            };
                            println!(
                                "{id:?} n {n} of {}..{}: {} {}; {:?} / {:?}",
                                new.base_vertex_count,
                                new.vertex_count(),
                                a.len(),
                                b.len(),
                                only(&a, &b),
                                only(&b, &a)
                            );
                            return Err("other mesh".into());
                        }
                        assert_eq!(old.error_at(n), new.error_at(n));
                    }
                    break;
                }
            }
        }
        let (words, above) = match entry {
            Some(entry) => {
                chained += 1;
                entry
            }
            None => {
                packed::pack(raw, &mut out)?;
                let sizes = packed::sizes(raw)?;
                parts.iter_mut().zip(sizes).for_each(|(sum, bits)| *sum += bits);
                if !record.is_root() {
                    refused += 1;
                }
                (words_of(raw), None)
            }
        };
        largest = largest.max(raw.len());
        pages[id.index()] = (words, out, above);
    }
    let packing = user_time()? - start;
    let mut raw = vec![0; largest];
    let mut seconds = 0.0;
    let times = 40_000_000u64.div_ceil(triangles);
    let start = user_time()?;
    for (id, (_, packed, above)) in (0..times).flat_map(|_| (0..).map(ClusterId).zip(&pages)) {
        let len = file.page_len(id) as usize;
        match above {
            Some(above) => {
                let len_above = file.page_len(*above) as usize;
                let parent = Page::view(&bytemuck::cast_slice(&pages[above.index()].0)[..len_above])?;
                packed::unchain(packed, &parent, &mut raw[..len])?;
            }
            None => packed::unpack(packed, &mut raw[..len])?,
        }
    }
    seconds += (user_time()? - start) / times as f64;
    for (id, (words, packed, above)) in (0..).map(ClusterId).zip(&pages) {
        let len = file.page_len(id) as usize;
        if let Some(above) = above {
            let parent =
                Page::view(&bytemuck::cast_slice(&pages[above.index()].0)[..file.page_len(*above) as usize])?;
            packed::unchain(packed, &parent, &mut raw[..len])?;
            assert!(raw[..len] == bytemuck::cast_slice::<u64, u8>(words)[..len]);
        }
    }
    // Locality: misses of a cache of 16 vertices for each triangle.
    let acmr = |of: &dyn Fn(ClusterId) -> Vec<[u16; 3]>| {
        let (mut misses, mut all) = (0u64, 0u64);
        for id in &ids {
            let mut cache: Vec<u16> = Vec::new();
            for v in of(*id).as_flattened() {
                if !cache.contains(v) {
                    misses += 1;
                    cache.push(*v);
                    if cache.len() > 16 {
                        cache.remove(0);
                    }
                }
            }
            all += of(*id).len() as u64;
        }
        misses as f64 / all as f64
    };
    let before = acmr(&|id| Page::view(file.page_bytes(id)).unwrap().triangles.to_vec());
    let after = acmr(&|id| {
        let len = file.page_len(id) as usize;
        Page::view(&bytemuck::cast_slice(&pages[id.index()].0)[..len]).unwrap().triangles.to_vec()
    });
    let all: usize = pages.iter().map(|p| p.1.len().next_multiple_of(8)).sum();
    println!("{name}: {chained} chained, {refused} refused of {}", ids.len());
    println!("pages {:.3} bytes a source triangle", all as f64 / source);
    let told = packed::PARTS
        .iter()
        .zip(parts)
        .map(|(part, bits)| format!("{part} {:.3}", bits as f64 / 8.0 / source));
    println!("parts: {}", told.collect::<Vec<_>>().join(", "));
    println!(
        "packing {packing:.2} s; unpacking {:.1} million stored triangles a second",
        triangles as f64 / seconds / 1e6
    );
    println!("misses of a cache of 16: {before:.3} before, {after:.3} after");
    Ok(())
}
