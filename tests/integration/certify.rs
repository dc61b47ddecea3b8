//! `chpm verify --errors`: stored errors that are proven to hold, and false ones that are refuted.

use super::harness::{Folder, text};
use super::measure::leaf_with;
use chpm_format::{Gaps, checksum};
use chpm_mesh::TriMesh;
use chpm_synth::hand;
use serde_json::Value;
use std::f64::consts::TAU;

fn json(folder: &Folder, words: &str, code: i32) -> Value {
    let output = folder.chpm(words).code(code);
    serde_json::from_slice(&output.get_output().stdout).expect("valid JSON")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

/// A pyramid of height 1 over the square from -2 to 2 whose apex, vertex 4, falls onto a corner.
fn pyramid() -> TriMesh {
    let positions =
        vec![[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0], [0.0, 0.0, 1.0]];
    TriMesh::new(positions, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
}

#[test]
fn an_error_that_is_just_right_holds_and_a_little_less_is_refuted() {
    // The apex is just so far above the square. The square's middle is so far below the pyramid's sides, and no sample lies just there.
    let deepest = 2.0 / 5f64.sqrt();
    for (error, gap, of_mesh, of_source) in
        [(1.0, 0.0, 0, 0), (0.999, 0.0, 0, 4), (0.895, 1.0, 0, 0), (0.894, 1.0, 2, 0), (0.894, 0.0, 2, 4)]
    {
        let folder = Folder::new();
        let (fine, base, from) = (0.0, gap, 0.0);
        folder.write_mesh("in.ply", &pyramid());
        folder.write("in.chpm", leaf_with(&pyramid(), &[0], &[error], Gaps { fine, base, from }));
        let code = i32::from(of_mesh + of_source > 0);
        let words = "verify in.chpm --against in.ply --errors -q";
        let found = json(&folder, &format!("{words} --json"), code);
        let row = &found["errors"]["levels"][0];
        // What the page stores is rounded up.
        assert!(number(&row["stored_error"]) >= f64::from(error), "{found}");
        assert_eq!(
            (&row["of_mesh"]["violations"], &row["of_source"]["violations"]),
            (&of_mesh.into(), &of_source.into()),
            "{found}"
        );
        assert_eq!(found["errors"]["violations"], of_mesh + of_source);
        assert_eq!(
            (&found["fault_count"], &found["errors"]["undecided"]),
            (&(of_mesh + of_source).into(), &0.into())
        );
        for (side, expected) in [("of_mesh", deepest), ("of_source", 1.0)] {
            let [least, most] = ["least", "most"].map(|key| number(&row[side][key]));
            assert!(
                least <= expected && expected <= most && most <= 1.0101 * least,
                "{side}: {least} {most}"
            );
        }
        let told = text(&folder.chpm(words).code(code).get_output().stdout);
        let fault = "I5 error: level 0, 100 % collapsed";
        assert_eq!(told.contains(fault), code == 1, "{told}");
        assert_eq!(told.contains("4 triangles of the source farther from the mesh than the stored distance; the worst point, at 0 0 1, by 1.00 units"), of_source > 0, "{told}");
        assert_eq!(told.contains("every stored distance holds, proven"), code == 0, "{told}");
        // Cuts are held to what they store, too.
        let cuts = json(&folder, &format!("{words} --json --cuts 8 --seed 3"), code);
        assert_eq!(cuts["errors"]["cuts"].as_array().expect("cuts").len(), 8);
        assert_eq!(number(&cuts["errors"]["violations"]) > f64::from(of_mesh + of_source), code == 1);
    }
}

#[test]
fn what_has_vanished_is_within_the_gap() {
    // A large triangle that stays, and far above it a small one that becomes its corner.
    let mut mesh = hand::strip(1);
    mesh.positions.truncate(3);
    mesh.positions.extend([[0.25, 0.25, 50.0], [1.25, 0.25, 50.0], [0.25, 1.25, 50.0]]);
    mesh.triangles = vec![[0, 1, 2], [3, 4, 5]];
    for (base, code) in [(0.0, 1), (49.9, 1), (52.0, 0)] {
        let folder = Folder::new();
        folder.write_mesh("in.ply", &mesh);
        folder.write("in.chpm", leaf_with(&mesh, &[3, 3], &[1.0; 2], Gaps { fine: 0.0, base, from: 1.0 }));
        let found = json(&folder, "verify in.chpm --against in.ply --errors --json -q", code);
        let row = &found["errors"]["levels"][0];
        assert_eq!((&row["triangles"], &row["stored_error"]), (&1.into(), &1.0.into()), "{found}");
        assert_eq!(row["of_source"]["violations"], code);
        assert!(number(&row["of_source"]["least"]) >= 49.9, "{found}");
    }
}

/// Halves every error and gap of a file and makes its checksums right: powers of two, so that nothing else changes.
fn halve_errors(file: &mut [u8]) {
    let word = |file: &[u8], at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes"));
    let long = |file: &[u8], at: usize| u64::from_le_bytes(file[at..at + 8].try_into().expect("eight bytes"));
    let halve = |file: &mut [u8], at: usize| {
        let half = 0.5 * f32::from_bits(word(file, at));
        file[at..at + 4].copy_from_slice(&half.to_le_bytes());
    };
    let seal = |file: &mut [u8], at: usize, from: std::ops::Range<usize>| {
        let sum = checksum(&file[from]);
        file[at..at + 8].copy_from_slice(&sum.to_le_bytes());
    };
    let count = word(file, 32) as usize;
    let entry = |kind: u32| {
        let mut entries = (0..count).map(|slot| 256 + 40 * slot);
        entries.find(|entry| word(file, *entry) == kind).expect("the section")
    };
    // Clusters, groups, members, levels, and what tells chunks of the first three.
    let entries = [1, 2, 3, 4, 0x8000_0001].map(entry);
    let section = |file: &[u8], entry: usize| {
        let start = long(file, entry + 8) as usize;
        start..start + long(file, entry + 16) as usize
    };
    halve(file, 144);
    for record in section(file, entries[0]).step_by(128) {
        let page = long(file, record) as usize;
        let end = page + word(file, record + 8) as usize;
        [record + 48, record + 52, page + 28, page + 32].into_iter().for_each(|at| halve(file, at));
        seal(file, record + 96, page..end);
    }
    for record in section(file, entries[1]).step_by(64) {
        [24, 28, 48, 52, 56].into_iter().for_each(|at| halve(file, record + at));
    }
    for record in section(file, entries[3]).step_by(128) {
        [48, 52].into_iter().for_each(|at| halve(file, record + at));
    }
    let list = section(file, entries[4]);
    let chunk = long(file, list.start) as usize;
    let tables = entries[..3].iter().flat_map(|entry| file[section(file, *entry)].chunks(chunk));
    let sums: Vec<u64> = tables.map(checksum).collect();
    for (at, sum) in list.step_by(8).skip(1).zip(sums) {
        file[at..at + 8].copy_from_slice(&sum.to_le_bytes());
    }
    for entry in entries {
        let range = section(file, entry);
        seal(file, entry + 32, range);
    }
    seal(file, 240, 256..256 + count * 40);
    seal(file, 248, 0..248);
}

#[test]
fn builds_are_certified_and_half_their_errors_are_refuted() {
    for (shape, more) in [
        ("isosurface", ""),
        ("terrain", "--boundary lock"),
        ("hard:pages", ""),
        ("hard:needles", ""),
        ("odd:soup", ""),
    ] {
        let folder = Folder::new();
        folder.stdout(&format!("synth {shape} --triangles 3000 -o in.ply -q"));
        folder.stdout(&format!("build in.ply -q --cluster-triangles 64 {more}"));
        let words = "verify in.chpm --against in.ply --errors --positions 2 --cuts 2 --json -q";
        let found = json(&folder, words, 0);
        let levels = found["errors"]["levels"].as_array().expect("levels");
        assert!(levels.len() >= 6, "{shape}");
        for row in levels {
            for (side, stored) in [("of_mesh", "stored_error"), ("of_source", "stored_distance")] {
                let [least, most] = ["least", "most"].map(|key| number(&row[side][key]));
                // What is certified is never more than what is stored, and mostly known to a hundredth.
                let stored = number(&row[stored]) + number(&found["errors"]["slack"]);
                assert!(least <= most && most <= stored.max(1.0101 * least), "{shape}: {row}");
            }
        }
        let mut file = folder.read("in.chpm");
        halve_errors(&mut file);
        folder.write("in.chpm", file);
        // Nothing that the file alone shows is wrong with it.
        folder.stdout("verify in.chpm --against in.ply -q");
        let found = json(&folder, words, 1);
        assert!(number(&found["errors"]["violations"]) > 0.0, "{shape}: {found}");
    }
}

#[test]
fn threads_and_memory_do_not_show() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 6000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 256");
    let words = "verify in.chpm --against in.ply --errors --cuts 2 --json -q";
    let result = |more: &str| folder.stdout(&format!("{words} {more}"));
    let one = result("--threads 1");
    assert!(one == result("--threads 3 --memory 40M"));
}

#[test]
fn levels_are_those_that_are_asked_for() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 6000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 128");
    let found = json(
        &folder,
        "verify in.chpm --against in.ply --errors --level 1 --level 3 --positions 2 --json -q",
        0,
    );
    let rows = found["errors"]["levels"].as_array().expect("levels");
    let of = |row: &Value| (number(&row["level"]), number(&row["collapsed"]));
    assert_eq!(rows.iter().map(of).collect::<Vec<_>>(), [(1.0, 0.5), (1.0, 1.0), (3.0, 0.5), (3.0, 1.0)]);
}

