//! glTF as it comes, and as it must not.

use super::*;
use crate::batch::{Batch, BatchKind};
use crate::options::{Invalid, Options};
use crate::{Input, SourceInfo};
use chpm_extmem::{Cancel, Store};
use serde_json::{Value, json};
use std::fs;

/// Mesh as it was read of a file.
#[derive(Debug, Default, PartialEq)]
struct Read {
    positions: Vec<[f64; 3]>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[u8; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl Read {
    /// Corners of a triangle.
    fn corners(&self, triangle: usize) -> [[f64; 3]; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }
}

fn read_file(path: &Path, options: Options, memory: u64) -> Result<(Read, SourceInfo), String> {
    let work = tempfile::tempdir().unwrap();
    let store = Store::create(work.path(), memory).unwrap();
    let told = |error: SourceError| error.to_string();
    let mut input = Input::open(path, options, &store, &Cancel::default()).map_err(told)?;
    let (mut read, mut batch) = (Read::default(), Batch::default());
    loop {
        let kind = input.next_batch(&mut batch).map_err(told)?;
        read.positions.extend(batch.vertices.positions.iter().map(|p| p.map(f64::from)));
        read.positions.append(&mut batch.positions_f64);
        read.normals.append(&mut batch.vertices.normals);
        read.colors.append(&mut batch.vertices.colors);
        read.triangles.append(&mut batch.triangles);
        if kind == BatchKind::End {
            break;
        }
    }
    let all = read.positions.len() as u32;
    assert!(read.triangles.as_flattened().iter().all(|v| *v < all));
    Ok((read, input.finish().map_err(told)?))
}

fn try_read(bytes: &[u8], options: Options) -> Result<(Read, SourceInfo), String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    fs::write(&path, bytes).unwrap();
    let read = read_file(&path, options.clone(), 1 << 30)?;
    // No budget shows in what is read.
    let (again, _) = read_file(&path, options, 0).unwrap();
    assert_eq!(read.0, again);
    Ok(read)
}

fn read(bytes: &[u8]) -> Read {
    try_read(bytes, Options::default()).expect("a mesh").0
}

fn refusal(file: &Value, data: &[u8]) -> String {
    try_read(&glb(file, data), Options::default()).expect_err("refused")
}

fn glb(file: &Value, data: &[u8]) -> Vec<u8> {
    let mut text = file.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let chunk = data.len().next_multiple_of(4);
    let mut bytes = b"glTF".to_vec();
    for word in [2, 28 + text.len() + chunk, text.len()] {
        bytes.extend((word as u32).to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(&text);
    bytes.extend((chunk as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

/// A file that grows: data, and a view and an accessor for each piece of it.
struct Made {
    file: Value,
    data: Vec<u8>,
}

const F32: u32 = 5126;

impl Made {
    fn new() -> Made {
        let file = json!({
            "asset": { "version": "2.0" }, "buffers": [{ "byteLength": 0 }], "bufferViews": [], "accessors": [],
            "meshes": [], "nodes": [], "scenes": [{ "nodes": [0] }],
        });
        Made { file, data: Vec::new() }
    }

    fn list(&mut self, name: &str) -> &mut Vec<Value> {
        self.file[name].as_array_mut().unwrap()
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        // Nothing has to lie at a multiple of its size.
        self.data.push(0xaa);
        let view = json!({ "buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len() });
        self.data.extend(bytes);
        self.file["buffers"][0]["byteLength"] = self.data.len().into();
        self.list("bufferViews").push(view);
        self.list("bufferViews").len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, shape: &str) -> usize {
        let view = self.view(bytes);
        let accessor =
            json!({ "bufferView": view, "componentType": component, "count": count, "type": shape });
        self.list("accessors").push(accessor);
        self.list("accessors").len() - 1
    }

    fn floats(&mut self, numbers: &[[f32; 3]]) -> usize {
        let bytes: Vec<u8> = numbers.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, F32, numbers.len(), "VEC3")
    }

    fn primitive(&mut self, primitive: Value) -> usize {
        self.list("meshes").push(json!({ "primitives": [primitive] }));
        self.list("meshes").len() - 1
    }

    fn node(&mut self, node: Value) -> usize {
        self.list("nodes").push(node);
        self.list("nodes").len() - 1
    }

    /// A file with these corners, three a triangle.
    fn soup(corners: &[[f32; 3]]) -> Made {
        let mut made = Made::new();
        let positions = made.floats(corners);
        let mesh = made.primitive(json!({ "attributes": { "POSITION": positions } }));
        made.node(json!({ "mesh": mesh }));
        made
    }

    fn glb(&self) -> Vec<u8> {
        glb(&self.file, &self.data)
    }
}

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 2.0, 0.5]];

/// A mode, indices, and the triangles that they are.
type ModeCase<'a> = (u8, &'a [u32], &'a [[u32; 3]]);
/// A change of a file, and words of its refusal.
type Refused<'a> = (&'a dyn Fn(&mut Value), &'a str);

#[test]
fn every_mode_and_index_type_says_the_same() {
    let expected = [[0, 1, 2], [2, 1, 3]];
    let cases: [ModeCase<'_>; 3] = [
        (4, &[0, 1, 2, 2, 1, 3], &expected),
        (5, &[0, 1, 2, 3], &[[0, 1, 2], [1, 3, 2]]),
        (6, &[1, 3, 2, 0], &[[3, 2, 1], [2, 0, 1]]),
    ];
    for (mode, indices, triangles) in cases {
        for (component, size) in [(5121, 1), (5123, 2), (5125, 4)] {
            let mut made = Made::new();
            let positions = made.floats(&SQUARE);
            let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()[..size].to_vec()).collect();
            let indices = made.accessor(&bytes, component, indices.len(), "SCALAR");
            let mesh = made.primitive(
                json!({ "attributes": { "POSITION": positions }, "indices": indices, "mode": mode }),
            );
            made.node(json!({ "mesh": mesh }));
            let mesh = read(&made.glb());
            assert_eq!((&mesh.triangles[..], mesh.positions.len()), (triangles, 4));
        }
        // Without indices, the vertices are the corners in their order.
        let mut made = Made::new();
        let corners: Vec<[f32; 3]> = indices.iter().map(|i| SQUARE[*i as usize]).collect();
        let positions = made.floats(&corners);
        let mesh = made.primitive(json!({ "attributes": { "POSITION": positions }, "mode": mode }));
        made.node(json!({ "mesh": mesh }));
        let mesh = read(&made.glb());
        assert_eq!(mesh.positions.len(), 4, "corners are joined");
        for (at, triangle) in triangles.iter().enumerate() {
            assert_eq!(mesh.corners(at), triangle.map(|v| SQUARE[v as usize].map(f64::from)));
        }
    }
}

#[test]
fn placements_are_nested_and_mirrors_turn_triangles_over() {
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mut made = Made::new();
    let (positions, normals) = (made.floats(&corners), made.floats(&[[0.0, 0.0, 1.0]; 3]));
    let mesh = made.primitive(json!({ "attributes": { "POSITION": positions, "NORMAL": normals } }));
    // A quarter turn about z, after that moved; within that, twice as wide and mirrored in z.
    let half = 0.5f64.sqrt();
    made.node(json!({ "children": [1, 2], "translation": [10, 0, 0.125], "rotation": [0, 0, half, half] }));
    made.node(json!({ "mesh": mesh, "scale": [2, 1, -1] }));
    made.node(json!({ "mesh": mesh, "matrix": [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 3, 1] }));
    let (mesh, info) = try_read(&made.glb(), Options::default()).unwrap();
    let near = |got: [[f64; 3]; 3], expected: [[f64; 3]; 3]| {
        let most = got.as_flattened().iter().zip(expected.as_flattened()).map(|(a, b)| (a - b).abs());
        assert!(most.fold(0.0, f64::max) < 1e-12, "{got:?} {expected:?}");
    };
    near(mesh.corners(0), [[10.0, 0.0, 0.125], [9.0, 0.0, 0.125], [10.0, 2.0, 0.125]]);
    near(mesh.corners(1), [[10.0, 0.0, 3.125], [10.0, 2.0, 3.125], [9.0, 0.0, 3.125]]);
    assert_eq!((mesh.normals[0], mesh.normals[4]), ([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]));
    assert_eq!((info.vertex_count, info.face_count), (6, 2));
    // Flat, nothing is left of a normal, and nobody minds.
    made.file["nodes"][1]["scale"] = json!([0, 0, 0]);
    let flat = read(&made.glb());
    assert_eq!((flat.triangles.len(), flat.normals[0]), (1, [0.0; 3]));
}

#[test]
fn normals_of_slanted_surfaces_stay_upright() {
    let mut made = Made::new();
    let slope = 0.5f32.sqrt();
    let positions = made.floats(&[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, -1.0]]);
    let normals = made.floats(&[[slope, 0.0, slope]; 3]);
    let mesh = made.primitive(json!({ "attributes": { "POSITION": positions, "NORMAL": normals } }));
    made.node(json!({ "mesh": mesh, "scale": [3, 1, 1] }));
    let mesh = read(&made.glb());
    let [a, _, c] = mesh.corners(0);
    let along: f64 = (0..3).map(|axis| (c[axis] - a[axis]) * f64::from(mesh.normals[0][axis])).sum();
    assert!(along.abs() < 1e-6, "{along}");
}

#[test]
fn joined_vertices_keep_the_first_colour_and_add_their_normals() {
    let corners = [SQUARE[0], SQUARE[1], SQUARE[2], SQUARE[2], SQUARE[1], SQUARE[3]];
    let up = [0.0, 0.0, 1.0];
    let side = [1.0, 0.0, 0.0];
    let file = |order: [usize; 2]| {
        let mut made = Made::new();
        let mut primitives = Vec::new();
        for half in order {
            let positions = made.floats(&corners[3 * half..][..3]);
            let normals = made.floats(&[[up, side][half]; 3]);
            let colors = made.accessor(&[[0, 255, 55], [255, 0, 0]][half].repeat(3), 5121, 3, "VEC3");
            // What forgets to say so is meant so.
            made.file["accessors"][colors]["normalized"] = (half == 1).into();
            let attributes = json!({ "POSITION": positions, "NORMAL": normals, "COLOR_0": colors });
            primitives.push(json!({ "attributes": attributes }));
        }
        made.list("meshes").push(json!({ "primitives": primitives }));
        made.node(json!({ "mesh": 0 }));
        try_read(&made.glb(), Options::default()).unwrap()
    };
    let (mesh, info) = file([0, 1]);
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.colors, [[0, 255, 128, 255], [0, 255, 128, 255], [0, 255, 128, 255], [255, 0, 0, 255]]);
    let between = [0.5f32.sqrt(), 0.0, 0.5f32.sqrt()];
    assert_eq!(mesh.normals, [up, between, between, side]);
    assert!(info.warnings.iter().any(|told| told.contains("2 vertices the sum")), "{:?}", info.warnings);
    assert!(info.warnings.iter().any(|told| told.contains("2 vertices the first of the different colours")));
    assert!(info.warnings.iter().any(|told| told.contains("the integers of 1 primitives' colours")));
    // The sum does not go by the order, the colour does.
    let (mesh, _) = file([1, 0]);
    assert_eq!((mesh.normals[0], mesh.normals[1], mesh.colors[0]), (between, between, [255, 0, 0, 255]));
}

#[test]
fn instances_and_shared_vertices_are_read() {
    let mut made = Made::new();
    let positions = made.floats(&SQUARE);
    let indices = [[0u8, 1, 2], [2, 1, 3]].map(|corners| made.accessor(&corners, 5121, 3, "SCALAR"));
    let primitives = indices.map(|i| json!({ "attributes": { "POSITION": positions }, "indices": i }));
    made.list("meshes").push(json!({ "primitives": primitives }));
    made.file["scenes"][0]["nodes"] = json!([0, 1, 2]);
    made.node(json!({ "mesh": 0 }));
    made.node(json!({ "mesh": 0, "translation": [1, 0, 0] }));
    made.node(json!({}));
    let mesh = read(&made.glb());
    assert_eq!(mesh.triangles.len(), 4);
    // An edge of the one lies at one of the other's, but for a corner.
    assert_eq!(mesh.positions.len(), 7);
}

#[test]
fn sparse_accessors_replace_elements() {
    let mut made = Made::soup(&[SQUARE[0], SQUARE[1], [7.0; 3]]);
    let (indices, values) = (made.view(&[2, 0]), SQUARE[2].map(f32::to_le_bytes));
    let values = made.view(values.as_flattened());
    made.file["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": { "bufferView": indices, "componentType": 5123 }, "values": { "bufferView": values },
    });
    assert_eq!(read(&made.glb()).positions[2], SQUARE[2].map(f64::from));
    let base = made.list("accessors")[0].as_object_mut().unwrap().remove("bufferView");
    assert!(base.is_some());
    assert_eq!(read(&made.glb()).positions, [[0.0; 3], SQUARE[2].map(f64::from)], "the others are zero");
    made.file["accessors"][0]["sparse"]["indices"]["byteOffset"] = 1.into();
    assert!(refusal(&made.file, &made.data).contains("accessor 0"));
}

#[test]
fn integers_are_numbers_or_shares() {
    let mut made = Made::new();
    let bytes: Vec<u8> =
        [0i16, 0, 0, 0, 32767, 0, 0, 0, 0, -32768, 8, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let positions = made.accessor(&bytes, 5122, 3, "VEC3");
    let view = made.file["accessors"][positions]["bufferView"].as_u64().unwrap() as usize;
    made.file["bufferViews"][view]["byteStride"] = 8.into();
    let colors: Vec<u8> = [0.0f32, 0.5, 1.0, 0.25].repeat(3).iter().flat_map(|x| x.to_le_bytes()).collect();
    let colors = made.accessor(&colors, F32, 3, "VEC4");
    let mesh = made.primitive(json!({ "attributes": { "POSITION": positions, "COLOR_0": colors } }));
    made.node(json!({ "mesh": mesh }));
    made.file["extensionsRequired"] = json!(["KHR_mesh_quantization", "KHR_materials_unlit"]);
    let mesh = read(&made.glb());
    assert_eq!(mesh.positions, [[0.0; 3], [32767.0, 0.0, 0.0], [0.0, -32768.0, 8.0]]);
    assert_eq!(mesh.colors[0], [0, 188, 255, 64]);
    made.file["accessors"][positions]["normalized"] = true.into();
    assert_eq!(read(&made.glb()).positions[1..], [[1.0, 0.0, 0.0], [0.0, -1.0, 8.0 / 32767.0]]);
}

#[test]
fn data_lies_beside_it_or_in_it() {
    let made = Made::soup(&SQUARE[..3]);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gltf");
    let mut file = made.file.clone();
    let read = |file: &Value| {
        fs::write(&path, format!("\u{feff}{file}")).unwrap();
        read_file(&path, Options::default(), 1 << 30)
    };
    let base64 = base64_of(&made.data);
    file["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{base64}").into();
    assert_eq!(read(&file).unwrap().0.corners(0), [0, 1, 2].map(|v: usize| SQUARE[v].map(f64::from)));
    file["buffers"][0]["uri"] = "data:application/octet-stream;base64,AAA?".into();
    assert!(read(&file).unwrap_err().contains("buffer 0 is no valid base64"));

    fs::create_dir(dir.path().join("sub")).unwrap();
    fs::write(dir.path().join("sub/my data.bin"), &made.data).unwrap();
    file["buffers"][0]["uri"] = "sub/./my%20data.bin".into();
    let (mesh, info) = read(&file).unwrap();
    assert_eq!((mesh.triangles.len(), info.beside.len()), (1, 1));
    let files = crate::input::files(&path, crate::Images::Ignored, &Cancel::default()).unwrap();
    assert_eq!(files.len(), 2);
    let fingerprint = crate::input::fingerprint(&files, &Cancel::default()).unwrap();
    assert_eq!((info.byte_len, info.hash), fingerprint);

    for (uri, words) in [
        ("none.bin", "none.bin"),
        ("../a.bin", "does not lie beside it"),
        ("sub/../../a.bin", "does not lie beside it"),
        ("/etc/passwd", "does not lie beside it"),
        ("https://example.org/a.bin", "does not lie beside it"),
        ("file:a.bin", "does not lie beside it"),
        ("%2e%2e/a.bin", "does not lie beside it"),
        ("a%2", "no valid URI"),
        ("%00", "no valid URI"),
        ("", "no valid URI"),
    ] {
        file["buffers"][0]["uri"] = uri.into();
        let told = read(&file).unwrap_err();
        assert!(told.contains(words), "{uri}: {told}");
    }
}

/// As an oracle has it.
fn base64_of(bytes: &[u8]) -> String {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let bits: Vec<bool> =
        bytes.iter().flat_map(|byte| (0..8).rev().map(move |i| byte >> i & 1 == 1)).collect();
    let letter = |six: &[bool]| {
        let value = (0..6).fold(0, |sum, i| sum * 2 + usize::from(six.get(i).copied().unwrap_or(false)));
        LETTERS[value] as char
    };
    let mut text: String = bits.chunks(6).map(letter).collect();
    while !text.len().is_multiple_of(4) {
        text.push('=');
    }
    text
}

#[test]
fn meshopt_data_is_what_its_encoders_were_given() {
    let vertices: Vec<[u8; 20]> = (0..1_000u32)
        .map(|i| std::array::from_fn(|k| (i.wrapping_mul(0x9e37_79b9 >> (k % 7)) >> (8 + k % 9)) as u8))
        .collect();
    let packed = ::meshopt::encode_vertex_buffer_level(&vertices, 2, Some(0)).unwrap();
    let view = |mode, stride, count, filter| document::Compressed {
        buffer: 0,
        byte_offset: 0,
        byte_length: 0,
        byte_stride: stride,
        count,
        mode,
        filter,
    };
    use document::{Filter, Mode};
    let plain = view(Mode::Attributes, 20, 1_000, Filter::None);
    assert_eq!(meshopt::decode(&packed, &plain).unwrap(), vertices.as_flattened());
    for cut in (0..packed.len()).step_by(97) {
        assert!(meshopt::decode(&packed[..cut], &plain).is_err());
    }

    let indices: Vec<u32> = (0..30u32)
        .flat_map(|y| {
            (0..40u32).flat_map(move |x| {
                let v = 41 * y + x;
                [v, v + 1, v + 41, v + 41, v + 1, v + 42]
            })
        })
        .chain([5, 900, 17, 1_270, 3, 600])
        .collect();
    let packed = ::meshopt::encode_index_buffer(&indices, 1_271).unwrap();
    let decoded =
        meshopt::decode(&packed, &view(Mode::Triangles, 4, indices.len() as u64, Filter::None)).unwrap();
    let corners = |bytes: &[u8]| {
        let numbers: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
        // A triangle may be turned.
        let turned = |t: &[u32; 3]| {
            let least = (0..3).min_by_key(|i| t[*i]).unwrap();
            [t[least], t[(least + 1) % 3], t[(least + 2) % 3]]
        };
        numbers.as_chunks::<3>().0.iter().map(turned).collect::<Vec<_>>()
    };
    let given: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
    assert_eq!(corners(&decoded), corners(&given));

    // Through the filters, as their encoders have it.
    let numbers = [[1.5f32, -0.25, 1e-3, 1e6], [0.0, 3.0, -7.0, 0.125]];
    let mut exponents = vec![[0u8; 16]; 2];
    for (out, numbers) in exponents.iter_mut().zip(&numbers) {
        for (out, x) in out.as_chunks_mut::<4>().0.iter_mut().zip(numbers) {
            let exponent = if *x == 0.0 { 0 } else { x.abs().log2().ceil() as i32 - 22 };
            let mantissa = (f64::from(*x) * f64::from(-exponent).exp2()).round() as i32;
            *out = (exponent << 24 | mantissa & 0xff_ffff).to_le_bytes();
        }
    }
    let packed = ::meshopt::encode_vertex_buffer_level(&exponents, 2, Some(0)).unwrap();
    let decoded = meshopt::decode(&packed, &view(Mode::Attributes, 16, 2, Filter::Exponential)).unwrap();
    for (bytes, x) in decoded.as_chunks::<4>().0.iter().zip(numbers.as_flattened()) {
        assert!((f32::from_le_bytes(*bytes) - x).abs() <= 1e-6 * x.abs());
    }
    let octahedral =
        [[0u8, 0, 127, 9], [127, 0, 127, 0], [0, 0x81, 127, 0], [64, 63, 127, 0], [0x81, 0x81, 127, 0]];
    let packed = ::meshopt::encode_vertex_buffer_level(&octahedral, 2, Some(0)).unwrap();
    let decoded = meshopt::decode(&packed, &view(Mode::Attributes, 4, 5, Filter::Octahedral)).unwrap();
    let expected = [[0i8, 0, 127, 9], [127, 0, 0, 0], [0, -127, 0, 0], [91, 89, 0, 0], [0, 0, -127, 0]];
    assert_eq!(decoded.iter().map(|b| *b as i8).collect::<Vec<_>>(), expected.as_flattened());
}

#[test]
fn what_is_not_read_is_named() {
    let made = Made::soup(&SQUARE[..3]);
    let told = |change: &dyn Fn(&mut Value)| {
        let mut file = made.file.clone();
        change(&mut file);
        refusal(&file, &made.data)
    };
    let cases: [Refused<'_>; 25] = [
        (&|f| f["asset"]["version"] = "1.0".into(), "glTF 1.0"),
        (&|f| f["asset"] = json!({}), "JSON"),
        (&|f| f["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]), "KHR_draco_mesh_compression"),
        (&|f| f["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]), "EXT_mesh_gpu_instancing"),
        (&|f| f["nodes"][0]["children"] = json!([0]), "node 0"),
        (&|f| f["scenes"][0]["nodes"] = json!([0, 0]), "node 0"),
        (&|f| f["scenes"][0]["nodes"] = json!([1]), "node 1"),
        (&|f| f["scene"] = 1.into(), "scene 1"),
        (&|f| f["nodes"][0]["mesh"] = 1.into(), "mesh 1"),
        (&|f| f["nodes"][0]["rotation"] = json!([0, 0, 0, 0]), "node 0"),
        (&|f| f["nodes"][0]["matrix"] = json!([1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]), "node 0"),
        (&|f| f["meshes"][0]["primitives"][0]["mode"] = 7.into(), "mode 7"),
        (&|f| f["meshes"][0]["primitives"][0]["indices"] = 0.into(), "accessor 0"),
        (&|f| f["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 9.into(), "accessor 9"),
        (&|f| f["accessors"][0]["count"] = 4.into(), "accessor 0"),
        (&|f| f["accessors"][0]["count"] = u64::MAX.into(), "accessor 0"),
        (&|f| f["accessors"][0]["byteOffset"] = u64::MAX.into(), "accessor 0"),
        (&|f| f["accessors"][0]["componentType"] = 5124.into(), "component type 5124"),
        (&|f| f["accessors"][0]["type"] = "MAT4".into(), "Mat4"),
        (&|f| f["bufferViews"][0]["byteLength"] = 1_000.into(), "buffer view 0"),
        (&|f| f["bufferViews"][0]["byteStride"] = 0.into(), "byteStride of 0"),
        (&|f| f["bufferViews"][0]["byteStride"] = 8.into(), "byteStride of its buffer view is 8"),
        (&|f| f["bufferViews"][0]["buffer"] = 3.into(), "buffer 3"),
        (&|f| f["buffers"][0]["byteLength"] = 1_000.into(), "buffer 0"),
        (
            &|f| f["accessors"][0] = json!({ "componentType": 5126, "count": 4e9 as u64, "type": "VEC3" }),
            "would all be zero",
        ),
    ];
    for (change, words) in cases {
        let told = told(change);
        assert!(told.contains("a.glb") && told.contains(words), "{words}: {told}");
    }
}

#[test]
fn points_and_lines_are_counted() {
    let mut made = Made::soup(&SQUARE[..3]);
    let five = made.accessor(&[0, 1, 2, 0, 1], 5121, 5, "SCALAR");
    let primitives = made.file["meshes"][0]["primitives"].as_array_mut().unwrap();
    primitives.push(json!({ "attributes": { "POSITION": 0 }, "mode": 0 }));
    primitives.push(json!({ "attributes": { "POSITION": 0 }, "indices": five }));
    primitives.push(json!({ "attributes": { "POSITION": 0, "TEXCOORD_0": 0 }, "targets": [{}] }));
    made.list("scenes").push(json!({}));
    let (mesh, info) = try_read(&made.glb(), Options::default()).unwrap();
    assert_eq!(mesh.triangles.len(), 3);
    let told = info.warnings.join("\n");
    for words in ["1 primitives of points", "morph", "texture coordinates of 1", "scene 0 of 2", "2 corners"]
    {
        assert!(told.contains(words), "{told}");
    }
}

#[test]
fn invalid_data_is_refused_or_left_out() {
    let mut made = Made::new();
    let positions = made.floats(&[SQUARE[0], SQUARE[1], SQUARE[2], [f32::NAN, 0.0, 0.0]]);
    let indices = made.accessor(&[0, 1, 2, 0, 1, 3, 0, 1, 9, 0, 0, 1], 5121, 12, "SCALAR");
    let mesh = made.primitive(json!({ "attributes": { "POSITION": positions }, "indices": indices }));
    made.node(json!({ "mesh": mesh }));
    assert!(refusal(&made.file, &made.data).contains("NaN"));
    let options = Options { invalid: Invalid::Drop, ..Options::default() };
    let (mesh, info) = try_read(&made.glb(), options).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(
        (info.tally.dropped_vertices, info.tally.dropped_faces, info.tally.degenerate_faces),
        (1, 2, 1)
    );
}

#[test]
fn vertices_without_triangles_need_no_normals() {
    let mut made = Made::new();
    let (positions, normals) = (made.floats(&SQUARE[..3]), made.floats(&[[0.0, 0.0, 1.0]; 3]));
    let others = made.floats(&[SQUARE[3], SQUARE[0]]);
    made.list("meshes").push(json!({ "primitives": [
        { "attributes": { "POSITION": positions, "NORMAL": normals } }, { "attributes": { "POSITION": others } },
    ] }));
    made.node(json!({ "mesh": 0 }));
    assert_eq!(read(&made.glb()).normals, [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0; 3]]);
}

#[test]
fn compressed_files_are_read_alike() {
    let bytes = Made::soup(&SQUARE[..3]).glb();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb.gz");
    let mut gzip =
        flate2::write::GzEncoder::new(fs::File::create(&path).unwrap(), flate2::Compression::fast());
    std::io::Write::write_all(&mut gzip, &bytes).unwrap();
    gzip.finish().unwrap();
    let (mesh, info) = read_file(&path, Options::default(), 1 << 30).unwrap();
    assert_eq!((mesh, &info.encoding[..]), (read(&bytes), "gltf, binary, gzip"));
}

#[test]
fn nodes_may_be_nested_deeply() {
    let mut made = Made::soup(&SQUARE[..3]);
    let depth = 100_000;
    made.file["nodes"] = (1..depth).map(|child| json!({ "children": [child] })).collect();
    made.list("nodes").push(json!({ "mesh": 0 }));
    assert_eq!(read(&made.glb()).triangles.len(), 1);
}

#[test]
fn a_file_that_is_cut_is_refused() {
    let bytes = Made::soup(&SQUARE[..3]).glb();
    for cut in 4..bytes.len() - 3 {
        let told = try_read(&bytes[..cut], Options::default()).expect_err("refused");
        assert!(told.contains("a.glb"), "{cut}: {told}");
    }
}

proptest::proptest! {
    #[test]
    fn damage_is_refused_or_read(at: proptest::sample::Index, byte: u8, more in 0usize..3, drop: bool) {
        let mut made = Made::soup(&SQUARE[..3]);
        made.node(json!({ "mesh": 0, "scale": [-1, 2, 3] }));
        made.file["scenes"][0]["nodes"] = json!([0, 1]);
        let mut bytes = made.glb();
        for step in 0..=more {
            let place = (at.index(bytes.len()) + 37 * step) % bytes.len();
            bytes[place] = byte;
        }
        let invalid = if drop { Invalid::Drop } else { Invalid::Refuse };
        let _ = try_read(&bytes, Options { invalid, ..Options::default() });
    }

    #[test]
    fn any_meshopt_data_is_read_or_refused(bytes: Vec<u8>, header in 0u8..4, count in 0u64..100) {
        let modes = [document::Mode::Attributes, document::Mode::Triangles, document::Mode::Indices];
        for (mode, first) in modes.into_iter().zip([0xa0, 0xe1, 0xd1]) {
            let bytes = [&[first ^ (header / 3)], &bytes[..]].concat();
            let filter = document::Filter::None;
            let view = document::Compressed {
                buffer: 0, byte_offset: 0, byte_length: 0, byte_stride: 4, count: 3 * count, mode, filter,
            };
            let _ = super::meshopt::decode(&bytes, &view);
        }
    }
}
