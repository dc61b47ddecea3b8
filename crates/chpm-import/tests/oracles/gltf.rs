//! GLB, beside the crate `gltf`: index types, strips and fans, interleaved and sparse data, nodes that are nested, used twice, and mirrored.

use super::{Face, Fixture, assert_same, fixtures, ours, single};
use gltf::mesh::Mode;
use gltf::{Gltf, Node};
use serde_json::{Value, json};

/// How the positions and corners of a mesh are written.
#[derive(Clone, Copy, Debug)]
enum Form {
    /// Without indices.
    Soup,
    /// With indices of the smallest type, and positions of another element between.
    Interleaved,
    /// With indices of 32 bits; every third position is replaced by a sparse one.
    Sparse,
    /// All vertices in their order, as they are, too.
    Strip,
    Fan,
}

const FORMS: [Form; 5] = [Form::Soup, Form::Interleaved, Form::Sparse, Form::Strip, Form::Fan];

/// A file that grows.
struct Made {
    file: Value,
    data: Vec<u8>,
}

fn push(file: &mut Value, list: &str, value: Value) -> usize {
    let list = file[list].as_array_mut().unwrap();
    list.push(value);
    list.len() - 1
}

fn bytes_of(points: &[[f64; 3]]) -> Vec<u8> {
    points.as_flattened().iter().flat_map(|x| (*x as f32).to_le_bytes()).collect()
}

impl Made {
    fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len() });
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        self.data.extend(bytes);
        push(&mut self.file, "bufferViews", view)
    }

    fn positions(&mut self, points: &[[f64; 3]], form: Form) -> usize {
        let mut accessor = json!({ "componentType": 5126, "count": points.len(), "type": "VEC3" });
        match form {
            Form::Interleaved => {
                let rows = points.iter().flat_map(|point| [bytes_of(&[*point]), vec![0xaa; 8]].concat());
                accessor["bufferView"] = self.view(&rows.collect::<Vec<u8>>(), Some(20)).into();
            }
            Form::Sparse => {
                let replaced: Vec<u32> = (0..points.len() as u32).step_by(3).collect();
                let values: Vec<_> = replaced.iter().map(|v| points[*v as usize]).collect();
                let mut dense = points.to_vec();
                replaced.iter().for_each(|v| dense[*v as usize] = [7.0; 3]);
                accessor["bufferView"] = self.view(&bytes_of(&dense), None).into();
                let indices: Vec<u8> = replaced.iter().flat_map(|v| v.to_le_bytes()).collect();
                let indices = json!({ "bufferView": self.view(&indices, None), "componentType": 5125 });
                let values = json!({ "bufferView": self.view(&bytes_of(&values), None) });
                accessor["sparse"] = json!({ "count": replaced.len(), "indices": indices, "values": values });
            }
            _ => accessor["bufferView"] = self.view(&bytes_of(points), None).into(),
        }
        push(&mut self.file, "accessors", accessor)
    }

    fn indices(&mut self, corners: &[u32], form: Form) -> usize {
        let largest = corners.iter().max().copied().unwrap_or(0);
        // The largest number of a type restarts a primitive.
        let (component, size) = match (form, largest) {
            (Form::Interleaved, ..255) => (5121, 1),
            (Form::Interleaved, ..65_535) => (5123, 2),
            _ => (5125, 4),
        };
        let bytes: Vec<u8> = corners.iter().flat_map(|v| v.to_le_bytes()[..size].to_vec()).collect();
        let view = self.view(&bytes, None);
        let accessor = json!({ "bufferView": view, "componentType": component, "count": corners.len(), "type": "SCALAR" });
        push(&mut self.file, "accessors", accessor)
    }

    fn primitives(&mut self, fixture: &Fixture, form: Form) -> Value {
        let corners: Vec<u32> = fixture.faces.concat();
        if let Form::Soup = form {
            let points: Vec<_> = corners.iter().map(|v| fixture.points[*v as usize]).collect();
            return json!([{ "attributes": { "POSITION": self.positions(&points, form) } }]);
        }
        let positions = json!({ "POSITION": self.positions(&fixture.points, form) });
        let indices = self.indices(&corners, form);
        let mut primitives = vec![json!({ "attributes": positions, "indices": indices })];
        match form {
            Form::Strip => primitives.push(json!({ "attributes": positions, "mode": 5 })),
            Form::Fan => primitives.push(json!({ "attributes": positions, "mode": 6, "indices": indices })),
            _ => {}
        }
        primitives.into()
    }
}

