//! A reader of GLB for tests: all primitives of one mesh, packed or not.

use chpm_mesh::TriMesh;
use serde_json::Value;

/// What a GLB holds.
pub(crate) struct Glb {
    pub(crate) json: Value,
    /// As it is in the buffers, primitives one after the other.
    pub(crate) mesh: TriMesh,
    /// Linear, 16 bits.
    pub(crate) colors: Vec<[u16; 4]>,
}

fn number(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize
}

fn field(value: &Value, name: &str) -> usize {
    value.get(name).map_or(0, |value| value.as_u64().expect("a whole number") as usize)
}

fn unpacked<const N: usize>(bytes: &[u8], count: usize) -> Vec<u8> {
    // Arrays of this length have no default.
    assert_eq!(N % 4, 0);
    match N {
        12 => meshopt::decode_vertex_buffer::<[u32; 3]>(bytes, count)
            .map(|all| bytemuck::cast_slice(&all).to_vec()),
        20 => meshopt::decode_vertex_buffer::<[u32; 5]>(bytes, count)
            .map(|all| bytemuck::cast_slice(&all).to_vec()),
        24 => meshopt::decode_vertex_buffer::<[u32; 6]>(bytes, count)
            .map(|all| bytemuck::cast_slice(&all).to_vec()),
        _ => meshopt::decode_vertex_buffer::<[u32; 8]>(bytes, count)
            .map(|all| bytemuck::cast_slice(&all).to_vec()),
    }
    .expect("a vertex buffer")
}

/// The bytes of a view.
fn view(json: &Value, body: &[u8], number: &Value) -> Vec<u8> {
    let view = &json["bufferViews"][number.as_u64().expect("a view") as usize];
    let plain = |of: &Value| body[field(of, "byteOffset")..][..field(of, "byteLength")].to_vec();
    let packed = &view["extensions"]["EXT_meshopt_compression"];
    if packed.is_null() {
        assert_eq!(field(view, "buffer"), 0);
        return plain(view);
    }
    assert_eq!(field(view, "buffer"), 1, "the buffer that is not there");
    let (bytes, count, step) = (plain(packed), field(packed, "count"), field(packed, "byteStride"));
    let bytes = match (packed["mode"].as_str(), step) {
        (Some("ATTRIBUTES"), 12) => unpacked::<12>(&bytes, count),
        (Some("ATTRIBUTES"), 20) => unpacked::<20>(&bytes, count),
        (Some("ATTRIBUTES"), 24) => unpacked::<24>(&bytes, count),
        (Some("ATTRIBUTES"), 32) => unpacked::<32>(&bytes, count),
        (Some("TRIANGLES"), 2) => {
            let indices: Vec<u16> = meshopt::decode_index_buffer(&bytes, count).expect("an index buffer");
            bytemuck::cast_slice(&indices).to_vec()
        }
        other => panic!("{other:?}"),
    };
    assert_eq!(bytes.len(), field(view, "byteLength"));
    bytes
}

impl Glb {
    pub(crate) fn read(bytes: &[u8]) -> Glb {
        assert_eq!((&bytes[..4], number(bytes, 4), number(bytes, 8)), (&b"glTF"[..], 2, bytes.len()));
        let len = number(bytes, 12);
        assert_eq!(&bytes[16..20], b"JSON");
        let json: Value = serde_json::from_slice(&bytes[20..20 + len]).expect("JSON");
        let body = if 20 + len < bytes.len() {
            assert_eq!(
                (number(bytes, 20 + len), &bytes[24 + len..28 + len]),
                (bytes.len() - len - 28, &b"BIN\0"[..])
            );
            &bytes[28 + len..]
        } else {
            &[]
        };
        let mut glb = Glb { json: json.clone(), mesh: TriMesh::default(), colors: Vec::new() };
        for primitive in json["meshes"][0]["primitives"].as_array().map_or(&[][..], Vec::as_slice) {
            glb.take(&json, body, primitive);
        }
        glb
    }

    fn take(&mut self, json: &Value, body: &[u8], primitive: &Value) {
        let accessor = |number: &Value| &json["accessors"][number.as_u64().expect("an accessor") as usize];
        let first = self.mesh.positions.len() as u32;
        let rows = |name: &str, len: usize| -> Vec<Vec<u8>> {
            let Some(number) = primitive["attributes"].get(name) else { return Vec::new() };
            let of = accessor(number);
            let bytes = view(json, body, &of["bufferView"]);
            let step = field(&json["bufferViews"][field(of, "bufferView")], "byteStride");
            let row = |i: usize| bytes[i * step + field(of, "byteOffset")..][..len].to_vec();
            (0..field(of, "count")).map(row).collect()
        };
        let floats = |row: &Vec<u8>| -> [f32; 3] {
            std::array::from_fn(|i| f32::from_le_bytes(row[4 * i..][..4].try_into().expect("four bytes")))
        };
        let positions: Vec<[f32; 3]> = rows("POSITION", 12).iter().map(floats).collect();
        let of = accessor(&primitive["attributes"]["POSITION"]);
        for axis in 0..3 {
            let all = positions.iter().map(|p| p[axis]);
            let ends = (all.clone().fold(f32::INFINITY, f32::min), all.fold(f32::NEG_INFINITY, f32::max));
            // The parser may be off by the last bit of a double.
            let told = |name: &str| of[name][axis].as_f64().map(|x| x as f32);
            assert_eq!((told("min"), told("max")), (Some(ends.0), Some(ends.1)));
        }
        self.mesh.normals.extend(rows("NORMAL", 12).iter().map(floats));
        let shorts = |row: &Vec<u8>| -> [u16; 4] {
            std::array::from_fn(|i| u16::from_le_bytes([row[2 * i], row[2 * i + 1]]))
        };
        self.colors.extend(rows("COLOR_0", 8).iter().map(shorts));
        self.mesh.positions.extend(positions);

        let of = accessor(&primitive["indices"]);
        let bytes = view(json, body, &of["bufferView"]);
        let indices: Vec<u32> = match field(of, "componentType") {
            5123 => bytes.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b).into()).collect(),
            _ => bytes.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect(),
        };
        assert_eq!(indices.len(), field(of, "count"));
        let triangles = indices.as_chunks::<3>().0.iter();
        self.mesh.triangles.extend(triangles.map(|corners| corners.map(|v| first + v)));
    }

    /// What the mesh, or the node of none, tells.
    pub(crate) fn extras(&self) -> &Value {
        let of_mesh = &self.json["meshes"][0]["extras"];
        if of_mesh.is_null() { &self.json["nodes"][0]["extras"] } else { of_mesh }
    }
}
