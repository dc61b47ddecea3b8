//! Frame times on the adapter that is there: `cargo bench -p chpm-viewer --bench frames -- PART [FILE.chpm]`. A wait for the device
//! follows each frame. Parts are told in their modules; what `benches/README.md` has records of prints CSV.

#[path = "../../../chpm-refine/examples/front_pass/plane.rs"]
mod plane;

mod calm;
mod clusters;
mod cold;
mod film;
mod flat;
mod moves;
mod picks;
mod plain;
mod shadows;

use chpm_build::{BuildConfig, Cancel, Settings, Silent, build};
use chpm_import::ply::{Encoding, PlyWriter};
use chpm_synth::{Shape, Synth};
use chpm_viewer::{AdapterChoice, Gpu};
use std::error::Error;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Triangles of a cluster, unless there are to be many clusters.
const USUAL: u32 = 4096;
const PARTS: &str = "clusters, flat, moves, calm, cold, shadows, picks";

fn main() -> Result<(), Box<dyn Error>> {
    // Cargo's own arguments start with dashes.
    let mut args = std::env::args().skip(1).filter(|arg| !arg.starts_with("--"));
    let part = args.next().unwrap_or_else(|| "clusters".to_owned());
    let file = args.next().map(PathBuf::from);
    let gpu = Arc::new(Gpu::headless(&AdapterChoice::Best)?);
    eprintln!("{}", gpu.describe());
    let folder = tempfile::tempdir()?;
    let file = |shape, triangles, cluster| match &file {
        Some(file) => Ok(file.clone()),
        None => built(shape, triangles, cluster, folder.path()),
    };
    match &*part {
        "clusters" => clusters::run(&gpu),
        "flat" => flat::run(&gpu, &file(Shape::Isosurface, 1_000_000, USUAL)?),
        "calm" => calm::run(&gpu, &file(Shape::Terrain, 1_000_000, USUAL)?),
        "cold" => cold::run(&gpu, &file(Shape::Isosurface, 4_000_000, USUAL)?),
        "moves" => moves::run(&gpu, &file(Shape::Isosurface, 1_000_000, USUAL)?),
        "picks" => picks::run(&gpu, &file(Shape::Isosurface, 4_000_000, USUAL)?),
        "shadows" => shadows::run(&gpu, &file(Shape::Isosurface, 4_000_000, USUAL)?),
        other => Err(format!("no part '{other}': there are {PARTS}").into()),
    }
}

/// The file of a generated shape, in this folder.
fn built(
    shape: Shape,
    triangles: u64,
    cluster_triangles: u32,
    folder: &Path,
) -> Result<PathBuf, Box<dyn Error>> {
    let mesh = Synth::new(shape, triangles, 1).to_mesh();
    let source = folder.join("model.ply");
    let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let encoding = Encoding::BinaryLittleEndian;
    let mut ply =
        PlyWriter::new(File::create(&source)?, encoding, vertices, triangles, mesh.attributes(), false, &[])?;
    ply.vertices(mesh.view())?;
    ply.triangles(&mesh.triangles)?;
    ply.finish()?;
    let path = folder.join("model.chpm");
    let settings = Settings { cluster_triangles, ..Settings::default() };
    build(&source, &path, &BuildConfig { settings, ..BuildConfig::default() }, &Silent, &Cancel::default())?;
    Ok(path)
}
