//! Boundaries and topology as they are asked for, and random cuts that prove that nothing cracks.

use super::harness::{CHPM, Folder, much, text};
use chpm_format::{Chpm, ChpmWriter, PageParts, Tables, checksum};
use chpm_mesh::{ClusterId, TriMesh};
use chpm_synth::hand;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use std::{env, fs};

const MODES: [&str; 4] = [
    "--boundary lock --topology keep",
    "--boundary lock --topology change",
    "--boundary dependencies --topology keep",
    "--boundary dependencies --topology change",
];

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("valid JSON")
}

fn model(shape: &str) -> Folder {
    let folder = Folder::new();
    folder.stdout(&format!("synth {shape} --triangles 8000 -o in.ply -q"));
    folder
}

#[test]
fn no_mode_cracks_and_each_is_stored() {
    let cuts = much(60, 300);
    // Closed and of high genus, open, mechanical, plain.
    for shape in ["isosurface", "terrain", "plates", "torus", "sphere"] {
        let folder = model(shape);
        for mode in MODES {
            folder.stdout(&format!("build in.ply -qf --cluster-triangles 128 {mode}"));
            let out = folder.stdout(&format!("verify in.chpm --against in.ply --cuts {cuts} -q"));
            assert!(out.contains(&format!("no crack in {cuts} random cuts")), "{shape} {mode}: {out}");
            let info = folder.stdout("info in.chpm --settings");
            let words: Vec<&str> = mode.split_whitespace().collect();
            for setting in [format!("boundary {}", words[1]), format!("topology {}", words[3])] {
                assert!(info.contains(&setting), "{setting}: {info}");
            }
        }
    }
}

#[test]
fn dependencies_and_a_change_of_topology_are_the_default() {
    let folder = model("isosurface");
    folder.stdout("build in.ply -q --cluster-triangles 128");
    folder.stdout(&format!("build in.ply -q --cluster-triangles 128 {} -o same.chpm", MODES[3]));
    assert!(folder.read("in.chpm") == folder.read("same.chpm"));
}

#[test]
fn levels_tell_what_was_forced() {
    let folder = model("isosurface");
    for (topology, is_forced) in [("keep", false), ("change", true)] {
        let build = format!("build in.ply -qf --json --cluster-triangles 128 --topology {topology}");
        let (built, info) = (json(&folder.stdout(&build)), json(&folder.stdout("info in.chpm --json")));
        assert_eq!(built["levels"], info["levels"]);
        let levels = info["levels"].as_array().expect("levels");
        let forced: u64 =
            levels.iter().map(|level| level["forced_collapses"].as_u64().expect("a count")).sum();
        assert_eq!(forced > 0, is_forced, "{topology}: {forced}");
        assert!(folder.stdout("info in.chpm --levels").contains("forced"));
    }
}

/// A sheet with a hole in every fifth quad or so.
fn holes(side: u32) -> TriMesh {
    let mut mesh = hand::grid(side, side);
    let quads = mesh.triangles.chunks(2).enumerate().filter(|(quad, _)| quad % 5 != 2);
    mesh.triangles = quads.flat_map(|(_, quad)| quad.to_vec()).collect();
    mesh
}

