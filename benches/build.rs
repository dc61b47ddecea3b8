//! The whole build, from a PLY in a temporary folder to a published file: a generated isosurface, and every PLY of the
//! folder that `CHPM_DATA` names, if it is set.

use chpm_build::{BuildConfig, Cancel, Silent, build};
use chpm_import::ply::{Encoding, write_mesh};
use chpm_synth::{Shape, Synth};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

fn builds(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let generated = folder.path().join("isosurface-1m.ply");
    let mesh = Synth::new(Shape::Isosurface, 1_000_000, 1).to_mesh();
    let file = File::create(&generated).expect("a file in it");
    write_mesh(file, &mesh, Encoding::BinaryLittleEndian).expect("the mesh in the file");
    drop(mesh);

    let mut group = criterion.benchmark_group("build");
    group.sample_size(10);
    for source in std::iter::once(generated).chain(models()) {
        let output = folder.path().join("out.chpm");
        // The first run warms the page cache and counts the triangles; a file that does not build is no model.
        let Some(triangles) = run(&source, &output) else { continue };
        group.throughput(Throughput::Elements(triangles));
        let name = source.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        group.bench_function(name, |bencher| bencher.iter(|| run(&source, &output)));
    }
    group.finish();
}

fn run(source: &Path, output: &Path) -> Option<u64> {
    let config = BuildConfig { overwrite: true, ..BuildConfig::default() };
    build(source, output, &config, &Silent, &Cancel::default()).ok().map(|report| report.triangles)
}

fn models() -> Vec<PathBuf> {
    let folder = std::env::var_os("CHPM_DATA").and_then(|folder| fs::read_dir(folder).ok());
    let files = folder.into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let mut models: Vec<PathBuf> = files.filter(|p| p.extension().is_some_and(|e| e == "ply")).collect();
    models.sort();
    models
}

criterion_group!(benches, builds);
criterion_main!(benches);
