//! Builds of textured sources: images become colours, and nothing else.

use super::harness::{Folder, root, skipped, was_killed};
use chpm_mesh::TriMesh;
use std::fmt::Write;
use std::fs;
use std::process::Stdio;

/// Colours of the quarters of an image, by rows from the top.
const QUARTERS: [[u8; 3]; 4] = [[250, 20, 20], [20, 250, 20], [20, 20, 250], [200, 200, 20]];

/// An image of four quarters.
fn image(side: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, side, side);
    encoder.set_color(png::ColorType::Rgb);
    let pixel = |at: u32| QUARTERS[(2 * (at / side / (side / 2)) + at % side / (side / 2)) as usize];
    let pixels: Vec<u8> = (0..side * side).flat_map(pixel).collect();
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(&pixels).expect("pixels");
    drop(writer);
    bytes
}

/// A hilly sheet over the unit square, with the image all over it.
fn obj(side: usize, head: &str) -> String {
    let mut text = head.to_owned();
    let at = |x: usize| x as f64 / side as f64;
    for (x, y) in (0..=side).flat_map(|y| (0..=side).map(move |x| (at(x), at(y)))) {
        let z = 0.03 * ((17.0 * x).sin() * (13.0 * y).cos());
        writeln!(text, "v {x} {y} {z}\nvt {x} {y}").expect("text");
    }
    for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
        let [a, b] = [y, y + 1].map(|y| y * (side + 1) + x + 1);
        writeln!(text, "f {a}/{a} {0}/{0} {1}/{1} {b}/{b}", a + 1, b + 1).expect("text");
    }
    text
}

fn textured() -> Folder {
    let folder = Folder::new();
    folder.write("a.obj", obj(64, "mtllib a.mtl\nusemtl a\n"));
    folder.write("a.mtl", "newmtl a\nmap_Kd a.png\n");
    folder.write("a.png", image(256));
    folder
}

const BUILD: &str = "--cluster-triangles 512 -q";

/// The finest mesh, with its colours.
fn finest(folder: &Folder, file: &str) -> TriMesh {
    folder.stdout(&format!("extract {file} --error 0 -o finest.ply -q -f"));
    folder.read_mesh("finest.ply")
}

/// Colours of vertices away from where quarters meet, held against these.
fn check_quarters(mesh: &TriMesh, place: impl Fn([f32; 3]) -> [f32; 2]) {
    let mut seen = [0; 4];
    for (position, color) in mesh.positions.iter().zip(&mesh.colors) {
        let [u, v] = place(*position);
        if (u - 0.5).abs() > 0.05 && (v - 0.5).abs() > 0.05 {
            let quarter = 2 * usize::from(v < 0.5) + usize::from(u > 0.5);
            seen[quarter] += 1;
            for (channel, expected) in color.iter().zip(QUARTERS[quarter]) {
                assert!(
                    channel.abs_diff(expected) <= 1,
                    "{position:?}: {color:?}, not {:?}",
                    QUARTERS[quarter]
                );
            }
            assert_eq!(color[3], 255);
        }
    }
    assert!(seen.iter().all(|count| *count > 100), "{seen:?}");
}

