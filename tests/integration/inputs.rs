//! One mesh in every format that is read: the same triangles come out.

use super::harness::{Folder, text, triangles};
use chpm_mesh::TriMesh;
use flate2::Compression;
use flate2::write::GzEncoder;
use nalgebra::Vector3;
use std::fs;
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::process::Stdio;

/// A sphere of a few clusters as `ball.ply`, and itself.
fn ball() -> (Folder, TriMesh) {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 6000 -o ball.ply -q");
    let mesh = folder.read_mesh("ball.ply");
    (folder, mesh)
}

const BUILD: &str = "-q -f --cluster-triangles 512";

/// Builds `name`, verifies it against itself, and answers its triangles.
fn through(folder: &Folder, name: &str) -> TriMesh {
    folder.stdout(&format!("build {name} -o out.chpm {BUILD}"));
    folder.stdout(&format!("verify out.chpm --against {name} -q"));
    folder.stdout("extract out.chpm --level 0 -o out.ply -q -f");
    folder.read_mesh("out.ply")
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).expect("compressed");
    encoder.finish().expect("compressed")
}

#[test]
fn a_gzip_stream_with_a_wrong_checksum_is_to_be_copied_again() {
    let (folder, _) = ball();
    let whole = gzip(&folder.read("ball.ply"));
    let flipped = |at: usize| {
        let mut damaged = whole.clone();
        damaged[at] ^= 1;
        damaged
    };
    let behind = [&whole[..], b"notes on the ball"].concat();
    // The checksum, the length, and what is none.
    for (damaged, told) in
        [(flipped(whole.len() - 8), "checksum"), (flipped(whole.len() - 4), "checksum"), (behind, "follows")]
    {
        folder.write("bad.ply.gz", damaged);
        let error = folder.stderr("build bad.ply.gz -o bad.chpm -q", 2);
        assert!(error.contains(told) && error.contains("copy the file again"), "{told}: {error}");
    }
}

fn zstd(bytes: &[u8]) -> Vec<u8> {
    zstd::stream::encode_all(bytes, 1).expect("compressed")
}

