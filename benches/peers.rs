//! A build beside `meshopt`'s cluster hierarchy (`clod_build`, default settings, one thread, in core), both from a PLY to a
//! file, in turn.
//!
//! `peers` generates an isosurface of a million triangles; `peers PLY [ROUNDS]` takes a file; `peers clod PLY OUT` runs the
//! other builder once and prints its triangles and peak resident bytes, which is what `record.sh` times as a process.

use chpm_build::{BuildConfig, Cancel, Silent, build};
use chpm_extmem::process;
use chpm_import::ply::{self, Encoding};
use chpm_synth::{Shape, Synth};
use meshopt::VertexDataAdapter;
use meshopt::clusterlod::{ClodMesh, clod_build, clod_default_config};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

/// Triangles of a cluster of the other builder; its documentation's choice for rasterisation.
const CLUSTER: usize = 128;

fn main() -> anyhow::Result<()> {
    // Cargo adds `--bench`.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["clod", source, output] => {
            let triangles = clod(Path::new(source), Path::new(output))?;
            println!("{triangles} {}", process::peak_resident().unwrap_or_default());
            Ok(())
        }
        [] => {
            let folder = tempfile::tempdir()?;
            let source = folder.path().join("isosurface.ply");
            let mesh = Synth::new(Shape::Isosurface, 1_000_000, 1).to_mesh();
            ply::write_mesh(File::create(&source)?, &mesh, Encoding::BinaryLittleEndian)?;
            compare(&source, 3)
        }
        [source] => compare(Path::new(source), 5),
        [source, rounds] => compare(Path::new(source), rounds.parse()?),
        _ => anyhow::bail!("usage: peers [PLY [ROUNDS]] | peers clod PLY OUT"),
    }
}

/// Runs both in turn and prints medians; the ratio is taken round by round.
fn compare(source: &Path, rounds: usize) -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let (ours, theirs) = (folder.path().join("out.chpm"), folder.path().join("out.clod"));
    let config = BuildConfig { overwrite: true, ..BuildConfig::default() };
    let (mut chpm_times, mut clod_times, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    let mut triangles = 0;
    for _ in 0..rounds.max(1) {
        let start = Instant::now();
        triangles = build(source, &ours, &config, &Silent, &Cancel::default())?.triangles;
        let chpm = start.elapsed().as_secs_f64();
        let start = Instant::now();
        clod(source, &theirs)?;
        let clod = start.elapsed().as_secs_f64();
        chpm_times.push(chpm);
        clod_times.push(clod);
        ratios.push(clod / chpm);
    }
    for (name, times, file) in [("chpm", &mut chpm_times, ours), ("clod", &mut clod_times, theirs)] {
        let (seconds, len) = (median(times), file.metadata()?.len());
        let (rate, bytes) = (triangles as f64 / seconds, len as f64 / triangles as f64);
        println!("{name}  {seconds:8.3} s  {rate:9.0} triangles/s  {bytes:5.1} bytes/triangle");
    }
    println!("chpm is {:.2} times as fast", median(&mut ratios));
    Ok(())
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Positions, then for every cluster its bounds, its vertices' numbers and its triangles in bytes. Answers the source's triangles.
fn clod(source: &Path, output: &Path) -> anyhow::Result<u64> {
    let (mesh, ..) = ply::read_mesh(File::open(source)?, Default::default())?;
    let indices = mesh.triangles.as_flattened();
    let positions = meshopt::typed_to_bytes(&mesh.positions);
    let vertices = VertexDataAdapter::new(positions, 12, 0)?;
    let mut out = BufWriter::with_capacity(1 << 20, File::create(output)?);
    out.write_all(positions)?;
    let mut written = Ok(());
    let mut groups = 0;
    let mut local = vec![u32::MAX; mesh.positions.len()];
    clod_build(clod_default_config(CLUSTER), &ClodMesh::new(indices, &vertices), |_, clusters| {
        for cluster in clusters {
            let bounds = cluster.bounds;
            let mut bytes: Vec<u8> = Vec::with_capacity(cluster.indices.len() * 4);
            let [x, y, z] = bounds.center;
            for number in [x, y, z, bounds.radius, bounds.error] {
                bytes.extend(number.to_le_bytes());
            }
            let mut corners = Vec::with_capacity(cluster.indices.len());
            let mut count = 0;
            for v in cluster.indices {
                if local[*v as usize] == u32::MAX {
                    local[*v as usize] = count;
                    count += 1;
                    bytes.extend(v.to_le_bytes());
                }
                corners.push(local[*v as usize] as u8);
            }
            cluster.indices.iter().for_each(|v| local[*v as usize] = u32::MAX);
            bytes.extend(cluster.refined.to_le_bytes());
            bytes.extend(corners);
            if written.is_ok() {
                written = out.write_all(&bytes);
            }
        }
        groups += 1;
        groups - 1
    });
    written?;
    out.flush()?;
    Ok(mesh.triangles.len() as u64)
}
