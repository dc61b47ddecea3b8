//! Odd sources, names and options: what is told of them, and what comes out.

use super::harness::{Folder, text};
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;

/// A tetrahedron at these nodes, as glTF; its buffer is `t.bin`.
fn gltf(folder: &Folder, name: &str, nodes: Value) {
    let places: [f32; 12] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.];
    let corners: [u16; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
    let mut bytes: Vec<u8> = places.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend(corners.iter().flat_map(|x| x.to_le_bytes()));
    folder.write("t.bin", bytes);
    let accessor = |view: u32, kind: u32, count: u32, shape: &str| json!({ "bufferView": view, "componentType": kind, "count": count, "type": shape });
    let document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_node_visibility"],
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": nodes,
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [accessor(0, 5126, 4, "VEC3"), accessor(1, 5123, 12, "SCALAR")],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 24 },
        ],
        "buffers": [{ "uri": "t.bin", "byteLength": 72 }],
    });
    folder.write(name, document.to_string());
}

#[test]
fn hidden_nodes_are_left_out_with_a_word() {
    let folder = Folder::new();
    let hidden = |visible: bool| json!({ "KHR_node_visibility": { "visible": visible } });
    let child = json!({ "mesh": 0, "translation": [9, 0, 0] });
    for (visible, triangles) in [(true, 8), (false, 4)] {
        let above = json!({ "children": [2], "extensions": hidden(visible) });
        gltf(&folder, "a.gltf", json!([{ "mesh": 0 }, above, child]));
        let told = folder.stdout("build a.gltf -f --json -q");
        let told: Value = serde_json::from_str(&told).expect("JSON");
        assert_eq!(told["triangles"], triangles);
        let is_told = told["warnings"].to_string().contains("left out 1 hidden nodes");
        assert_eq!(is_told, !visible, "{told}");
    }
    let node = json!({ "mesh": 0, "extensions": hidden(false) });
    gltf(&folder, "b.gltf", json!([node, node]));
    let error = folder.stderr("build b.gltf -q", 2);
    assert!(error.contains("all of its meshes are hidden"), "{error}");
}

/// There corners become one, which is not what is to be told.
#[test]
fn what_is_placed_too_far_is_told_as_far() {
    let folder = Folder::new();
    let far = json!({ "mesh": 0, "translation": [1e308, 1e308, 1e308] });
    gltf(&folder, "a.gltf", json!([far, far]));
    let error = folder.stderr("build a.gltf -q", 2);
    assert!(error.contains("1e308 is farther from zero than 1e36"), "{error}");
}

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
                   facet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n";

#[test]
fn zeros_around_the_words_of_an_stl_are_blanks() {
    let folder = Folder::new();
    let padded = [STL.as_bytes(), &[0; 300]].concat();
    // More lines than a sniff sees are before these zeros.
    let facet = STL.lines().skip(1).take(7).collect::<Vec<_>>().join("\n");
    let long = format!("solid a\n{}\nendsolid\n", vec![facet; 100].join("\n")) + &"\0".repeat(300);
    for (name, bytes, triangles) in [
        ("end.stl", padded, 2),
        ("dos.stl", format!("{STL}\u{1a}").into_bytes(), 2),
        ("name.stl", STL.replace("solid a\n", "solid a\0\0\0\n").into_bytes(), 2),
        ("long.stl", long.into_bytes(), 1),
    ] {
        folder.write(name, bytes);
        folder.stdout(&format!("build {name} -o {name}.chpm -q"));
        let told: Value =
            serde_json::from_str(&folder.stdout(&format!("info {name}.chpm --json"))).expect("JSON");
        assert_eq!(told["triangles"], triangles, "{name}");
    }
}

/// In place of faces.
#[test]
fn what_a_source_without_faces_has_is_told() {
    let folder = Folder::new();
    folder.write("a.obj", "v 0 0 0\nv 1 0 0\np 1\nl 1 2\n");
    let error = folder.stderr("build a.obj -q", 2);
    assert!(error.contains("no faces") && error.contains("skipped 2 lines and points"), "{error}");
}

