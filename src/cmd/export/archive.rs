//! A tileset as one file: the 3D Tiles archive.

use super::{Args, Sums, Work};
use crate::output::EXPORT;
use anyhow::Result;
use chpm_export::tiles::{Archive, Mesh, Options, SharedNormals, tile, tile_image, tile_path};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::ClusterId;
use std::path::Path;

/// Memory of a cluster: two files in the mean, since half of all are leaves, whose finest mesh and image have files, too; and some subtrees.
pub(super) const EACH: u64 = 3 * Archive::<Vec<u8>>::EACH;

/// Writes all of it.
pub(super) fn write(work: &Work<'_>, options: &Options, target: &Path, args: &Args) -> Result<Sums> {
    let mut archive = Archive::new(EXPORT.create(target, args.force, &[&args.file])?);
    let sets = work.tilesets(options, |set| Ok(archive.add(&set.path, set.json.as_bytes())?))?;
    let mut sums = Sums { sets, ..Sums::default() };

    let normals = work.normals()?;
    let make = |id| files(work.file, id, options, normals.as_ref());
    work.in_order("tiles", make, |files| {
        for TileFile { path, bytes, triangles } in files {
            archive.add(&path, &bytes)?;
            sums.bytes += bytes.len() as u64;
            sums.tiles += u64::from(triangles.is_some());
            sums.triangles += triangles.unwrap_or(0);
        }
        Ok(())
    })?;
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
