//! Numbers as people type and read them, and what is said where a file gives less than was asked for.

use super::harness::{Folder, text};

/// A file of several levels and roots in the middle of nothing special.
fn built() -> Folder {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 20k -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 512");
    folder
}

fn warning(folder: &Folder, words: &str) -> String {
    let output = folder.chpm(words).success();
    text(&output.get_output().stderr)
}

#[test]
fn counts_lengths_and_sizes_are_understood_as_people_type_them() {
    let folder = built();
    let mut meshes = Vec::new();
    for triangles in ["5000", "5,000", "5_000", "5k", "0.005M", "5e3"] {
        folder.stdout(&format!("extract in.chpm --triangles {triangles} -o out.ply -qf"));
        meshes.push(folder.read("out.ply"));
    }
    meshes.dedup();
    assert_eq!(meshes.len(), 1);
    let total: f64 = folder.read_mesh("in.ply").triangles.len() as f64;
    folder.stdout("extract in.chpm --triangles 25% -o out.ply -qf");
    let share = folder.read_mesh("out.ply").triangles.len() as f64 / total;
    assert!(0.15 < share && share <= 0.25, "{share}");

    // The diagonal of a sphere's box is 2 * sqrt 3 radii.
    let [of_diagonal, units] = ["1%", "1_0e-3"].map(|error| {
        folder.stdout(&format!("extract in.chpm --error {error} -o out.ply -qf"));
        folder.read_mesh("out.ply").triangles.len()
    });
    assert!(of_diagonal < units && units < 20_000, "{of_diagonal}, {units}");

    folder.stdout("path orbit in.chpm --frames 1e1 -o in.path");
    assert!(folder.stdout("walk in.chpm in.path --latency 0.001k --memory 0.5G -q").contains("10 frames"));
    folder.stdout("verify in.chpm -q --cuts 2e0");
    folder.stdout("measure in.chpm --against in.ply --samples 1e0 --positions 1_0e-1 -q --memory 0.5GiB");
    folder
        .stdout("build in.ply -qf --memory 0.5G --threads 2e0 --cluster-triangles 0.5k --finest-error 1e-3%");
}

