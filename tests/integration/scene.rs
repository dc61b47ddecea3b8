//! Building only what a scene needs: errors that are too fine or too coarse for it, and what costs nothing.

use super::harness::Folder;
use chpm_format::Chpm;
use chpm_synth::hand;
use serde_json::Value;

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("valid JSON")
}

fn model(shape: &str) -> Folder {
    let folder = Folder::new();
    folder.stdout(&format!("synth {shape} --triangles 12000 -o in.ply -q"));
    folder
}

/// The deviation of what is extracted from the file from its source.
fn deviation(folder: &Folder, options: &str) -> f64 {
    folder.stdout(&format!("extract in.chpm {options} -o out.ply -qf"));
    json(&folder.stdout("measure out.ply in.ply -q --json"))["max"].as_f64().expect("a distance")
}

#[test]
fn both_ends_hold_and_nothing_cracks() {
    for shape in ["torus", "terrain", "isosurface", "plates"] {
        let folder = model(shape);
        folder.stdout("build in.ply -q --cluster-triangles 256 --topology keep -o whole.chpm");
        for options in
            ["--finest-error 0.2%", "--target-error 0.3%", "--finest-error 0.2% --target-error 0.3%"]
        {
            folder.stdout(&format!("build in.ply -qf --cluster-triangles 256 --topology keep {options}"));
            let file = Chpm::open(folder.read("in.chpm")).expect("a file");
            let diagonal = file.header().aabb().diagonal();
            assert!(folder.read("in.chpm").len() < folder.read("whole.chpm").len(), "{shape} {options}");
            let out = folder.stdout("verify in.chpm --against in.ply --cuts 200 -q");
            assert!(out.contains("no crack in 200 random cuts"), "{shape} {options}: {out}");
            let trimmed = options.contains("finest");
            assert_eq!(out.contains("not compared with in.ply"), trimmed, "{shape} {options}: {out}");
            assert_eq!(out.contains("the leaves are the "), !trimmed, "{shape} {options}: {out}");
            assert_eq!(file.roots().count() > 1, options.contains("target"), "{shape} {options}");
            let finest = deviation(&folder, "--error 0") / diagonal;
            assert!(finest <= if trimmed { 0.002 } else { 1e-6 }, "{shape} {options}: {finest}");
            if options.contains("target") {
                let coarsest = deviation(&folder, "--error 1e30") / diagonal;
                assert!(coarsest <= 0.003 + 1e-6, "{shape} {options}: {coarsest}");
            }
        }
    }
}

#[test]
fn options_are_told_by_the_file() {
    let folder = model("torus");
    folder.stdout("build in.ply -q --cluster-triangles 256 --finest-error 0.05% --target-error 1.5");
    let info = folder.stdout("info in.chpm --settings");
    assert!(info.contains("finest-error 0.05%") && info.contains("target-error 1.5"), "{info}");
    let verified = json(&folder.stdout("verify in.chpm --against in.ply -q --json"));
    assert_eq!((&verified["trimmed"], &verified["sound"]), (&true.into(), &true.into()));
    assert!(verified["against"].is_null());
    folder.stdout("build in.ply -qf --cluster-triangles 256");
    let info = folder.stdout("info in.chpm --settings");
    assert!(info.contains("finest-error none") && info.contains("target-error none"), "{info}");
    let verified = json(&folder.stdout("verify in.chpm --against in.ply -q --json"));
    assert_eq!((&verified["trimmed"], &verified["against"]["equal"]), (&false.into(), &true.into()));
}

#[test]
fn what_is_flat_is_pruned() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &hand::grid(80, 80));
    folder.stdout("build in.ply -q --cluster-triangles 1024 -o whole.chpm");
    folder.stdout("build in.ply -q --cluster-triangles 1024 --prune-exact");
    folder.stdout("build in.ply -q --cluster-triangles 1024 --finest-error 0 -o same.chpm");
    assert!(folder.read("in.chpm") == folder.read("same.chpm"));
    assert!(folder.read("in.chpm").len() < 3 * 4096, "{} bytes", folder.read("in.chpm").len());
    let file = Chpm::open(folder.read("in.chpm")).expect("a file");
    assert!(file.header().source_triangle_count <= 100 && file.header().max_error == 0.0);
    assert_eq!(deviation(&folder, "--error 0"), 0.0);
    folder.stdout("verify in.chpm --cuts 10 -q");
}

#[test]
fn what_cannot_be_built_or_measured_is_refused() {
    let folder = model("torus");
    let error = folder.stderr("build in.ply --finest-error 2% --target-error 1%", 2);
    assert!(error.contains("raise the target error or lower the finest"), "{error}");
    assert_eq!(folder.names(), ["in.ply"]);
    for words in [
        "build in.ply --finest-error few",
        "build in.ply --finest-error=-1",
        "build in.ply --target-error 1e400",
        "build in.ply --target-error %",
        "build in.ply --prune-exact --finest-error 1",
    ] {
        assert!(folder.stderr(words, 2).contains("-error"), "{words}");
    }
    folder.stdout("build in.ply -q --finest-error 1%");
    let error = folder.stderr("measure in.chpm --against in.ply -q", 2);
    assert!(error.contains("without detail below an error") && error.contains("chpm extract"), "{error}");
}
