//! A source that has changed somewhere is built anew there alone, to the bytes that a build from nothing has.

use super::harness::{Folder, was_killed};
use chpm_mesh::TriMesh;
use serde_json::Value;
use std::fs;
use std::process::Stdio;

/// Small clusters, so that a model of some ten thousand triangles has many regions.
const BUILD: &str = "build --json -q --cluster-triangles 64";

fn model(words: &str) -> (Folder, TriMesh) {
    let folder = Folder::new();
    folder.stdout(&format!("synth {words} -o old.ply -q"));
    let mut mesh = folder.read_mesh("old.ply");
    if words.contains("torus") {
        mesh.vertices.colors =
            (0..mesh.positions.len() as u32).map(|v| hash(v / 50, 4).to_le_bytes()).collect();
        folder.write_mesh("old.ply", &mesh);
    }
    (folder, mesh)
}

fn hash(i: u32, salt: u32) -> u32 {
    (i ^ salt.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0x9e37_79b9) >> 8
}

/// A mesh of which one place was scanned anew: vertices near the vertex `about` have moved, some faces there are gone, and others were divided.
fn scanned_anew(old: &TriMesh, about: usize, share: f64) -> TriMesh {
    let mut mesh = old.clone();
    let center = old.positions[about];
    let square = |p: &[f32; 3]| (0..3).map(|a| f64::from(p[a] - center[a]).powi(2)).sum::<f64>();
    let mut squares: Vec<f64> = old.positions.iter().map(square).collect();
    let place = (share * squares.len() as f64) as usize;
    let reach = *squares.select_nth_unstable_by(place, f64::total_cmp).1;
    let is_near = |v: u32| square(&old.positions[v as usize]) <= reach;
    let noise = reach.sqrt() as f32 * 1e-3 / (1 << 24) as f32;
    for v in (0..old.positions.len() as u32).filter(|v| is_near(*v)) {
        let moved = &mut mesh.positions[v as usize];
        (0..3).for_each(|axis| moved[axis] += noise * hash(v, axis as u32 + 1) as f32);
    }
    mesh.triangles.clear();
    for (index, [a, b, c]) in (0..).zip(&old.triangles) {
        match (is_near(*a), hash(index, 9) % 40) {
            (true, 0) => {}
            (true, 1) if mesh.colors.is_empty() => {
                let middle = mesh.positions.len() as u32;
                let corners = [a, b, c].map(|v| mesh.positions[*v as usize]);
                mesh.positions.push(std::array::from_fn(|x| corners.iter().map(|p| p[x]).sum::<f32>() / 3.0));
                mesh.triangles.extend([[*a, *b, middle], [*b, *c, middle], [*c, *a, middle]]);
            }
            _ => mesh.triangles.push([*a, *b, *c]),
        }
    }
    mesh
}

/// Regions and groups that were taken over, and how many there are of each.
fn taken(json: &str) -> [[u64; 2]; 2] {
    let report: Value = serde_json::from_str(json).expect("a report");
    let notes = report["notes"].as_array().expect("notes").iter().filter_map(Value::as_str);
    let told = notes.filter_map(|note| note.strip_prefix("as before: ")).next().expect("what is as before");
    let numbers: Vec<u64> = told.split([' ', ',']).filter_map(|word| word.parse().ok()).collect();
    let [regions, of_regions, groups, of_groups] = numbers[..] else { panic!("{told}") };
    [[regions, of_regions], [groups, of_groups]]
}

/// Builds the changed source both ways; answers what was taken over.
fn updated(folder: &Folder, options: &str) -> [[u64; 2]; 2] {
    folder.stdout(&format!("{BUILD} new.ply -o nothing.chpm -f --updatable {options}"));
    let json = folder.stdout(&format!(
        "{BUILD} new.ply -o new.chpm -f --update old.chpm --threads 3 --memory 16K --any-memory {options}"
    ));
    assert!(folder.read("new.chpm") == folder.read("nothing.chpm"), "{options}: the model's bytes");
    assert!(folder.read("new.chpm.memo") == folder.read("nothing.chpm.memo"), "{options}: the memo's bytes");
    taken(&json)
}

