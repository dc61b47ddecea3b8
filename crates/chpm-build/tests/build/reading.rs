//! What decides how coordinates are stored, how far they may be from zero, and sources that are no files.

use crate::site::{ChpmFile, Site, check_against, check_leaves, config};
use chpm_build::{BuildError, BuildReport, Cancel, Silent, build};
use chpm_format::{Chpm, verify};
use chpm_import::SourceError;
use chpm_mesh::{FAR, TriMesh};
use chpm_synth::{Shape, Synth, hand};
use std::fs;
use std::path::Path;

/// Builds `text` under `name` with some memory, and checks the file.
fn built(name: &str, text: &[u8], memory: u64) -> (BuildReport, ChpmFile) {
    let dir = tempfile::tempdir().unwrap();
    let (source, output) = (dir.path().join(name), dir.path().join("out.chpm"));
    fs::write(&source, text).unwrap();
    let mut config = config(256);
    config.resources.memory = chpm_mesh::Bytes(memory);
    let report = build(&source, &output, &config, &Silent, &Cancel::default()).unwrap();
    let file = Chpm::open(fs::read(output).unwrap()).unwrap();
    let found = verify(&file, |_, _| ());
    assert!(found.is_ok(), "{name}: {:#?}", found.faults);
    (report, file)
}

fn refused(name: &str, text: &[u8]) -> String {
    let dir = tempfile::tempdir().unwrap();
    let (source, output) = (dir.path().join(name), dir.path().join("out.chpm"));
    fs::write(&source, text).unwrap();
    let error = build(&source, &output, &config(256), &Silent, &Cancel::default()).unwrap_err();
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "{error}");
    error.to_string()
}

fn ply(ty: &str, vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty {ty} x\nproperty {ty} y\nproperty {ty} z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        triangles.len()
    );
    vertices.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
    triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    text.into_bytes()
}

fn obj(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut text = String::new();
    vertices.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
    triangles.iter().for_each(|[a, b, c]| text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    text.into_bytes()
}

fn stl(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut text = "solid\n".to_owned();
    for corners in triangles {
        text += "facet\n";
        for [x, y, z] in corners.map(|v| vertices[v as usize]) {
            text += &format!("vertex {x} {y} {z}\n");
        }
        text += "endfacet\n";
    }
    (text + "endsolid\n").into_bytes()
}

/// A surface of some thousand triangles, as surveyors have them.
fn far_away() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let mesh = Synth::new(Shape::Terrain, 3_000, 1).to_mesh();
    let place = |p: &[f32; 3]| {
        let [x, y, z] = p.map(|x| (f64::from(x) * 1e4).round() / 1e3);
        [500_000.127 + x, 5_234_567.891 + y, z]
    };
    (mesh.positions.iter().map(place).collect(), mesh.triangles)
}

fn rounding(report: &BuildReport) -> f32 {
    report.levels[0].min_error
}

#[test]
fn every_text_is_read_as_double() {
    let (vertices, triangles) = far_away();
    for (name, text) in [
        ("a.ply", ply("double", &vertices, &triangles)),
        ("b.ply", ply("float", &vertices, &triangles)),
        ("c.obj", obj(&vertices, &triangles)),
        ("d.stl", stl(&vertices, &triangles)),
    ] {
        let (report, file) = built(name, &text, 256 << 20);
        assert_eq!(report.triangles, triangles.len() as u64, "{name}");
        assert_eq!(report.repairs.boundary_loops, 1, "{name}");
        assert!((400_000.0..600_000.0).contains(&file.header().origin[0]), "{name}");
        assert!(rounding(&report) > 0.0 && rounding(&report) < 1e-5, "{name}: {}", rounding(&report));
        assert!(report.warnings.iter().any(|w| w.contains("rounded to 24 bits")), "{name}");
    }
}

/// The way from the middle of very different numbers is no double: what that loses counts.
#[test]
fn what_a_difference_of_doubles_loses_is_counted() {
    let (small, far) = (1.234_567_890_12e-9, 3.0 * 2f64.powi(30));
    let vertices = [[small, 0.0, 0.0], [far, 0.0, 0.0], [0.0, far, 0.0], [small, far, small]];
    let (report, file) = built("far.ply", &ply("double", &vertices, &[[0, 1, 2], [1, 3, 2]]), 256 << 20);
    assert_eq!(file.header().origin[0], far / 2.0);
    // What a single holds of it is the middle itself, and the small number is gone.
    assert!(f64::from(rounding(&report)) >= small * 3f64.sqrt(), "{}", rounding(&report));
}