fn stl(mesh: &TriMesh) -> Vec<u8> {
    let mut bytes = b"solid but binary".to_vec();
    bytes.resize(80, b' ');
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for corners in &mesh.triangles {
        bytes.extend([0; 12]);
        bytes.extend(mesh.corners(*corners).as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn stl_text(mesh: &TriMesh) -> String {
    let mut text = "solid ball\n".to_owned();
    for corners in &mesh.triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        mesh.corners(*corners).iter().for_each(|[x, y, z]| text += &format!("vertex {x} {y} {z}\n"));
        text += "endloop\nendfacet\n";
    }
    text + "endsolid\n"
}

fn obj(mesh: &TriMesh) -> String {
    let exact = |x: f32| f64::from(x);
    let vertices =
        mesh.positions.iter().map(|[x, y, z]| format!("v {:?} {:?} {:?}\n", exact(*x), exact(*y), exact(*z)));
    let faces = mesh.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    vertices.chain(faces).collect()
}

#[test]
fn compressed_files_give_the_bytes_of_plain_ones_but_for_the_provenance() {
    let (folder, mesh) = ball();
    let plain = folder.read("ball.ply");
    // Several members, or frames, are one stream.
    let half = plain.len() / 2;
    for (name, bytes) in [
        ("one.gz", gzip(&plain)),
        ("two.gz", [gzip(&plain[..half]), gzip(&plain[half..])].concat()),
        ("one.ply.zst", zstd(&plain)),
        ("two.dat", [zstd(&plain[..half]), zstd(&plain[half..])].concat()),
    ] {
        folder.write(name, bytes);
        assert_eq!(triangles(&through(&folder, name)), triangles(&mesh), "{name}");
    }
}

#[test]
fn damaged_compression_is_an_error_that_leaves_nothing() {
    let (folder, mesh) = ball();
    let plain = folder.read("ball.ply");
    // An OBJ is read to its end, and sees what is there.
    folder.write("tail.obj.gz", [gzip(obj(&mesh).as_bytes()), b"notes on the ball".to_vec()].concat());
    let error = folder.stderr("build tail.obj.gz -q", 2);
    assert!(error.contains("tail.obj.gz") && error.contains("the gzip data ends"), "{error}");
    fs::remove_file(folder.path("tail.obj.gz")).expect("the file");
    for (name, whole) in [("bad.ply.gz", gzip(&plain)), ("bad.ply.zst", zstd(&plain))] {
        let mut flipped = whole.clone();
        let middle = whole.len() / 2;
        flipped[middle] ^= 0x55;
        for bytes in [&whole[..whole.len() - 9], &whole[..middle], &whole[..6], &flipped[..]] {
            folder.write(name, bytes);
            let error = folder.stderr(&format!("build {name} -q"), 2);
            assert!(error.contains(name), "{error}");
        }
    }
    assert_eq!(folder.names(), ["bad.ply.gz", "bad.ply.zst", "ball.ply"]);
}

/// A stream that asks for more memory to unpack than it may have is refused, with the remedy; with more memory it is read.
#[test]
fn a_window_of_zstd_keeps_to_the_memory() {
    let (folder, _) = ball();
    let mut encoder = zstd::Encoder::new(Vec::new(), 3).expect("an encoder");
    // Where the length is known, a window is never larger.
    encoder.window_log(26).expect("a window");
    encoder.write_all(&folder.read("ball.ply")).expect("compressed");
    folder.write("wide.ply.zst", encoder.finish().expect("compressed"));
    let refused = folder.stderr("build wide.ply.zst -o out.chpm -q -f --memory 128M", 2);
    assert!(refused.contains("--memory"), "{refused}");
    assert!(!folder.path("out.chpm").exists());
    folder.stdout("build wide.ply.zst -o out.chpm -q -f --memory 512M");
}

#[test]
fn a_bomb_of_zeros_is_refused_before_it_goes_off() {
    let folder = Folder::new();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n\
                  property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let mut encoder = GzEncoder::new(header.as_bytes().to_vec(), Compression::best());
    encoder.write_all(header.as_bytes()).expect("compressed");
    encoder.write_all(&vec![0; 64 << 20]).expect("compressed");
    let bytes = encoder.finish().expect("compressed");
    // The header in front is no part of the compressed stream.
    folder.write("bomb.ply.gz", &bytes[header.len()..]);
    let error = folder.stderr("build bomb.ply.gz -q --memory 128M", 2);
    assert!(error.contains("the file ends here"), "{error}");
    assert_eq!(folder.names(), ["bomb.ply.gz"]);
}

#[test]
fn stl_is_welded_to_the_mesh_that_it_was_made_of() {
    let (folder, mesh) = ball();
    folder.write("ball.stl", stl(&mesh));
    folder.write("text.stl", stl_text(&mesh));
    // Neither needs its extension to be known.
    folder.write("binary", stl(&mesh));
    for name in ["ball.stl", "text.stl", "binary"] {
        let out = through(&folder, name);
        assert_eq!(triangles(&out), triangles(&mesh), "{name}");
        assert_eq!(out.positions.len(), mesh.positions.len(), "{name}");
    }
    let report = folder.stdout("info out.chpm --settings");
    assert!(!report.contains("boundary edges"), "{report}");
}

#[test]
fn welding_does_not_show_the_budget() {
    let (folder, mesh) = ball();
    let large: TriMesh = {
        folder.stdout("synth isosurface --triangles 60000 -o iso.ply -q");
        folder.read_mesh("iso.ply")
    };
    assert!(large.triangles.len() > mesh.triangles.len());
    folder.write("iso.stl", stl(&large));
    folder.stdout("build iso.stl -o a.chpm -q --memory 1G --threads 1");
    folder.stdout("build iso.stl -o b.chpm -q --memory 128M --threads 2");
    assert_eq!(folder.read("a.chpm"), folder.read("b.chpm"));
}

#[test]
fn zeros_of_both_signs_are_one_place() {
    let folder = Folder::new();
    let facet = |z: [&str; 2]| {
        format!(
            "facet\nvertex 0 0 {}\nvertex 1 0 {}\nvertex 0 1 0\nendfacet\nfacet\nvertex 1 0 {}\nvertex 1 1 0\nvertex 0 1 0\nendfacet\n",
            z[0], z[1], z[0]
        )
    };
    folder.write("a.stl", format!("solid\n{}endsolid\n", facet(["0", "-0.0"])));
    folder.stdout("build a.stl -q");
    let out = folder.stdout("info a.chpm --settings");
    assert!(out.contains("boundary edges"), "{out}");
    folder.stdout("extract a.chpm --level 0 -o out.ply -q");
    assert_eq!(folder.read_mesh("out.ply").positions.len(), 4);
}

#[test]
fn obj_keeps_its_triangles() {
    let (folder, mesh) = ball();
    folder.write("ball.obj", obj(&mesh));
    folder.write("ball.obj.gz", gzip(obj(&mesh).as_bytes()));
    for name in ["ball.obj", "ball.obj.gz"] {
        assert_eq!(triangles(&through(&folder, name)), triangles(&mesh), "{name}");
    }
    folder.write("bad.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
    let error = folder.stderr("build bad.obj -q", 2);
    assert!(error.contains("bad.obj") && error.contains("line 4") && error.contains("index 4"), "{error}");
}

/// Walls about an L, with its floor and its lid as one polygon each: of 12 sides, some of which lie in one line.
fn bracket() -> (Vec<[f64; 3]>, Vec<Vec<usize>>) {
    let outline =
        [[0, 0], [1, 0], [2, 0], [4, 0], [4, 1], [3, 1], [1, 1], [1, 2], [1, 4], [0, 4], [0, 2], [0, 1]];
    let n = outline.len();
    let points = (0..2).flat_map(|z| outline.map(|[x, y]| [x, y, z].map(f64::from))).collect();
    let walls = (0..n).map(|i| vec![i, (i + 1) % n, n + (i + 1) % n, n + i]);
    let faces = walls.chain([(0..n).rev().collect(), (n..2 * n).collect()]).collect();
    (points, faces)
}

/// Its polygons are tiled, so that the surface is as large as it should be, without a hole and without a fold: the volume is
/// right and each edge has two triangles.
#[test]
fn concave_polygons_are_tiled_in_every_format() {
    let folder = Folder::new();
    let (points, faces) = bracket();
    let vertices: String = points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let lists: String = faces
        .iter()
        .map(|face| face.iter().fold(face.len().to_string(), |text, v| text + &format!(" {v}")) + "\n")
        .collect();
    let ply = |first_faces: bool| {
        let of_vertices = format!(
            "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n",
            points.len()
        );
        let of_faces = format!("element face {}\nproperty list uchar int vertex_indices\n", faces.len());
        let (head, body) = match first_faces {
            true => (of_faces + &of_vertices, lists.clone() + &vertices),
            false => (of_vertices + &of_faces, vertices.clone() + &lists),
        };
        format!("ply\nformat ascii 1.0\n{head}end_header\n{body}")
    };
    folder.write("bracket.ply", ply(false));
    folder.write("early.ply", ply(true));
    let line =
        |face: &Vec<usize>| face.iter().fold("f".to_owned(), |text, v| text + &format!(" {}", v + 1)) + "\n";
    let of_points = |(prefix, points): (&str, &[[f64; 3]])| -> String {
        points.iter().map(|[x, y, z]| format!("{prefix} {x} {y} {z}\n")).collect()
    };
    folder.write("bracket.obj", of_points(("v", &points)) + &faces.iter().map(line).collect::<String>());
    let facet = |face: &Vec<usize>| {
        let corners: Vec<[f64; 3]> = face.iter().map(|v| points[*v]).collect();
        format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", of_points(("vertex", &corners)))
    };
    folder.write("bracket.stl", format!("solid\n{}endsolid\n", faces.iter().map(facet).collect::<String>()));
    folder.write("list.conf", "bmesh bracket.ply 1 2 3 0.5 0.5 0.5 0.5\n");
    let triangle_count: usize = faces.iter().map(|face| face.len() - 2).sum();
    for name in ["bracket.ply", "early.ply", "bracket.obj", "bracket.stl", "list.conf"] {
        let mesh = through(&folder, name);
        assert_eq!(mesh.triangles.len(), triangle_count, "{name}");
        let (mut volume, mut area, mut sides) = (0.0, 0.0, Vec::new());
        for t in &mesh.triangles {
            let [a, b, c] = mesh.corners(*t).map(|p| Vector3::from(p.map(f64::from)));
            let cross = (b - a).cross(&(c - a));
            (volume, area) = (volume + a.dot(&cross) / 6.0, area + 0.5 * cross.norm());
            let key = |p: Vector3<f64>| <[u64; 3]>::from(p.map(|x| (x + 0.0).to_bits()));
            sides.extend([[a, b], [b, c], [c, a]].map(|side| side.map(key)));
        }
        assert!((volume - 7.0).abs() < 1e-4, "{name}: {volume}");
        assert!((area - 30.0).abs() < 1e-4, "{name}: {area}");
        sides.sort_unstable();
        assert!(sides.iter().all(|[a, b]| sides.binary_search(&[*b, *a]).is_ok()), "{name}");
    }
}

#[test]
fn normals_of_an_obj_are_carried_if_each_vertex_has_one() {
    let (folder, mesh) = ball();
    let normals: String = mesh.positions.iter().rev().map(|[x, y, z]| format!("vn {x} {y} {z}\n")).collect();
    let vertices: String = mesh.positions.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let count = mesh.positions.len();
    // The last normal is the first vertex's. Every other corner counts from the end.
    let corner = |v: &u32| match v % 2 {
        0 => format!(" {}//{}", v + 1, count - *v as usize),
        _ => format!(" {}//-{}", v + 1, v + 1),
    };
    let faces: Vec<String> = mesh
        .triangles
        .iter()
        .map(|t| "f".to_owned() + &t.iter().map(corner).collect::<String>() + "\n")
        .collect();
    let unused = "v 9 9 9\n";
    let whole = format!("{vertices}{unused}{normals}{}", faces.concat());
    // The same value under another number is the same normal.
    let [x, y, z] = mesh.positions[mesh.triangles[0][0] as usize];
    let [a, b, c] = mesh.triangles[0].map(|v| v + 1);
    let again = format!(
        "{whole}vn {x} {y} {z}\nf {a}//-1 {c}//{} {b}//{}\n",
        count + 1 - c as usize,
        count + 1 - b as usize
    );
    let several = format!(
        "{whole}vn 1 1 1\nf {a}//-1 {c}//{} {b}//{}\n",
        count + 1 - c as usize,
        count + 1 - b as usize
    );
    let bare = format!("{whole}f {a} {c} {b}\n");
    for (name, source, told) in [
        ("whole.obj", &whole, None),
        ("again.obj", &again, None),
        ("several.obj", &several, Some("since there is more than one at 1 vertex")),
        ("bare.obj", &bare, Some("since some corners of faces name none")),
    ] {
        folder.write(name, source);
        for memory in ["128M", "1G"] {
            let built = folder
                .chpm(&format!("build {name} -o out.chpm -f --cluster-triangles 512 --memory {memory}"));
            let warned = text(&built.success().get_output().stdout);
            assert!(told.is_none_or(|told| warned.contains(told)), "{name}: {warned}");
            folder.stdout("extract out.chpm --level 0 -o out.ply -q -f");
            let read = folder.read_mesh("out.ply");
            assert_eq!(read.normals.is_empty(), told.is_some(), "{name}: {warned}");
            // The ball has its places as its normals.
            read.positions.iter().zip(&read.normals).for_each(|(p, n)| assert_eq!(p, n, "{name}"));
        }
    }
    folder.stdout(&format!("build whole.obj -o out.chpm {BUILD} --no-normals"));
    folder.stdout("extract out.chpm --level 0 -o out.ply -q -f");
    assert!(folder.read_mesh("out.ply").normals.is_empty());
}

/// Coordinates that single precision cannot hold: what they lose is part of every error, from the leaves up.
#[test]
fn what_rounding_takes_is_in_the_errors() {
    let (folder, mesh) = ball();
    let points: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.map(|x| 4e5 + f64::from(x) / 3.0)).collect();
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        points.len(),
        mesh.triangles.len()
    );
    points.iter().for_each(|[x, y, z]| ply += &format!("{x} {y} {z}\n"));
    mesh.triangles.iter().for_each(|[a, b, c]| ply += &format!("3 {a} {b} {c}\n"));
    folder.write("far.ply", ply);

    let info = |words: &str| -> serde_json::Value {
        folder.stdout(&format!("build {words} -o out.chpm {BUILD}"));
        serde_json::from_str(&folder.stdout("info --json out.chpm")).expect("JSON")
    };
    let far = info("far.ply");
    let origin: Vec<f64> = serde_json::from_value(far["origin"].clone()).expect("an origin");
    let lost = |p: &[f64; 3]| {
        let lost = [0, 1, 2].map(|axis| {
            let exact = p[axis] - origin[axis];
            f64::from(exact as f32) - exact
        });
        (
            lost.map(|x| x.abs()).into_iter().fold(0.0, f64::max),
            lost.iter().map(|x| x * x).sum::<f64>().sqrt(),
        )
    };
    let (axis, length) =
        points.iter().map(lost).fold((0.0f64, 0.0f64), |most, lost| (most.0.max(lost.0), most.1.max(lost.1)));
    let least = far["levels"][0]["min_error"].as_f64().expect("an error");
    assert!(length > 0.0 && least >= length, "{least} for {length}");
    assert!(least <= 1.000_001 * 3.0f64.sqrt() * axis, "{least} for {axis} along each axis");
    // What is exact but for that is pruned as if it were exact: nothing of a sphere, but it builds.
    assert_eq!(info("far.ply --prune-exact")["levels"][0]["triangles"], far["levels"][0]["triangles"]);
    assert_eq!(info("ball.ply")["levels"][0]["min_error"], 0.0);
}

#[test]
fn range_scans_are_moved_into_one_frame() {
    let (folder, mesh) = ball();
    let (count, half) = (mesh.triangles.len(), mesh.triangles.len() / 2);
    let part = |range: std::ops::Range<usize>, place: fn([f32; 3]) -> [f32; 3]| {
        let positions = mesh.positions.iter().map(|p| place(*p)).collect();
        TriMesh::new(positions, mesh.triangles[range].to_vec())
    };
    // The second scan saw the model a half turn about z and one unit of x away: its pose brings it back, exactly.
    folder.write_mesh("one.ply", &part(0..half, |p| p));
    folder.write_mesh("two.ply", &part(half..count, |[x, y, z]| [-x, -y, z]));
    folder.write(
        "ball.conf",
        "camera 0 0 0 0 0 0 1\nbmesh one.ply 0 0 0 0 0 0 1\nbmesh two.ply 0 0 0 0 0 1 0\n",
    );
    let out = through(&folder, "ball.conf");
    assert_eq!(triangles(&out), triangles(&mesh));
    let info = folder.stdout("info out.chpm --settings");
    assert!(info.contains("range scans"), "{info}");

    folder.write("lost.conf", "bmesh one.ply 0 0 0 0 0 0 1\nbmesh three.ply 0 0 0 0 0 0 1\n");
    let error = folder.stderr("build lost.conf -q", 2);
    assert!(error.contains("three.ply"), "{error}");
    folder.write("self.conf", "bmesh self.conf 0 0 0 0 0 0 1\n");
    assert!(folder.stderr("build self.conf -q", 2).contains("self.conf"));
}

/// A scan of `side` by `side` samples, some of them missing, half of them a step nearer than the others.
fn range_grid(side: usize) -> String {
    let seen = |i: usize| i % 17 != 3;
    let vertices: Vec<usize> = (0..side * side).filter(|i| seen(*i)).collect();
    let mut text = format!(
        "ply\nformat ascii 1.0\nobj_info num_cols {side}\nobj_info num_rows {side}\nelement vertex {}\nproperty float x\n\
         property float y\nproperty float z\nelement range_grid {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        side * side
    );
    for i in &vertices {
        let (x, y) = (i % side, i / side);
        text += &format!("{x} {y} {}\n", if x < side / 2 { 0 } else { 50 });
    }
    let mut next = 0;
    for i in 0..side * side {
        text += &if seen(i) { format!("1 {next}\n") } else { "0\n".to_owned() };
        next += usize::from(seen(i));
    }
    text
}

#[test]
fn range_grids_are_surfaces_without_curtains() {
    let folder = Folder::new();
    folder.write("one.ply", range_grid(40));
    folder.write("two.ply.gz", gzip(range_grid(30).as_bytes()));
    folder.write("set.conf", "bmesh one.ply 0 0 0 0 0 0 1\nbmesh two.ply.gz 100 0 0 0 0 1 0\n");
    let one = through(&folder, "one.ply");
    assert!(one.triangles.len() > 2000, "{}", one.triangles.len());
    for corners in &one.triangles {
        let [a, b, c] = one.corners(*corners);
        assert!(a[2] == b[2] && b[2] == c[2], "a curtain: {a:?} {b:?} {c:?}");
        // Turned to where the scanner was.
        assert!((b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0]));
    }
    let both = through(&folder, "set.conf");
    assert!(both.triangles.len() > one.triangles.len());
    let info = folder.stdout("info out.chpm --settings");
    assert!(info.contains("one.ply: left out") && info.contains("two.ply.gz: left out"), "{info}");
}

