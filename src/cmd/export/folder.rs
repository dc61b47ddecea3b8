//! A tileset in a folder, which a next run goes on with where one was stopped.

use super::{Args, Sums, Work};
use crate::cmd::check_unchanged;
use crate::folder::{OutputFolder, above};
use crate::output;
use crate::progress::line;
use anyhow::Result;
use chpm_export::tiles::{Mesh, Options, tile, tile_image, tile_path};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{ClusterId, Counted};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use xxhash_rust::xxh3::xxh3_64;

/// Files in an export's folder, one of each kind.
const NAMES: [&str; 6] = [
    "tileset.json",
    "tiles/0/0.glb",
    "tiles/0/0-finest.glb",
    "tiles/0/0.jpg",
    "tiles/0/0.png",
    "subtrees/0/0.json",
];

/// Memory of a cluster: a stopped run's record of its tiles.
pub(super) const EACH: u64 = 2 * 2 * 32;

/// Writes all of it.
pub(super) fn write(work: &Work<'_>, options: &Options, target: &Path, args: &Args) -> Result<Sums> {
    let folder = OutputFolder::create(target, args.force, &NAMES, Some(key(work.file, options)))?;
    if folder.found() > 0 && !args.quiet {
        line(&format!("going on: {} are there", Counted(folder.found() as u64, "tile")));
    }
    let sums = match fill(work, options, &folder) {
        Ok(sums) => sums,
        // What is wrong with the source will be so next time.
        Err(error) if work.cancel.is_cancelled() || error.chain().any(|cause| cause.is::<io::Error>()) => {
            return Err(folder.keep(error));
        }
        Err(error) => return Err(error),
    };
    folder.publish()?;
    output::finish(target);
    Ok(sums)
}

/// Hash of everything that decides the bytes: the options, and the file, whose header has a checksum of the checksums of all that is in it.
fn key(file: &Chpm<MappedFile>, options: &Options) -> u64 {
    xxh3_64(format!("{:016x} {options:?}", file.header().header_checksum).as_bytes())
}

fn fill(work: &Work<'_>, options: &Options, folder: &OutputFolder) -> Result<Sums> {
    let &Work { file, meter, .. } = work;
    let sets = work.tilesets(options, |set| {
        folder.folder(above(&set.path))?;
        folder.write(&set.path, set.json.as_bytes())
    })?;

    let normals = work.normals()?;
    let clusters: Vec<ClusterId> = (0..file.header().cluster_count).map(ClusterId).collect();
    let folders: BTreeSet<String> =
        clusters.iter().map(|id| above(&tile_path(*id, Mesh::Base)).to_owned()).collect();
    folders.iter().try_for_each(|name| folder.folder(name))?;
    meter.start("tiles", clusters.len() as u64);
    let [tiles, triangles, bytes] = [0, 0, 0].map(AtomicU64::new);
    clusters.par_iter().try_for_each(|id| {
        for mesh in Mesh::of(file, *id) {
            let path = tile_path(*id, *mesh);
            let (len, count) = match folder.whole(&path) {
                Some(found) => found,
                None => {
                    let (glb, count) = tile(file, *id, *mesh, options, normals.as_ref())?;
                    folder.write_to_keep(&path, &glb, count)?;
                    (glb.len() as u64, count)
                }
            };
            for (sum, more) in [(&tiles, 1), (&triangles, count), (&bytes, len)] {
                sum.fetch_add(more, Relaxed);
            }
        }
        if let Some((path, image)) = tile_image(file, *id)? {
            if folder.whole(&path).is_none() {
                folder.write_to_keep(&path, &image, 0)?;
            }
            bytes.fetch_add(image.len() as u64, Relaxed);
        }
        work.step()
    })?;
    check_unchanged(file)?;
    let [tiles, triangles, bytes] = [tiles, triangles, bytes].map(AtomicU64::into_inner);
    Ok(Sums { sets, tiles, triangles, bytes, archive: None })
}
