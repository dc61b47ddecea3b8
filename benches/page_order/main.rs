//! Orders of pages: how many runs of pages side by side, and how many blocks, traversals read.
//!
//! `cargo bench --no-default-features --bench page_order -- FILE.chpm...`, CSV on stdout. What a traversal reads in a frame does not depend on the order, so each is
//! walked once. Pages are placed as they would be: at multiples of 4096 bytes or of 8.

mod orders;
mod ways;

use chpm_extmem::MappedFile;
use chpm_format::{Chpm, PACKED_ALIGN, PAGE_ALIGN};
use chpm_mesh::{Bytes, ClusterId};
use std::collections::BTreeSet;
use std::error::Error;
use std::path::Path;

/// Where the pages of an order are.
struct Places {
    /// By cluster: how many pages come before its own.
    ranks: Vec<u32>,
    offsets: Vec<u64>,
}

impl Places {
    fn of(file: &Chpm<MappedFile>, order: &[ClusterId], align: u64) -> Self {
        let mut places = Places { ranks: vec![0; order.len()], offsets: vec![0; order.len()] };
        let mut offset = 0;
        for (rank, id) in (0..).zip(order) {
            places.ranks[id.index()] = rank;
            places.offsets[id.index()] = offset;
            offset = (offset + u64::from(file.clusters()[id.index()].page_len)).next_multiple_of(align);
        }
        places
    }

    fn runs(&self, pages: &[ClusterId]) -> usize {
        let ranks: BTreeSet<u32> = pages.iter().map(|id| self.ranks[id.index()]).collect();
        ranks.iter().filter(|rank| **rank == 0 || !ranks.contains(&(**rank - 1))).count()
    }

    fn blocks(&self, file: &Chpm<MappedFile>, pages: &[ClusterId], len: u64) -> usize {
        let blocks = pages.iter().flat_map(|id| {
            let start = self.offsets[id.index()];
            start / len..=(start + u64::from(file.clusters()[id.index()].page_len) - 1) / len
        });
        blocks.collect::<BTreeSet<u64>>().len()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("model,pages,traversal,memory,read,order,align,runs,blocks_4k,blocks_64k");
    for name in std::env::args().skip(1).filter(|name| name.ends_with(".chpm")) {
        let path = Path::new(&name);
        let file = Chpm::open(MappedFile::open(path)?)?;
        let model = path.file_stem().unwrap_or_default().to_string_lossy();
        let orders = orders::all(&file);
        let splits = ways::splits(&file);
        let mut ways = vec![("every split by itself", "none", splits)];
        for (memory, told) in [(Bytes(u64::MAX), "unlimited"), (Bytes::mib(40), "40M")] {
            ways.extend(ways::cameras(&file, memory)?.into_iter().map(|(way, frames)| (way, told, frames)));
        }
        ways.push(("collision", "unlimited", ways::collision(&file)));
        for (way, memory, frames) in ways {
            let read: usize = frames.iter().map(Vec::len).sum();
            for (order, ids) in &orders {
                for align in [PAGE_ALIGN, PACKED_ALIGN] {
                    let places = Places::of(&file, ids, align);
                    let sum = |of: &dyn Fn(&[ClusterId]) -> usize| {
                        frames.iter().map(|pages| of(pages)).sum::<usize>()
                    };
                    println!(
                        "{model},{},{way},{memory},{read},{order},{align},{},{},{}",
                        ids.len(),
                        sum(&|pages| places.runs(pages)),
                        sum(&|pages| places.blocks(&file, pages, 4 << 10)),
                        sum(&|pages| places.blocks(&file, pages, 64 << 10)),
                    );
                }
            }
        }
    }
    Ok(())
}
