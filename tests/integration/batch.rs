//! Many models at once.

use super::harness::{Folder, text};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::process::Stdio;

/// Four models in `in`, one of them deeper, and one that is none.
fn scans() -> Folder {
    let folder = Folder::new();
    fs::create_dir_all(folder.path("in/deep")).expect("a folder");
    for (name, shape, triangles) in
        [("a", "sphere", 3000), ("b", "torus", 5000), ("deep/c", "terrain", 4000), ("d", "plates", 2000)]
    {
        folder.stdout(&format!("synth {shape} --triangles {triangles} -o in/{name}.ply -q"));
    }
    folder.write("in/bad.ply", "no mesh");
    folder
}

fn summary(folder: &Folder, name: &str) -> Value {
    serde_json::from_slice(&folder.read(name)).expect("a summary")
}

/// Names with what became of them.
fn fates(summary: &Value) -> Vec<(String, String)> {
    let word = |row: &Value, key: &str| row[key].as_str().expect("text").to_owned();
    let rows = summary["models"].as_array().expect("models");
    rows.iter().map(|row| (word(row, "name"), word(row, "status"))).collect()
}

fn expected(fates: [(&str, &str); 5]) -> Vec<(String, String)> {
    fates.map(|(name, fate)| (name.to_owned(), fate.to_owned())).to_vec()
}

const BATCH: &str = "-o out -q --cluster-triangles 512";

#[test]
fn no_model_has_less_than_the_least_memory() {
    let folder = scans();
    let told = |batch: &str| text(&folder.chpm(batch).code(1).get_output().stderr);
    let fewer = told("batch in -o out --jobs 3 --memory 300M");
    assert!(fewer.contains("2 side by side instead of 3"), "{fewer}");
    let all = told("batch in -o out --jobs 2 --memory 300M --force");
    assert!(!all.contains("side by side"), "{all}");
}

#[test]
#[cfg(unix)]
fn a_name_of_two_lines_is_told_in_one() {
    let folder = scans();
    std::fs::rename(folder.path("in/bad.ply"), folder.path("in/b\nad.ply")).expect("a move");
    let table = text(&folder.chpm("batch in -o out").code(1).get_output().stdout);
    assert!(table.contains(" b\\u000aad ") && !table.contains("\nad"), "{table}");
}

#[test]
fn a_failure_stops_no_other_and_only_what_is_left_is_built_again() {
    let folder = scans();
    let printed = text(&folder.chpm(&format!("batch in {BATCH} --jobs 2")).code(1).get_output().stdout);
    assert!(printed.contains("5 models: 4 built, 1 failed"), "{printed}");
    assert_eq!(printed.matches("text that is no mesh").count(), 1, "{printed}");
    let first = summary(&folder, "out/summary.json");
    let all = [("a", "built"), ("b", "built"), ("bad", "failed"), ("d", "built"), ("deep/c", "built")];
    assert_eq!(fates(&first), expected(all));
    let bad = &first["models"][2];
    assert!(bad["error"].as_str().expect("an error").contains("bad.ply"), "{bad}");
    // The same bytes as one by one.
    folder.stdout("build in/deep/c.ply -o c.chpm -q --cluster-triangles 512");
    assert_eq!(folder.read("c.chpm"), folder.read("out/deep/c.chpm"));
    assert!(!folder.path("out/bad.chpm").exists());
    let csv = text(&folder.read("out/summary.csv"));
    assert_eq!(csv.lines().count(), 6, "{csv}");
    assert!(csv.lines().nth(1).expect("a row").starts_with("a,built,new,"), "{csv}");

    // Nothing but the failure is left to do.
    folder.chpm(&format!("batch in {BATCH}")).code(1);
    let current =
        [("a", "current"), ("b", "current"), ("bad", "failed"), ("d", "current"), ("deep/c", "current")];
    let again = summary(&folder, "out/summary.json");
    assert_eq!(fates(&again), expected(current));
    assert_eq!(again["models"][0]["triangles"], first["models"][0]["triangles"]);

    // What is repaired, changed, missing or touched is found.
    folder.stdout("synth sphere --triangles 1000 -o in/bad.ply -q -f");
    folder.stdout("synth sphere --triangles 3000 --seed 5 -o in/a.ply -q -f");
    folder.stdout("synth terrain --triangles 4000 --seed 99 -o in/deep/c.ply -q -f");
    fs::remove_file(folder.path("out/d.chpm")).expect("removed");
    let bytes = folder.read("in/b.ply");
    fs::remove_file(folder.path("in/b.ply")).expect("removed");
    folder.write("in/b.ply", bytes);
    fs::remove_file(folder.path("out/summary.json")).expect("removed");
    let plan = folder.stdout(&format!("batch in {BATCH} --dry-run --json"));
    let plan: Value = serde_json::from_str(&plan).expect("a plan");
    let reason = |i: usize| plan["models"][i]["reason"].as_str().expect("a reason").to_owned();
    assert_eq!([reason(1), reason(2), reason(3), reason(4)], ["", "new", "new", "source changed"]);
    assert!(!folder.path("out/summary.json").exists(), "a dry run writes nothing");
    folder.stdout(&format!("batch in {BATCH}"));
    let settled = fates(&summary(&folder, "out/summary.json"));
    assert_eq!(
        settled[1..3],
        [("b".to_owned(), "current".to_owned()), ("bad".to_owned(), "built".to_owned())]
    );

    // Other settings are another model.
    let other = folder.stdout("batch in -o out -q --cluster-triangles 256 --dry-run");
    assert!(other.contains("5 planned") && other.contains("other settings"), "{other}");
}