#[test]
fn too_little_effort_is_no_proof() {
    // Two triangles over thousands, without any distance: every one of them has to be cut out.
    let folder = Folder::new();
    folder.stdout("synth hard:plane --triangles 6000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 256");
    let words = "verify in.chpm --against in.ply --errors -q";
    let told = text(&folder.chpm(&format!("{words} --effort 1")).code(1).get_output().stdout);
    assert!(told.contains("neither proven nor refuted; a larger --effort may decide"), "{told}");
    assert!(!told.contains("proven\n") && !told.contains("sound"), "{told}");
    assert!(folder.stdout(words).contains("every stored distance holds, proven"));
}

/// Slivers about one vertex: where they meet, a triangle has far more of them under it than its area says.
#[test]
fn rough_fans_of_slivers_are_decided() {
    let folder = Folder::new();
    let count = 1200;
    for seed in [7, 40_503] {
        let noise = |i: u32| {
            let x = i.wrapping_mul(2_654_435_761).wrapping_add(seed);
            let x = (x ^ x >> 15).wrapping_mul(2_246_822_519);
            f64::from(x ^ x >> 13) / 4_294_967_296.0
        };
        let vertex = |i: u32| {
            let (angle, reach) = (f64::from(i) * TAU / f64::from(count), f64::from(u8::from(i > 0)));
            format!("v {:.6} {:.6} {:.6}\n", reach * angle.cos(), reach * angle.sin(), noise(i))
        };
        let face = |i: u32| format!("f 1 {} {}\n", i + 2, (i + 1) % count + 2);
        let fan: String = (0..=count).map(vertex).chain((0..count).map(face)).collect();
        folder.write("in.obj", fan);
        folder.stdout("build in.obj -q -f --cluster-triangles 16 --partitioner greedy");
        let out = folder.stdout("verify in.chpm --against in.obj --errors --positions 2 -q");
        assert!(out.contains("every stored distance holds, proven"), "{out}");
    }
}

