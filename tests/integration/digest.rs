//! `chpm info` in one screen, its tables behind options, and what a build says at its end.

use super::harness::Folder;
use serde_json::Value;

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("valid JSON")
}

/// A count as `info` writes it.
fn count(text: &str) -> f64 {
    let (number, unit) = text.split_once(' ').unwrap_or((text, ""));
    let factor = match unit {
        "k" => 1e3,
        "M" => 1e6,
        _ => 1.0,
    };
    number.replace(',', "").parse::<f64>().expect("a number") * factor
}

/// A shape with several levels.
fn model(shape: &str, settings: &str) -> Folder {
    let folder = Folder::new();
    folder.stdout(&format!("synth {shape} --triangles 60k -o in.ply -q"));
    folder.stdout(&format!("build in.ply -q {settings}"));
    folder
}

#[test]
fn a_screen_has_what_people_ask_first() {
    for (shape, settings) in [
        ("isosurface", "--cluster-triangles 256"),
        ("terrain", "--pages packed"),
        ("sphere", "--target-error 0.1%"),
    ] {
        let folder = model(shape, settings);
        let info = folder.stdout("info in.chpm");
        assert!(info.lines().count() <= 24, "{info}");
        assert!(info.lines().all(|line| line.chars().count() <= 132), "{info}");
        for word in [
            "in.chpm: CHPM 1.",
            "model ",
            "in.ply",
            "box ",
            "hierarchy ",
            "size ",
            "error ",
            "next:",
            "chpm stats",
        ] {
            assert!(info.contains(word), "{word}: {info}");
        }
        assert!(info.contains("\ngood ") != info.contains("\nlook at "), "{info}");
        assert!(!info.contains("locked") && !info.contains("xxh3"), "only where it is asked for: {info}");
    }
}

#[test]
fn what_it_draws_is_what_is_extracted() {
    let folder = model("isosurface", "--cluster-triangles 512 --target-error 2%");
    let info = folder.stdout("info in.chpm");
    let rows: Vec<&str> = info
        .lines()
        .map(str::trim)
        .filter(|line| line.starts_with("--level ") || line.starts_with("the coarsest"))
        .collect();
    assert!(rows.len() >= 4, "{info}");
    for row in rows {
        let cells: Vec<&str> = row.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).collect();
        let [what, clusters, triangles, distance, _] = cells[..] else { panic!("{row}") };
        if !what.starts_with("--level") {
            continue;
        }
        let told = folder.stdout(&format!("extract in.chpm {what} -o out.ply -f"));
        let mesh = folder.read_mesh("out.ply");
        assert!((count(triangles) / mesh.triangles.len() as f64 - 1.0).abs() < 0.01, "{row}: {told}");
        assert!(told.contains(&format!("from {clusters} cluster")), "{row}: {told}");
        let bound = distance.parse::<f64>().expect("a distance");
        let error = told.split("error ").nth(1).and_then(|rest| rest.split(' ').next()).expect("an error");
        let vanished = told.split('(').nth(1).and_then(|rest| rest.split(' ').next());
        let expected: f64 = vanished.unwrap_or(error).parse().expect("a distance");
        assert!((bound - expected).abs() <= 0.01 * expected, "{row}: {told}");
    }
}

#[test]
fn tables_come_where_they_are_asked_for() {
    let folder = model("terrain", "--cluster-triangles 512");
    for (option, words) in [
        ("--levels", ["level", "kept", "stalled"]),
        ("--refusals", ["refused at", "level 0", "locked"]),
        ("--settings", ["xxh3", "cluster-triangles 512", "boundary edges"]),
    ] {
        let told = folder.stdout(&format!("info in.chpm {option}"));
        assert!(words.iter().all(|word| told.contains(word)), "{option}: {told}");
        assert!(!told.contains("next:"), "{option}: {told}");
    }
    let plain = json(&folder.stdout("info in.chpm --json"));
    assert_eq!(plain, json(&folder.stdout("info in.chpm --json --levels --refusals --settings")));
    assert!(plain["levels"][0]["refusals"]["locked"].is_u64() && plain["settings"]["seed"].is_string());
}

#[test]
fn a_build_is_told_in_some_lines_and_with_verbose_in_tables() {
    let folder = model("terrain", "");
    let short = folder.stdout("build in.ply -q -f --cluster-triangles 512");
    assert!(
        !short.contains("locked") && !short.contains("decompose") && short.lines().count() <= 12,
        "{short}"
    );
    assert!(
        short.contains("built in ") && short.contains("triangles/s") && short.contains("next:"),
        "{short}"
    );
    let long = folder.stdout("build in.ply -q -f --cluster-triangles 512 -v");
    assert!(["locked", "decompose", "kept", "next:"].iter().all(|word| long.contains(word)), "{long}");
}

#[test]
fn what_could_be_better_is_named() {
    let folder = model("isosurface", "--cluster-triangles 256 --topology keep --boundary lock");
    let info = folder.stdout("info in.chpm");
    assert!(info.contains("\nlook at    level ") && info.contains("--refusals tells why"), "{info}");
    let folder = model("sphere", "--finest-error 0.1%");
    let info = folder.stdout("info in.chpm");
    assert!(info.contains("\nlook at    detail of the source was left out"), "{info}");
}