/// Models that are kept updatable are built anew where they have changed, to the bytes that `build` has.
#[test]
fn a_model_whose_source_changes_is_updated_in_its_place() {
    let folder = scans();
    fs::remove_file(folder.path("in/bad.ply")).expect("removed");
    const UPDATABLE: &str = "batch in -o out -q --cluster-triangles 64 --updatable";
    folder.stdout(UPDATABLE);
    let reasons = |words: &str| -> Vec<String> {
        folder.stdout(words);
        let summary = summary(&folder, "out/summary.json");
        let rows = summary["models"].as_array().expect("models").iter();
        rows.map(|row| row["reason"].as_str().expect("a reason").to_owned()).collect()
    };
    assert_eq!(reasons(UPDATABLE), ["", "", "", ""]);
    let change = |name: &str| {
        let mut mesh = folder.read_mesh(name);
        mesh.positions[7][2] += 1e-4;
        folder.write_mesh(name, &mesh);
        folder.stdout(&format!("build {name} -o nothing.chpm -f -q --cluster-triangles 64 --updatable"));
    };
    change("in/b.ply");
    let reasons_of_b = reasons(UPDATABLE);
    assert!(reasons_of_b[1].starts_with("source changed; as before: "), "{reasons_of_b:?}");
    assert!(!reasons_of_b[1].contains(", 0 of "), "{reasons_of_b:?}");
    assert_eq!((&*reasons_of_b[0], &*reasons_of_b[2]), ("", ""));
    assert!(folder.read("out/b.chpm") == folder.read("nothing.chpm"));
    assert!(folder.read("out/b.chpm.memo") == folder.read("nothing.chpm.memo"));

    // Without a memo it is built from nothing, and where something else has its name it is not built.
    change("in/b.ply");
    fs::remove_file(folder.path("out/b.chpm.memo")).expect("removed");
    assert_eq!(reasons(UPDATABLE)[1], "source changed");
    assert!(folder.read("out/b.chpm.memo") == folder.read("nothing.chpm.memo"));
    change("in/b.ply");
    folder.write("out/b.chpm.memo", "mine");
    let told = text(&folder.chpm(UPDATABLE).code(1).get_output().stdout);
    assert!(told.contains("b.chpm.memo' is there"), "{told}");
    assert_eq!(folder.read("out/b.chpm.memo"), b"mine");
    assert_eq!(reasons(&format!("{UPDATABLE} --force"))[1], "asked for");
    // A model that was not updatable is another one.
    assert_eq!(reasons("batch in -o out -q --cluster-triangles 64")[1], "other settings");
}

/// What a file tells of its source beside its settings is no other setting.
#[test]
fn lattices_and_dense_images_are_not_built_again() {
    let folder = Folder::new();
    fs::create_dir(folder.path("in")).expect("a folder");
    folder.write("in/a.obj", "mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 2/1 4/2 3/3\n");
    folder.write("in/a.mtl", "newmtl a\nmap_Kd a.png\n");
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 64, 64);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().expect("a header").write_image_data(&[90; 64 * 64]).expect("pixels");
    folder.write("in/a.png", &bytes);
    for settings in ["", "--positions lattice:12"] {
        for fate in ["built", "current"] {
            folder.stdout(&format!("batch in -o out -q {settings}"));
            let fates = fates(&summary(&folder, "out/summary.json"));
            assert_eq!(fates, [("a".to_owned(), fate.to_owned())], "{settings}");
        }
    }
    let told = folder.stdout("info out/a.chpm --settings");
    assert!(told.contains("leaf-triangles") && told.contains("lattice-step"), "{told}");
    // Whoever asks for so many triangles gets them.
    let other = folder.stdout("batch in -o out -q --positions lattice:12 --cluster-triangles 4096 --dry-run");
    assert!(other.contains("1 planned") && other.contains("other settings"), "{other}");
}

