//! Dust above a surface: it costs what it is worth, and what is said of it is proven.

use super::harness::{Folder, text};
use chpm_format::{Chpm, ChpmWriter, Remnant, Tables};
use chpm_mesh::{Aabb, ClusterId, TriMesh};
use chpm_synth::{Shape, Synth, hand};
use serde_json::Value;

const SPECKS: usize = 64;

/// A terrain, and above it specks of a thousandth of its size, farther and farther away.
fn dusty(specks: usize) -> TriMesh {
    with_specks(specks, 0.001)
}

/// The same with specks of any share of its size.
fn with_specks(specks: usize, share: f32) -> TriMesh {
    let mut mesh = Synth::new(Shape::Terrain, 20_000, 1).to_mesh();
    let bounds = Aabb::of_points(&mesh.positions);
    let size = bounds.diagonal() as f32;
    for i in 0..specks {
        let first = mesh.positions.len() as u32;
        let along = |axis: usize, step: usize| {
            bounds.min[axis] + (bounds.max[axis] - bounds.min[axis]) * (step as f32 + 0.5) / 8.0
        };
        let place = [along(0, i % 8), along(1, i / 8), bounds.max[2] + 0.01 * size * (1 + i % 20) as f32];
        let speck = hand::tetrahedron();
        let corner = |p: &[f32; 3]| std::array::from_fn(|axis| place[axis] + share * size * p[axis]);
        mesh.positions.extend(speck.positions.iter().map(corner));
        mesh.triangles.extend(speck.triangles.iter().map(|t| t.map(|v| first + v)));
    }
    mesh
}

fn folder() -> Folder {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &dusty(SPECKS));
    folder.stdout("build in.ply -q");
    folder
}

fn json(folder: &Folder, words: &str, code: i32) -> Value {
    serde_json::from_slice(&folder.chpm(words).code(code).get_output().stdout).expect("valid JSON")
}

/// Triangles of the mesh within a distance, of a file or a source.
fn triangles(folder: &Folder, words: &str) -> u64 {
    json(folder, &format!("{words} -o out.ply -fq --json"), 0)["triangles"].as_u64().expect("a number")
}

/// Where a speck vanishes among the leaves, the root's errors are found anew as if it had never been, beside meshes in which it is missing.
#[test]
fn bounds_are_tight_beside_dust_that_vanished_early() {
    let folder = Folder::new();
    folder.write_mesh("none.ply", &with_specks(0, 0.0));
    folder.write_mesh("one.ply", &with_specks(1, 1e-6));
    folder.stdout("build none.ply -q");
    folder.stdout("build one.ply -q");
    folder.stdout("build one.ply -q -o quick.chpm --bounds quick");
    let [none, one, quick] =
        ["none", "one", "quick"].map(|name| triangles(&folder, &format!("extract {name}.chpm --error 1%")));
    assert!(one <= none * 11 / 10 && 10 * one < 9 * quick, "{none}, {one}, {quick}");
    assert_eq!(json(&folder, "info one.chpm --json", 0)["remnants"], 1);
    folder.stdout("verify one.chpm --against one.ply --errors --cuts 6 -q");
}

#[test]
fn dust_makes_no_plateau() {
    let folder = folder();
    // With one speck, as errors of roots are found anew where nothing vanishes at all.
    folder.write_mesh("one.ply", &dusty(1));
    folder.stdout("build one.ply -q");
    for share in ["1%", "2%", "4%", "8%"] {
        let [one, dusty] =
            ["one", "in"].map(|name| triangles(&folder, &format!("extract {name}.chpm --error {share}")));
        assert!(dusty <= one * 13 / 10 + SPECKS as u64, "{share}: {dusty} triangles, {one} with one speck");
        let at_once = triangles(&folder, &format!("simplify in.ply --within {share} --effort 0"));
        assert_eq!(at_once, dusty);
        let proven = triangles(&folder, &format!("extract in.chpm --error {share} --tight"));
        assert!(proven <= dusty && (share == "8%" || proven > 20), "{share}: {proven} of {dusty}");
    }
    assert_eq!(json(&folder, "info in.chpm --json", 0)["remnants"], SPECKS);
    assert_eq!(json(&folder, "info one.chpm --json", 0)["remnants"], 1);
    assert!(folder.stdout("info in.chpm").contains("64 pieces vanish"));
    // They follow their clusters, and are the same for any memory and threads.
    folder.stdout("relayout in.chpm --pages packed --order levels -o packed.chpm");
    folder.stdout("verify packed.chpm --same-as in.chpm -q");
    let words = |name: &str| format!("extract {name}.chpm --error 4%");
    assert_eq!(triangles(&folder, &words("packed")), triangles(&folder, &words("in")));
    folder.stdout("build in.ply -q -o again.chpm --threads 1 --memory 128M");
    assert!(folder.read("again.chpm") == folder.read("in.chpm"));
    // Where ends are cut off there are none, and gaps tell as much as before.
    folder.stdout("build in.ply -q -o cut.chpm --finest-error 0.1%");
    assert_eq!(json(&folder, "info cut.chpm --json", 0)["remnants"], 0);
    folder.stdout("verify cut.chpm -q");
}

