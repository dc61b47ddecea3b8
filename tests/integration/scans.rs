//! Real meshes, where there are any.
//!
//! They are looked for in the folder that `CHPM_DATA` names, or in `../shared/data` beside the repository. Those of more than 20 MB are for runs by
//! hand, with `CHPM_LARGE_SCANS=1`.

use super::harness::{Folder, root, skipped};
use assert_cmd::Command;
use std::path::PathBuf;
use std::{env, fs};

fn scans() -> Vec<PathBuf> {
    let folder = env::var_os("CHPM_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let Ok(entries) = fs::read_dir(&folder) else {
        skipped(format_args!("scans: none in {}; name their folder in CHPM_DATA", folder.display()));
        return Vec::new();
    };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "ply"));
    let large = env::var_os("CHPM_LARGE_SCANS").is_some();
    paths.retain(|path| large || path.metadata().is_ok_and(|data| data.len() <= 20_000_000));
    paths.sort();
    if paths.is_empty() {
        skipped(format_args!("scans: no .ply in {}", folder.display()));
    }
    paths
}

#[test]
fn real_meshes_are_built_and_hold_all_their_triangles() {
    let folder = Folder::new();
    for scan in scans() {
        let run = |words: &[&str]| {
            let mut command = Command::new(super::harness::CHPM);
            command.args(words).current_dir(folder.path("")).assert().success();
        };
        let source = scan.to_string_lossy();
        run(&["build", &source, "-o", "out.chpm", "-qf"]);
        run(&["verify", "out.chpm", "-q", "--against", &source]);
    }
}
