//! A tileset as one file: the 3D Tiles archive.

use super::{Args, Sums, Work};
use crate::output::EXPORT;
use anyhow::Result;
use chpm_export::tiles::{Archive, Mesh, Options, SharedNormals, tile, tile_image, tile_path};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::ClusterId;
use rayon::prelude::*;

/// Memory of a cluster: two files in the mean, since half of all are leaves, whose finest mesh and image have files, too; and some subtrees.
pub(super) const EACH: u64 = 3 * Archive::<Vec<u8>>::EACH;

/// Clusters that are made before they are written, for each thread: files come in their order, whoever is faster.
const AHEAD: usize = 4;

fn batch() -> usize {
    AHEAD * rayon::current_num_threads()
}

/// Memory of the files that wait to be written, at most.
pub(super) fn waiting(file: &Chpm<MappedFile>) -> u64 {
    // Positions, normals, colours and indices of the base mesh and the finest, with what stands before them.
    let heaviest = file.clusters().iter().map(|cluster| {
        4096 + 2 * (40 * u64::from(cluster.vertex_count) + 12 * u64::from(cluster.triangle_count))
    });
    let sheet = file.sheets().iter().map(|sheet| sheet.len()).max().unwrap_or(0);
    batch() as u64 * (heaviest.max().unwrap_or(0) + sheet)
}

/// Writes all of it.
pub(super) fn write(work: &Work<'_>, args: &Args) -> Result<Sums> {
    let &Work { file, options, meter, .. } = work;
    let mut archive = Archive::new(EXPORT.create(&args.tiles, args.force, &[&args.file])?);
    let mut sums = Sums::default();
    sums.sets = work.tilesets(|set| Ok(archive.add(&set.path, set.json.as_bytes())?))?;

    let normals = work.normals()?;
    let clusters: Vec<ClusterId> = (0..file.header().cluster_count).map(ClusterId).collect();
    meter.start("tiles", clusters.len() as u64);
    for batch in clusters.chunks(batch()) {
        let made = batch.par_iter().map(|id| {
            work.step()?;
            files(file, *id, options, normals.as_ref())
        });
        let made: Vec<Vec<TileFile>> = made.collect::<Result<_>>()?;
        for TileFile { path, bytes, triangles } in made.into_iter().flatten() {
            archive.add(&path, &bytes)?;
            sums.bytes += bytes.len() as u64;
            sums.tiles += u64::from(triangles.is_some());
            sums.triangles += triangles.unwrap_or(0);
        }
    }
    file.get_ref().check_unchanged()?;
    let (out, len) = archive.finish()?;
    out.publish()?;
    Ok(Sums { archive: Some(len), ..sums })
}

struct TileFile {
    path: String,
    bytes: Vec<u8>,
    /// None of an image.
    triangles: Option<u64>,
}

/// A cluster's files.
fn files(
    file: &Chpm<MappedFile>,
    cluster: ClusterId,
    options: &Options,
    normals: Option<&SharedNormals>,
) -> Result<Vec<TileFile>> {
    let mut files = Vec::new();
    for mesh in Mesh::of(file, cluster) {
        let (bytes, triangles) = tile(file, cluster, *mesh, options, normals)?;
        files.push(TileFile { path: tile_path(cluster, *mesh), bytes, triangles: Some(triangles) });
    }
    let image = tile_image(file, cluster)?;
    files.extend(image.map(|(path, bytes)| TileFile { path, bytes, triangles: None }));
    Ok(files)
}
