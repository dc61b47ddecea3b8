//! `verify --against` reads sources by itself: what a build lost is missed, whatever the format.

use super::harness::{Folder, text};
use chpm_mesh::TriMesh;
use chpm_synth::hand;

const FAR: [f64; 3] = [435_112.25, 5_411_907.5, 311.0];

/// A bumpy square of `side` by `side` cells of 2 mm, in doubles, far from the zero point.
fn far(side: usize) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let at = |i: usize, j: usize| {
        let z = ((i / 2 + j / 3) % 7) as f64 * 1e-4;
        [FAR[0] + i as f64 * 0.002, FAR[1] + j as f64 * 0.002, FAR[2] + z]
    };
    let points = (0..=side).flat_map(|i| (0..=side).map(move |j| at(i, j))).collect();
    let corner = |i: usize, j: usize| (i * (side + 1) + j) as u32;
    let cell = |i, j| {
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let triangles = (0..side).flat_map(|i| (0..side).flat_map(move |j| cell(i, j))).collect();
    (points, triangles)
}

fn stl(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> String {
    let vertex = |v: &u32| {
        let [x, y, z] = points[*v as usize];
        format!("vertex {x} {y} {z}\n")
    };
    let facet = |t: &[u32; 3]| {
        format!("facet\nouter loop\n{}endloop\nendfacet\n", t.iter().map(vertex).collect::<String>())
    };
    format!("solid\n{}endsolid\n", triangles.iter().map(facet).collect::<String>())
}

fn obj(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> String {
    let vertices = points.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let faces = triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    vertices.chain(faces).collect()
}

fn ply(points: &[[f64; 3]], triangles: &[[u32; 3]], of: &str) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty {of} x\nproperty {of} y\nproperty {of} z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        points.len(),
        triangles.len()
    );
    points.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
    triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    text
}

/// Text has no precision of its own: whatever the format, every triangle of a survey in metres is there.
#[test]
fn text_far_from_the_zero_point_comes_out_whole() {
    let folder = Folder::new();
    let (points, triangles) = far(30);
    folder.write("far.stl", stl(&points, &triangles));
    folder.write("far.obj", obj(&points, &triangles));
    folder.write("far.ply", ply(&points, &triangles, "double"));
    for name in ["far.stl", "far.obj", "far.ply"] {
        folder.stdout(&format!("build {name} -o out.chpm -q -f"));
        for other in ["far.stl", "far.obj", "far.ply"] {
            let told = folder.stdout(&format!("verify out.chpm --against {other} -q"));
            assert!(told.contains("the leaves are the 1,800 triangles"), "{name}, {other}: {told}");
        }
    }
}

/// Vertices that single precision made equal take triangles with them; the file that is left is sound, and not the source.
#[test]
fn triangles_that_a_build_lost_are_named() {
    let folder = Folder::new();
    let (points, triangles) = far(30);
    let single: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| f64::from(x as f32))).collect();
    // Joined by position, as an STL is.
    folder.write("lost.stl", stl(&single, &triangles));
    folder.stdout("build lost.stl -o out.chpm -q");
    folder.stdout("verify out.chpm --against lost.stl -q");
    folder.write("far.stl", stl(&points, &triangles));
    folder.write("far.obj", obj(&points, &triangles));
    folder.write("far.ply", ply(&points, &triangles, "double"));
    for name in ["far.stl", "far.obj", "far.ply"] {
        let told =
            text(&folder.chpm(&format!("verify out.chpm --against {name} -q")).code(1).get_output().stdout);
        assert!(told.contains("of the source is in no leaf"), "{name}: {told}");
    }
}

/// One triangle, of any format, is enough.
#[test]
fn one_triangle_is_missed() {
    let folder = Folder::new();
    let (points, triangles) = far(12);
    folder.write("short.ply", ply(&points, &triangles[1..], "double"));
    folder.stdout("build short.ply -q");
    for (name, whole) in [
        ("far.stl", stl(&points, &triangles)),
        ("far.obj", obj(&points, &triangles)),
        ("far.ply", ply(&points, &triangles, "double")),
    ] {
        folder.write(name, whole);
        let out = folder.chpm(&format!("verify short.chpm --against {name} -q")).code(1);
        let told = text(&out.get_output().stdout);
        assert!(
            told.contains("triangle 0 of the source is in no leaf") && told.contains("1 fault"),
            "{name}: {told}"
        );
    }
}

