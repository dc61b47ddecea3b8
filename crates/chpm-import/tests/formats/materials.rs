//! What sources say of materials, and images that no material has.

use super::textures::{FACE, PNG, folder, read};
use chpm_import::Images;

#[test]
fn names_of_materials_are_looked_for_with_and_without_comments() {
    let mtl = b"newmtl a # of wood\nmap_Kd a.png\nnewmtl b\nmap_Kd b.png\nnewmtl b #2\nmap_Kd c.png\n";
    let faces = ["a", "a # wood", "a # of wood", "b", "b # brick", "b #2", "b #3"]
        .map(|name| format!("usemtl {name}\nf 1/1 2/2 3/3\n"))
        .concat();
    let obj = format!("mtllib a.mtl\n{FACE}{faces}");
    let files = [("a.mtl", &mtl[..]), ("a.png", PNG), ("b.png", PNG), ("c.png", PNG)];
    let dir = folder(&[&files[..], &[("a.obj", obj.as_bytes())]].concat());
    let read = read(&dir, "a.obj", Images::Required).unwrap();
    let names: Vec<_> = (0..read.textured.len()).filter_map(|at| read.image(at)).collect();
    assert_eq!(names, ["a.png", "a.png", "a.png", "b.png", "b.png", "c.png", "b.png"]);
    assert_eq!(read.info.warnings, Vec::<String>::new());
}

#[test]
fn materials_that_no_library_has_are_told_or_refused() {
    let mtl = b"newmtl a\nmap_Kd a.png\n";
    // One before its library, one of another case, twice, one that no face has, and none at all.
    let obj = format!(
        "usemtl early\n{FACE}f 1/1 2/2 3/3\nusemtl a\nmtllib a.mtl\nf 1/1 2/2 3/3\nusemtl A\nf 1/1 2/2 3/3\nf 1/1 2/2 4/4\nusemtl A\nf 2/2 3/3 4/4\nusemtl bare\nusemtl\nf 1/1 3/3 4/4\n"
    );
    let dir = folder(&[("a.mtl", mtl), ("a.png", PNG), ("a.obj", obj.as_bytes())]);
    let grey = read(&dir, "a.obj", Images::Grey).unwrap();
    assert_eq!((grey.triangles.len(), grey.textured.len()), (6, 1));
    let told =
        |name: &str| format!("material '{name}' was in no library when faces named it, which have no image");
    assert_eq!(grey.info.warnings, [told("A"), told("early")]);
    let refused = read(&dir, "a.obj", Images::Required).expect_err("a material is missing");
    assert!(refused.contains("'A'") && refused.contains("--missing-images grey"), "{refused}");

    // Colours can be lost as images can.
    let dir = folder(&[("a.mtl", b"newmtl a\nKd 1 0 0\n"), ("a.obj", obj.as_bytes())]);
    assert_eq!(read(&dir, "a.obj", Images::Grey).unwrap().info.warnings, [told("A"), told("early")]);
    assert!(read(&dir, "a.obj", Images::Required).expect_err("a material is missing").contains("'A'"));

    // Without either there is nothing to lose.
    let dir = folder(&[("a.mtl", b"newmtl a\nKd 0.5 0.5 0.5\n"), ("a.obj", obj.as_bytes())]);
    let plain = read(&dir, "a.obj", Images::Required).unwrap();
    assert!(!plain.info.warnings.iter().any(|warning| warning.contains("'A'")), "{:?}", plain.info.warnings);
}

#[test]
fn faces_of_a_ply_with_another_image_or_other_coordinates_are_told_or_refused() {
    let ply = |faces: &str| {
        let count = faces.lines().count();
        format!(
            "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face {count}\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n{faces}"
        )
    };
    let good = "3 0 1 2 6 0 0 1 0 0 1 0\n3 0 1 3 0 0\n3 1 2 3 6 0 0 1 0 0 1 -1\n";
    let bad = format!("{good}3 0 2 1 6 0 0 1 0 0 1 1\n3 0 3 1 4 0 0 1 0 0\n");
    let dir =
        folder(&[("a.png", PNG), ("good.ply", ply(good).as_bytes()), ("bad.ply", ply(&bad).as_bytes())]);
    let whole = read(&dir, "good.ply", Images::Required).unwrap();
    assert_eq!((whole.textured.len(), whole.info.warnings.len()), (1, 0), "{:?}", whole.info.warnings);
    let grey = read(&dir, "bad.ply", Images::Grey).unwrap();
    assert_eq!(grey.textured.len(), 1);
    assert!(grey.info.warnings[0].starts_with("2 faces without an image"), "{:?}", grey.info.warnings);
    let refused = read(&dir, "bad.ply", Images::Required).expect_err("an image is missing");
    assert!(refused.starts_with("'") || refused.contains("2 faces without an image"), "{refused}");
    assert!(refused.contains("--missing-images grey"), "{refused}");
}

/// Coordinates before the library go by the rules of all others: comments, lines that go on, and what looks like a statement.
#[test]
fn coordinates_mean_the_same_before_the_library_and_behind_it() {
    let coordinates =
        "vt 0.1 0.1#c\nvt 0.9 \\\n 0.1 # \\\nvt 0.25 \\\n\\\n0.75#vt\ng a \\\nvt 9 9\n# vt \\\nvt 1 1\n";
    let (faces, library) = ("usemtl a\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n", "mtllib a.mtl\n");
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n";
    let dir = folder(&[
        ("a.mtl", b"newmtl a\nmap_Kd a.png\n"),
        ("a.png", PNG),
        ("before.obj", format!("{vertices}{coordinates}{library}{faces}").as_bytes()),
        ("behind.obj", format!("{library}{vertices}{coordinates}{faces}").as_bytes()),
        // A comment that ends in a backslash hides no library.
        ("comment.obj", format!("# a \\\n{library}{vertices}{coordinates}{faces}").as_bytes()),
    ]);
    for name in ["before.obj", "behind.obj", "comment.obj"] {
        let read = read(&dir, name, Images::Required).unwrap();
        let uv: Vec<_> = read.textured.iter().map(|it| it.uv).collect();
        let (a, b, c) = ([0.1, 0.1], [0.9, 0.1], [0.25, 0.75]);
        assert_eq!(uv, [[a, b, c], [a, c, [1.0, 1.0]]], "{name}");
    }
}
