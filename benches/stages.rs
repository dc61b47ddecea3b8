//! Each stage of a build by itself, on one thread: a generated isosurface is built again and again, and the seconds that the build tells
//! of one stage are taken. `chpm bench --threads 1,2,4` shows how stages scale.

use chpm_build::{BuildConfig, BuildReport, Cancel, Resources, Silent, Stage, build};
use chpm_import::ply::{Encoding, write_mesh};
use chpm_synth::{Shape, Synth};
use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::fs::File;
use std::path::Path;
use std::time::Duration;

const TRIANGLES: u64 = 200_000;

fn stages(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (source, output) = (folder.path().join("source.ply"), folder.path().join("out.chpm"));
    let file = File::create(&source).expect("a file in it");
    let mesh = Synth::new(Shape::Isosurface, TRIANGLES, 1).to_mesh();
    write_mesh(file, &mesh, Encoding::BinaryLittleEndian).expect("the mesh in the file");
    drop(mesh);

    let mut group = criterion.benchmark_group("stages");
    // Whole builds are run for each, however short the stage is.
    group.sample_size(10).sampling_mode(SamplingMode::Flat).measurement_time(Duration::from_secs(8));
    group.throughput(Throughput::Elements(run(&source, &output).triangles));
    for stage in Stage::ALL {
        group.bench_function(stage.name(), |bencher| {
            bencher.iter_custom(|builds| (0..builds).map(|_| seconds(&run(&source, &output), stage)).sum());
        });
    }
    group.finish();
}

fn run(source: &Path, output: &Path) -> BuildReport {
    let resources = Resources { threads: 1, checkpoint: None, ..Resources::default() };
    let config = BuildConfig { overwrite: true, resources, ..BuildConfig::default() };
    build(source, output, &config, &Silent, &Cancel::default()).expect("a generated mesh builds")
}

fn seconds(report: &BuildReport, stage: Stage) -> Duration {
    let of_stage = report.stages.iter().filter(|row| row.stage == stage);
    of_stage.map(|row| Duration::from_secs_f64(row.seconds)).sum()
}

criterion_group!(benches, stages);
criterion_main!(benches);