#[test]
fn an_encoding_that_is_not_read_is_named() {
    let folder = Folder::new();
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\n";
    for (name, words) in [("a.obj", OBJ), ("a.ply", ply), ("a.stl", STL), ("a.off", "OFF\n3 1 0\n")] {
        let little: Vec<u8> = words.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = words.encode_utf16().flat_map(u16::to_be_bytes).collect();
        for bytes in [[b"\xff\xfe", &little[..]].concat(), [b"\xfe\xff", &big[..]].concat(), little, big] {
            folder.write(name, bytes);
            let error = folder.stderr(&format!("build {name} -q"), 2);
            assert!(error.contains("UTF-16") && error.contains("save it as UTF-8"), "{name}: {error}");
        }
    }
}

#[test]
fn a_line_of_too_many_numbers_is_named_itself() {
    let folder = Folder::new();
    let lines = [
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         element face 2\nproperty list uchar int vertex_indices\nend_header",
        "0 0 0",
        "1 0 0",
        "0 1 0",
        "3 0 1 2",
        "3 0 2 1",
    ];
    for (line, told) in [(1, "vertex 0"), (2, "vertex 1"), (3, "vertex 2"), (4, "face 0")] {
        let mut lines = lines.map(str::to_owned);
        lines[line] += " 7";
        folder.write("a.ply", lines.join("\n"));
        let error = folder.stderr("build a.ply -q", 2);
        assert!(error.contains(&format!("a.ply: {told}, ")), "{told}: {error}");
        assert!(error.contains(&format!("line {}: expected the line to end here", 9 + line)), "{error}");
    }
}

/// It is built under a name that can be written down, and its neighbours are built, too.
#[test]
fn a_name_that_is_no_text_is_built_like_others() {
    let folder = Folder::new();
    fs::create_dir(folder.path("in")).expect("a folder");
    folder.write("in/good.obj", OBJ);
    fs::write(folder.path("in").join(OsStr::from_bytes(b"b\xffd.obj")), OBJ).expect("a file");
    folder.stdout("batch in -o out -q");
    assert!(folder.path("out/good.chpm").exists() && folder.path("out/b\u{fffd}d.chpm").exists());
    let again = folder.stdout("batch in -o out -q --json");
    let again: Value = serde_json::from_str(&again).expect("JSON");
    let rows = again["models"].as_array().expect("models");
    assert!(rows.len() == 2 && rows.iter().all(|row| row["status"] == "current"), "{again}");
}

/// In the texts of an OBJ as in its folder, names are bytes of whatever code.
#[test]
fn images_and_libraries_have_names_in_any_code() {
    let folder = Folder::new();
    let [library, image] = [&b"m\xe4dchen.mtl"[..], &b"t\xfcr.png"[..]];
    let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    folder.write("a.obj", [&b"mtllib "[..], library, b"\n", text].concat());
    let put = |name: &[u8], bytes: &[u8]| {
        fs::write(folder.path("").join(OsStr::from_bytes(name)), bytes).expect("a file")
    };
    put(library, &[&b"newmtl a\nmap_Kd "[..], image, b"\n"].concat());
    let told = || {
        let told = folder.stdout("build a.obj -qf --json");
        serde_json::from_str::<Value>(&told).expect("JSON")["warnings"].to_string()
    };
    assert!(told().contains("is not there"), "{}", told());
    put(image, &super::sheets::png(32, |_, _| vec![200, 10, 10], png::ColorType::Rgb));
    assert_eq!(told(), "[]");
    // Which of two it is cannot be told apart.
    put(b"t\xf6r.png", b"");
    assert!(told().contains("is not there"), "{}", told());
}

#[test]
fn colours_that_are_asked_for_and_left_out_are_refused() {
    let folder = Folder::new();
    folder.write("a.obj", OBJ);
    for which in ["vertices", "sheets"] {
        let error = folder.stderr(&format!("build a.obj --no-colors --texture {which} -q"), 2);
        assert!(error.contains(&format!("--texture {which}")) && error.contains("--no-colors"), "{error}");
    }
    let error = folder.stderr("stage plan a.obj -o plan --no-colors --texture vertices -q", 2);
    assert!(error.contains("--no-colors"), "{error}");
    folder.stdout("build a.obj --no-colors --texture none -q");
}