#[test]
fn an_update_has_the_bytes_of_a_build_from_nothing() {
    for (source, options) in [
        ("isosurface --triangles 40k", ""),
        ("terrain --triangles 20k --seed 3", "--normals computed --pages packed"),
        ("terrain --triangles 20k", "--positions lattice:16 --topology keep"),
        ("torus --triangles 15k", "--seed 3"),
        ("hard:components --triangles 20k", "--order simplification"),
        ("odd:poles --triangles 20k", "--partitioner greedy"),
        ("hard:unwelded --triangles 20k", "--boundary lock"),
        ("isosurface --triangles 20k", "--finest-error 0.01% --target-error 1%"),
    ] {
        let (folder, mesh) = model(source);
        let json = folder.stdout(&format!("{BUILD} old.ply --updatable {options}"));
        assert!(!json.contains("as before"), "there is nothing before");
        for (place, share) in [(0, 0.002), (1, 0.02), (2, 0.3)] {
            let about = mesh.positions.len() * (1 + 2 * place) / 7;
            folder.write_mesh("new.ply", &scanned_anew(&mesh, about, share));
            let [regions, groups] = updated(&folder, options);
            println!("{source} {options} {share}: {regions:?} {groups:?}");
            assert!(regions[0] < regions[1] && groups[0] < groups[1], "{source}: something has changed");
            if place == 0 && source.starts_with("isosurface") {
                assert!(2 * regions[0] > regions[1] && 2 * groups[0] > groups[1], "{regions:?} {groups:?}");
            }
        }
        // Nothing has changed.
        fs::copy(folder.path("old.ply"), folder.path("new.ply")).expect("a copy");
        let [regions, groups] = updated(&folder, options);
        assert!(regions[0] == regions[1] && groups[0] == groups[1], "{source}: {regions:?} {groups:?}");
        folder.stdout("verify new.chpm --against new.ply");
    }
}

/// An update goes on from an update, in place of the model, and cuts stay without cracks.
#[test]
fn a_model_is_updated_in_its_place_again_and_again() {
    let (folder, mut mesh) = model("sphere --triangles 40k");
    folder.stdout(&format!("{BUILD} old.ply -o model.chpm --updatable"));
    for round in 0..3 {
        mesh = scanned_anew(&mesh, mesh.positions.len() * (round + 1) / 5, 0.01);
        folder.write_mesh("new.ply", &mesh);
        let json = folder.stdout(&format!("{BUILD} new.ply -o model.chpm -f --update model.chpm"));
        let [regions, groups] = taken(&json);
        assert!(2 * regions[0] > regions[1] && 2 * groups[0] > groups[1], "{regions:?} {groups:?}");
        folder.stdout("verify model.chpm --against new.ply --cuts 6 --errors");
    }
    folder.stdout(&format!("{BUILD} new.ply -o nothing.chpm --updatable"));
    assert!(folder.read("model.chpm") == folder.read("nothing.chpm"));
}