/// The file with its remnants changed, and all checksums right.
fn with(folder: &Folder, change: impl Fn(&mut Remnant)) -> Vec<u8> {
    let file = Chpm::open(folder.read("in.chpm")).expect("a file");
    let mut tables = Tables::of(&file).expect("tables");
    tables.remnants.iter_mut().for_each(change);
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).expect("a head");
    let pages = (0..file.header().cluster_count).map(ClusterId);
    pages.for_each(|id| writer.page(file.page_bytes(id)).expect("a page"));
    writer.finish().expect("a file")
}

#[test]
fn what_remnants_say_is_proven_or_refuted() {
    let folder = folder();
    let words = "verify in.chpm --against in.ply --errors --level 1 -q";
    let told = json(&folder, &format!("{words} --json"), 0);
    assert_eq!(
        (&told["errors"]["violations"], &told["errors"]["undecided"]),
        (&0.into(), &0.into()),
        "{told}"
    );
    let row = &told["errors"]["within"][0];
    assert!(row["stored_distance"].as_f64() <= row["within"].as_f64(), "{told}");
    assert!(folder.stdout(words).contains("cut within"));

    // Balls that lie on the surface hide what is missing.
    let good = folder.read("in.chpm");
    folder.write("in.chpm", with(&folder, |remnant| remnant.center[2] = 0.0));
    let told = json(&folder, &format!("{words} --json"), 1);
    assert!(told["errors"]["within"][0]["of_source"]["violations"].as_u64() > Some(0), "{told}");
    folder.write("in.chpm", &good);

    // What the file alone can show.
    folder.write("in.chpm", with(&folder, |remnant| remnant.bound = 1.0));
    let told = text(&folder.chpm("verify in.chpm -q").code(1).get_output().stdout);
    assert!(told.contains("I6 nesting") && told.contains("a remnant within the error"), "{told}");
    folder.write("in.chpm", with(&folder, |remnant| remnant.corners.swap(1, 2)));
    let told = text(&folder.chpm("verify in.chpm -q").code(1).get_output().stdout);
    assert!(told.contains("I8 vertices") && told.contains("a remnant of the corners"), "{told}");
}

/// Nothing but dust, more of it in a leaf than is kept apart: what is asked for is there all the same.
#[test]
fn a_mesh_of_dust_is_within_what_is_asked() {
    let folder = Folder::new();
    folder.stdout("synth odd:tetrahedra --triangles 3000 -o in.ply -q");
    folder.stdout("build in.ply -q");
    for share in [0.0, 0.1, 1.0, 20.0] {
        let told = json(&folder, &format!("extract in.chpm --error {share}% -o out.ply -fq --json"), 0);
        assert!(told["warnings"].as_array().expect("a list").is_empty(), "{told}");
        let told = json(&folder, "measure in.ply out.ply --json -q", 0);
        let (max, diagonal) = (told["max"].as_f64().unwrap(), told["diagonal"].as_f64().unwrap());
        assert!(max <= 0.01 * share * diagonal * (1.0 + 1e-6), "{share}: {told}");
    }
    let simplified = triangles(&folder, "simplify in.ply --within 0.1%");
    assert!((1..=3000).contains(&simplified), "{simplified}");
}
