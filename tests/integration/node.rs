//! Tests of the reader in JavaScript and of the page, one for each file of them, so that they run beside each other.

use super::harness::{CHPM, skipped};
use std::fs;
use std::process::Command;

const TESTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/web/test");

fn passes(name: &str) {
    let node = Command::new("node").arg("--version").output();
    let version = node.map(|out| String::from_utf8_lossy(&out.stdout).trim().to_owned()).unwrap_or_default();
    let major: u32 =
        version.trim_start_matches('v').split('.').next().and_then(|n| n.parse().ok()).unwrap_or(0);
    if major < 20 {
        skipped(format_args!("the reader in JavaScript: no Node.js 20 or newer ({version:?})"));
        return;
    }
    let mut node = Command::new("node");
    let out =
        node.current_dir(TESTS).env("CHPM", CHPM).args(["--test", &format!("{name}.test.mjs")]).output();
    let out = out.expect("a process");
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(out.status.success(), "{said}");
    // What was skipped, and why.
    said.lines().filter(|line| line.contains("# SKIP")).for_each(skipped);
}

macro_rules! files {
    ($($name:ident)*) => {
        $(#[test] fn $name() { passes(stringify!($name)); })*

        #[test]
        fn none_is_forgotten() {
            let named = [$(concat!(stringify!($name), ".test.mjs")),*];
            let there = fs::read_dir(TESTS).expect("a folder").map(|entry| entry.expect("a file").file_name());
            let there: Vec<_> = there.filter(|name| name.to_string_lossy().ends_with(".test.mjs")).collect();
            assert!(there.iter().all(|name| named.iter().any(|one| *one == *name)), "{there:?}");
        }
    };
}

files! {
    contrast crossing decoder facing glide occlusion orbit outline package page reader section select share sheets source tabs tools volumes worker
}