#[test]
fn text_that_says_singles_is_singles() {
    let mesh = Synth::new(Shape::Sphere, 2_000, 0).to_mesh();
    // As short as they are told from other singles, not as doubles of the same value.
    let short = |x: f32| -> f64 { x.to_string().parse().unwrap() };
    let vertices: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.map(short)).collect();
    for (name, text) in [
        ("a.ply", ply("float", &vertices, &mesh.triangles)),
        ("b.ply", ply("double", &vertices, &mesh.triangles)),
        ("c.obj", obj(&vertices, &mesh.triangles)),
        ("d.stl", stl(&vertices, &mesh.triangles)),
    ] {
        let (report, file) = built(name, &text, 256 << 20);
        assert_eq!(file.header().origin, [0.0; 3], "{name}");
        check_against(&file, &mesh);
        // Only a declared type makes them exact.
        assert_eq!(rounding(&report) == 0.0, name == "a.ply", "{name}");
        assert!(rounding(&report) < 1e-6, "{name}");
    }
}

#[test]
fn vertices_that_no_face_uses_decide_nothing() {
    let (vertices, triangles) = far_away();
    let (clean, file) = built("clean.ply", &ply("double", &vertices, &triangles), 256 << 20);
    for stray in [[0.0; 3], [1e9, -1e9, 1e9 + 0.1], [1e300, -1e300, 1e38], [-1e-300, 3e38, 0.1]] {
        for memory in [1 << 16, 256 << 20] {
            let with = [&[stray][..], &vertices, &[stray]].concat();
            let moved: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| v + 1)).collect();
            let (report, same) = built("stray.ply", &ply("double", &with, &moved), memory);
            assert_eq!(same.header().origin, file.header().origin, "{stray:?}");
            assert_eq!(rounding(&report), rounding(&clean), "{stray:?}");
            assert_eq!(report.repairs.unreferenced_vertices, 2);
            assert!(same.header().aabb_min == file.header().aabb_min, "{stray:?}");
        }
    }
    // Faces that come before their vertices say as well which are used.
    let with = [&[[1e300; 3]][..], &vertices].concat();
    let moved: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| v + 1)).collect();
    let text = String::from_utf8(obj(&with, &moved)).unwrap();
    let (corners, faces) = text.split_at(text.find('f').unwrap());
    let (_, same) = built("late.obj", format!("{faces}{corners}").as_bytes(), 256 << 20);
    assert_eq!(same.header().origin, file.header().origin);
    // Two far ones about two triangles: the file that was built was not valid.
    let quad = [[0.1, 0.2, 0.3], [1.1, 0.2, 0.3], [0.1, 1.2, 0.3], [1.1, 1.2, 0.35]];
    let with = [&quad[..], &[[1_000_000_000.1; 3], [-1_000_000_000.1; 3]]].concat();
    built("two.ply", &ply("double", &with, &[[0, 1, 2], [1, 3, 2]]), 256 << 20);
    // Singles, whose bits stay.
    let mut mesh = hand::grid(20, 20);
    let plain = Site::of(&mesh).build(&config(256)).1;
    mesh.positions.push([3e38, -3e38, 3e38]);
    let stray = Site::of(&mesh).build(&config(256)).1;
    assert!(
        plain.header().aabb_min == stray.header().aabb_min
            && plain.header().aabb_max == stray.header().aabb_max
    );
}

fn scaled(mut mesh: TriMesh, scale: f64) -> TriMesh {
    let largest = mesh.positions.as_flattened().iter().fold(0.0f32, |l, x| l.max(x.abs()));
    let scale = scale / f64::from(largest);
    mesh.positions.as_flattened_mut().iter_mut().for_each(|x| *x = (f64::from(*x) * scale) as f32);
    mesh
}