/// What a build leaves out is counted in the file, and counted again in the source.
#[test]
fn faces_that_were_left_out_are_counted_alike() {
    let folder = Folder::new();
    let (points, mut triangles) = far(12);
    triangles.extend([[0, 0, 1], [5, 6, 5]]);
    folder.write("two.ply", ply(&points, &triangles, "double"));
    folder.stdout("build two.ply -q");
    folder.stdout("verify two.chpm --against two.ply -q");
    triangles.push([7, 7, 7]);
    folder.write("three.ply", ply(&points, &triangles, "double"));
    let told = text(&folder.chpm("verify two.chpm --against three.ply -q").code(1).get_output().stdout);
    assert!(told.contains("the file counts 2 degenerate-faces, and the source has 3"), "{told}");
}

/// A file whose errors leave the rounding of its source out says something that is not so.
#[test]
fn rounding_that_no_error_tells_is_a_fault() {
    let folder = Folder::new();
    let ball: TriMesh = hand::icosphere(3);
    // Doubles that are singles, and the same ones a bit less than half a step away.
    let single: Vec<[f64; 3]> = ball.positions.iter().map(|p| p.map(f64::from)).collect();
    let between = |x: f64| x * (1.0 + 0.49 * f64::from(f32::EPSILON) / 2.0);
    let double: Vec<[f64; 3]> = single.iter().map(|p| p.map(between)).collect();
    folder.write("single.ply", ply(&single, &ball.triangles, "double"));
    folder.write("double.ply", ply(&double, &ball.triangles, "double"));
    folder.stdout("build single.ply -q");
    folder.stdout("verify single.chpm --against single.ply -q");
    let told = text(&folder.chpm("verify single.chpm --against double.ply -q").code(1).get_output().stdout);
    assert!(told.contains("rounding moved a coordinate") && told.contains("1 fault"), "{told}");
}

/// Whoever builds looks at the first word alone there.
#[test]
fn what_follows_the_end_of_a_header_is_passed_over() {
    let folder = Folder::new();
    folder.write_mesh("in.ply", &hand::cube());
    let bytes = folder.read("in.ply");
    let end = b"end_header".as_slice();
    let at = bytes.windows(end.len()).position(|window| window == end).expect("an end") + end.len();
    let odd = [&bytes[..at], b"\r\0 and more", &bytes[at..]].concat();
    folder.write("odd.ply", &odd);
    folder.stdout("build odd.ply -q");
    folder.stdout("verify odd.chpm --against odd.ply -q");
}

/// What a build was told to leave out is not looked at, damaged or not.
#[test]
fn damage_in_normals_that_are_left_out_is_passed_over() {
    let folder = Folder::new();
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
        property float ny\nproperty float nz\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let body = [b"0 0 0 0 0 1\n1 0 0 0 \xff\xfe 1\n0 1 0 0 0 1\n3 0 1 2\n".as_slice()].concat();
    folder.write("in.ply", [header.as_bytes(), &body].concat());
    assert!(folder.stderr("build in.ply -q", 2).contains("in.ply"));
    folder.stdout("build in.ply -q --no-normals");
    folder.stdout("verify in.chpm --against in.ply -q");
}

/// Of a corner in an OBJ only the number of its vertex matters here, whatever bytes follow it.
#[test]
fn what_is_behind_the_slash_of_a_corner_is_passed_over() {
    let folder = Folder::new();
    let (points, triangles) = far(10);
    let text = obj(&points, &triangles);
    let mut bytes = text.replacen("f 1 ", "f 1/@ ", 1).into_bytes();
    let at = bytes.iter().position(|byte| *byte == b'@').expect("a corner with a slash");
    bytes[at] = 0x80;
    folder.write("odd.obj", bytes);
    folder.stdout("build odd.obj --no-normals -q");
    folder.stdout("verify odd.chpm --against odd.obj -q");
}
