//! The same bytes on every system: builds of all kinds of meshes by all kinds of settings, beside the digests of a list.
//!
//! Whoever changes bytes on purpose writes the list anew: `CHPM_GOLDEN=write cargo test --test integration bytes`.
//! `tests/targets.sh` runs this for other systems.

use super::harness::Folder;
use std::env;
use std::fs;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// Digest of the file, source and settings, a line each.
const LIST: &str = include_str!("bytes.txt");

fn built(source: &str, settings: &str) -> u64 {
    let folder = Folder::new();
    folder.stdout(&format!("synth {source} -o in.ply -q"));
    folder.stdout(&format!("build in.ply -q {settings}"));
    let mut bytes = folder.read("in.chpm");
    // Its volumes follow, if it has any.
    let names = folder.names();
    names.iter().filter(|name| name.ends_with(".pages")).for_each(|name| bytes.extend(folder.read(name)));
    xxh3_64(&bytes)
}

#[test]
fn every_build_has_the_bytes_of_the_list() {
    let mut now = String::new();
    for line in LIST.lines() {
        let fields: Vec<&str> = line.split(';').map(str::trim).collect();
        now += &match fields[..] {
            [_, source, settings] => {
                format!("{:016x}; {source}; {settings}", built(source, settings)).trim_end().to_owned()
            }
            _ => line.to_owned(),
        };
        now.push('\n');
    }

    if env::var_os("CHPM_GOLDEN").is_some_and(|what| what == "write") {
        let list = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/integration/bytes.txt");
        fs::write(list, &now).expect("the list");
    } else {
        for (expected, line) in LIST.lines().zip(now.lines()) {
            assert_eq!(expected, line);
        }
    }
}
