//! Models that lie in several files, cut at borders of tiles.

use super::harness::{Folder, shell, text, triangles};
use chpm_mesh::TriMesh;
use chpm_synth::{Shape, Synth};
use serde_json::Value;
use std::fmt::Write;
use std::fs;

const BUILD: &str = "--cluster-triangles 512 -q -f";

/// The mesh in four parts, by where triangles have their first corner, each with vertices of its own.
fn quarters(mesh: &TriMesh) -> Vec<TriMesh> {
    let middle: [f32; 2] = std::array::from_fn(|axis| {
        let along = mesh.positions.iter().map(|p| p[axis]);
        along.clone().fold(f32::INFINITY, f32::min).midpoint(along.fold(f32::NEG_INFINITY, f32::max))
    });
    let quarter = |[a, ..]: &[u32; 3]| {
        let p = mesh.positions[*a as usize];
        usize::from(p[0] > middle[0]) + 2 * usize::from(p[1] > middle[1])
    };
    let part = |which: usize| {
        let mut own = vec![u32::MAX; mesh.positions.len()];
        let mut positions = Vec::new();
        let kept = mesh.triangles.iter().filter(|triangle| quarter(triangle) == which);
        let renumbered = kept.map(|triangle| {
            triangle.map(|vertex| {
                let own = &mut own[vertex as usize];
                if *own == u32::MAX {
                    *own = positions.len() as u32;
                    positions.push(mesh.positions[vertex as usize]);
                }
                *own
            })
        });
        let triangles = renumbered.collect();
        TriMesh::new(positions, triangles)
    };
    (0..4).map(part).collect()
}

/// `tiles.tiles` in a folder, of four files, and the mesh that they are of.
fn terrain() -> (Folder, TriMesh) {
    let folder = Folder::new();
    let mesh = Synth::new(Shape::Terrain, 20_000, 1).to_mesh();
    fs::create_dir(folder.path("south")).expect("a folder");
    let mut list = "# a ground\ntiles\n\n".to_owned();
    for (tile, name) in quarters(&mesh).iter().zip(["south/a.ply", "south/b c.ply", "d.ply", "e.ply"]) {
        folder.write_mesh(name, tile);
        writeln!(list, "{name}").expect("text");
    }
    folder.write("tiles.tiles", list);
    folder.write_mesh("whole.ply", &mesh);
    (folder, mesh)
}

fn finest(folder: &Folder, file: &str) -> TriMesh {
    folder.stdout(&format!("extract {file} --level 0 -o finest.ply -q -f"));
    folder.read_mesh("finest.ply")
}

/// Builds a list or a mesh beside it, and answers what is known of the file.
fn built(folder: &Folder, source: &str) -> Value {
    folder.stdout(&format!("build {source} {BUILD}"));
    let output = std::path::Path::new(source).with_extension("chpm");
    serde_json::from_str(&folder.stdout(&format!("info {} --json", output.display()))).expect("JSON")
}

#[test]
fn tiles_are_one_mesh_whose_inner_borders_are_closed() {
    let (folder, mesh) = terrain();
    let whole = built(&folder, "whole.ply");
    let tiles = built(&folder, "tiles.tiles");
    for count in ["triangles", "vertices"] {
        assert_eq!(tiles[count], whole[count], "{count}");
    }
    assert_eq!(tiles["repairs"], whole["repairs"]);
    assert!(triangles(&finest(&folder, "tiles.chpm")) == triangles(&mesh));
    folder.chpm("verify tiles.chpm --against tiles.tiles --errors -q").success();
    folder.chpm("verify tiles.chpm --against whole.ply --errors -q").success();
    let info = folder.stdout("info tiles.chpm --settings");
    assert!(info.contains("joined at their borders"), "{info}");

    // Memory and threads change nothing.
    let bytes = folder.read("tiles.chpm");
    folder.stdout(&format!("build tiles.tiles {BUILD} --memory 128M --threads 3"));
    assert!(folder.read("tiles.chpm") == bytes);
}

