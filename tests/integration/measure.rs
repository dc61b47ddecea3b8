//! `chpm measure`: known distances between meshes, and stored errors that hold or do not.

use super::harness::{Folder, text};
use chpm_format::{
    BoundaryMode, ChpmWriter, ClusterRecord, ErrorKind, Gaps, GroupRecord, HeaderFields, LevelRecord,
    Metadata, PageParts, Tables,
};
use chpm_mesh::{Attributes, GroupId, Level, TriMesh};
use chpm_synth::hand;
use serde_json::Value;

fn json(folder: &Folder, words: &str, code: i32) -> Value {
    let output = folder.chpm(words).code(code);
    serde_json::from_slice(&output.get_output().stdout).expect("valid JSON")
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
}

#[test]
fn parallel_planes_are_their_distance_apart() {
    let folder = Folder::new();
    let low = hand::grid(4, 4);
    let mut high = low.clone();
    high.positions.iter_mut().for_each(|p| p[2] += 0.25);
    folder.write_mesh("low.ply", &low);
    folder.write_mesh("high.ply", &high);
    let out = json(&folder, "measure low.ply high.ply --json -q", 0);
    for side in ["forward", "backward"] {
        assert_eq!((&out[side]["max"], &out[side]["mean"]), (&0.25.into(), &0.25.into()), "{out}");
        // 25 vertices, 56 edges of 4, 32 triangles of 10.
        assert!(out[side]["samples"].as_u64() >= Some(25 + 56 * 4 + 32 * 10), "{out}");
    }
    assert!((out["rms"].as_f64().unwrap() - 0.25).abs() < 1e-15);
    assert!((out["diagonal"].as_f64().unwrap() - (32.0 + 0.0625f64).sqrt()).abs() < 1e-12, "{out}");
    let told = folder.stdout("measure low.ply high.ply -q");
    assert!(told.contains("0.250") && told.contains("4.4151 %"), "{told}");
    assert!(json(&folder, "measure low.ply low.ply --json -q", 0)["max"] == 0.0);
}

#[test]
fn the_farthest_point_is_named_with_its_side() {
    let folder = Folder::new();
    folder.write_mesh("one.ply", &hand::soup(1));
    folder.write_mesh("two.ply", &hand::soup(2));
    let out = json(&folder, "measure one.ply two.ply --json -q", 0);
    assert_eq!((&out["forward"]["max"], &out["backward"]["max"]), (&0.0.into(), &2.0.into()));
    assert_eq!(numbers(&out["at"]), [3.0, 0.0, 0.0]);
    let told = folder.stdout("measure one.ply two.ply -q");
    assert!(told.contains("the maximum is at 3 0 0, on two.ply"), "{told}");
}

#[test]
fn far_from_zero_nothing_is_lost() {
    let folder = Folder::new();
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    for (name, z) in [("a.ply", "0.125"), ("b.ply", "0.25")] {
        let vertices = format!("10000000 5e6 {z}\n10000000.5 5e6 {z}\n10000000 5000000.5 {z}\n");
        folder.write(name, format!("{header}{vertices}3 0 1 2\n"));
    }
    let out = json(&folder, "measure a.ply b.ply --json -q", 0);
    assert_eq!((&out["max"], &out["mean"]), (&0.125.into(), &0.125.into()));
    assert!(numbers(&out["at"])[0] >= 1e7, "{out}");
}

#[test]
fn threads_and_memory_do_not_show() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 6000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 256");
    folder.stdout("extract in.chpm --triangles 900 -o lod.ply -q");
    for words in ["measure in.ply lod.ply", "measure in.chpm --against in.ply --levels --cuts 2 --samples 2"]
    {
        let result =
            |more: &str| folder.chpm(&format!("{words} --json -q {more}")).get_output().stdout.clone();
        let one = result("--threads 1");
        assert!(one.len() > 100);
        assert!(one == result("--threads 3 --memory 40M"), "{words}");
    }
}

/// A file of one leaf whose collapses have these errors, finest first.
fn leaf(mesh: &TriMesh, targets: &[u16], errors: &[f32]) -> Vec<u8> {
    leaf_with(mesh, targets, errors, Gaps::default())
}