#[test]
fn images_become_colours_and_leave_the_geometry_alone() {
    let folder = textured();
    let told = folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    assert!(told.contains("averages of the texels of 1 image"), "{told}");
    check_quarters(&finest(&folder, "a.chpm"), |[x, y, _]| [x, y]);
    assert!(folder.stdout("info a.chpm --json").contains(r#""texture": "sheets""#));

    folder.stdout(&format!("build a.obj -o none.chpm --texture none {BUILD}"));
    for ask in ["--error 0", "--triangles 2000", "--triangles 300"] {
        let taken = ["a", "none"].map(|name| {
            folder.stdout(&format!("extract {name}.chpm {ask} --no-colors -o {name}.ply -q -f"));
            folder.read(&format!("{name}.ply"))
        });
        assert!(taken[0] == taken[1], "{ask}");
    }
    for file in ["a", "none"] {
        folder.stdout(&format!("verify {file}.chpm --against a.obj -q"));
    }
    folder.stdout("measure a.chpm --against a.obj -q --samples 20");
}

#[test]
fn any_memory_and_threads_give_the_same_bytes() {
    let folder = textured();
    let mut built = Vec::new();
    for resources in ["", "--threads 1", "--threads 8 --memory 128M", "--memory 16K --any-memory"] {
        folder.stdout(&format!("build a.obj -o a.chpm -f {BUILD} {resources}"));
        built.push(folder.read("a.chpm"));
    }
    assert!(built.windows(2).all(|two| two[0] == two[1]));
}

/// Colours of materials are those of vertices, where these have none; a shade of grey alone says nothing.
#[test]
fn materials_without_images_are_coloured() {
    let folder = Folder::new();
    let hill = obj(16, "mtllib a.mtl\nusemtl red\n");
    // The same surface again, two units farther, in another colour.
    let beside: String = hill
        .lines()
        .filter_map(|line| line.strip_prefix("v ")?.split_once(' '))
        .map(|(x, rest)| format!("v {} {rest}\n", x.parse::<f64>().expect("a number") + 2.0))
        .collect();
    let faces = hill.lines().filter(|line| line.starts_with("f "));
    let behind: String = faces
        .map(|line| {
            let corners = line.split(' ').skip(1).map(|corner| corner.split('/').next().expect("a vertex"));
            let corners = corners.map(|number| number.parse::<usize>().expect("a number") + 17 * 17);
            corners.fold("f".to_owned(), |text, number| text + " " + &number.to_string()) + "\n"
        })
        .collect();
    folder.write("a.obj", format!("{hill}{beside}usemtl green\n{behind}"));
    folder.write("a.mtl", "newmtl red\nKd 1 0 0\nnewmtl green\nKd 0 0.5 0.25\n");
    let told = folder.stdout("build a.obj -o a.chpm --cluster-triangles 64 -q");
    assert!(told.contains("colours of vertices are those of materials"), "{told}");
    assert!(
        !told.contains("references to materials") && !folder.stdout("info a.chpm").contains("sheets     ")
    );
    folder.stdout("verify a.chpm --against a.obj --cuts 3 -q");
    let check = |mesh: &TriMesh| {
        let mut seen = [0; 2];
        for (position, color) in mesh.positions.iter().zip(&mesh.colors) {
            let is_behind = position[0] > 1.5;
            seen[usize::from(is_behind)] += 1;
            assert_eq!(*color, if is_behind { [0, 128, 64, 255] } else { [255, 0, 0, 255] }, "{position:?}");
        }
        assert!(seen.iter().all(|count| *count > 20), "{seen:?}");
    };
    check(&finest(&folder, "a.chpm"));
    // Vertices that have colours keep them.
    folder.write(
        "own.obj",
        String::from_utf8(folder.read("a.obj")).expect("text").replace("\nvt", " 0 0 1\nvt"),
    );
    folder.stdout("build own.obj -o own.chpm -q");
    let own = finest(&folder, "own.chpm");
    assert!(own.colors.contains(&[0, 0, 255, 255]) && !own.colors.contains(&[255, 0, 0, 255]));
    // Two shades of grey tell something, one does not; whoever asks for none gets none.
    for (mtl, more, is_coloured) in [
        ("newmtl red\nKd 0.5 0.5 0.5\nnewmtl green\nKd 0.5 0.5 0.5\n", "", false),
        ("newmtl red\nKd 0.5 0.5 0.5\nnewmtl green\nKd 0.8 0.8 0.8\n", "", true),
        ("newmtl red\nKd 1 0 0\n", "", true),
        ("newmtl red\nKd 1 0 0\n", "--texture none", false),
        ("newmtl red\nKd 1 0 0\n", "--no-colors", false),
    ] {
        folder.write("a.mtl", mtl);
        folder.stdout(&format!("build a.obj -o a.chpm -f -q {more}"));
        assert_eq!(finest(&folder, "a.chpm").colors.is_empty(), !is_coloured, "{mtl} {more}");
    }
}

/// Nothing but textures changes bytes.
#[test]
fn sources_without_images_are_built_as_ever() {
    let folder = textured();
    folder.write("bare.obj", obj(32, ""));
    folder.write("names.obj", obj(32, "mtllib b.mtl\nusemtl a\n"));
    folder.write("b.mtl", "newmtl a\nKd 0.7 0.7 0.7\nmap_bump a.png\n");
    for source in ["bare", "names"] {
        for texture in ["", "--texture none", "--texture vertices", "--missing-images refuse"] {
            folder.stdout(&format!("build {source}.obj -o out.chpm -f {BUILD} {texture}"));
            let now = folder.read("out.chpm");
            folder.stdout(&format!("build {source}.obj -o none.chpm -f {BUILD} --texture none"));
            assert!(now == folder.read("none.chpm"), "{source} {texture}");
        }
    }
    assert!(finest(&folder, "out.chpm").colors.is_empty());

    folder.stdout(&format!("build a.obj -o out.chpm -f {BUILD} --no-colors"));
    assert!(finest(&folder, "out.chpm").colors.is_empty());
}

#[test]
fn images_that_are_missing_are_told() {
    let folder = textured();
    fs::remove_file(folder.path("a.png")).expect("a file");
    let told = folder.stdout(&format!("build a.obj -o a.chpm {BUILD}"));
    assert!(told.contains("warning: image 'a.png' is not there: textures are left out"), "{told}");
    assert!(finest(&folder, "a.chpm").colors.is_empty());

    let told = folder.stdout(&format!("build a.obj -o a.chpm -f --texture vertices {BUILD}"));
    assert!(told.contains("image 'a.png' is not there: grey instead"), "{told}");
    assert!(finest(&folder, "a.chpm").colors.iter().all(|color| *color == [128, 128, 128, 255]));

    let refused = folder.stderr(&format!("build a.obj -o b.chpm --missing-images refuse {BUILD}"), 2);
    assert!(refused.contains("image 'a.png' is not there: put it there"), "{refused}");

    let whole = image(64);
    folder.write("a.png", &whole[..whole.len() / 2]);
    let refused = folder.stderr(&format!("build a.obj -o b.chpm {BUILD}"), 2);
    assert!(refused.contains("a.png'") && refused.contains("--texture none"), "{refused}");
    assert!(!folder.names().contains(&"b.chpm".to_owned()));
}

#[test]
fn colours_of_vertices_tint_or_stay_where_no_image_is() {
    let folder = textured();
    let red = obj(64, "mtllib a.mtl\nusemtl a\n").replace("\nvt", " 1 0 0\nvt");
    folder.write("red.obj", &red);
    folder.stdout(&format!("build red.obj -o red.chpm {BUILD}"));
    check_quarters(&finest(&folder, "red.chpm"), |[x, y, _]| [x, y]);

    // Without a material, faces have their own colours.
    folder.write(
        "own.obj",
        red.replace("usemtl a\n", "") + "usemtl a\nv 0 0 5\nv 1 0 5\nv 0 1 5\nf -3/1 -2/65 -1/1\n",
    );
    folder.stdout(&format!("build own.obj -o own.chpm {BUILD}"));
    let own = finest(&folder, "own.chpm");
    let colors = own.positions.iter().zip(&own.colors).filter(|(position, _)| position[2] < 1.0);
    assert!(colors.clone().count() > 1000);
    colors.for_each(|(_, color)| assert_eq!(*color, [255, 0, 0, 255]));
}

/// Those of a glTF multiply: in what vertices have of the image; sheets show the image, and a build says so.
#[test]
fn colours_that_do_not_tint_sheets_are_told() {
    let folder = Folder::new();
    let numbers = [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1].map(|x: i8| f32::from(x).to_le_bytes());
    let with = |color: [u8; 4]| [numbers.as_flattened(), &color.repeat(3)].concat();
    let view = |offset: usize, length: usize| serde_json::json!({ "buffer": 0, "byteOffset": offset, "byteLength": length });
    let column = |view: usize, kind: usize, shape: &str| serde_json::json!({ "bufferView": view, "componentType": kind, "normalized": view == 2, "count": 3, "type": shape });
    let gltf = serde_json::json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 2 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0 }], "images": [{ "uri": "a.png" }],
        "buffers": [{ "uri": "a.bin", "byteLength": 72 }],
        "bufferViews": [view(0, 36), view(36, 24), view(60, 12)],
        "accessors": [column(0, 5126, "VEC3"), column(1, 5126, "VEC2"), column(2, 5121, "VEC4")],
    });
    folder.write("a.gltf", gltf.to_string());
    folder.write("a.png", image(64));
    let told = |color: [u8; 4], ways: &str| {
        folder.write("a.bin", with(color));
        let told = folder.stdout(&format!("build a.gltf -qf --json {ways}"));
        let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
        told["warnings"].to_string()
    };
    let red = [0, 255, 255, 255];
    let warned = told(red, "--texture sheets");
    assert!(
        warned.contains("colours of 3 textured vertices tint") && warned.contains("not in sheets"),
        "{warned}"
    );
    assert_eq!(told(red, "--texture vertices"), "[]");
    assert!(finest(&folder, "a.chpm").colors.iter().all(|color| color[0] == 0), "they do tint");
    assert_eq!(told([255; 4], "--texture sheets"), "[]");
}