#[test]
fn what_is_no_number_of_the_kind_is_refused_with_what_is_understood() {
    let folder = Folder::new();
    folder.write("in.chpm", "never read");
    for (words, told) in [
        ("extract in.chpm -o x.ply --triangles 1,5", "ambiguous"),
        ("extract in.chpm -o x.ply --triangles 1.5", "20,000, 20_000, 20k"),
        ("extract in.chpm -o x.ply --triangles 0", "at least 1"),
        ("extract in.chpm -o x.ply --triangles 101%", "at most 100%"),
        ("extract in.chpm -o x.ply --triangles nan", "1%"),
        ("extract in.chpm -o x.ply --triangles=-5", "20k"),
        ("extract in.chpm -o x.ply --triangles 99999999999999999999", "too large"),
        ("extract in.chpm -o x.ply --error 1,5", "with a point"),
        ("extract in.chpm -o x.ply --error nan", "0.1%"),
        ("extract in.chpm -o x.ply --error=-1", "0.1%"),
        ("extract in.chpm -o x.ply --error 1e999", "0.1%"),
        ("extract in.chpm -o x.ply --error 1mm", "model's units"),
        ("extract in.chpm -o x.ply --level=-1", "whole number"),
        ("extract in.chpm -o x.ply --poe nan", "not a number"),
        ("extract in.chpm -o x.ply --poe 1,5", "ambiguous"),
        ("extract in.chpm -o x.ply --poe 1 --viewport 0x5", "1920x1080"),
        ("extract in.chpm -o x.ply --poe 1 --viewport 5e9x5", "1920x1080"),
        ("extract in.chpm -o x.ply --poe 1 --camera 1,2,3", "px,py,pz"),
        ("extract in.chpm -o x.ply --poe 1 --camera 1,2,3,nan,5,6", "px,py,pz"),
        ("walk in.chpm in.path --memory 1,5G", "1.5GiB"),
        ("walk in.chpm in.path --memory=-1", "1.5GiB"),
        ("walk in.chpm in.path --latency 5e9", "at most 4294967295"),
        ("verify in.chpm --cuts 0", "at least 1"),
        ("measure a b --samples 2M", "at most 1000000"),
        ("measure a b --threads 0", "at least 1"),
        ("path orbit in.chpm -o x.path --frames 0", "at least 1"),
        ("synth torus -o x.ply --triangles 1,00", "ambiguous"),
        ("build in.ply --threads 0", "at least 1"),
        ("build in.ply --checkpoint nan", "not a number"),
        ("build in.ply --checkpoint 1e10", "1e9"),
        ("build in.ply --memory nan", "1.5GiB"),
        ("batch in.ply -o out --jobs 0", "at least 1"),
        ("bench in.ply --runs 1e4", "at most 1000"),
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    assert_eq!(folder.names(), ["in.chpm"]);
}

#[test]
fn a_level_that_is_not_there_is_an_error_that_names_the_highest() {
    let folder = built();
    let info: serde_json::Value = serde_json::from_str(&folder.stdout("info in.chpm --json")).expect("JSON");
    let highest = info["counts"]["levels"].as_u64().expect("levels") - 1;
    folder.stdout(&format!("extract in.chpm --level {highest} -o out.ply -q"));
    for level in [highest + 1, 99] {
        let error = folder.stderr(&format!("extract in.chpm --level {level} -o none.ply -q"), 2);
        assert!(error.contains(&format!("no level {level}: the highest is {highest}")), "{error}");
        assert!(error.contains("'in.chpm'"), "{error}");
    }
    assert!(!folder.path("none.ply").exists());
}

#[test]
fn numbers_for_people_have_no_powers_of_ten() {
    let folder = built();
    let mut told = folder.stdout("build in.ply -qf --cluster-triangles 512");
    told += &folder.stdout("info in.chpm");
    told += &folder.stdout("extract in.chpm --triangles 2000 -o out.ply -q");
    told += &folder.stdout("measure in.chpm --against in.ply --samples 1 -q");
    told += &folder.stdout("measure in.ply out.ply --samples 1 -q");
    let is_power = |word: &&str| {
        let digits = word.trim_end_matches([',', ';', ')']);
        digits.split_once('e').is_some_and(|(lead, power)| {
            lead.parse::<f64>().is_ok() && power.parse::<i32>().is_ok_and(|power| (-4..6).contains(&power))
        })
    };
    assert_eq!(told.split_whitespace().find(is_power), None, "{told}");
    assert!(told.contains("error") && told.contains(" units"), "{told}");
}

#[test]
fn one_is_singular() {
    let folder = Folder::new();
    folder.write("one.ply", concat!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n",
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    ));
    let mut told = folder.stdout("build one.ply -q");
    told += &folder.stdout("info one.chpm");
    told += &folder.stdout("verify one.chpm --against one.ply --cuts 1 -q");
    told += &folder.stdout("extract one.chpm --level 0 -o out.ply -q");
    told += &folder.stdout("path orbit one.chpm --frames 1 -o one.path");
    told += &folder.stdout("walk one.chpm one.path -q");
    told += &folder.stdout("measure one.ply out.ply --samples 1 -q");
    told += &folder.stdout("batch one.ply -o out -q");
    for line in told.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let is_wrong = |pair: &&[&str]| {
            let noun = pair[1].trim_end_matches([',', ';', ':', ')']);
            pair[0].trim_start_matches('(') == "1" && noun.ends_with('s')
        };
        assert_eq!(words.windows(2).find(is_wrong), None, "{line}");
    }
    assert!(told.contains("1 cluster with 1 triangle checked"), "{told}");
}

#[test]
fn less_than_was_asked_for_is_told() {
    let folder = built();
    folder.stdout("build in.ply -q --cluster-triangles 512 --finest-error 1% -o coarse.chpm");
    let too_fine = "extract coarse.chpm --error 1e-5 -o out.ply -qf";
    let told = warning(&folder, too_fine);
    assert!(told.contains("warning: the finest mesh of 'coarse.chpm' has an error of 0.0"), "{told}");
    assert!(!folder.read_mesh("out.ply").triangles.is_empty(), "the finest mesh is written");
    folder.stderr(&format!("{too_fine} --strict"), 1);
    let told = warning(&folder, "extract in.chpm --triangles 1M -o out.ply -qf");
    assert!(told.contains("fewer than 1,000,000"), "{told}");
    folder.stderr("extract in.chpm --triangles 1M -o out.ply -qf --strict", 1);
    for enough in
        ["--error 0", "--error 1%", "--triangles 5k", "--triangles 100%", "--poe 1 --cull", "--level 1"]
    {
        let told = warning(&folder, &format!("extract in.chpm {enough} -o out.ply -qf --strict"));
        assert_eq!(told, "", "{enough}");
    }
}

#[test]
fn what_a_file_does_not_have_is_refused_by_its_name() {
    let folder = built();
    let told = folder.stderr("extract in.chpm --level 99 -o out.ply -qf", 2);
    assert!(
        told.contains("'in.chpm' does not have that") && told.contains("no level 99: the highest is"),
        "{told}"
    );
    let told = folder.stderr("extract in.chpm --triangles 1 -o out.ply -qf", 2);
    assert!(
        told.contains("'in.chpm' does not have that") && told.contains("; ask for at least as many"),
        "{told}"
    );
    let told = folder.stderr("simplify in.ply --triangles 1 -o out.ply -qf", 2);
    assert!(told.contains("the coarsest mesh has") && !told.contains(".chpm"), "{told}");
    assert!(!folder.path("out.ply").exists());
}