#[test]
fn wrong_words_and_files_are_refused() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 3000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 256 -o in.chpm");
    folder.stdout("build in.ply -q --cluster-triangles 256 --finest-error 1% -o trimmed.chpm");
    for (words, told) in [
        ("verify in.chpm --errors", "--against"),
        ("verify in.chpm --against in.ply --level 1", "--errors"),
        ("verify in.chpm --against in.ply --errors --effort 0", "--effort"),
        ("verify in.chpm --against in.ply --errors --level 9 -q", "its levels are 0 to"),
        ("verify trimmed.chpm --against in.ply --errors -q", "built without detail below an error"),
    ] {
        let error = folder.stderr(words, 2);
        assert!(error.contains(told), "{words}: {error}");
    }
    // Errors of another source are no errors of this file.
    folder.write_mesh("other.ply", &pyramid());
    let found = json(&folder, "verify in.chpm --against other.ply --errors --json -q", 1);
    assert!(found["errors"].is_null() && found["against"]["equal"] == false, "{found}");
}

fn triangles(folder: &Folder, words: &str) -> u64 {
    json(folder, &format!("{words} -o out.ply --json -qf"), 0)["triangles"].as_u64().expect("a count")
}

#[test]
fn what_is_proven_anew_is_coarser_and_near_enough() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 20k -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 512 --bounds quick");
    folder.stdout(
        "build in.ply -o trimmed.chpm -q --cluster-triangles 512 --bounds quick --finest-error 0.05%",
    );
    for file in ["in.chpm", "trimmed.chpm"] {
        for share in ["3%", "1%", "0.5%"] {
            let asked = format!("extract {file} --error {share}");
            let stored = triangles(&folder, &asked);
            let told = json(&folder, &format!("{asked} --tight --threads 1 -o tight.ply --json -qf"), 0);
            let tight = told["triangles"].as_u64().expect("a count");
            assert!(tight < stored, "{file} {share}: {tight}, {stored}");
            let measured = json(&folder, "measure tight.ply in.ply --json -q", 0);
            assert!(number(&measured["max"]) <= number(&told["distance"]), "{file} {share}: {measured}");
            let of_diagonal = 0.01 * share.trim_end_matches('%').parse::<f64>().expect("a number");
            let limit = of_diagonal * number(&measured["diagonal"]);
            assert!(number(&told["distance"]) <= limit * (1.0 + 1e-6), "{file} {share}: {told}");
            // Whatever works on it.
            triangles(&folder, &format!("{asked} --tight --threads 3 --memory 128M"));
            assert!(folder.read("out.ply") == folder.read("tight.ply"), "{file} {share}");
        }
    }
    let simplified = triangles(&folder, "simplify in.ply --within 0.5% --tight");
    assert!(simplified <= triangles(&folder, "simplify in.ply --within 0.5% --effort 0"));
    for words in
        ["extract in.chpm --level 0", "extract in.chpm --triangles 9", "simplify in.ply --triangles 9"]
    {
        let refused = folder.stderr(&format!("{words} --tight -o no.ply"), 2);
        assert!(refused.contains("cannot be used"), "{words}: {refused}");
    }
}

