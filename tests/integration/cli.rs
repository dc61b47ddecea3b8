//! Every verb, its exit codes, and that errors leave nothing behind.

use super::harness::{Folder, text};
use chpm_synth::{Shape, Synth, hand};
use serde_json::Value;
use std::process::Stdio;

const VERBS: [&str; 11] =
    ["build", "info", "verify", "dump", "extract", "export", "simplify", "path", "walk", "synth", "demo"];

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("valid JSON")
}

/// A built sphere: `ball.ply` and `ball.chpm`.
fn ball() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 6000 -o ball.ply -q");
    folder.stdout("build ball.ply -q --cluster-triangles 512");
    folder
}

#[test]
fn help_names_every_verb() {
    let folder = Folder::new();
    let help = folder.stdout("--help");
    for verb in VERBS {
        assert!(help.contains(verb), "{verb}");
        assert!(folder.stdout(&format!("{verb} --help")).contains("Usage: chpm"));
    }
    assert!(folder.stdout("--version").starts_with("chpm "));
}

#[test]
fn wrong_usage_is_an_error() {
    let folder = Folder::new();
    for words in [
        "",
        "buidl x.ply",
        "build",
        "build x.ply --threads 0",
        "build x.ply --memory much",
        "extract x.chpm -o y.ply",
        "extract x.chpm -o y.ply --level 0 --error 1",
        "extract x.chpm -o y.ply --error nan",
        "extract x.chpm -o y.ply --error=-1",
        "synth cube -o x.ply",
    ] {
        folder.chpm(words).code(2);
    }
    assert!(folder.names().is_empty());
}

#[test]
fn missing_files_are_named() {
    let folder = Folder::new();
    for words in [
        "build no.ply",
        "info no.chpm",
        "verify no.chpm",
        "dump no.chpm",
        "extract no.chpm --level 0 -o y.ply",
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.contains("error: ") && error.contains("no."), "{words}: {error}");
    }
    assert!(folder.names().is_empty());
}

#[test]
fn errors_name_the_file_that_they_are_about() {
    let folder = ball();
    folder.write("scans.conf", "bmesh ball.ply 0 0 0 0 0 0 1\nbmesh absent.ply 0 0 0 0 0 0 1\n");
    folder.write("far.path", "chpm-path 1\n0 0 1e300 0 0 0 0 1 0 45\n");
    for (words, names) in [
        ("build scans.conf -o x.chpm -q", "scans.conf: its mesh 1: cannot read absent.ply"),
        ("extract ball.chpm --poe 1 --camera 0,0,1e300,0,0,0 -o x.ply -q", "'ball.chpm'"),
        ("walk ball.chpm far.path -q", "frame 0 of 'far.path'"),
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.contains(names), "{words}: {error}");
        assert!(!error.contains("a target away from the position"), "{words}: {error}");
    }
    // Of two files, the damaged one alone.
    let mut bytes = folder.read("ball.chpm");
    let half = bytes.len() / 2;
    bytes[half..].fill(0xff);
    folder.write("torn.chpm", bytes);
    for words in ["compare torn.chpm ball.chpm -q", "compare ball.chpm torn.chpm -q"] {
        let error = folder.stderr(words, 2);
        assert!(
            error.contains("cannot read 'torn.chpm'") && !error.contains("'ball.chpm'"),
            "{words}: {error}"
        );
    }
}

#[test]
fn a_build_goes_beside_its_source_unless_told_otherwise() {
    let folder = ball();
    assert_eq!(folder.names(), ["ball.chpm", "ball.ply"]);
    folder.stdout("build ball.ply -q --cluster-triangles 512 -o other.chpm");
    assert_eq!(folder.read("ball.chpm"), folder.read("other.chpm"));
}

#[test]
fn outputs_are_replaced_only_by_force() {
    let folder = ball();
    folder.write("taken", "precious");
    for words in [
        "build ball.ply -o taken",
        "extract ball.chpm --level 0 -o taken",
        "synth sphere --triangles 100 -o taken",
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.contains("taken") && error.contains("--force"), "{words}: {error}");
        assert_eq!(folder.read("taken"), b"precious");
        folder.chpm(&format!("{words} --force")).success();
        assert_ne!(folder.read("taken"), b"precious");
        folder.write("taken", "precious");
    }
    assert_eq!(folder.names(), ["ball.chpm", "ball.ply", "taken"]);
}

