//! Scans at random poses against looking at every pair of triangles. They are looked for in the folder that `CHPM_DATA` names, or in `../shared/data` beside
//! the repository.

use crate::brute;
use crate::hard::{ask, rounding, stored};
use crate::site::{Built, Random};
use crate::touching::{find, near_pairs};
use chpm_import::ply::{Options, read_mesh};
use chpm_proximity::contacts::Near;
use chpm_proximity::{Answer, Pose};
use std::env;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Poses; more with CHPM_SCAN_POSES, for a run by hand.
fn poses() -> usize {
    env::var("CHPM_SCAN_POSES").ok().and_then(|n| n.parse().ok()).unwrap_or(2)
}

fn scans() -> Vec<Built> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = env::var_os("CHPM_DATA").map_or_else(beside, PathBuf::from);
    let names = ["fandisk", "cycloidal_facecolor", "beetle", "gargo_color", "bunny70k", "lucy100k"];
    // The smaller ones are enough for a few poses.
    let count = if poses() > 10 { names.len() } else { 2 };
    let built = names.into_iter().take(count).filter_map(|name| {
        let file = File::open(folder.join(name).with_extension("ply")).ok()?;
        let (mesh, ..) = read_mesh(file, Options::default()).expect("a PLY file");
        Some(Built::new(name, mesh, [0.0; 3], false))
    });
    built.collect()
}

#[test]
fn scans_are_as_far_apart_as_every_pair_of_triangles_says() {
    let scans = scans();
    if scans.len() < 2 {
        println!("skipped: no scans; name their folder in CHPM_DATA");
        // `tests/all.sh` lists what was skipped.
        if let Some(list) = env::var_os("CHPM_SKIPPED") {
            let mut list = File::options().append(true).create(true).open(list).expect("a list");
            writeln!(list, "proximity of scans: name their folder in CHPM_DATA").expect("a list");
        }
        return;
    }
    let mut random = Random::new(31);
    for turn in 0..poses() {
        let a = &scans[random.next() as usize % scans.len()];
        let b = &scans[random.next() as usize % scans.len()];
        // Each as large as it is, and as often through each other as apart.
        let pose = random.pose(a, b, [0.7, 1.0, 1.3, 2.0][turn % 4]);
        let told = format!("pose {turn}, {} and {}", a.name, b.name);
        let truth = brute::distance(&a.placed(&Pose::IDENTITY), &b.placed(&pose));
        let (slack, stored, size) = (rounding(a, b), stored(a, b), a.diagonal() + b.diagonal());
        for error in [0.0, 1e-3 * size] {
            let Answer { lower, upper, margin, .. } = ask(a, b, &pose, error);
            let held = lower <= truth + slack + stored && truth <= upper + slack + stored;
            assert!(held, "{told}: {truth} outside of {lower} to {upper}");
            let width = error + 2.0 * margin + slack + 4.0 * stored;
            assert!(upper - lower <= width, "{told}: {lower} to {upper} is wider than {width}");
        }
        // All that is a little farther than what is nearest, where that is not too much.
        let within = truth + 1e-4 * size;
        let found = find(a, b, &pose, &Near { within, error: 0.0, limit: 1 << 22 });
        let parallel = 1e-8 * size;
        let [fewest, upper] = [within - slack - stored, within + slack + stored + found.margin + parallel]
            .map(|within| near_pairs(a, b, &pose, within).len() as u64);
        assert!(found.complete && fewest > 0, "{told}");
        assert!((fewest..=upper).contains(&found.pairs), "{told}: {} of {fewest} to {upper}", found.pairs);
        println!("{told}: {truth} apart, {} pairs within {within}", found.pairs);
    }
}