#[test]
fn a_cut_that_is_not_exact_is_welded_within_a_distance() {
    let (folder, mesh) = terrain();
    // Each tile is off by a little, in its own way.
    for (tile, mut part) in quarters(&mesh).into_iter().enumerate() {
        let by = 1e-4 * tile as f32;
        part.positions.iter_mut().for_each(|p| *p = [p[0] + by, p[1] - by, p[2] + by]);
        folder.write_mesh(&format!("{tile}.ply"), &part);
    }
    let files = "0.ply\n1.ply\n2.ply\n3.ply\n";
    folder.write("open.tiles", format!("tiles\n{files}"));
    folder.write("near.tiles", format!("tiles weld 0.002\n{files}"));
    let whole = built(&folder, "whole.ply");
    let open = built(&folder, "open.tiles");
    let near = built(&folder, "near.tiles");
    assert!(open["vertices"].as_u64() > whole["vertices"].as_u64(), "{open}");
    assert!(open["warnings"].to_string().contains("weld DISTANCE"), "{open}");
    assert_eq!((&near["vertices"], &near["triangles"]), (&whole["vertices"], &whole["triangles"]));
    assert_eq!(near["repairs"], whole["repairs"]);
    folder.chpm("verify near.chpm --against near.tiles --errors -q").success();
}

#[test]
fn vertices_of_one_tile_stay_apart() {
    let folder = Folder::new();
    // Two sheets that lie on each other in each tile, and meet those of the other tile.
    let sheet = |x: f32| {
        let corners = [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0], [x + 1.0, 1.0, 0.0]];
        let positions = [corners, corners].concat();
        TriMesh::new(positions, vec![[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6]])
    };
    folder.write_mesh("a.ply", &sheet(0.0));
    folder.write_mesh("b.ply", &sheet(1.0));
    for head in ["tiles", "tiles weld 0.25"] {
        folder.write("two.tiles", format!("{head}\na.ply\nb.ply\n"));
        let two = built(&folder, "two.tiles");
        // Of sixteen vertices four are met by others.
        assert_eq!(two["vertices"], 12, "{head}: {two}");
        assert_eq!(finest(&folder, "two.chpm").triangles.len(), 8, "{head}");
    }
}

#[test]
fn formats_and_attributes_of_tiles_may_differ() {
    let (folder, mesh) = terrain();
    let parts = quarters(&mesh);
    let mut obj = String::new();
    for [x, y, z] in &parts[0].positions {
        writeln!(obj, "v {x} {y} {z}\nvn 0 0 1").expect("text");
    }
    for [a, b, c] in parts[0].triangles.iter().map(|triangle| triangle.map(|v| v + 1)) {
        writeln!(obj, "f {a}//{a} {b}//{b} {c}//{c}").expect("text");
    }
    folder.write("a.obj", &obj);
    let mut colored = parts[1].clone();
    colored.colors = vec![[10, 20, 30, 255]; colored.positions.len()];
    folder.write_mesh("colored.ply", &colored);
    folder.write("mixed.tiles", "tiles weld 1e-6\r\na.obj\r\ncolored.ply\r\n  d.ply  \r\ne.ply\r\n");
    let mixed = built(&folder, "mixed.tiles");
    assert!(mixed["warnings"].to_string().contains("dropped colours"), "{mixed}");
    // Decimal text is not single precision, so all of it is moved, and rounded.
    let whole = built(&folder, "whole.ply");
    assert_eq!((&mixed["vertices"], &mixed["triangles"]), (&whole["vertices"], &whole["triangles"]));

    // Normals that corners have: those of the second tile are its own.
    folder.write("b.obj", obj.replace("vn 0 0 1", "vn 0 1 0").replace("v ", "v 100"));
    folder.write("normals.tiles", "tiles\na.obj\nb.obj\n");
    folder.stdout(&format!("build normals.tiles {BUILD}"));
    let out = finest(&folder, "normals.chpm");
    assert_eq!(out.normals.len(), out.positions.len());
    for (position, normal) in out.positions.iter().zip(&out.normals) {
        let expected = if position[0] > 50.0 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        assert_eq!(*normal, expected, "{position:?}");
    }
    // Where another one has none, there are none.
    folder.write("some.tiles", "tiles\na.obj\nd.ply\n");
    let some = built(&folder, "some.tiles");
    assert!(some["normals"] == false && some["warnings"].to_string().contains("normals"), "{some}");
    // So it is with scans; each turns its own.
    folder.write("two.conf", "bmesh a.obj 0 0 0 0 0 0 1\nbmesh b.obj 0 0 0 1 0 0 0\n");
    folder.stdout(&format!("build two.conf {BUILD}"));
    let out = finest(&folder, "two.chpm");
    assert!(out.positions.iter().zip(&out.normals).any(|(p, n)| p[0] > 50.0 && n[1] == -1.0));
    assert!(out.positions.iter().zip(&out.normals).all(|(p, n)| (p[0] > 50.0) == (n[2] != 1.0)));
}