pub(super) fn leaf_with(mesh: &TriMesh, targets: &[u16], errors: &[f32], gaps: Gaps) -> Vec<u8> {
    let triangles: Vec<[u16; 3]> = mesh.triangles.iter().map(|t| t.map(|v| v as u16)).collect();
    let coarse_first: Vec<f32> = errors.iter().rev().copied().collect();
    let mut payload = Vec::new();
    PageParts {
        vertices: mesh.view(),
        triangles: &triangles,
        targets,
        errors: &coarse_first,
        shared: &[],
        min_error: 0.0,
        scale_error: 0.0,
    }
    .encode(&mut payload)
    .expect("a payload");
    let record = ClusterRecord::of_page(&payload, Level(0), GroupId(0), GroupId::NONE).expect("a record");
    let mut tables = Tables {
        header: HeaderFields {
            attributes: Attributes::NONE,
            source_vertex_count: mesh.positions.len() as u64,
            boundary_mode: BoundaryMode::Lock,
            error_kind: ErrorKind::Quadric,
            shared_vertex_count: 0,
            origin: [0.0; 3],
            ..HeaderFields::default()
        },
        groups: vec![GroupRecord {
            coarse_count: 1,
            max_error: record.max_error,
            center: record.center,
            radius: record.radius,
            gaps,
            ..GroupRecord::default()
        }],
        clusters: vec![record],
        members: vec![0],
        levels: vec![LevelRecord::default()],
        scalars: Vec::new(),
        remnants: Vec::new(),
        sheets: Vec::new(),
        metadata: Metadata::default(),
    };
    let mut writer = ChpmWriter::begin(Vec::new(), &mut tables).expect("a head");
    writer.page(&payload).expect("a page written");
    writer.finish().expect("a file")
}