#[test]
fn collisions_are_found_before_any_work() {
    let folder = scans();
    fs::copy(folder.path("in/a.ply"), folder.path("a.ply")).expect("a copy");
    let error = folder.stderr(&format!("batch in a.ply {BATCH}"), 2);
    assert!(error.contains("would both be built as 'a.chpm'"), "{error}");
    let error = folder.stderr(&format!("batch none {BATCH}"), 2);
    assert!(error.contains("'none' does not exist"), "{error}");
    assert!(!folder.path("out").exists());
}

#[test]
fn what_no_batch_wrote_is_not_replaced_without_force() {
    let folder = scans();
    fs::create_dir(folder.path("out")).expect("a folder");
    let own = ["summary.json", "summary.csv", "index.html"];
    for name in own {
        let path = format!("out/{name}");
        folder.write(&path, "mine");
        let error = folder.stderr(&format!("batch in {BATCH} --report"), 2);
        assert!(error.contains("which no batch wrote") && error.contains(name), "{error}");
        assert_eq!(folder.read(&path), b"mine");
        fs::remove_file(folder.path(&path)).expect("removed");
    }
    // The list itself, with and without force.
    fs::create_dir(folder.path("list")).expect("a folder");
    folder.write("list/summary.json", r#"{"models": [{"source": "../in/a.ply"}]}"#);
    for force in ["", "-f"] {
        let error = folder.stderr(&format!("batch list/summary.json -o list -q {force}"), 2);
        assert!(error.contains("the list that it was given"), "{error}");
    }

    // Models: of another source, and what is none.
    folder.stdout("build in/b.ply -o out/a.chpm -q --cluster-triangles 512");
    folder.write("out/b.chpm", "mine");
    let (of_b, bytes) = (folder.read("out/a.chpm"), b"mine".to_vec());
    folder.chpm(&format!("batch in {BATCH} --report")).code(1);
    let told = summary(&folder, "out/summary.json");
    for i in [0, 1] {
        let error = told["models"][i]["error"].as_str().expect("an error");
        assert!(error.contains("is not of this source"), "{error}");
    }
    assert_eq!((folder.read("out/a.chpm"), folder.read("out/b.chpm")), (of_b, bytes));
    // It is still refused, and with force replaced.
    folder.chpm(&format!("batch in {BATCH} --report")).code(1);
    assert_eq!(folder.read("out/b.chpm"), b"mine");
    folder.chpm(&format!("batch in {BATCH} --report -f")).code(1);
    let fates = fates(&summary(&folder, "out/summary.json"));
    assert_eq!(fates[..2], [("a".to_owned(), "built".to_owned()), ("b".to_owned(), "built".to_owned())]);
    // What a build made of the same source beforehand is taken over.
    fs::remove_dir_all(folder.path("out")).expect("removed");
    fs::create_dir(folder.path("out")).expect("a folder");
    folder.stdout("build in/b.ply -o out/b.chpm -q --cluster-triangles 256");
    folder.chpm(&format!("batch in {BATCH}")).code(1);
    assert_eq!(fates_of(&folder)[1], ("b".to_owned(), "built".to_owned()));
}

fn fates_of(folder: &Folder) -> Vec<(String, String)> {
    fates(&summary(folder, "out/summary.json"))
}

#[test]
fn lists_give_models_names_and_settings_of_their_own() {
    let folder = scans();
    folder.write(
        "list.toml",
        "[settings]\nseed = 4\n[[model]]\nsource = 'in/a.ply'\nname = 'sets/first'\nsettings = { boundary = 'lock', \
         cluster-triangles = 256, no-layout = true }\n[[model]]\nsource = 'in/b.ply'\n",
    );
    folder.stdout(&format!("batch list.toml {BATCH}"));
    folder.stdout("build in/a.ply -o a.chpm -q --seed 4 --boundary lock --cluster-triangles 256 --no-layout");
    folder.stdout("build in/b.ply -o b.chpm -q --seed 4 --cluster-triangles 512");
    assert_eq!(folder.read("a.chpm"), folder.read("out/sets/first.chpm"));
    assert_eq!(folder.read("b.chpm"), folder.read("out/b.chpm"));
    let row =
        |settings: &str| format!(r#"{{"models": [{{"source": "in/a.ply", "settings": {{{settings}}}}}]}}"#);
    folder.write(
        "twice.json",
        r#"{"models": [{"source": "in/a.ply", "name": "x/m"}, {"source": "in/b.ply", "name": "x//m"}]}"#,
    );
    let error = folder.stderr(&format!("batch twice.json {BATCH}"), 2);
    assert!(error.contains("would both be built as 'x/m.chpm'"), "{error}");
    for (settings, word) in
        [(r#""jobs": 2"#, "jobs"), (r#""seed": "x""#, "seed"), (r#""topology": "free""#, "topology")]
    {
        folder.write("bad.json", row(settings));
        let error = folder.stderr(&format!("batch bad.json {BATCH}"), 2);
        assert!(error.contains("model 'a'") && error.contains(word), "{error}");
    }
}

#[test]
fn a_list_comes_on_standard_input() {
    let folder = scans();
    let mut child = folder
        .command(&format!("batch - {BATCH} --dry-run"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("a process");
    std::io::Write::write_all(&mut child.stdin.take().expect("a pipe"), b"in/a.ply\nin/deep\n")
        .expect("written");
    let output = child.wait_with_output().expect("an end");
    let out = text(&output.stdout);
    assert!(output.status.success() && out.contains("2 models: 2 planned"), "{out}");
}

#[test]
fn shards_make_up_the_whole() {
    let folder = scans();
    fs::remove_file(folder.path("in/bad.ply")).expect("removed");
    for shard in 1..=3 {
        folder.stdout(&format!("batch in {BATCH} --shard {shard}/3"));
    }
    let error = folder.stderr("batch --merge out/summary-1-of-3.json out/summary-3-of-3.json -o out", 2);
    assert!(error.contains("missing: 2"), "{error}");
    let merge =
        "batch --merge out/summary-1-of-3.json out/summary-2-of-3.json out/summary-3-of-3.json -o out";
    let printed = folder.stdout(merge);
    assert!(printed.contains("4 models: 4 built"), "{printed}");
    folder.stdout("batch in -o whole -q --cluster-triangles 512");
    for name in ["a", "b", "d", "deep/c"] {
        assert_eq!(
            folder.read(&format!("out/{name}.chpm")),
            folder.read(&format!("whole/{name}.chpm")),
            "{name}"
        );
    }
    // What shards have built needs no building by one machine.
    folder.stdout(&format!("batch in {BATCH}"));
    assert_eq!(summary(&folder, "out/summary.json")["models"][0]["status"], "current");
}

#[test]
fn a_stopped_batch_keeps_what_is_whole_and_goes_on_later() {
    let folder = Folder::new();
    fs::create_dir(folder.path("in")).expect("a folder");
    folder.stdout("synth isosurface --triangles 300000 -o in/large.ply -q");
    folder.stdout("synth sphere --triangles 1000 -o in/tiny.ply -q");
    folder.stdout("synth isosurface --triangles 290000 --seed 3 -o in/second.ply -q");
    let mut child = folder
        .command("batch in -o out --threads 1")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a process");
    let mut lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    let first = lines.next().expect("a line").expect("text");
    assert!(first.starts_with("[1/3] large: "), "{first}");
    let id = i32::try_from(child.id()).expect("a process id");
    kill(Pid::from_raw(id), Signal::SIGINT).expect("a signal sent");
    lines.for_each(drop);
    let code = child.wait().expect("an end").code();
    let summary = summary(&folder, "out/summary.json");
    let fates = fates(&summary);
    assert_eq!(fates[0], ("large".to_owned(), "built".to_owned()));
    // It may have been faster than the signal.
    if code == Some(130) {
        assert!(fates.iter().any(|(_, fate)| fate == "stopped"), "{fates:?}");
    } else {
        assert_eq!(code, Some(0));
    }
    let left = fs::read_dir(folder.path("out")).expect("a folder").count();
    let built = fates.iter().filter(|(_, fate)| fate == "built").count();
    assert_eq!(left, built + 2, "summaries and whole outputs only");
    let out = folder.stdout("batch in -o out -q");
    assert!(out.contains(&format!("{} built, {built} current", 3 - built)) || built == 3, "{out}");
}
