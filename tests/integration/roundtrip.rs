//! What goes in comes out: all of it at level 0, a crack-free part of it elsewhere.

use super::harness::{Folder, triangles};
use chpm_import::ply::{Batch, BatchKind, Encoding, Options, PlyReader, PlyWriter};
use chpm_measure::crack::cracks;
use chpm_mesh::{Attributes, TriMesh, VertexSlices};
use chpm_synth::hand;
use std::fs::File;

#[test]
fn level_0_is_the_source() {
    for shape in ["terrain", "isosurface", "sphere", "torus", "plates"] {
        let folder = Folder::new();
        folder.stdout(&format!("synth {shape} --triangles 12000 -o in.ply -q"));
        folder.stdout("build in.ply -q --cluster-triangles 512");
        folder.stdout("verify in.chpm --against in.ply -q");
        folder.stdout("extract in.chpm --level 0 -o out.ply -q");
        let (source, out) = (folder.read_mesh("in.ply"), folder.read_mesh("out.ply"));
        assert!(triangles(&source) == triangles(&out), "{shape}");
        assert_eq!(source.positions.len(), out.positions.len(), "{shape}: vertices are welded");
    }
}

#[test]
fn difficult_meshes_come_out_whole() {
    let meshes = [
        ("fan", hand::fan(40)),
        ("strip", hand::strip(60)),
        ("bow_tie", hand::bow_tie()),
        ("moebius", hand::moebius(30)),
        ("klein_bottle", hand::klein_bottle(16)),
        ("two_cubes", hand::two_cubes_sharing_an_edge()),
        ("isolated", hand::isolated_vertex()),
        ("duplicates", hand::duplicate_faces()),
        ("winding", hand::mixed_winding()),
        ("soup", hand::soup(300)),
        ("edge_fan", hand::edge_fan(7)),
    ];
    for (name, mesh) in meshes {
        let folder = Folder::new();
        folder.write_mesh("in.ply", &mesh);
        folder.stdout("build in.ply -q --cluster-triangles 16");
        folder.stdout("verify in.chpm --against in.ply -q");
        folder.stdout("extract in.chpm --level 0 -o out.ply -q");
        let mut expected = triangles(&mesh);
        if name == "duplicates" {
            expected.dedup();
        }
        assert!(expected == triangles(&folder.read_mesh("out.ply")), "{name}");
    }
}

#[test]
fn every_selection_is_crack_free_and_keeps_its_promise() {
    for shape in ["terrain", "isosurface", "torus"] {
        let folder = Folder::new();
        folder.stdout(&format!("synth {shape} --triangles 20000 -o in.ply -q"));
        folder.stdout("build in.ply -q --cluster-triangles 512");
        let source = folder.read_mesh("in.ply");
        let mut smaller = source.triangles.len();
        for limit in [15_000, 9_000, 6_000] {
            folder.stdout(&format!("extract in.chpm --triangles {limit} -o out.ply -qf"));
            let lod = folder.read_mesh("out.ply");
            assert!(lod.triangles.len() <= limit && lod.triangles.len() < smaller, "{shape} {limit}");
            assert_eq!(cracks(&lod, &source), [], "{shape} {limit}");
            smaller = lod.triangles.len();
        }
        let info: serde_json::Value =
            serde_json::from_str(&folder.stdout("info in.chpm --json")).expect("JSON");
        let top = format!("--level {}", info["counts"]["levels"].as_u64().expect("levels") - 1);
        for wanted in ["--level 1", "--level 2", &top, "--error 0.002", "--error 1e9"] {
            folder.stdout(&format!("extract in.chpm {wanted} -o out.ply -qf"));
            let lod = folder.read_mesh("out.ply");
            assert!(lod.triangles.len() < source.triangles.len(), "{shape} {wanted}");
            assert_eq!(cracks(&lod, &source), [], "{shape} {wanted}");
        }
        folder.stdout("extract in.chpm --error 0 -o out.ply -qf");
        let exact = folder.read_mesh("out.ply");
        assert_eq!(cracks(&exact, &source), [], "{shape} exact");
    }
}

#[test]
fn fewer_triangles_than_there_are_is_refused() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 6000 -o in.ply -q");
    folder.stdout("build in.ply -q");
    let error = folder.stderr("extract in.chpm --triangles 1 -o out.ply -q", 2);
    assert!(error.contains("ask for at least"), "{error}");
    assert_eq!(folder.names(), ["in.chpm", "in.ply"]);
}

#[test]
fn triangles_that_lie_on_others_are_told() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 30000 -o in.ply -q");
    folder.stdout("build in.ply -q --cluster-triangles 1024");
    let mut all = 0;
    for wanted in ["--level 0", "--triangles 6000", "--triangles 600"] {
        let words = format!("extract in.chpm {wanted} -o out.ply -f");
        let told: serde_json::Value =
            serde_json::from_str(&folder.stdout(&format!("{words} -q --json"))).expect("JSON");
        let mesh = folder.read_mesh("out.ply");
        let mut corners = mesh.triangles.clone();
        corners.iter_mut().for_each(|corners| corners.sort_unstable());
        corners.sort_unstable();
        let found = corners.windows(2).filter(|pair| pair[0] == pair[1]).count() as u64;
        let own = told["coincident"].as_u64().expect("a number");
        // Few of those of two clusters have three vertices that both have.
        assert!(own <= found && 20 * (found - own) <= found, "{wanted}: {own} of {found}");
        assert!(own == found || told["clusters"] != 1, "{wanted}: {own} of {found}");
        let text = folder.stdout(&format!("{words} -q"));
        assert_eq!(text.contains(" of them on others"), own > 0, "{text}");
        all += own;
    }
    assert!(all > 0, "there are some to tell");
}