/// What a root stores is never more than what it stores in haste, is less where it counts, and is proven; whatever works on it.
#[test]
fn bounds_that_are_tight_are_smaller_and_hold() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 20k -o in.ply -q");
    folder.stdout("build in.ply -o quick.chpm -q --bounds quick");
    folder.stdout("build in.ply -o tight.chpm -q --threads 1");
    folder.stdout("build in.ply -o same.chpm -q --bounds tight --threads 3 --memory 128M");
    assert!(folder.read("tight.chpm") == folder.read("same.chpm"));
    for share in ["2%", "0.3%"] {
        let [quick, tight] = ["quick", "tight"]
            .map(|name| triangles(&folder, &format!("extract {name}.chpm --error {share}")));
        assert!(10 * tight < 9 * quick, "{share}: {tight}, {quick}");
    }
    let found = json(&folder, "verify tight.chpm --against in.ply --errors --cuts 20 --json -q", 0);
    assert_eq!((&found["errors"]["violations"], &found["errors"]["undecided"]), (&0.into(), &0.into()));
    let info = |name: &str| json(&folder, &format!("info {name} --json"), 0).to_string();
    assert!(info("quick.chpm").contains("quick") && !info("tight.chpm").contains("quick"));
}

/// Vertex by vertex, fewer triangles are left than any mesh of the file has, as near, whatever works on it and wherever they go.
#[test]
fn a_mesh_is_taken_further_than_the_file_goes() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 3000 -o in.ply -q");
    let asked = "simplify in.ply --within 1%";
    let told =
        |effort: u32, rest: &str| json(&folder, &format!("{asked} --effort {effort} {rest} --json -qf"), 0);
    let cut = told(1, "-o cut.ply")["triangles"].as_u64();
    folder.stdout("build in.ply -q");
    for effort in [2, 3] {
        let further = told(effort, "-o out.ply --threads 1");
        assert!(further["triangles"].as_u64() < cut, "{further} {cut:?}");
        let measured = json(&folder, "measure out.ply in.ply --json -q", 0);
        let limit = 0.01 * number(&measured["diagonal"]) * (1.0 + 1e-6);
        assert!(number(&measured["max"]) <= number(&further["distance"]), "{further} {measured}");
        assert!(number(&further["distance"]) <= limit, "{further}");

        told(effort, "-o same.ply --threads 3");
        assert!(folder.read("out.ply") == folder.read("same.ply"), "{effort}");
        let extracted = triangles(&folder, &format!("extract in.chpm --error 1% --effort {effort}"));
        assert_eq!(Some(extracted), further["triangles"].as_u64(), "{effort}");
        folder.stdout(&format!("{asked} --effort {effort} -o out.ply -qf"));
        for name in ["out.stl", "out.obj", "out.glb"] {
            assert_eq!(told(effort, &format!("-o {name}"))["triangles"], further["triangles"], "{name}");
            assert_eq!(json(&folder, &format!("measure {name} out.ply --json -q"), 0)["max"], 0.0, "{name}");
        }
    }
    for wrong in ["--effort 4", "--effort 1 --tight"] {
        folder.stderr(&format!("{asked} {wrong} -o no.ply"), 2);
    }
}

