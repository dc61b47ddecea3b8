//! Accuracy at equal triangle counts: a uniform cut of a built file beside one in-core run over the whole mesh, by the plain
//! simplifier that recomputes everything and by meshopt. Deviations are sampled both ways against the source.
//!
//! `accuracy` takes generated models; `accuracy PLY...` takes files. The plain simplifier is slow: half a million triangles are a
//! matter of minutes.

use chpm_build::{BuildConfig, Cancel, Silent, build};
use chpm_format::Chpm;
use chpm_import::ply::{self, Encoding};
use chpm_measure::{Deviation, deviation, naive};
use chpm_mesh::TriMesh;
use chpm_refine::{Cut, extract};
use chpm_synth::{Shape, Synth};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use std::fs::File;
use std::path::Path;

/// Samples for each triangle of the finer mesh.
const SAMPLES: usize = 10;
/// The source's triangles are divided by these.
const DIVISORS: [u64; 4] = [4, 16, 64, 256];

fn main() -> anyhow::Result<()> {
    let files: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    println!(
        "model,triangles,cut,chpm_rms,chpm_max,stored_error,plain_rms,plain_max,meshopt_rms,meshopt_max"
    );
    let folder = tempfile::tempdir()?;
    if files.is_empty() {
        for shape in [Shape::Terrain, Shape::Torus, Shape::Isosurface] {
            let source = folder.path().join(format!("{shape}.ply"));
            let mesh = Synth::new(shape, 30_000, 1).to_mesh();
            ply::write_mesh(File::create(&source)?, &mesh, Encoding::BinaryLittleEndian)?;
            compare(&source, folder.path())?;
        }
    }
    for file in files {
        compare(Path::new(&file), folder.path())?;
    }
    Ok(())
}

fn compare(source: &Path, folder: &Path) -> anyhow::Result<()> {
    let (mesh, ..) = ply::read_mesh(File::open(source)?, Default::default())?;
    let output = folder.join("accuracy.chpm");
    build(
        source,
        &output,
        &BuildConfig { overwrite: true, ..BuildConfig::default() },
        &Silent,
        &Cancel::default(),
    )?;
    let file = Chpm::open(chpm_extmem::MappedFile::open(&output)?)?;
    let mut plain = TriMesh::new(mesh.positions.clone(), mesh.triangles.clone());
    let name = source.file_stem().unwrap_or_default().to_string_lossy();
    for divisor in DIVISORS {
        let cut = Cut::at_triangles(&file, mesh.triangles.len() as u64 / divisor)?;
        let ours = extract(&file, &cut)?;
        let count = ours.triangles.len();
        // Both peers go to the count that the cut has.
        plain = naive::simplify(&plain, count, &[]);
        let peer = by_meshopt(&mesh, count)?;
        let [ours, plain, peer] = [&ours, &plain, &peer].map(|lod| deviation(&mesh, lod, SAMPLES));
        let pair = |d: &Deviation| format!("{:.4e},{:.4e}", d.rms(), d.max());
        println!(
            "{name},{},{count},{},{:.4e},{},{}",
            mesh.triangles.len(),
            pair(&ours),
            cut.error(&file)?,
            pair(&plain),
            pair(&peer)
        );
    }
    Ok(())
}

fn by_meshopt(mesh: &TriMesh, triangles: usize) -> anyhow::Result<TriMesh> {
    let bytes = meshopt::typed_to_bytes(&mesh.positions);
    let vertices = VertexDataAdapter::new(bytes, 12, 0)?;
    let indices = mesh.triangles.as_flattened();
    let simplified =
        meshopt::simplify(indices, &vertices, 3 * triangles, f32::MAX, SimplifyOptions::None, None);
    Ok(TriMesh::new(mesh.positions.clone(), simplified.as_chunks().0.to_vec()))
}
