//! Settings of presets and of a `chpm.toml`, and what `chpm config` says of them.

use super::harness::{Folder, text};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;

fn scan() -> Folder {
    let folder = Folder::new();
    fs::create_dir(folder.path("in")).expect("a folder");
    folder.stdout("synth terrain --triangles 4000 -o in/scan.ply -q");
    folder
}

/// Settings that a file was built with.
fn settings(folder: &Folder, file: &str) -> Value {
    let info: Value = serde_json::from_str(&folder.stdout(&format!("info {file} --json"))).expect("JSON");
    info["settings"].clone()
}

/// Values and origins by name.
fn effective(folder: &Folder, words: &str) -> BTreeMap<String, (String, String)> {
    let told: Value = serde_json::from_str(&folder.stdout(&format!("config {words} --json"))).expect("JSON");
    let text = |value: &Value| value.as_str().expect("a text").to_owned();
    let rows = told["settings"].as_array().expect("settings").iter();
    rows.map(|row| (text(&row["name"]), (text(&row["value"]), text(&row["from"])))).collect()
}

fn told(value: &str, from: &str) -> (String, String) {
    (value.to_owned(), from.to_owned())
}

#[test]
fn what_is_typed_wins_over_the_file_and_the_file_over_its_preset() {
    let folder = scan();
    folder.write(
        "in/chpm.toml",
        "preset = 'terrain'\n[settings]\nseed = 5\ncluster-triangles = 256\nno-normals = true\n",
    );
    let run = folder.chpm("build in/scan.ply --seed 7").success();
    let said = text(&run.get_output().stderr);
    assert!(said.contains("settings from in/chpm.toml, preset terrain"), "{said}");
    let built = settings(&folder, "in/scan.chpm");
    for (name, value) in
        [("seed", "7"), ("cluster_triangles", "256"), ("normals", "false"), ("pages", "packed")]
    {
        assert!(built[name] == value || name == "pages", "{name}: {built:#}");
    }
    folder.stdout("build in/scan.ply -o typed.chpm -q --no-config --seed 7 --cluster-triangles 256 --no-normals --pages packed");
    assert!(folder.read("in/scan.chpm") == folder.read("typed.chpm"), "as if all of it had been typed");

    let all = effective(&folder, "in/scan.ply --seed 7");
    assert_eq!(all["seed"], told("7", "command line"));
    assert_eq!(all["cluster-triangles"], told("256", "in/chpm.toml"));
    assert_eq!(all["pages"], told("packed", "preset terrain"));
    assert_eq!(all["topology"], told("change", "default"));
    assert_eq!(all["no-normals"], told("true", "in/chpm.toml"));
    assert_eq!(all["finest-error"], told("none", "default"));
    assert_eq!(all["texture"], told("sheets", "default"));
    for (typed, name, value) in [
        ("--prune-exact", "texture", "vertices"),
        ("--texture none", "texture", "none"),
        ("--no-config", "cluster-triangles", "4096"),
    ] {
        assert_eq!(effective(&folder, &format!("in/scan.ply {typed}"))[name].0, value, "{typed}");
    }
    assert_eq!(all["memory"], told("1G", "default"));
    let table = folder.stdout("config in/scan.ply");
    assert!(table.contains("in/chpm.toml") && table.contains("preset terrain"), "{table}");
}

#[test]
fn files_are_named_or_beside_and_can_be_left_alone() {
    let folder = scan();
    folder.write("other.toml", "[settings]\nseed = 9\nprune-exact = true\n");
    assert_eq!(effective(&folder, "in/scan.ply")["seed"].1, "default");
    assert_eq!(effective(&folder, "in/scan.ply --config other.toml")["seed"], told("9", "other.toml"));
    folder.write("in/chpm.toml", "[settings]\nseed = 3\n");
    assert_eq!(effective(&folder, "in/scan.ply")["seed"].0, "3");
    assert_eq!(effective(&folder, "in/scan.ply --config other.toml")["seed"].0, "9");
    assert_eq!(effective(&folder, "in/scan.ply --no-config")["seed"].1, "default");
    // What takes another's place is no contradiction.
    let all = effective(&folder, "in/scan.ply --config other.toml --finest-error 1%");
    assert_eq!((all["finest-error"].0.as_str(), all["prune-exact"].0.as_str()), ("1%", "false"));
}

#[test]
fn what_can_be_given_several_times_is_a_list() {
    let folder = scan();
    folder.write("in/chpm.toml", "[settings]\nkeep = ['time', 'class']\n");
    assert_eq!(effective(&folder, "in/scan.ply")["keep"], told("time, class", "in/chpm.toml"));
    let typed = effective(&folder, "in/scan.ply --keep quality --keep time");
    assert_eq!(typed["keep"], told("quality, time", "command line"));
    let refused = folder.stderr("build in/scan.ply -q", 2);
    assert!(refused.contains("no scalar 'time' to keep"), "{refused}");
    folder.write("in/chpm.toml", "[settings]\nseed = [1, 2]\n");
    let refused = folder.stderr("build in/scan.ply -q", 2);
    assert!(refused.contains("in/chpm.toml") && refused.contains("--seed"), "{refused}");
}