/// A square of `color` at `x`, as an OBJ with an image.
fn painted(folder: &Folder, name: &str, x: usize, color: [u8; 3]) {
    let side = 12;
    let mut text = format!("mtllib {name}.mtl\nusemtl m\n");
    for (i, j) in (0..=side).flat_map(|j| (0..=side).map(move |i| (i, j))) {
        let [u, v] = [i, j].map(|at| at as f64 / side as f64);
        writeln!(text, "v {} {v} 0\nvt {u} {v}", x as f64 + u).expect("text");
    }
    for (i, j) in (0..side).flat_map(|j| (0..side).map(move |i| (i, j))) {
        let [a, b] = [j, j + 1].map(|j| j * (side + 1) + i + 1);
        writeln!(text, "f {a}/{a} {0}/{0} {1}/{1} {b}/{b}", a + 1, b + 1).expect("text");
    }
    folder.write(&format!("{name}.obj"), text);
    folder.write(&format!("{name}.mtl"), format!("newmtl m\nmap_Kd {name}.png\n"));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 8, 8);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(&color.repeat(64)).expect("pixels");
    drop(writer);
    folder.write(&format!("{name}.png"), bytes);
}

#[test]
fn each_tile_has_its_own_images() {
    let folder = Folder::new();
    painted(&folder, "a", 0, [250, 20, 20]);
    painted(&folder, "b", 1, [20, 20, 250]);
    folder.write("two.tiles", "tiles\na.obj\nb.obj\n");
    folder.stdout(&format!("build two.tiles {BUILD} --texture vertices"));
    let out = finest(&folder, "two.chpm");
    // Thirteen vertices are of both.
    assert_eq!(out.positions.len(), 2 * 13 * 13 - 13);
    for (position, color) in out.positions.iter().zip(&out.colors) {
        let expected = match position[0] {
            x if x < 0.99 => [250, 20, 20, 255],
            x if x > 1.01 => [20, 20, 250, 255],
            _ => continue,
        };
        assert_eq!(*color, expected, "{position:?}");
    }

    // Without them, each tile tells once that its coordinates of images are left out.
    folder.stdout(&format!("build two.tiles {BUILD} --texture none"));
    let info = folder.stdout("info two.chpm --settings");
    let told: Vec<&str> = info.lines().filter(|line| line.contains("a.obj: dropped 169 texture")).collect();
    assert!(told.len() == 1, "{info}");

    // As images of clusters, too; an image that has changed is noticed.
    folder.stdout(&format!("build two.tiles {BUILD} --texture sheets"));
    folder.chpm("verify two.chpm --against two.tiles -q").success();
    let error = folder.stderr(&format!("build two.tiles -o b.png {BUILD}"), 2);
    assert!(error.contains("b.png"), "{error}");
}

#[test]
fn tiles_with_images_keep_no_files_open() {
    let folder = Folder::new();
    painted(&folder, "a", 0, [250, 20, 20]);
    folder.stdout(&format!("build a.obj {BUILD} --texture sheets"));
    folder.stdout("extract a.chpm --level 0 --texture-size 256 -o 0.glb");
    let mut list = "tiles\n0.glb\n".to_owned();
    for tile in 1..60 {
        fs::copy(folder.path("0.glb"), folder.path(&format!("{tile}.glb"))).expect("a copy");
        writeln!(list, "{tile}.glb").expect("text");
    }
    folder.write("many.tiles", list);
    let line = format!("ulimit -n 64; exec chpm build many.tiles {BUILD} --texture vertices --threads 1");
    let built = shell(&folder, &line);
    assert!(built.status.success(), "{}", text(&built.stderr));
    assert!(finest(&folder, "many.chpm").colors.iter().all(|[red, ..]| *red > 200));
}