#[test]
fn zeros_of_rays_have_no_sign() {
    let folder = Folder::new();
    folder.write("a.obj", cube([-0.5; 2]));
    folder.stdout("build a.obj -q");
    let rays = "0.1,0.2,-1,0,0,1\n0.1,0.2,9,0,0,-1\n-9,0.2,0.3,1,0,0\n9,0.2,0.3,-1,0,0\n0.1,-9,0.3,0,1,0\n0.1,9,0.3,0,-1,0\n";
    folder.write("rays.csv", rays);
    for words in ["", "--error 1%"] {
        let rows = folder.stdout(&format!("rays a.chpm rays.csv -o - -q {words}"));
        assert_eq!(rows.lines().filter(|row| row.starts_with("1,")).count(), 6, "{rows}");
        assert!(rows.lines().flat_map(|row| row.split(',')).all(|cell| cell != "-0"), "{rows}");
    }
}

/// One after the other, so that the second figure was asked for by the first.
#[test]
fn the_memory_that_is_told_for_an_order_suffices() {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 60000 -o a.ply -q");
    folder.stdout("build a.ply -q");
    for words in ["--level 0", "--lods 50k,10k"] {
        let words = format!("extract a.chpm {words} --order cache-oblivious -o out.glb -q -f --memory");
        let error = folder.stderr(&format!("{words} 1M"), 2);
        let told = error.split("give it ").nth(1).and_then(|rest| rest.split_whitespace().next());
        let told = told.expect("a figure");
        folder.stdout(&format!("{words} {told}"));
    }
}

#[test]
fn colours_of_measures_are_quantized_like_other_meshes() {
    let folder = Folder::new();
    folder.stdout("synth sphere --triangles 3000 -o a.ply -q");
    folder.stdout("build a.ply -q");
    for verb in ["compare a.chpm a.chpm", "thickness a.chpm", "visible a.chpm --from 9,0,0"] {
        let sizes = ["", "--quantize"].map(|words| {
            folder.stdout(&format!("{verb} -o out.glb -q -f {words}"));
            let bytes = folder.read("out.glb");
            assert_eq!(text(&bytes).contains("KHR_mesh_quantization"), !words.is_empty(), "{verb}");
            bytes.len()
        });
        assert!(sizes[1] < sizes[0], "{verb}: {sizes:?}");
        let error = folder.stderr(&format!("{verb} -o out.ply -q --quantize"), 2);
        assert!(error.contains("--quantize is for GLB and glTF"), "{error}");
    }
    assert!(!folder.path("out.ply").exists());
}

/// A cube of length 1, as OBJ.
fn cube([x, y]: [f64; 2]) -> String {
    let corner = |n: u32| {
        let [i, j, k] = [n & 1, n >> 1 & 1, n >> 2].map(f64::from);
        format!("v {} {} {k}\n", x + i, y + j)
    };
    let faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";
    (0..8).map(corner).collect::<String>() + faces
}

#[test]
fn places_far_from_zero_and_bounds_near_what_is_asked_are_told_with_their_digits() {
    let folder = Folder::new();
    for (name, x) in [("a.obj", 500_000.125), ("b.obj", 500_002.625)] {
        folder.write(name, cube([x, 5_400_000.5]));
        folder.stdout(&format!("build {name} -q"));
    }
    let told = folder.stdout("contacts a.chpm b.chpm --within 2 -q");
    assert!(told.contains("500001.12") && told.contains("540000"), "{told}");
    let told = folder.stdout("info a.chpm");
    assert!(told.contains("from (500000.1250, 5400000.5000, 0)"), "{told}");
    let told = folder.stdout("clearance a.chpm b.chpm --above 1.4999 -q");
    let bound = told.split_whitespace().nth(1).and_then(|bound| bound.parse::<f64>().ok());
    assert!(bound.is_some_and(|bound| bound > 1.4999 && bound <= 1.5), "{told}");
    assert!(told.contains("above 1.4999"), "{told}");
}