#[test]
fn the_source_is_never_replaced() {
    let folder = ball();
    let before = folder.read("ball.ply");
    let error = folder.stderr("build ball.ply -o ./ball.ply --force", 2);
    assert!(error.contains("source itself"), "{error}");
    assert_eq!(folder.read("ball.ply"), before);
}

#[test]
fn an_output_that_cannot_be_written_is_refused_before_the_work() {
    let folder = ball();
    for words in [
        "build ball.ply -o no/ball.chpm",
        "extract ball.chpm --level 0 -o no/ball.ply",
        "synth sphere --triangles 100 -o no/ball.ply",
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.contains("no/") && !error.contains("took"), "{words}: {error}");
    }
}

#[test]
fn an_empty_mesh_is_refused() {
    let folder = Folder::new();
    folder.write(
        "point.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n3 0 0 0\n",
    );
    let error = folder.stderr("build point.ply", 2);
    assert!(error.contains("no triangle"), "{error}");
    assert_eq!(folder.names(), ["point.ply"]);
}

#[test]
fn progress_goes_to_stderr_and_results_to_stdout() {
    let folder = ball();
    let output = folder.chpm("build ball.ply --force --verbose").success();
    let (out, err) = (text(&output.get_output().stdout), text(&output.get_output().stderr));
    let begun = |stage: &str| err.find(&format!("{stage} ...")).unwrap_or_else(|| panic!("{stage}: {err}"));
    let stages = ["ingest", "decompose", "hierarchy", "simplify", "layout", "emit"];
    assert!(stages.map(begun).is_sorted(), "{err}");
    for word in stages.iter().chain(&["level", "locked", "bytes for each of", "next:"]) {
        assert!(out.contains(word), "{word}: {out}");
    }
    assert_eq!(folder.stderr("build ball.ply --force --quiet", 0), "");
}

#[test]
fn reports_are_json_and_agree() {
    let folder = ball();
    let built = json(&folder.stdout("build ball.ply --force -q --json"));
    let info = json(&folder.stdout("info ball.chpm --json"));
    let verified = json(&folder.stdout("verify ball.chpm --against ball.ply -q --json"));
    assert_eq!(built["triangles"], info["triangles"]);
    assert_eq!(built["levels"], info["levels"]);
    assert_eq!(built["repairs"], info["repairs"]);
    assert_eq!(built["bytes"], info["bytes"]["file"]);
    assert_eq!(built["bytes"], folder.read("ball.chpm").len());
    assert_eq!(built["stages"].as_array().map(Vec::len), Some(6));
    assert_eq!(info["source"]["bytes"], folder.read("ball.ply").len());
    assert_eq!(info["levels"][0]["triangles"], info["triangles"]);
    assert_eq!(verified["sound"], true);
    assert_eq!(verified["against"]["equal"], true);
    assert_eq!(verified["against"]["source_triangles"], info["triangles"]);
}

#[test]
fn info_shows_counts_sizes_and_provenance() {
    let folder = ball();
    let info =
        folder.stdout("info ball.chpm --levels --refusals --settings") + &folder.stdout("info ball.chpm");
    for words in ["clusters", "padding", "ball.ply", "cluster-triangles 512", "locked", "stalled", "xxh3"] {
        assert!(info.contains(words), "{words}: {info}");
    }
}

#[test]
fn verify_names_what_another_source_lacks() {
    let folder = ball();
    let mut other = folder.read_mesh("ball.ply");
    other.triangles[17].swap(0, 1);
    folder.write_mesh("other.ply", &other);
    let output = folder.chpm("verify ball.chpm --against other.ply -q").code(1);
    let out = text(&output.get_output().stdout);
    assert!(out.contains("triangle 17 of the source is in no leaf"), "{out}");
    assert!(out.contains("is not in the source") && out.contains("cluster "), "{out}");
    assert!(out.contains("2 faults"), "{out}");
    let out = json(&text(&folder.chpm("verify ball.chpm --against other.ply -q --json").get_output().stdout));
    assert_eq!((&out["sound"], &out["fault_count"]), (&false.into(), &2.into()));
}