#[test]
fn an_empty_picture_is_a_warning() {
    let folder = built();
    let away = "--camera 0,0,10,0,0,20";
    let told = warning(&folder, &format!("extract in.chpm --poe 1 --cull {away} -o out.ply -qf"));
    assert!(told.contains("warning: nothing of 'in.chpm' is in the image"), "{told}");
    folder.stderr(&format!("extract in.chpm --poe 1 --cull {away} -o out.ply -qf --strict"), 1);
    folder.stdout("path orbit in.chpm --frames 2 -o in.path");
    let path = text(&folder.read("in.path"));
    let turned = |line: &str| match line.split_whitespace().collect::<Vec<_>>()[..] {
        [x, y, z, ..] if x.parse::<f64>().is_ok() => {
            let rest = line.split_whitespace().skip(6).collect::<Vec<_>>().join(" ");
            let [a, b, c] = [x, y, z].map(|n| 2.0 * n.parse::<f64>().expect("a number"));
            format!("{x} {y} {z} {a} {b} {c} {rest}\n")
        }
        _ => format!("{line}\n"),
    };
    folder.write("away.path", path.lines().map(turned).collect::<String>());
    let told = warning(&folder, "walk in.chpm away.path -q");
    assert!(told.contains("warning: no frame of 'away.path' sees anything of 'in.chpm'"), "{told}");
    assert_eq!(warning(&folder, "walk in.chpm in.path -q"), "");
}

#[cfg(feature = "viewer")]
#[test]
fn a_picture_says_what_it_lacks() {
    let folder = built();
    let render = "render in.chpm --viewport 40x30 -o a.png -f";
    let told = warning(&folder, &format!("{render} --camera 0,0,10,0,0,20"));
    assert!(told.contains("warning: the picture is empty"), "{told}");
    folder.stderr(&format!("{render} --camera 0,0,10,0,0,20 --strict"), 1);
    // What is drawn and still covers nothing is said to be so.
    let told = warning(&folder, &format!("{render} --camera 0,0,1e30,0,0,0"));
    assert!(told.contains("no pixel covered") && !told.contains("in view"), "{told}");
    folder.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let told = warning(&folder, "render flat.obj --viewport 40x30 -o sheet.png -f -q --contact-sheet --up y");
    assert!(told.contains("warning: view 2 of 6: the picture is empty"), "{told}");
    assert!(warning(&folder, &format!("{render} --triangles 1M")).contains("fewer than 1,000,000"));
    for enough in ["--triangles 5%", "--triangles 5k", "--poe 2", ""] {
        assert_eq!(warning(&folder, &format!("{render} --strict {enough}")), "", "{enough}");
    }
}

#[test]
fn meshes_of_every_format_are_measured() {
    let folder = built();
    let mesh = folder.read_mesh("in.ply");
    let mut obj = String::new();
    mesh.positions.iter().for_each(|[x, y, z]| obj += &format!("v {x} {y} {z}\n"));
    mesh.triangles.iter().for_each(|corners| {
        let [a, b, c] = corners.map(|v| v + 1);
        obj += &format!("f {a} {b} {c}\n");
    });
    folder.write("in.obj", obj);
    let out = folder.stdout("measure in.ply in.obj --samples 1 -q --json");
    let out: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!(out["second"]["triangles"], out["first"]["triangles"]);
    // Decimal text is not single precision, so both are moved, and rounded.
    assert!(out["max"].as_f64() < Some(1e-6), "{out}");
    let only = "--only meshopt-simplify --runs 1 --samples 1 -q";
    assert!(folder.stdout(&format!("bench in.obj {only}")).starts_with("in.obj: "));
}

#[test]
fn documents_name_every_format_that_is_read() {
    for page in ["README.md", "docs/MANUAL.md"] {
        let text = std::fs::read_to_string(super::harness::root().join(page)).expect("a document");
        for format in chpm_import::FORMATS.iter().filter(|format| !format.is_list) {
            assert!(text.contains(format.name), "{page}: {}", format.name);
        }
        assert!(text.contains(".conf"), "{page}");
    }
}

#[test]
fn help_names_every_format_that_is_read() {
    let folder = Folder::new();
    let mut pages = vec!["--help", "build --help", "verify --help", "measure --help", "bench --help"];
    pages.extend(cfg!(feature = "viewer").then_some("view --help"));
    for page in pages {
        let help = folder.stdout(page);
        let line = help.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(line.contains(&chpm_import::read_formats()), "{page}: {help}");
    }
}