#[test]
fn drawings_and_pages_have_no_control_characters() {
    let folder = Folder::new();
    let name = "a\u{1b}[31m.chpm";
    folder.write("a.obj", OBJ);
    folder.stdout("build a.obj -q");
    fs::rename(folder.path("a.chpm"), folder.path(name)).expect("a new name");
    for words in [
        format!("compare {name} {name} -q --svg out.svg --html out.html -f"),
        format!("thickness {name} -q --svg out.svg -f"),
        format!("section {name} --plane 0,0,1:0.25 -q -o out.svg -f"),
        format!("report {name} -o out.html -f"),
    ] {
        folder.stdout(&words);
        for name in ["out.svg", "out.html"].iter().filter(|name| folder.path(name).exists()) {
            let told = text(&folder.read(name));
            assert!(!told.contains('\u{1b}') && told.contains("[31m"), "{words}: {name}");
            fs::remove_file(folder.path(name)).expect("removed");
        }
    }
}

/// A triangle, as PLY of text.
fn ply(properties: &str, vertices: [&str; 3]) -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{properties}element face 1\n\
         property list uchar int vertex_indices\nend_header\n{}\n3 0 1 2\n",
        vertices.join("\n")
    )
}

#[test]
fn a_mark_of_utf_8_before_a_ply_is_passed_over() {
    let folder = Folder::new();
    let plain = ply("", ["0 0 0", "1 0 0", "0 1 0"]);
    for name in ["a.ply", "a"] {
        folder.write(name, format!("\u{feff}{plain}"));
        folder.stdout(&format!("build {name} -o a.chpm -q -f"));
        folder.stdout(&format!("verify a.chpm --against {name} -q"));
    }
    // Places are those of the file.
    folder.write("b.ply", format!("\u{feff}{}", plain.replace("1 0 0", "one 0 0")));
    let at = 3 + plain.find("1 0 0").expect("the vertex");
    let error = folder.stderr("build b.ply -q", 2);
    assert!(error.contains(&format!("vertex 1, byte {at}, line 11:")), "{error}");
}

#[test]
fn real_colours_beyond_one_are_told() {
    let folder = Folder::new();
    let colors = "property float red\nproperty float green\nproperty float blue\n";
    for (color, is_told) in
        [("255 128 0", true), ("1 0.5 0", false), ("1.0000001 0 0", false), ("nan 0 0", true)]
    {
        let vertices = ["0 0 0", "1 0 0", "0 1 0"].map(|place| format!("{place} {color}"));
        folder.write("text.ply", ply(colors, vertices.each_ref().map(String::as_str)));
        folder.stdout("build text.ply -q -f");
        let header = ply(colors, [""; 3]).replace("ascii", "binary_little_endian");
        let mut bytes = header.split_once("end_header\n").expect("a header").0.as_bytes().to_vec();
        bytes.extend(b"end_header\n");
        for number in vertices.iter().flat_map(|vertex| vertex.split(' ')) {
            bytes.extend(number.parse::<f32>().expect("a number").to_le_bytes());
        }
        bytes.push(3);
        bytes.extend([0_u32, 1, 2].iter().flat_map(|corner| corner.to_le_bytes()));
        folder.write("binary.ply", bytes);
        for name in ["text.ply", "binary.ply"] {
            let told = folder.stdout(&format!("build {name} -o a.chpm -q -f"));
            let told = told.contains("clamped colours of 3 vertices to 0 to 1");
            assert_eq!(told, is_told, "{name} {color}");
        }
    }
}

#[test]
fn a_mark_of_utf_8_before_lists_and_paths_is_passed_over() {
    let folder = Folder::new();
    folder.write("a.obj", OBJ);
    folder.write("list.json", "\u{feff}{\"model\": [{\"source\": \"a.obj\"}]}");
    folder.stdout("batch list.json -o out -q");
    folder.write("a.path", "\u{feff}chpm-path 1\n0 0 5 0 0 0 0 1 0 45\n");
    folder.stdout("walk out/a.chpm a.path -q");
}