#[test]
fn what_is_wrong_with_a_list_of_tiles_is_named() {
    let (folder, _) = terrain();
    for (list, words) in [
        ("tiles\nd.ply\nmissing.ply\n", "missing.ply"),
        ("tiles\nd.ply\nd.ply\n", "each file once"),
        ("tiles\n# none\n", "names no tile"),
        ("tiles weld much\nd.ply\n", "line 1"),
        ("tiles weld -1\nd.ply\n", "line 1"),
        ("tiles weld nan\nd.ply\n", "line 1"),
        ("tiles\nother.tiles\n", "list of meshes"),
        ("tiles\nsouth\n", "a folder"),
    ] {
        folder.write("other.tiles", list);
        let error = folder.stderr(&format!("build other.tiles -o x.chpm {BUILD}"), 2);
        assert!(error.contains(words) && error.contains("other.tiles"), "{list}: {error}");
    }
    // A vertex of both is too far away; where no face has it, nothing is wrong.
    let far = |name: &str, faces: Vec<[u32; 3]>| {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1e37, 0.0, 0.0]];
        folder.write_mesh(name, &TriMesh::new(positions, faces));
    };
    far("far.ply", vec![[0, 1, 2]]);
    far("used.ply", vec![[0, 1, 3]]);
    folder.write("far.tiles", "tiles\nfar.ply\nused.ply\n");
    let error = folder.stderr(&format!("build far.tiles -o x.chpm {BUILD}"), 2);
    assert!(
        ["far.tiles", "vertex 3", "farther from zero"].iter().all(|told| error.contains(told)),
        "{error}"
    );
    far("used.ply", vec![[0, 2, 1]]);
    built(&folder, "far.tiles");
    let piped = super::harness::shell(&folder, "cat tiles.tiles | chpm build - -o x.chpm -q");
    assert!(String::from_utf8_lossy(&piped.stderr).contains("list of tiles"));
    assert!(!folder.path("x.chpm").exists());
}

#[test]
fn a_batch_takes_a_list_and_not_its_tiles() {
    let (folder, _) = terrain();
    fs::create_dir(folder.path("out")).expect("a folder");
    folder.stdout("batch . -o out -q");
    assert!(folder.path("out/tiles.chpm").exists() && folder.path("out/whole.chpm").exists());
    for tile in ["d.chpm", "e.chpm", "south/a.chpm"] {
        assert!(!folder.path("out").join(tile).exists(), "{tile}");
    }
}

/// Sources on the command line are the list that they leave.
#[test]
fn several_sources_are_tiles_of_one_model() {
    let (folder, mesh) = terrain();
    let sources = ["south/a.ply", "south/b c.ply", "d.ply", "e.ply"];
    let run = |words: &str, sources: &[&str]| {
        folder
            .command(words)
            .args(sources)
            .output()
            .map(|output| (output.status.code(), output))
            .expect("a run")
    };
    let (code, output) = run(&format!("build -o named.chpm {BUILD}"), &sources);
    assert_eq!(code, Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let list = "tiles\nsouth/a.ply\nsouth/b c.ply\nd.ply\ne.ply\n";
    assert_eq!(folder.read("named.tiles"), list.as_bytes());
    folder.stdout(&format!("build named.tiles -o listed.chpm {BUILD}"));
    assert!(folder.read("named.chpm") == folder.read("listed.chpm"), "the bytes of a list");
    folder.stdout("verify named.chpm --against named.tiles -q");
    assert_eq!(finest(&folder, "named.chpm").triangles.len(), mesh.triangles.len());

    // Again is no other list; from elsewhere names are those of there; steps take several, too.
    assert_eq!(run(&format!("build -o named.chpm {BUILD}"), &sources).0, Some(0));
    assert_eq!(run(&format!("build -o south/named.chpm --weld 0.001 {BUILD}"), &sources[..2]).0, Some(0));
    assert_eq!(folder.read("south/named.tiles"), b"tiles weld 0.001\na.ply\nb c.ply\n");
    assert_eq!(run("stage plan -o steps -q", &sources).0, Some(0));
    assert_eq!(folder.read("steps.tiles"), list.as_bytes());

    folder.write("plain", folder.read("e.ply"));
    for (words, sources, told) in [
        ("build -q", &sources[..], "several sources give the output no name"),
        ("build -o named.chpm -q", &sources[..3], "'named.tiles' is there and lists other tiles"),
        ("build -o new.chpm -q", &["d.ply", "e.ply", "d.ply"], "'d.ply' is named twice"),
        ("build -o new.chpm -q", &["d.ply", "none.ply"], "cannot read 'none.ply'"),
        ("build -o new.chpm -q", &["d.ply", "south"], "'south' is no file"),
        ("build -o new.chpm -q --weld 1", &["d.ply"], "--weld joins several sources"),
        ("build -o new.chpm -q --weld=-1", &["d.ply", "e.ply"], "--weld"),
        ("build -o e.ply -q -f", &["d.ply", "e.ply"], "build writes CHPM"),
        ("build -o plain -q -f", &["d.ply", "plain"], "the output 'plain' is one of the sources"),
    ] {
        let (code, output) = run(words, sources);
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(code, Some(2), "{words}: {error}");
        assert!(error.contains(told), "{words}: {error}");
    }
    assert!(folder.read("plain") == folder.read("e.ply") && !folder.path("e.tiles").exists());
    assert!(!folder.path("new.tiles").exists() && !folder.path("new.chpm").exists());
}