#[test]
fn wrong_files_are_refused_with_their_names() {
    let folder = scan();
    for (content, word) in [
        ("[settings]\nseeed = 3\n", "seeed"),
        ("[settings]\nseed = 'many'\n", "many"),
        ("[settings]\noutput = 'x'\n", "output"),
        ("preset = 'statue'\n", "preset"),
        ("[setings]\n", "setings"),
        ("not toml", "TOML"),
        ("[settings]\nmemory = '0'\n", "--memory 0"),
        ("[settings]\npartitioner = 'scotch'\n", "scotch"),
        (&"# long\n".repeat(150_000)[..], "longer than 1.0 MiB"),
    ] {
        folder.write("in/chpm.toml", content);
        for verb in ["build in/scan.ply -q", "config in/scan.ply", "batch in -o out -q"] {
            let error = folder.stderr(verb, 2);
            assert!(error.contains("chpm.toml") && error.contains(word), "{verb}: {content}: {error}");
        }
    }
    // What may have no end is not begun.
    fs::remove_file(folder.path("in/chpm.toml")).expect("a file removed");
    nix::unistd::mkfifo(&folder.path("in/chpm.toml"), nix::sys::stat::Mode::S_IRWXU).expect("a FIFO");
    for verb in ["build in/scan.ply -q", "config in/scan.ply", "batch in -o out -q"] {
        let error = folder.stderr(verb, 2);
        assert!(error.contains("chpm.toml' is no regular file"), "{verb}: {error}");
    }
    for config in ["/dev/zero", "in"] {
        let error = folder.stderr(&format!("build in/scan.ply -q --config {config}"), 2);
        assert!(error.contains(&format!("'{config}' is no regular file")), "{error}");
    }
    assert!(folder.stderr("config --memory 1M", 2).contains("128M or more"));
    assert_eq!(folder.names(), ["in"]);
    assert!(folder.stderr("build in/scan.ply -q --config none.toml", 2).contains("none.toml"));
    assert!(folder.stderr("build in/scan.ply -q --preset statue", 2).contains("isosurface"));
}

#[test]
fn a_batch_takes_the_file_beside_each_model() {
    let folder = scan();
    fs::create_dir(folder.path("in/deep")).expect("a folder");
    folder.stdout("synth terrain --triangles 4000 --seed 2 -o in/deep/b.ply -q");
    folder.write("in/chpm.toml", "[settings]\nseed = 3\n");
    folder.write("in/deep/chpm.toml", "preset = 'preview'\n[settings]\nseed = 4\n");
    folder.stdout("batch in -o out -q");
    let [scan, deep] = ["scan", "deep/b"].map(|name| settings(&folder, &format!("out/{name}.chpm")));
    assert_eq!((&scan["seed"], &scan["finest_error"]), (&"3".into(), &"none".into()));
    assert_eq!((&deep["seed"], &deep["finest_error"]), (&"4".into(), &"0.1%".into()));
    assert!(folder.stdout("batch in -o out -q").contains("2 current"));
    folder.write("in/chpm.toml", "[settings]\nseed = 8\n");
    let again = folder.stdout("batch in -o out -q");
    assert!(
        again.contains("1 built") && again.contains("other settings") && again.contains("1 current"),
        "{again}"
    );
    folder.stdout("batch in -o out -q --seed 1");
    assert_eq!(settings(&folder, "out/deep/b.chpm")["seed"], "1");
    // A model's own settings in a list win over all.
    folder.write("list.toml", "[[model]]\nsource = 'in/scan.ply'\nsettings = { seed = 6 }\n");
    folder.stdout("batch list.toml -o out -q --seed 1");
    assert_eq!(settings(&folder, "out/scan.chpm")["seed"], "6");
}

#[test]
fn presets_do_what_the_manual_says() {
    let folder = scan();
    folder.stdout("build in/scan.ply -o plain.chpm -q");
    let manual = fs::read_to_string(super::harness::root().join("docs/MANUAL.md")).expect("the page");
    for preset in ["scan", "cad", "isosurface", "terrain", "preview"] {
        let row = manual.lines().find(|line| line.starts_with(&format!("| `{preset}` |"))).expect("a row");
        let options = row.split('|').nth(2).expect("options").replace('`', "");
        folder.stdout(&format!("build in/scan.ply -o preset.chpm -q -f --preset {preset}"));
        folder.stdout(&format!("build in/scan.ply -o typed.chpm -q -f {options}"));
        assert!(folder.read("preset.chpm") == folder.read("typed.chpm"), "{preset}: {options}");
        assert!(folder.read("preset.chpm").len() < folder.read("plain.chpm").len(), "{preset}");
    }
}