/// A mesh at several places; no number of theirs is rounded on the way.
fn write(fixture: &Fixture, form: Form) -> Vec<u8> {
    let nodes = json!([
        { "children": [1, 2], "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 16, -8, 4, 1] },
        { "mesh": 0, "rotation": [0.5, 0.5, 0.5, 0.5], "scale": [2, 2, 2], "children": [3] },
        { "mesh": 0, "scale": [-1, 1, 1], "translation": [32, 0, 0] },
        { "mesh": 0, "translation": [0, 64, 0], "rotation": [0, 0, 1, 0], "scale": [0.5, -2, -4] },
        { "mesh": 0 },
    ]);
    let file = json!({
        "asset": { "version": "2.0" }, "buffers": [{}], "bufferViews": [], "accessors": [], "meshes": [],
        "nodes": nodes, "scenes": [{ "nodes": [0, 4] }], "scene": 0,
    });
    let mut made = Made { file, data: Vec::new() };
    let primitives = made.primitives(fixture, form);
    push(&mut made.file, "meshes", json!({ "primitives": primitives }));
    made.data.resize(made.data.len().next_multiple_of(4), 0);
    made.file["buffers"][0]["byteLength"] = made.data.len().into();

    let mut text = made.file.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    for word in [2, 28 + text.len() + made.data.len(), text.len()] {
        bytes.extend((word as u32).to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(&text);
    bytes.extend((made.data.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(made.data);
    bytes
}

type Columns = [[f64; 4]; 4];

fn product(a: &Columns, b: &Columns) -> Columns {
    b.map(|column| [0, 1, 2, 3].map(|row| (0..4).map(|i| a[i][row] * column[i]).sum()))
}

fn determinant([a, b, c, _]: &Columns) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) - b[0] * (a[1] * c[2] - a[2] * c[1])
        + c[0] * (a[1] * b[2] - a[2] * b[1])
}

/// Corners of the triangles of a primitive.
fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    let count = corners.len().saturating_sub(2);
    match mode {
        Mode::Triangles => corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
        Mode::TriangleStrip => {
            (0..count).map(|i| [corners[i], corners[i + 1 + i % 2], corners[i + 2 - i % 2]]).collect()
        }
        Mode::TriangleFan => (0..count).map(|i| [corners[i + 1], corners[i + 2], corners[0]]).collect(),
        other => panic!("{other:?} is not written"),
    }
}

fn read(node: &Node<'_>, above: &Columns, blob: &[u8], faces: &mut Vec<Face>) {
    let own = node.transform().matrix().map(|column| column.map(f64::from));
    let world = product(above, &own);
    for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
        let reader = primitive.reader(|_| Some(blob));
        let points: Vec<[f64; 3]> = reader
            .read_positions()
            .unwrap()
            .map(|point| {
                let [x, y, z] = point.map(f64::from);
                [0, 1, 2].map(|i| world[0][i] * x + world[1][i] * y + world[2][i] * z + world[3][i])
            })
            .collect();
        let corners: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..points.len() as u32).collect(),
        };
        for [a, b, c] in triangles(primitive.mode(), &corners) {
            let face = if determinant(&world) < 0.0 { [a, c, b] } else { [a, b, c] };
            faces.push(face.map(|corner| points[corner as usize]).to_vec());
        }
    }
    node.children().for_each(|child| read(&child, &world, blob, faces));
}

fn theirs(bytes: &[u8]) -> Vec<Face> {
    // It wants bounds of positions, which nobody needs.
    let file = Gltf::from_slice_without_validation(bytes).unwrap();
    let one: Columns = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| f64::from(u8::from(i == j))));
    let mut faces = Vec::new();
    for node in file.default_scene().unwrap().nodes() {
        read(&node, &one, file.blob.as_deref().unwrap(), &mut faces);
    }
    faces
}

/// Triangles that begin at the least of their corners, as they turn; those without an area, of which readers make what they like, left out.
fn turned(mut faces: Vec<Face>) -> Vec<Face> {
    faces.retain(|face| face[0] != face[1] && face[1] != face[2] && face[2] != face[0]);
    for face in &mut faces {
        let first = (0..3).min_by(|a, b| face[*a].partial_cmp(&face[*b]).unwrap()).unwrap();
        face.rotate_left(first);
    }
    faces
}

#[test]
fn gltf_reads_the_same_glb() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.glb");
    for fixture in fixtures().into_iter().filter(Fixture::is_of_triangles) {
        for form in FORMS {
            let bytes = write(&fixture, form);
            std::fs::write(&path, &bytes).unwrap();
            let [ours, theirs] = [ours(&path), theirs(&bytes)].map(|faces| turned(single(faces)));
            assert!(theirs.len() >= 3 * fixture.faces.len(), "{form:?} of {}", fixture.name);
            assert_same(&format!("{form:?}"), fixture.name, ours, theirs.clone(), theirs);
        }
    }
}