/// Closed balls beside one another, each of another fineness.
fn components(count: u32) -> TriMesh {
    let mut all = TriMesh::default();
    for i in 0..count {
        let ball = hand::icosphere(i % 4);
        let first = all.positions.len() as u32;
        all.positions.extend(ball.positions.iter().map(|p| [p[0] + 3.0 * i as f32, p[1], p[2]]));
        all.triangles.extend(ball.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    all
}

#[test]
fn meshes_that_are_cracked_or_tangled_themselves_are_no_fault() {
    for (name, mesh) in [
        ("grid", hand::grid(30, 30)),
        ("holes", holes(30)),
        ("components", components(12)),
        ("bow tie", hand::bow_tie()),
        ("moebius", hand::moebius(300)),
        ("klein bottle", hand::klein_bottle(25)),
        ("soup", hand::soup(300)),
        ("edge fan", hand::edge_fan(301)),
        ("mixed winding", hand::mixed_winding()),
        ("duplicates", hand::duplicate_faces()),
    ] {
        let folder = Folder::new();
        folder.write_mesh("in.ply", &mesh);
        for mode in MODES {
            folder.stdout(&format!("build in.ply -qf --cluster-triangles 32 {mode}"));
            let output = folder.chpm(&format!("verify in.chpm --cuts {} -q", much(40, 200)));
            let output = output.get_output();
            assert_eq!(output.status.code(), Some(0), "{name} {mode}: {}", text(&output.stdout));
        }
    }
}

#[test]
fn cuts_follow_from_their_seed() {
    let folder = model("torus");
    folder.stdout("build in.ply -q --cluster-triangles 128");
    let triangles = |words: &str| {
        let out = json(&folder.stdout(&format!("verify in.chpm -q --json {words}")));
        assert_eq!((&out["sound"], &out["cuts"]["fault_count"]), (&true.into(), &0.into()));
        out["cuts"]["triangles"].as_u64().expect("a count")
    };
    let all = triangles("--cuts 6");
    assert_eq!(all, triangles("--cuts 6 --seed 0"));
    assert_eq!(all, triangles("--cuts 2") + triangles("--cuts 3 --seed 2") + triangles("--cuts 1 --seed 5"));
    assert_ne!(all, triangles("--cuts 6 --seed 100"));
    assert!(json(&folder.stdout("verify in.chpm -q --json"))["cuts"].is_null());
    assert!(folder.stderr("verify in.chpm --cuts 3", 0).contains("cuts ..."));
}

/// The file with the clusters at `changed` refined later than their groups are: every error is that of the base mesh.
fn with_wrong_errors(bytes: Vec<u8>, changed: &[usize]) -> Vec<u8> {
    let file = Chpm::open(bytes).expect("a file");
    let mut tables = Tables::of(&file).expect("tables");
    let mut payloads = Vec::new();
    for index in 0..file.clusters().len() {
        let id = ClusterId(index as u32);
        let mut payload = file.page_bytes(id).to_vec();
        if changed.contains(&index) {
            let page = file.page(id).expect("a page");
            let page = page.view();
            let shared: Vec<(u16, u32)> = page.shared().collect();
            let parts = PageParts {
                vertices: page.vertices,
                triangles: page.triangles,
                targets: page.targets,
                errors: &vec![page.max_error(); page.targets.len()],
                shared: &shared,
                min_error: page.min_error,
                scale_error: page.error_scale,
            };
            payload.clear();
            parts.encode(&mut payload).expect("a payload");
            tables.clusters[index].page_checksum = checksum(&payload);
        }
        payloads.push(payload);
    }
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).expect("a head");
    payloads.iter().for_each(|payload| writer.page(payload).expect("a page written"));
    writer.finish().expect("a file")
}

#[test]
fn borders_that_differ_are_found_and_named() {
    let folder = model("torus");
    folder.stdout("build in.ply -q --cluster-triangles 128");
    let bytes = folder.read("in.chpm");
    let file = Chpm::open(bytes.clone()).expect("a file");
    let grouped = file.groups().iter().filter(|group| group.coarse_count > 1);
    let firsts: Vec<usize> =
        grouped.map(|group| file.members()[group.coarse_first as usize] as usize).collect();
    assert!(!firsts.is_empty());
    folder.write("same.chpm", with_wrong_errors(bytes.clone(), &[]));
    folder.stdout("verify same.chpm --cuts 40 -q");
    folder.write("bad.chpm", with_wrong_errors(bytes, &firsts));
    let output = folder.chpm("verify bad.chpm --cuts 40 -q").code(1);
    let out = text(&output.get_output().stdout);
    let told: Vec<&str> = out.lines().filter(|line| line.contains("I7 boundary: cut of seed ")).collect();
    assert!(!told.is_empty(), "{out}");
    assert!(told[0].contains("the edge from [") && told[0].contains("has no partner"), "{out}");
    let out = json(&text(&folder.chpm("verify bad.chpm --cuts 40 -q --json").code(1).get_output().stdout));
    assert_eq!(out["sound"], false);
    assert!(out["cuts"]["fault_count"].as_u64() >= Some(told.len() as u64));
    // The seed that was named alone shows the same.
    let seed = told[0].split("seed ").nth(1).and_then(|rest| rest.split(':').next()).expect("a seed");
    let again = folder.chpm(&format!("verify bad.chpm --cuts 1 --seed {seed} -q")).code(1);
    assert!(text(&again.get_output().stdout).contains(told[0]));
}

#[test]
fn a_damaged_page_is_named_once_and_no_cut_is_drawn() {
    let folder = model("torus");
    folder.stdout("build in.ply -q --cluster-triangles 512");
    let mut bytes = folder.read("in.chpm");
    let page = bytes.windows(4).position(|window| window == b"CPGE").expect("a page");
    bytes[page + 100] ^= 1;
    folder.write("bad.chpm", &bytes);
    let out = text(&folder.chpm("verify bad.chpm --cuts 5 -q").code(1).get_output().stdout);
    let line = out.lines().find(|line| line.contains("checksum")).expect("the fault");
    assert_eq!(line.matches("page of cluster 0").count(), 1, "{line}");
    assert!(!out.contains("random cuts"), "{out}");
}

#[test]
fn suggestions_work_as_they_are_printed() {
    for mode in [MODES[0], MODES[3]] {
        let folder = model("isosurface");
        let out = folder.stdout(&format!("build in.ply -q --cluster-triangles 64 {mode}"));
        try_suggestions(&folder, &out, 2);
    }
    // Whatever the shell would make of the name.
    let folder = model("isosurface");
    let name = "-it's $HOME; \"odd\"";
    fs::rename(folder.path("in.ply"), folder.path(&format!("{name}.ply"))).expect("renamed");
    let out = folder.command("build -q --").arg(format!("{name}.ply")).output().expect("it ran");
    let out = String::from_utf8(out.stdout).expect("text");
    try_suggestions(&folder, &out, 2);
    let folder = Folder::new();
    let out = folder.stdout("demo --triangles 1000 --keep here -q");
    try_suggestions(&folder, &out, 3);
}

fn try_suggestions(folder: &Folder, out: &str, least: usize) {
    let next = out.lines().skip_while(|line| *line != "next:").skip(1).map(str::trim);
    let commands: Vec<&str> = next.filter(|line| line.starts_with("chpm ") && !line.contains('|')).collect();
    assert!(commands.len() >= least, "{out}");
    let programs = Path::new(CHPM).parent().expect("a folder");
    let path = format!("{}:{}", programs.display(), env::var("PATH").unwrap_or_default());
    for command in commands {
        // A window needs a display; that its file is named as the shell wants it shows elsewhere, too.
        let command = command.replace("chpm view ", "chpm info ");
        let mut shell = Command::new("sh");
        shell.args(["-c", &command]).current_dir(folder.path("")).env("PATH", &path).stdout(Stdio::null());
        assert!(shell.status().expect("it ran").success(), "{command}");
    }
}

#[test]
fn wrong_modes_and_numbers_are_refused() {
    let folder = Folder::new();
    for words in [
        "build x.ply --boundary v-partition",
        "build x.ply --boundary",
        "build x.ply --topology maybe",
        "verify x.chpm --cuts 0",
        "verify x.chpm --cuts few",
        "verify x.chpm --cuts=-1",
        "verify x.chpm --seed 3",
        "verify x.chpm --cuts 3 --seed x",
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.contains("--"), "{words}: {error}");
    }
    let help = folder.stdout("build --help");
    for word in ["--boundary", "lock", "dependencies", "--topology", "keep", "change"] {
        assert!(help.contains(word), "{word}: {help}");
    }
}