/// A pyramid of height 1 over the square from -2 to 2 whose apex, vertex 4, falls onto a corner.
fn pyramid(error: f32) -> (TriMesh, Vec<u8>) {
    let positions =
        vec![[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0], [0.0, 0.0, 1.0]];
    let mesh = TriMesh::new(positions, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
    let file = leaf(&mesh, &[0], &[error]);
    (mesh, file)
}

#[test]
fn a_stored_error_holds_or_is_a_fault() {
    for (error, code, violating) in [(1.0, 0, 0), (1.5, 0, 0), (0.75, 1, 1)] {
        let folder = Folder::new();
        let (mesh, file) = pyramid(error);
        folder.write_mesh("in.ply", &mesh);
        folder.write("in.chpm", file);
        let out = json(&folder, "measure in.chpm --against in.ply --json -q", code);
        let base = &out["levels"][1];
        assert_eq!((&base["level"], &base["collapsed"]), (&0.into(), &1.0.into()));
        assert_eq!((&base["triangles"], &base["stored_error"]), (&2.into(), &error.into()), "{out}");
        // The apex is 1 above the square, and the square's middle 2 / sqrt(5) below the pyramid's sides.
        assert_eq!(base["of_source"]["max"], 1.0);
        let below = base["of_mesh"]["max"].as_f64().unwrap();
        let deepest = 2.0 / 5f64.sqrt();
        assert!(below <= deepest + 1e-12 && below > 0.98 * deepest, "{below}");
        assert_eq!(base["stored_by_measured"]["median"], f64::from(error));
        assert_eq!(base["violations"]["clusters"], violating);
        assert_eq!((&base["stored_distance"], &base["vanished"]["samples"]), (&error.into(), &0.into()));
        let told = text(&folder.chpm("measure in.chpm --against in.ply -q").code(code).get_output().stdout);
        let fault = "I5 error: level 0, 100 % collapsed";
        assert_eq!(told.contains(fault), code == 1, "{told}");
        assert_eq!(told.contains("at 0 0 1, by a distance of 1.00 units"), code == 1, "{told}");
        assert_eq!(told.contains("every stored distance holds"), code == 0, "{told}");
        // Cuts see the same.
        let out = json(&folder, "measure in.chpm --against in.ply --cuts 8 --seed 3 --json -q", code);
        assert_eq!((out["levels"].as_array().unwrap().len(), out["cuts"].as_array().unwrap().len()), (0, 8));
        assert_eq!(out["violations"].as_u64() > Some(0), code == 1);
    }
}

#[test]
fn what_has_vanished_is_as_far_as_the_gap_at_most() {
    // A large triangle that stays, and far above it a tetrahedron of size 1 that becomes its vertex 3.
    let mut mesh = hand::strip(1);
    mesh.positions.truncate(3);
    mesh.triangles = vec![[0, 1, 2], [3, 4, 5], [3, 5, 6], [3, 6, 4], [4, 6, 5]];
    let corner = [0.25, 0.25, 50.0];
    mesh.positions.push(corner);
    for axis in 0..3 {
        let mut p = corner;
        p[axis] += 1.0;
        mesh.positions.push(p);
    }
    for (base, code) in [(0.0, 1), (50.5, 1), (52.0, 0)] {
        let folder = Folder::new();
        folder.write_mesh("in.ply", &mesh);
        folder.write("in.chpm", leaf_with(&mesh, &[3, 3, 3], &[1.0; 3], Gaps { fine: 0.0, base, from: 1.0 }));
        let out = json(&folder, "measure in.chpm --against in.ply --positions 1 --json -q", code);
        let coarse = &out["levels"][0];
        assert_eq!((&coarse["triangles"], &coarse["stored_error"]), (&1.into(), &1.0.into()), "{out}");
        assert!(coarse["max"].as_f64() >= Some(50.0), "{out}");
        if code == 0 {
            assert_eq!(coarse["stored_distance"], base);
            assert!(coarse["vanished"]["samples"].as_u64() > Some(10), "{out}");
            assert!((50.0..52.0).contains(&coarse["vanished"]["max"].as_f64().unwrap()), "{out}");
        } else {
            assert!(coarse["violations"]["worst"].as_f64() >= Some(50.0), "{out}");
        }
        // Who asks for a distance gets the mesh in which nothing is missing.
        let words = "extract in.chpm --error 2 -qf -o out.ply";
        folder.stdout(words);
        let triangles = folder.read_mesh("out.ply").triangles.len();
        assert_eq!(triangles, if base > 2.0 { 5 } else { 1 });
    }
}

#[test]
fn another_source_is_refused() {
    let folder = Folder::new();
    let (mut mesh, file) = pyramid(1.0);
    mesh.positions[4][2] = 2.0;
    folder.write_mesh("other.ply", &mesh);
    folder.write("in.chpm", file);
    let error = folder.stderr("measure in.chpm --against other.ply -q", 2);
    assert!(error.contains("the leaves of 'in.chpm' are not the triangles of 'other.ply'"), "{error}");
}

#[test]
fn wrong_words_and_meshes_are_refused() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &hand::cube());
    folder.write_mesh("empty.ply", &TriMesh::default());
    for words in [
        "measure in.ply",
        "measure in.ply in.ply --against in.ply",
        "measure in.ply in.ply --levels",
        "measure in.ply in.ply --cuts 2",
        "measure in.ply in.ply --samples 0",
        "measure in.ply missing.ply",
        "measure in.ply empty.ply",
        "measure in.ply --against in.ply",
    ] {
        assert!(folder.stderr(words, 2).contains("error"), "{words}");
    }
}

/// Lower bounds hold for estimates too: a level is no nearer than its own cut, measured as a mesh.
#[test]
fn levels_agree_with_their_meshes() {
    let folder = Folder::new();
    for shape in ["terrain", "torus"] {
        folder.stdout(&format!("synth {shape} --triangles 8000 -o in.ply -qf"));
        folder.stdout("build in.ply -qf --cluster-triangles 128 --boundary dependencies");
        let output = folder.chpm("measure in.chpm --against in.ply --positions 1 --json -q");
        let out: Value = serde_json::from_slice(&output.get_output().stdout).expect("valid JSON");
        let levels = out["levels"].as_array().unwrap();
        assert!(levels.len() >= 4);
        // The base meshes of a level are the finest of the next.
        for (level, found) in levels.iter().enumerate().take(levels.len() - 1) {
            folder.stdout(&format!("extract in.chpm --level {} -o lod.ply -qf", level + 1));
            let whole = json(&folder, "measure in.ply lod.ply --samples 40 --json -q", 0);
            for (side, other) in [("of_source", "forward"), ("of_mesh", "backward")] {
                for value in ["max", "mean", "rms"] {
                    let [a, b] = [&found[side][value], &whole[other][value]].map(|x| x.as_f64().unwrap());
                    // Both sample densely, and not at the same points.
                    assert!((a - b).abs() <= 0.1 * b, "{shape} {level} {side} {value}: {a} {b}");
                }
            }
            assert_eq!(found["triangles"], whole["second"]["triangles"], "{shape} {level}");
        }
    }
}
