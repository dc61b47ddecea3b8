//! A build that is killed at any moment goes on where it was, to the same bytes.

use super::harness::{Folder, was_killed};
use nix::sys::signal::Signal;
use std::process::{ExitStatus, Stdio};

/// All arrays on disk, and a checkpoint at every opportunity.
const BUILD: &str =
    "build model.ply -o out.chpm -f --json --cluster-triangles 512 --memory 16K --any-memory --checkpoint 0";

fn model() -> (Folder, Vec<u8>) {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 30000 --seed 2 -o model.ply -q");
    folder.stdout(&format!("{BUILD} -q --no-resume"));
    let whole = folder.read("out.chpm");
    std::fs::remove_file(folder.path("out.chpm")).expect("the output");
    (folder, whole)
}

/// Builds to the end, which must be the same as ever; answers where it went on, if it did.
fn finished(folder: &Folder, whole: &[u8], what: &str) -> Option<String> {
    let json = folder.stdout(&format!("{BUILD} -q"));
    assert!(folder.read("out.chpm") == whole, "{what}");
    assert_eq!(folder.names(), ["model.ply", "out.chpm"], "{what}");
    std::fs::remove_file(folder.path("out.chpm")).expect("the output");
    let report: serde_json::Value = serde_json::from_str(&json).expect("a report");
    report["resumed_after"].as_str().map(str::to_owned)
}

fn killed_at(folder: &Folder, access: u64) -> ExitStatus {
    let mut command = folder.command(&format!("{BUILD} -q --kill-at {access}"));
    command.stdout(Stdio::null()).stderr(Stdio::null()).status().expect("a process")
}

#[test]
fn a_build_that_is_killed_at_any_access_to_a_file_goes_on() {
    let (folder, whole) = model();
    let mut resumed = Vec::new();
    for access in [0, 1, 2, 5, 20].into_iter().chain((60..).step_by(157)) {
        let status = killed_at(&folder, access);
        if status.success() {
            break;
        }
        assert!(was_killed(status), "at access {access}: {status}");
        resumed.extend(finished(&folder, &whole, &format!("killed at access {access}")));
    }
    for stage in ["ingest", "level 0", "level 1", "simplify"] {
        assert!(resumed.iter().any(|after| after.contains(stage)), "{stage} in {resumed:?}");
    }
}

#[test]
fn a_build_that_is_killed_again_and_again_ends_some_day() {
    let (folder, whole) = model();
    let mut kills = 0;
    // Reading what was saved takes some accesses, and each run gets a little farther than that.
    while !killed_at(&folder, 100 + 20 * kills).success() {
        kills += 1;
        assert!(kills < 200, "no run gets any farther");
    }
    assert!(kills > 3, "{kills} kills");
    assert!(folder.read("out.chpm") == whole);
    assert_eq!(folder.names(), ["model.ply", "out.chpm"]);
}

#[test]
fn a_build_that_is_killed_from_outside_goes_on() {
    let (folder, whole) = model();
    for (stage, signal) in [
        ("ingest", Signal::SIGKILL),
        ("hierarchy", Signal::SIGKILL),
        ("simplify", Signal::SIGKILL),
        ("layout", Signal::SIGKILL),
        ("simplify", Signal::SIGINT),
        ("layout", Signal::SIGTERM),
    ] {
        let (status, rest) = folder.signalled(&format!("{BUILD} --threads 2"), stage, signal);
        if status.success() {
            // The build was faster than the signal.
            std::fs::remove_file(folder.path("out.chpm")).expect("the output");
            continue;
        }
        if signal != Signal::SIGKILL {
            let told = rest.join("\n");
            assert!(told.contains(".work") && told.contains("same command"), "{stage}: {told}");
        }
        let resumed = finished(&folder, &whole, &format!("{signal} in {stage}"));
        assert!(resumed.is_some() || stage == "ingest", "{signal} in {stage}");
    }
}

#[test]
fn work_that_is_kept_is_used_again_and_other_work_is_named() {
    let (folder, whole) = model();
    folder.stdout(&format!("{BUILD} -q --keep-work"));
    assert_eq!(folder.names().len(), 3, "{:?}", folder.names());
    let other = folder.stdout(&format!("{BUILD} -q --seed 4"));
    assert!(other.contains("other settings; it is not used"), "{other}");
    assert_eq!(finished(&folder, &whole, "kept work").as_deref(), Some("simplify"));
}

/// All that is beside a model and can be seen.
fn seen(folder: &Folder) -> Vec<String> {
    folder.names().into_iter().filter(|name| !name.starts_with('.')).collect()
}

#[test]
fn what_a_kill_leaves_is_hidden_and_goes_with_the_next_run() {
    let (folder, _) = model();
    let without =
        "build model.ply -o out.chpm -q --no-resume --cluster-triangles 512 --memory 16K --any-memory";
    let with = without.replace("--no-resume", "");
    for next in [without, &with] {
        let killed = folder.command(&format!("{without} --kill-at 40")).status().expect("a process");
        assert!(was_killed(killed), "{killed}");
        assert!(folder.names().len() > 2 && seen(&folder) == ["model.ply"], "{:?}", folder.names());
        folder.stdout(next);
        assert_eq!(folder.names(), ["model.ply", "out.chpm"]);
        std::fs::remove_file(folder.path("out.chpm")).expect("the output");
    }

    let small = "simplify model.ply --triangles 100 -o small.ply";
    let (killed, _) = folder.signalled(small, "decompose", Signal::SIGKILL);
    assert!(was_killed(killed), "{killed}");
    assert!(folder.names().len() > 2 && seen(&folder) == ["model.ply"], "{:?}", folder.names());
    folder.stdout(&format!("{small} -q"));
    assert_eq!(folder.names(), ["model.ply", "small.ply"]);

    // As a process leaves it that is killed while it writes.
    folder.stdout(&format!("{without} --pages raw"));
    folder.write(".packed.chpm.0.partial", "left");
    folder.write(".other.chpm.0.partial", "another's");
    folder.stdout("relayout out.chpm --pages packed -o packed.chpm -q");
    assert_eq!(
        folder.names(),
        [".other.chpm.0.partial", "model.ply", "out.chpm", "packed.chpm", "small.ply"]
    );
}