/// A proof may reach its limit, and is told by the next single: that is never beyond what was asked for.
#[test]
fn what_is_within_a_distance_is_told_to_be() {
    let folder = Folder::new();
    for (shape, shares) in [("sphere", ["7%", "12%"]), ("torus", ["9%", "10%"])] {
        folder.stdout(&format!("synth {shape} --triangles 2000 -o in.ply -qf"));
        for share in shares {
            let simplify = format!("simplify in.ply --within {share} -o out.ply -qf --json");
            let told = json(&folder, &simplify, 0);
            let share: f64 = share.trim_end_matches('%').parse().expect("a number");
            let asked = 0.01 * share * number(&told["diagonal"]);
            assert!((0.9 * asked..=asked).contains(&number(&told["distance"])), "{shape} {share}: {told}");
        }
    }
}

/// A mesh that is stored to be far away, of which the truth is known: a little more is proven, and a little less is not.
#[test]
fn only_what_is_true_is_proven_anew() {
    let folder = Folder::new();
    let gaps = |base| Gaps { fine: 0.0, base, from: 1.0 };
    folder.write("pyramid.chpm", leaf_with(&pyramid(), &[0], &[3.0], gaps(0.0)));
    // A large triangle, and far above it a small one that becomes its corner.
    let mut mesh = hand::strip(1);
    mesh.positions.truncate(3);
    mesh.positions.extend([[0.25, 0.25, 50.0], [1.25, 0.25, 50.0], [0.25, 1.25, 50.0]]);
    mesh.triangles = vec![[0, 1, 2], [3, 4, 5]];
    folder.write("speck.chpm", leaf_with(&mesh, &[3, 3], &[1.0; 2], gaps(60.0)));
    // The farthest corner is beside the large one: 50 up and the square root of an eighth away.
    for (name, error, stored, tight) in [
        ("pyramid", 3.0, 2, 2),
        ("pyramid", 1.001, 4, 2),
        ("pyramid", 0.999, 4, 4),
        ("speck", 60.1, 1, 1),
        ("speck", 50.002, 2, 1),
        ("speck", 50.001, 2, 2),
    ] {
        let words = format!("extract {name}.chpm --error {error}");
        assert_eq!(triangles(&folder, &words), stored, "{words}");
        assert_eq!(triangles(&folder, &format!("{words} --tight")), tight, "{words}");
    }
}