#[test]
fn two_builds_of_one_output_do_not_meet() {
    let folder = Folder::new();
    folder.stdout("synth isosurface --triangles 200000 -o in.ply -q");
    let mut first = folder
        .command("build in.ply -o out.chpm")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a process");
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(first.stderr.take().expect("a pipe")));
    // The lock is taken before the first stage begins.
    lines.next().expect("a line").expect("text");
    let second = folder.chpm("build in.ply -o out.chpm -q --force");
    let second = second.get_output();
    let id = first.id();
    lines.for_each(drop);
    assert!(first.wait().expect("an end").success());
    // The first may have been done by then.
    if !second.status.success() {
        let error = super::harness::text(&second.stderr);
        assert!(
            error.contains("is being built by") && error.contains(&format!("process {id} on ")),
            "{error}"
        );
    }
    folder.stdout("verify out.chpm --against in.ply -q");
    assert_eq!(folder.names(), ["in.ply", "out.chpm"]);
    // What a dead process left does not matter.
    folder.write(".out.chpm.lock", "process 1 on nowhere");
    folder.stdout("build in.ply -o out.chpm -q --force");
    assert_eq!(folder.names(), ["in.ply", "out.chpm"]);
}

/// Runs the command with these bytes on standard input, and answers its exit code and what it said.
fn piped(folder: &Folder, words: &str, bytes: &[u8]) -> (Option<i32>, String) {
    let mut command = folder.command(words);
    let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = piped.spawn().expect("a process");
    // Whoever refuses its input does not read it.
    let _ = child.stdin.take().expect("a pipe").write_all(bytes);
    let output = child.wait_with_output().expect("an end");
    (output.status.code(), super::harness::text(&output.stderr))
}