/// Positions, normals and colours of the vertices, by their bits; ordered.
fn vertices(mesh: &TriMesh) -> Vec<([u32; 3], [u32; 3], [u8; 4])> {
    let bits = |v: &[f32; 3]| v.map(f32::to_bits);
    let all = mesh.positions.iter().zip(&mesh.normals).zip(&mesh.colors);
    let mut all: Vec<_> = all.map(|((p, n), c)| (bits(p), bits(n), *c)).collect();
    all.sort_unstable();
    all
}

#[test]
fn attributes_stay_with_their_vertices() {
    let folder = Folder::new();
    let mut mesh = hand::icosphere(4);
    mesh.normals = mesh.positions.clone();
    mesh.colors = (0..mesh.positions.len() as u32).map(u32::to_le_bytes).collect();
    folder.write_mesh("in.ply", &mesh);
    folder.stdout("build in.ply -q --cluster-triangles 512");
    folder.stdout("extract in.chpm --level 0 -o out.ply -q");
    assert!(vertices(&mesh) == vertices(&folder.read_mesh("out.ply")));

    folder.stdout("build in.ply -q --no-normals --no-colors -o bare.chpm");
    folder.stdout("extract bare.chpm --level 0 -o bare.ply -q");
    let bare = folder.read_mesh("bare.ply");
    assert_eq!(bare.attributes(), Attributes::NONE);
    assert!(triangles(&mesh) == triangles(&bare));
}

#[test]
fn normals_are_computed_where_that_is_asked_for() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &hand::icosphere(4));
    folder.stdout("build in.ply -q --cluster-triangles 256 --normals computed");
    let told = folder.stdout("info in.chpm");
    assert!(told.contains("CHPM 1.3") && told.contains("with computed normals"), "{told}");
    assert!(folder.stdout("info in.chpm --json").contains(r#""normals_from": "computed""#));
    folder.stdout("verify in.chpm --against in.ply -q");
    folder.stdout("relayout in.chpm -o packed.chpm --pages packed -q");
    folder.stdout("verify packed.chpm --same-as in.chpm -q");
    assert!(folder.stdout("dump packed.chpm --pages").contains(" normal ["));
    for arguments in ["in.chpm --level 0", "packed.chpm --level 0", "in.chpm --triangles 1000"] {
        folder.stdout(&format!("extract {arguments} -o out.ply -q --force"));
        let out = folder.read_mesh("out.ply");
        assert_eq!(out.normals.len(), out.positions.len());
        for (position, normal) in out.positions.iter().zip(&out.normals) {
            let along: f32 = position.iter().zip(normal).map(|(p, n)| p * n).sum();
            assert!(along > 0.999, "{position:?} {normal:?}");
        }
    }

    // A source that has normals keeps them, unless something else is asked for.
    for (asked, told) in [
        ("", "with normals"),
        ("--normals source", "with normals"),
        ("--normals computed", "with computed normals"),
        ("--normals none", "positions only"),
        ("--no-normals", "positions only"),
    ] {
        folder.stdout(&format!("build out.ply -o again.chpm -q --force {asked}"));
        let info = folder.stdout("info again.chpm");
        assert!(info.contains(told), "{asked}: {info}");
    }
    let error = folder.stderr("build out.ply -o again.chpm --force --no-normals --normals computed", 2);
    assert!(error.contains("cannot be used with"), "{error}");
}

fn read_doubles(folder: &Folder, name: &str) -> Vec<[f64; 3]> {
    let file = File::open(folder.path(name)).expect("a file");
    let mut reader = PlyReader::new(file, Options::default()).expect("a header");
    let (mut batch, mut positions) = (Batch::default(), Vec::new());
    while reader.next_batch(&mut batch).expect("a batch") != BatchKind::End {
        positions.append(&mut batch.positions_f64);
    }
    positions
}

#[test]
fn doubles_far_from_the_zero_point_keep_their_detail() {
    const FAR: [f64; 3] = [4_500_000.123, -5_200_000.456, 300.789];
    let folder = Folder::new();
    let mesh = hand::icosphere(4);
    let far = |p: &[f32; 3]| -> [f64; 3] { std::array::from_fn(|axis| FAR[axis] + f64::from(p[axis])) };
    let positions: Vec<[f64; 3]> = mesh.positions.iter().map(far).collect();
    let file = File::create(folder.path("in.ply")).expect("a file");
    let (vertices, triangles) = (positions.len() as u64, mesh.triangles.len() as u64);
    let mut ply = PlyWriter::new(file, Encoding::Ascii, vertices, triangles, Attributes::NONE, true, &[])
        .expect("a header");
    ply.vertices_f64(&positions, VertexSlices::default()).expect("vertices");
    ply.triangles(&mesh.triangles).expect("triangles");
    ply.finish().expect("an end");

    folder.stdout("build in.ply -q --cluster-triangles 512");
    folder.stdout("verify in.chpm --against in.ply -q");
    folder.stdout("extract in.chpm --level 0 -o out.ply -q");
    let mut out = read_doubles(&folder, "out.ply");
    let mut expected = positions;
    assert_eq!(out.len(), expected.len());
    // No two vertices of the icosphere are as near in x, y and z as the tolerance, so rounding keeps this order.
    let key = |p: &[f64; 3]| p.map(|x| (x * 1e4).round() as i64);
    out.sort_by_key(key);
    expected.sort_by_key(key);
    for (a, b) in out.iter().zip(&expected) {
        for axis in 0..3 {
            assert!((a[axis] - b[axis]).abs() <= 1.2e-7, "{a:?} {b:?}");
        }
    }
}