#[test]
fn coordinates_are_accepted_up_to_a_limit_and_refused_beyond() {
    let meshes =
        || [Synth::new(Shape::Terrain, 6_000, 1).to_mesh(), hand::soup(3_000), hand::klein_bottle(30)];
    let limit = f64::from((FAR as f32).next_down());
    for mesh in meshes() {
        let mesh = scaled(mesh, limit);
        let (report, file) = Site::of(&mesh).build(&config(64));
        check_against(&file, &mesh);
        // What is stored stays far from what singles can hold.
        let largest = file.groups().iter().map(|g| g.radius.max(g.max_error)).fold(0.0, f32::max);
        assert!(largest < 1e38 && report.levels.iter().all(|l| l.max_error < 1e38), "{largest:e}");
    }
    for mesh in meshes() {
        let site = Site::of(&scaled(mesh, limit * 1.001));
        let error = site.try_build(&config(64), &Silent, &Cancel::default()).unwrap_err();
        assert!(
            matches!(&error, BuildError::Source(error) if matches!(&**error, SourceError::TooFar { place, .. } if place.offset > 0)),
            "{error}"
        );
        assert!(error.to_string().contains("scale the model down"), "{error}");
        assert_eq!(site.files(), ["mesh.ply"]);
    }
    let vertices = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1e37, 0.0]];
    let text = String::from_utf8(ply("double", &vertices, &[[0, 1, 2]])).unwrap();
    let place = format!("vertex 2, byte {}, line 12", text.find("10000000").unwrap());
    for (name, text, place) in [
        ("a.ply", text.into_bytes(), &place[..]),
        ("a.obj", obj(&vertices, &[[0, 1, 2]]), "line 3"),
        ("a.stl", stl(&vertices, &[[0, 1, 2]]), "facet 0"),
    ] {
        let error = refused(name, &text);
        assert!(error.contains(name) && error.contains(place) && error.contains("1e37"), "{error}");
    }
}

#[test]
fn the_smallest_coordinates_build() {
    let at = |scale| scaled(Synth::new(Shape::Terrain, 4_000, 1).to_mesh(), scale);
    for mesh in [1e-36, 1e-38, 1e-40, 1e-43].map(at) {
        check_against(&Site::of(&mesh).build(&config(512)).1, &mesh);
    }
    // Here all vertices are in four places, so that what is inside and what is boundary is the same.
    let mesh = at(1.5e-45);
    check_leaves(&Site::of(&mesh).build(&config(512)).1, &mesh);
    // Doubles that single precision holds badly are told, with the reason.
    let mesh = Synth::new(Shape::Terrain, 4_000, 1).to_mesh();
    let vertices: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.map(|x| f64::from(x) * 1e-42)).collect();
    let (report, _) = built("tiny.ply", &ply("double", &vertices, &mesh.triangles), 256 << 20);
    let told = report.warnings.iter().find(|w| w.contains("of the diagonal")).expect("a warning");
    assert!(told.contains("scale it up"), "{told}");
    let (report, _) = built(
        "far.ply",
        &ply("double", &[[1e12, 0.0, 0.0], [1e12 + 0.3, 0.0, 0.0], [1e12, 0.1, 0.0]], &[[0, 1, 2]]),
        256 << 20,
    );
    assert!(!report.warnings.iter().any(|w| w.contains("of the diagonal")), "{:?}", report.warnings);
}

#[test]
fn nothing_to_build_is_named() {
    let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    for (name, text) in [
        ("a.ply", ply("float", &corners, &[])),
        ("b.ply", ply("float", &[], &[])),
        ("a.obj", obj(&corners, &[])),
        ("a.stl", stl(&corners, &[])),
        ("b.stl", vec![0; 84]),
    ] {
        let error = refused(name, &text);
        assert!(error.contains(name) && error.contains("no faces"), "{error}");
    }
}

#[test]
fn what_is_wrong_with_a_scan_names_the_list_and_the_scan() {
    let dir = tempfile::tempdir().unwrap();
    let list = dir.path().join("all.conf");
    let good = ply("double", &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]]);
    let far = ply("double", &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1e37, 0.0]], &[[0, 1, 2]]);
    fs::write(dir.path().join("one.ply"), &good).unwrap();
    fs::write(&list, "bmesh one.ply 0 0 0 0 0 0 1\nbmesh two.ply 0 0 0 0 0 0 1\n").unwrap();
    for (bytes, words) in [
        (&good[..good.len() - 4], "the file ends here"),
        (&far, "vertex 2"),
        (b"nothing", "text that is no mesh"),
    ] {
        fs::write(dir.path().join("two.ply"), bytes).unwrap();
        let output = dir.path().join("out.chpm");
        let error = build(&list, &output, &config(64), &Silent, &Cancel::default()).unwrap_err();
        assert!(
            matches!(&error, BuildError::Source(error) if matches!(**error, SourceError::Member { index: 1, .. })),
            "{error}"
        );
        let error = error.to_string();
        assert!(["all.conf", "two.ply", words].iter().all(|word| error.contains(word)), "{error}");
    }
}

#[test]
fn what_is_no_file_is_refused_as_that() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out.chpm");
    for (source, what) in [(dir.path(), "a folder"), (Path::new("/dev/null"), "a terminal or device")] {
        let error = build(source, &output, &config(64), &Silent, &Cancel::default()).unwrap_err();
        assert!(
            matches!(&error, BuildError::Source(error) if matches!(**error, SourceError::NotAFile { what: found, .. } if found == what)),
            "{error}"
        );
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}
