//! `textured_build SOURCE OUTPUT none|vertices|sheets THREADS MIB`: builds, verifies, and tells time and sizes.

use chpm_build::config::Texture;
use chpm_build::{BuildConfig, Cancel, Resources, Settings, Silent, build};
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, checksum, verify};
use chpm_mesh::Bytes;
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().collect();
    let [_, source, output, texture, threads, mebibytes] = &words[..] else {
        return Err("textured_build SOURCE OUTPUT none|vertices|sheets THREADS MIB".into());
    };
    let texture = match &texture[..] {
        "none" => Texture::None,
        "vertices" => Texture::Vertices,
        _ => Texture::Sheets,
    };
    let (threads, memory) = (threads.parse()?, Bytes::mib(mebibytes.parse()?));
    let config = BuildConfig {
        settings: Settings { texture, ..Settings::default() },
        resources: Resources { threads, memory, checkpoint: None, ..Resources::default() },
        overwrite: true,
    };
    let report = build(Path::new(source), Path::new(output), &config, &Silent, &Cancel::default())?;
    for stage in &report.stages {
        println!("{:10} {:.2} s of processor", stage.stage, stage.processor_seconds.unwrap_or(0.0));
    }
    println!("peak {} MiB", report.peak_resident.unwrap_or(0) >> 20);

    let file = Chpm::open(MappedFile::open(output.as_ref())?)?;
    println!("{} bytes, checksum {:016x}", file.bytes().len(), checksum(file.bytes()));
    let found = verify(&file, |_, _| ());
    println!("{} faults, {:?}", found.fault_count, found.faults.first());
    for level in 0..file.header().level_count {
        let of_level =
            || file.clusters().iter().zip(file.sheets()).filter(|(cluster, _)| cluster.level == level);
        let texels: u64 =
            of_level().map(|(_, sheet)| u64::from(sheet.size[0]) * u64::from(sheet.size[1])).sum();
        let bytes: u64 = of_level().map(|(_, sheet)| sheet.len()).sum();
        let charts: u32 = of_level().map(|(_, sheet)| sheet.chart_count).sum();
        let triangles: u32 = of_level().map(|(cluster, _)| cluster.triangle_count).sum();
        println!(
            "level {level}: {} clusters, {triangles} triangles, {charts} charts, {texels} texels, {bytes} bytes",
            of_level().count()
        );
    }
    Ok(())
}