#[test]
fn a_pipe_is_a_source() {
    let (folder, mesh) = ball();
    let plain = folder.read("ball.ply");
    for bytes in [plain.clone(), gzip(&plain), stl(&mesh), obj(&mesh).into_bytes()] {
        for name in ["-", "/dev/stdin"] {
            let (code, told) = piped(&folder, &format!("build {name} -o out.chpm {BUILD}"), &bytes);
            assert_eq!(code, Some(0), "{told}");
            folder.stdout("extract out.chpm --level 0 -o out.ply -q -f");
            assert_eq!(triangles(&folder.read_mesh("out.ply")), triangles(&mesh));
        }
    }
    assert_eq!(folder.names(), ["ball.ply", "out.chpm", "out.ply"], "what came is gone");
    for (words, bytes, expected) in [
        ("build - -q", &plain[..], "-o"),
        ("build - -o x.chpm -q", b"bmesh ball.ply 0 0 0 0 0 0 1\n", "list of range scans"),
        ("build - -o x.chpm -q", &plain[..1000], "/dev/stdin"),
        ("verify out.chpm --against /dev/stdin -q", &plain, "pipe"),
    ] {
        let (code, told) = piped(&folder, words, bytes);
        assert!(code == Some(2) && told.contains(expected), "{words}: {told}");
    }
    assert_eq!(folder.names(), ["ball.ply", "out.chpm", "out.ply"]);
}