#[test]
fn a_batch_builds_again_when_an_image_has_changed() {
    let folder = textured();
    let batch = |more: &str| folder.stdout(&format!("batch a.obj -o out --json {BUILD} {more}"));
    let status = |json: String| {
        let json: serde_json::Value = serde_json::from_str(&json).expect("a summary");
        json["models"][0]["status"].as_str().expect("text").to_owned()
    };
    assert_eq!(status(batch("")), "built");
    assert_eq!(status(batch("")), "current");
    folder.write("a.png", image(128));
    assert_eq!(status(batch("")), "built");
    assert_eq!(status(batch("--texture none")), "built");
    assert_eq!(status(batch("--texture none")), "current");
    assert_eq!(status(batch("")), "built");
}

/// A build that was killed goes on, but not with other images.
#[test]
fn checkpoints_are_those_of_these_images() {
    let folder = textured();
    let build = format!("build a.obj -o a.chpm -f {BUILD} --checkpoint 0 --json");
    let kill = |access: u64| {
        let mut command = folder.command(&format!("{build} --kill-at {access}"));
        let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status().expect("a process");
        assert!(was_killed(status), "at access {access}");
    };
    let resumed = || {
        let json: serde_json::Value = serde_json::from_str(&folder.stdout(&build)).expect("a report");
        json["resumed_after"].as_str().map(str::to_owned)
    };

    let goes_on = |access: &u64| {
        kill(*access);
        resumed().is_some()
    };
    let access =
        (40..).step_by(20).find(goes_on).expect("an access after which there is something to go on from");
    let whole = folder.read("a.chpm");
    kill(access);
    folder.write("a.png", image(128));
    assert_eq!(resumed(), None);
    assert!(folder.read("a.chpm") != whole);
}