#[test]
fn copies_of_a_triangle_count() {
    let folder = Folder::new();
    let once = hand::tetrahedron();
    let mut twice = once.clone();
    twice.triangles.push(twice.triangles[0]);
    folder.write_mesh("once.ply", &once);
    folder.write_mesh("twice.ply", &twice);
    folder.stdout("build twice.ply -q");
    folder.stdout("verify twice.chpm --against twice.ply -q");
    folder.chpm("verify twice.chpm --against once.ply -q").code(1);
}

#[test]
fn a_copy_is_one_face_with_a_count_that_verify_checks() {
    let folder = Folder::new();
    let once = Synth::new(Shape::Terrain, 3000, 1).to_mesh();
    let mut often = once.clone();
    often.triangles.extend((0..9).flat_map(|turn| {
        once.triangles.iter().map(move |[a, b, c]| match turn % 3 {
            0 => [*a, *b, *c],
            1 => [*b, *c, *a],
            _ => [*c, *a, *b],
        })
    }));
    folder.write_mesh("once.ply", &once);
    folder.write_mesh("often.ply", &often);
    let built = json(&folder.stdout("build often.ply -q --json --cluster-triangles 256"));
    folder.stdout("build once.ply -q --cluster-triangles 256");
    let (n, copies) = (once.triangles.len(), 9 * once.triangles.len());
    assert_eq!((&built["triangles"], &built["repairs"]["merged_copies"]), (&n.into(), &copies.into()));
    let out = folder.stdout("verify often.chpm --against often.ply");
    assert!(out.contains("without 26,676 copies"), "{out}");
    let of =
        |against: &str| json(&folder.stdout(&format!("verify often.chpm --against {against} -q --json")));
    assert_eq!(of("often.ply")["against"]["copies_left_out"], copies);
    // One copy less, one that is another triangle, none at all: each is noticed.
    let mut fewer = often.clone();
    fewer.triangles.pop();
    folder.write_mesh("fewer.ply", &fewer);
    let mut other = often.clone();
    other.triangles.last_mut().unwrap().swap(0, 1);
    folder.write_mesh("other.ply", &other);
    for against in ["fewer.ply", "other.ply", "once.ply"] {
        folder.chpm(&format!("verify often.chpm --against {against} -q")).code(1);
        folder
            .chpm(&format!("verify once.chpm --against {against} -q"))
            .code(i32::from(against != "once.ply"));
    }
}

#[test]
fn whoever_closes_the_pipe_has_read_enough() {
    let folder = ball();
    let mut child = folder
        .command("dump ball.chpm --pages")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a process");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("an end");
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
}

#[test]
fn synth_makes_every_shape_and_the_same_again() {
    let folder = Folder::new();
    for shape in ["terrain", "isosurface", "sphere", "torus", "plates", "plant --parts 8", "plant"] {
        folder.stdout(&format!("synth {shape} --triangles 5000 --seed 9 -o a.ply -qf"));
        folder.stdout(&format!("synth {shape} --triangles 5000 --seed 9 -o b.ply -qf"));
        assert_eq!(folder.read("a.ply"), folder.read("b.ply"), "{shape}");
        let triangles = folder.read_mesh("a.ply").triangles.len();
        assert!((4750..=5250).contains(&triangles), "{shape}: {triangles}");
        folder.stdout(&format!("synth {shape} --triangles 5000 --seed 9 --ascii -o c.ply -qf"));
        assert_eq!(folder.read_mesh("a.ply"), folder.read_mesh("c.ply"), "{shape}");
    }
    assert!(folder.stderr("synth sphere --parts 3 -o d.ply", 2).contains("only a plant has parts"));
}

#[test]
fn the_demo_verifies_and_keeps_its_files_if_asked() {
    let folder = Folder::new();
    let out = folder.stdout("demo --triangles 5000 -q");
    assert!(out.contains("verified: ") && out.contains("next:"), "{out}");
    assert!(folder.names().is_empty());
    folder.stdout("demo --triangles 5000 --keep here -q");
    folder.stdout("verify here/demo.chpm --against here/demo.ply");
    let again = folder.stderr("demo --triangles 5000 --keep here", 2);
    assert!(again.contains("is there already: choose another folder for --keep"), "{again}");
}
