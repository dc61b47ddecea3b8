//! Invalid PLY files are refused with their place, or dropped and counted.

use super::harness::Folder;
use serde_json::Value;

/// A binary PLY of a grid of `SIDE` by `SIDE` vertices, as its parts, so that tests can spoil any of them.
struct Ply {
    header: String,
    vertices: Vec<[f32; 3]>,
    faces: Vec<[i32; 3]>,
}

const SIDE: i32 = 20;
const FACE_LEN: usize = 13;

impl Ply {
    fn new() -> Self {
        let at = |i: i32| [(i % SIDE) as f32, (i / SIDE) as f32, (i % 7) as f32 * 0.1];
        let corners = |i: i32| {
            let v = i / (SIDE - 1) * SIDE + i % (SIDE - 1);
            [[v, v + 1, v + SIDE], [v + 1, v + SIDE + 1, v + SIDE]]
        };
        let vertices: Vec<[f32; 3]> = (0..SIDE * SIDE).map(at).collect();
        let faces: Vec<[i32; 3]> = (0..(SIDE - 1) * (SIDE - 1)).flat_map(corners).collect();
        let header = Self::header(vertices.len(), faces.len());
        Ply { header, vertices, faces }
    }

    fn header(vertices: usize, faces: usize) -> String {
        format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
             property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = self.header.clone().into_bytes();
        bytes.extend(self.vertices.iter().flatten().flat_map(|x| x.to_le_bytes()));
        for face in &self.faces {
            bytes.push(3);
            bytes.extend(face.iter().flat_map(|v| v.to_le_bytes()));
        }
        bytes
    }

    fn vertex_offset(&self, index: usize) -> usize {
        self.header.len() + 12 * index
    }

    fn face_offset(&self, index: usize) -> usize {
        self.vertex_offset(self.vertices.len()) + FACE_LEN * index
    }
}

/// Builds `bytes`, which must be refused in words that contain all of `expected`, and leave nothing.
fn refused(bytes: &[u8], expected: &[&str]) {
    let folder = Folder::new();
    folder.write("bad.ply", bytes);
    let error = folder.stderr("build bad.ply", 2);
    assert!(error.contains("bad.ply"), "{error}");
    for words in expected {
        assert!(error.contains(words), "{words}: {error}");
    }
    assert_eq!(folder.names(), ["bad.ply"]);
}

/// Builds `bytes` with `--drop-invalid` and answers the repairs; the result must be sound and be what the source
/// has left.
fn dropped(bytes: &[u8]) -> Value {
    let folder = Folder::new();
    folder.write("bad.ply", bytes);
    let report = folder.stdout("build bad.ply --drop-invalid -q --json");
    folder.stdout("verify bad.chpm --against bad.ply -q");
    serde_json::from_str::<Value>(&report).expect("valid JSON")["repairs"].clone()
}

#[test]
fn the_unspoilt_grid_is_built() {
    let folder = Folder::new();
    folder.write("good.ply", Ply::new().bytes());
    folder.stdout("build good.ply -q");
    folder.stdout("verify good.chpm --against good.ply -q");
}

#[test]
fn a_coordinate_that_is_no_number() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut ply = Ply::new();
        ply.vertices[123][1] = value;
        let place = format!("byte {}", ply.vertex_offset(123) + 4);
        refused(&ply.bytes(), &["vertex 123", &place]);
        let repairs = dropped(&ply.bytes());
        // The vertex is inside the grid: six faces use it.
        assert_eq!((&repairs["dropped_vertices"], &repairs["dropped_faces"]), (&1.into(), &6.into()));
    }
}

#[test]
fn an_index_out_of_range() {
    for index in [SIDE * SIDE, i32::MAX, -1, i32::MIN] {
        let mut ply = Ply::new();
        ply.faces[77][2] = index;
        let place = format!("byte {}", ply.face_offset(77) + 1 + 8);
        refused(&ply.bytes(), &["face 77", &place, &index.to_string(), "out of range"]);
        assert_eq!(dropped(&ply.bytes())["dropped_faces"], 1);
    }
}

#[test]
fn a_file_that_ends_early() {
    let ply = Ply::new();
    let bytes = ply.bytes();
    let cut = ply.face_offset(500) + 6;
    refused(&bytes[..cut], &["face", "500", "722"]);
    assert_eq!(dropped(&bytes[..cut])["missing_faces"], 722 - 500);
    refused(&bytes[..ply.vertex_offset(10) + 1], &["vertex", "10", "400"]);
    refused(&bytes[..ply.header.len() - 5], &["header"]);
    refused(&[], &["PLY"]);
}

#[test]
fn a_header_that_lies() {
    let mut ply = Ply::new();
    let (vertices, faces) = (ply.vertices.len(), ply.faces.len());
    ply.header = Ply::header(vertices, 4_000_000_000);
    refused(&ply.bytes(), &["face", "4000000000"]);
    ply.header = Ply::header(4_000_000_000, faces);
    refused(&ply.bytes(), &["vertex", "4000000000"]);
    ply.header = Ply::header(usize::MAX, faces);
    refused(&ply.bytes(), &["vertices"]);
    ply.header = Ply::new().header.replace("element vertex 400\n", "");
    refused(&ply.bytes(), &["header"]);
    ply.header = Ply::new().header.replace("float y", "float why");
    refused(&ply.bytes(), &["'y'"]);
    ply.header = Ply::new().header.replace("binary_little_endian", "zip");
    refused(&ply.bytes(), &["zip"]);
}

#[test]
fn text_that_is_no_number() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 zero 0\n0 1 0\n3 0 1 2\n";
    let offset = text.find("zero").expect("the word");
    refused(text.as_bytes(), &["vertex 1", &format!("byte {offset}"), "line 11", "'zero'"]);
}

#[test]
fn what_no_mesh_file_is() {
    refused(b"solid cube\nendsolid cube\n", &["no faces"]);
    refused(b"A mesh, they said\n", &["text that is no mesh"]);
    refused(&[0x89; 5000], &["no format that is known"]);
}
