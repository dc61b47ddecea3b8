//! The Snakemake workflow of `data/workflow`, where snakemake is installed.

use super::harness::{CHPM, Folder, root, skipped, text};
use serde_json::Value;
use std::fs;
use std::process::{Command, Output};

/// Runs the workflow on `in`, or answers none where there is no snakemake.
fn snakemake(folder: &Folder) -> Option<Output> {
    let file = root().join("data/workflow/Snakefile");
    let settings = ["scans=in", "out=out", "shards=3", "threads=1", "mem_mb=256"].map(str::to_owned);
    let run = Command::new("snakemake")
        .current_dir(folder.path(""))
        // Its caches belong into the folder, too.
        .env("HOME", folder.path(""))
        .env("XDG_CACHE_HOME", folder.path("cache"))
        .args(["--cores", "2", "--keep-going", "-s"])
        .arg(file)
        .arg("--config")
        .args(settings)
        .args([format!("chpm={CHPM}"), "options=--cluster-triangles 512".to_owned()])
        .output();
    match run {
        Ok(output) => Some(output),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
        Err(error) => panic!("snakemake: {error}"),
    }
}

#[test]
fn the_workflow_builds_every_part_and_tells_of_failures() {
    let folder = Folder::new();
    fs::create_dir(folder.path("in")).expect("a folder");
    for seed in 0..5 {
        folder.stdout(&format!("synth terrain --triangles 2000 --seed {seed} -o in/{seed}.ply -q"));
    }
    folder.write("in/bad.ply", "no mesh");
    let Some(output) = snakemake(&folder) else {
        skipped("the workflow: snakemake is not installed (pip install snakemake)");
        return;
    };
    let told = text(&output.stderr);
    assert!(!output.status.success(), "a model failed: {told}");
    let summary: Value = serde_json::from_slice(&folder.read("out/summary.json")).expect(&told);
    let fates: Vec<&str> = summary["models"]
        .as_array()
        .expect("models")
        .iter()
        .filter_map(|row| row["status"].as_str())
        .collect();
    assert_eq!(fates, ["built", "built", "built", "built", "built", "failed"], "{told}");

    folder.stdout("synth terrain --triangles 2000 --seed 9 -o in/bad.ply -q -f");
    let output = snakemake(&folder).expect("snakemake is still there");
    let told = text(&output.stderr);
    assert!(output.status.success(), "{told}");
    let summary: Value = serde_json::from_slice(&folder.read("out/summary.json")).expect(&told);
    let built =
        summary["models"].as_array().expect("models").iter().filter(|row| row["status"] == "built").count();
    assert_eq!(built, 1, "only what was changed: {summary:#}");
    folder.stdout("build in/3.ply -o 3.chpm -q --cluster-triangles 512");
    assert_eq!(folder.read("3.chpm"), folder.read("out/3.chpm"));
}
