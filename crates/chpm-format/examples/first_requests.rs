//! Requests and bytes of a reader far away before it can draw: for the tables, for the roots, and for a model that is refined where it is worst.
//!
//! `cargo run --release -p chpm-format --example first_requests -- scan.chpm`. Ranges are read from a file here, as they would be from a server.

use chpm_format::RemoteChpm;
use chpm_mesh::ClusterId;
use std::cell::Cell;
use std::error::Error;
use std::fs::File;
use std::os::unix::fs::FileExt;

/// Pages are asked for until they are more than this, bytes.
const ENOUGH: u64 = 192 << 10;

fn main() -> Result<(), Box<dyn Error>> {
    let name = std::env::args().nth(1).ok_or("name a .chpm file")?;
    let source = File::open(&name)?;
    let (requests, bytes) = (Cell::new(0), Cell::new(0));
    let mut file = RemoteChpm::open(source.metadata()?.len(), |_, offset, out: &mut [u8]| {
        requests.set(requests.get() + 1);
        bytes.set(bytes.get() + out.len());
        source.read_exact_at(out, offset)
    })?;
    let tell = |what: &str| println!("{what}: {} requests, {} bytes so far", requests.get(), bytes.get());
    println!(
        "{name}: {} clusters, {}",
        file.header().cluster_count,
        match file.is_chunked() {
            true => "in chunks",
            false => "tables as a whole",
        }
    );
    let mut cut = file.roots()?;
    tell("places of the roots");
    for root in &cut {
        file.page(*root)?;
    }
    tell("pages of the roots");

    // The group of the largest error is split next, as a view from far away would do.
    let (mut pages, mut splits) = (0, 0);
    let mut error = f32::INFINITY;
    while pages < ENOUGH {
        let mut worst: Option<(f32, ClusterId)> = None;
        for id in &cut {
            let group = file.cluster(*id)?.group();
            let group = file.group(group)?;
            if !group.is_leaf() && worst.is_none_or(|(error, _)| group.min_error > error) {
                worst = Some((group.min_error, *id));
            }
        }
        let Some((largest, id)) = worst else { break };
        error = largest;
        let group = file.cluster(id)?.group();
        let (coarse, fine) = (file.coarse(group)?, file.fine(group)?);
        if splits == 0 {
            tell("members of the first group");
        }
        cut.retain(|id| !coarse.contains(id));
        for id in fine {
            file.page(id)?;
            pages += u64::from(file.cluster(id)?.page_len);
            cut.push(id);
        }
        splits += 1;
    }
    let mut triangles = 0;
    for id in &cut {
        triangles += file.cluster(*id)?.triangle_count;
    }
    tell(&format!("{splits} groups split, {triangles} triangles at an error below {error}"));
    Ok(())
}