#[test]
fn a_memo_that_is_not_there_or_of_no_use_is_named() {
    let (folder, _) = model("sphere --triangles 5k");
    folder.stdout(&format!("{BUILD} old.ply -o plain.chpm"));
    let refused = |what: &str| {
        let error = folder.stderr(&format!("{BUILD} old.ply -o new.chpm --update plain.chpm"), 2);
        assert!(error.contains("'plain.chpm.memo'") && error.contains(what), "{error}");
        assert!(error.contains("build once with --updatable"), "{error}");
        assert!(!folder.path("new.chpm").exists() && !folder.path("new.chpm.memo").exists());
    };
    refused("is not there");
    folder.write("plain.chpm.memo", "short");
    refused("too short");
    folder.write("plain.chpm.memo", vec![7; 4000]);
    refused("not whole, or of another version");
    folder.stdout(&format!("{BUILD} old.ply -o old.chpm --updatable"));
    let memo = folder.read("old.chpm.memo");
    folder.write("plain.chpm.memo", &memo[..memo.len() - 100]);
    refused("not whole, or of another version");
    // The program's version, near the end.
    let at = memo.windows(5).rposition(|word| word == b"chpm ").expect("a version");
    let mut other = memo.clone();
    other[at + 5] ^= 1;
    folder.write("plain.chpm.memo", &other);
    refused("is not what was written");

    // What has the name of a memo, and is none, is replaced only by force.
    folder.write("new.chpm.memo", "mine");
    let error = folder.stderr(&format!("{BUILD} old.ply -o new.chpm --updatable"), 2);
    assert!(error.contains("'new.chpm.memo'") && error.contains("exists"), "{error}");
    assert!(folder.read("new.chpm.memo") == b"mine" && !folder.path("new.chpm").exists());
    folder.stdout(&format!("{BUILD} old.ply -o new.chpm --updatable -f"));
    fs::remove_file(folder.path("new.chpm")).expect("a model");

    // Other settings find nothing, and are built all the same.
    let json =
        folder.stdout(&format!("{BUILD} old.ply -o new.chpm --update old.chpm --seed 5 --topology keep"));
    assert_eq!(taken(&json).map(|[taken, _]| taken), [0, 0]);
    let error = folder.stderr(&format!("{BUILD} old.ply -o x.chpm --update old.chpm --keep-work"), 2);
    assert!(error.contains("--keep-work"), "{error}");
}

#[test]
fn damage_within_a_memo_is_built_anew() {
    let (folder, _) = model("isosurface --triangles 30k");
    folder.stdout(&format!("{BUILD} old.ply -o old.chpm --updatable"));
    let memo = folder.read("old.chpm.memo");
    for part in [3, 5, 8] {
        let mut damaged = memo.clone();
        damaged[memo.len() / 10 * part] ^= 4;
        folder.write("old.chpm.memo", &damaged);
        let json = folder.stdout(&format!("{BUILD} old.ply -o new.chpm -f --update old.chpm"));
        assert!(json.contains("damaged in the memo"), "{json}");
        assert!(folder.read("new.chpm") == folder.read("old.chpm"));
        assert!(folder.read("new.chpm.memo") == memo);
    }
}

/// Whenever an update in place is killed, the model is the old one or the new one, and the same command goes through then.
#[test]
fn an_update_that_is_killed_leaves_a_model_that_can_be_updated() {
    let (folder, mesh) = model("sphere --triangles 10k");
    folder.stdout(&format!("{BUILD} old.ply -o old.chpm --updatable"));
    folder.write_mesh("new.ply", &scanned_anew(&mesh, 77, 0.02));
    folder.stdout(&format!("{BUILD} new.ply -o new.chpm --updatable"));
    let [old, new] = ["old.chpm", "new.chpm"].map(|name| folder.read(name));
    let mut kills = 0;
    for access in [0, 1, 3, 9].into_iter().chain((20..).step_by(71)) {
        for name in ["chpm", "chpm.memo"] {
            fs::copy(folder.path(&format!("old.{name}")), folder.path(&format!("model.{name}")))
                .expect("a copy");
        }
        let words = format!("{BUILD} new.ply -o model.chpm -f --update model.chpm --memory 16K --any-memory");
        let mut command = folder.command(&format!("{words} --kill-at {access}"));
        let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status().expect("a process");
        let model = folder.read("model.chpm");
        assert!(model == old || model == new, "killed at {access}");
        if status.success() {
            break;
        }
        assert!(was_killed(status), "at access {access}: {status}");
        kills += 1;
        folder.stdout(&words);
        assert!(folder.read("model.chpm") == new, "after a kill at {access}");
    }
    assert!(kills > 5, "{kills} kills");
}