#[test]
fn the_header_of_an_stl_may_begin_like_a_packed_file() {
    let (folder, mesh) = ball();
    let plain = stl(&mesh);
    for (name, magic) in [
        ("one.stl", &[0x1f, 0x8b, 0][..]),
        ("two.stl", &[0x1f, 0x8b, 8]),
        ("three.stl", &[0x28, 0xb5, 0x2f, 0xfd]),
    ] {
        let mut bytes = plain.clone();
        bytes[..magic.len()].copy_from_slice(magic);
        folder.write(name, bytes);
        assert_eq!(triangles(&through(&folder, name)), triangles(&mesh), "{name}");
    }
}

#[test]
fn what_is_not_read_is_named_with_a_remedy() {
    let folder = Folder::new();
    let header = |elements: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{elements}end_header\n"
        )
    };
    let face = header("element face 1\nproperty list uchar int vertex_indices\n");
    let edge = header("element edge 2\nproperty int vertex1\nproperty int vertex2\n");
    let cases = [
        ("a.dae", "<?xml version=\"1.0\"?>\n<COLLADA>".to_owned(), "a COLLADA scene", "convert it"),
        ("a.off", "OFF\n3 1 0\n".to_owned(), "expected 3 vertices more", "copy the file again"),
        ("a.stl", String::new(), "an empty file", "copy it again"),
        ("a.ply", "<!DOCTYPE html><html>".to_owned(), "a web page", "download it again"),
        ("lines.ply", edge + "0 0 0\n1 0 0\n0 1 0\n0 1\n1 2\n", "2 lines between 3 vertices", "a mesh"),
        ("depth.ply", face + "0 0 0\nnan nan nan\n0 1 0\n3 0 1 2\n", "NaN", "--drop-invalid"),
    ];
    for (name, content, what, remedy) in cases {
        folder.write(name, content);
        let told = folder.stderr(&format!("build {name} -o out.chpm -q"), 2);
        assert!(told.contains(name) && told.contains(what) && told.contains(remedy), "{told}");
    }
    folder.stdout("synth sphere --triangles 400 -o ball.ply -q");
    folder.stdout("build ball.ply -q");
    let told = folder.stderr("build ball.chpm -o out.chpm -q", 2);
    assert!(told.contains("a .chpm file, which is built already") && told.contains("chpm view"), "{told}");
}

/// Runs as one who may not write everywhere, where the tests run as root.
#[test]
fn a_folder_that_takes_no_file_is_told_with_a_remedy() {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 400 -o ball.ply -q");
    fs::set_permissions(folder.path("ball.ply"), fs::Permissions::from_mode(0o644)).expect("permissions");
    fs::set_permissions(folder.path(""), fs::Permissions::from_mode(0o555)).expect("permissions");
    let mut command = folder.command("build ball.ply -q");
    // Root may write anywhere.
    if fs::write(folder.path("try"), "").is_ok() {
        fs::remove_file(folder.path("try")).expect("it was made");
        command.uid(65_534).gid(65_534);
    }
    let run = command.output();
    fs::set_permissions(folder.path(""), fs::Permissions::from_mode(0o755)).expect("permissions");
    let Ok(run) = run else { return println!("skipped: nobody else can run the command") };
    let told = text(&run.stderr);
    assert!(
        run.status.code() == Some(2) && told.contains("cannot be written") && told.contains("-o"),
        "{told}"
    );
    assert_eq!(folder.names(), ["ball.ply"]);
}