#[test]
fn what_comes_through_a_pipe_has_no_images_beside_it() {
    let folder = textured();
    let input = fs::File::open(folder.path("a.obj")).expect("a file");
    let mut command = folder.command(&format!("build - -o a.chpm {BUILD}"));
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::null()).spawn().expect("a process");
    let mut pipe = child.stdin.take().expect("a pipe");
    std::io::copy(&mut std::io::BufReader::new(input), &mut pipe).expect("a source");
    drop(pipe);
    assert!(child.wait().expect("an end").success());
    assert!(finest(&folder, "a.chpm").colors.is_empty());
}

/// Real scans, where there are some: all of the scan is coloured, and by its image.
#[test]
fn textured_scans_are_coloured() {
    let data = root().join("../shared/data/textured");
    for name in ["texturedMesh.obj", "ferry_tile.glb"] {
        let source = data.join(name);
        if !source.exists() {
            skipped(format!("the textured scan {name}"));
            continue;
        }
        let folder = Folder::new();
        folder.stdout(&format!("build {} -o a.chpm -q", source.display()));
        let colors = finest(&folder, "a.chpm").colors.clone();
        let mut distinct: Vec<_> = colors.clone();
        distinct.sort_unstable();
        distinct.dedup();
        assert!(colors.len() > 5000 && 4 * distinct.len() > colors.len(), "{name}: {}", distinct.len());
    }
}
