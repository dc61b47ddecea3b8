//! A reader of glTF for tests, in either container. It keeps to the specification alone: checks where views and accessors lie and what they tell, and
//! hands out meshes where their nodes place them.

use super::harness::Folder;
use serde_json::Value;

/// A glTF and its buffers.
pub(crate) struct Gltf {
    pub(crate) json: Value,
    /// By view, its bytes.
    views: Vec<Vec<u8>>,
}

/// The mesh of a node; numbers as a reader has them.
#[derive(Default, Debug)]
pub(crate) struct Placed {
    /// As the buffer has them.
    pub(crate) stored: Vec<[f64; 3]>,
    /// Where the node places them.
    pub(crate) positions: Vec<[f64; 3]>,
    pub(crate) normals: Vec<[f64; 3]>,
    pub(crate) colors: Vec<[f64; 4]>,
    pub(crate) places: Vec<[f64; 2]>,
    pub(crate) triangles: Vec<[usize; 3]>,
}

fn number(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize
}

fn field(value: &Value, name: &str) -> usize {
    value.get(name).map_or(0, |value| value.as_u64().expect("a whole number") as usize)
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// A name out of a relative address.
pub(crate) fn decoded(uri: &str) -> String {
    assert!(uri.bytes().all(|byte| byte.is_ascii_graphic()), "{uri}");
    let (mut bytes, mut rest) = (Vec::new(), uri.bytes());
    while let Some(byte) = rest.next() {
        bytes.push(if byte == b'%' {
            let digits = [rest.next(), rest.next()].map(|digit| char::from(digit.expect("a digit")));
            u8::from_str_radix(&digits.iter().collect::<String>(), 16).expect("two digits")
        } else {
            byte
        });
    }
    String::from_utf8(bytes).expect("UTF-8")
}

/// Bytes and whether they are normalized and what they are divided by then.
fn component(kind: usize) -> (usize, f64) {
    match kind {
        5120 => (1, 127.0),
        5121 => (1, 255.0),
        5122 => (2, 32_767.0),
        5123 => (2, 65_535.0),
        5125 => (4, f64::NAN),
        5126 => (4, f64::NAN),
        other => panic!("component type {other}"),
    }
}

fn value(bytes: &[u8], kind: usize) -> f64 {
    match kind {
        5120 => f64::from(bytes[0].cast_signed()),
        5121 => f64::from(bytes[0]),
        5122 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
        5123 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        5125 => number(bytes, 0) as f64,
        _ => f64::from(f32::from_le_bytes(bytes[..4].try_into().expect("four bytes"))),
    }
}

fn unpacked<const N: usize>(bytes: &[u8], count: usize) -> Vec<u8>
where
    [u8; N]: Default + bytemuck::Pod,
{
    let items = meshopt::decode_vertex_buffer::<[u8; N]>(bytes, count).expect("a vertex buffer");
    items.into_iter().flatten().collect()
}

/// What `EXT_meshopt_compression` has packed.
fn unpack(of: &Value, bytes: &[u8]) -> Vec<u8> {
    let (count, step) = (field(of, "count"), field(of, "byteStride"));
    match (of["mode"].as_str(), step) {
        (Some("ATTRIBUTES"), 4) => unpacked::<4>(bytes, count),
        (Some("ATTRIBUTES"), 8) => unpacked::<8>(bytes, count),
        (Some("ATTRIBUTES"), 12) => unpacked::<12>(bytes, count),
        (Some("ATTRIBUTES"), 16) => unpacked::<16>(bytes, count),
        (Some("ATTRIBUTES"), 20) => unpacked::<20>(bytes, count),
        (Some("ATTRIBUTES"), 24) => unpacked::<24>(bytes, count),
        (Some("ATTRIBUTES"), 32) => unpacked::<32>(bytes, count),
        (Some("TRIANGLES"), 2) => {
            let indices: Vec<u16> = meshopt::decode_index_buffer(bytes, count).expect("an index buffer");
            indices.iter().flat_map(|index| index.to_le_bytes()).collect()
        }
        (Some("TRIANGLES"), 4) => {
            let indices: Vec<u32> = meshopt::decode_index_buffer(bytes, count).expect("an index buffer");
            indices.iter().flat_map(|index| index.to_le_bytes()).collect()
        }
        other => panic!("{other:?}"),
    }
}

impl Gltf {
    pub(crate) fn open(folder: &Folder, name: &str) -> Gltf {
        let bytes = folder.read(name);
        let (json, inside): (Value, Vec<u8>) = if bytes.starts_with(b"glTF") {
            assert_eq!((number(&bytes, 4), number(&bytes, 8)), (2, bytes.len()));
            let len = number(&bytes, 12);
            let body = bytes.get(28 + len..).unwrap_or(&[]).to_vec();
            (serde_json::from_slice(&bytes[20..20 + len]).expect("JSON"), body)
        } else {
            (serde_json::from_slice(&bytes).expect("JSON"), Vec::new())
        };
        assert_eq!(json["asset"]["version"], "2.0");
        let buffer = |buffer: &Value| {
            let bytes = match buffer["uri"].as_str() {
                Some(uri) => folder.read(&decoded(uri)),
                None => inside.clone(),
            };
            let is_there = buffer["extensions"].is_null();
            assert!(!is_there || bytes.len() == field(buffer, "byteLength"), "{buffer}");
            bytes
        };
        let buffers: Vec<Vec<u8>> = list(&json["buffers"]).iter().map(buffer).collect();
        let view = |view: &Value| {
            let packed = &view["extensions"]["EXT_meshopt_compression"];
            let of = if packed.is_null() { view } else { packed };
            let (offset, len) = (field(of, "byteOffset"), field(of, "byteLength"));
            assert_eq!(offset % 4, 0, "{view}");
            let bytes = buffers[field(of, "buffer")][offset..offset + len].to_vec();
            if packed.is_null() { bytes } else { unpack(packed, &bytes) }
        };
        let views = list(&json["bufferViews"]).iter().map(view).collect();
        let gltf = Gltf { json, views };
        let used: Vec<&str> = list(&gltf.json["extensionsUsed"]).iter().filter_map(Value::as_str).collect();
        for required in list(&gltf.json["extensionsRequired"]) {
            assert!(used.contains(&required.as_str().expect("a name")), "{required}");
        }
        gltf
    }

    /// Whether readers have to know an extension, or may do without, or it is not there.
    pub(crate) fn extension(&self, name: &str) -> Option<bool> {
        let names = |key: &str| list(&self.json[key]).iter().any(|known| known == name);
        names("extensionsUsed").then(|| names("extensionsRequired"))
    }

    /// The rows of an accessor.
    fn rows<const N: usize>(&self, at: &Value, is_vertex: bool) -> Vec<[f64; N]> {
        let of = &self.json["accessors"][at.as_u64().expect("an accessor") as usize];
        let view = &self.json["bufferViews"][field(of, "bufferView")];
        let (bytes, kind) = (&self.views[field(of, "bufferView")], field(of, "componentType"));
        let (size, most) = component(kind);
        let step = if view.get("byteStride").is_some() { field(view, "byteStride") } else { N * size };
        let offset = field(of, "byteOffset");
        assert!(!is_vertex || (step.is_multiple_of(4) && offset.is_multiple_of(4)), "{of} {view}");
        assert!(offset.is_multiple_of(size) && offset + N * size <= step, "{of} {view}");
        let is_normalized = of["normalized"] == true;
        let names = ["", "SCALAR", "VEC2", "VEC3", "VEC4"];
        assert_eq!(of["type"], names[N], "{of}");
        let stored: Vec<[f64; N]> = (0..field(of, "count"))
            .map(|row| std::array::from_fn(|i| value(&bytes[row * step + offset + i * size..], kind)))
            .collect();
        for (name, start, pick) in
            [("min", f64::INFINITY, f64::min as fn(f64, f64) -> f64), ("max", f64::NEG_INFINITY, f64::max)]
        {
            for (axis, told) in list(&of[name]).iter().enumerate() {
                let end = stored.iter().map(|row| row[axis]).fold(start, pick);
                // The parser may be off by the last bit of a double.
                assert!((told.as_f64().expect("a number") as f32 - end as f32) == 0.0, "{of}: {end}");
            }
        }
        let read = |x: f64| if is_normalized { (x / most).max(-1.0) } else { x };
        stored.into_iter().map(|row| row.map(read)).collect()
    }

    /// Where a node places a point.
    fn placed(node: &Value, point: [f64; 3]) -> [f64; 3] {
        let numbers = |name: &str, otherwise: f64| -> [f64; 3] {
            [0, 1, 2].map(|axis| node[name][axis].as_f64().unwrap_or(otherwise))
        };
        if let Some(matrix) = node["matrix"].as_array() {
            assert!(node.get("translation").is_none() && node.get("scale").is_none(), "{node}");
            let at = |row: usize, column: usize| matrix[4 * column + row].as_f64().expect("a number");
            return [0, 1, 2]
                .map(|row| (0..3).map(|axis| at(row, axis) * point[axis]).sum::<f64>() + at(row, 3));
        }
        let (scale, translation) = (numbers("scale", 1.0), numbers("translation", 0.0));
        [0, 1, 2].map(|axis| scale[axis] * point[axis] + translation[axis])
    }

    /// The mesh of a node, all primitives one after the other.
    pub(crate) fn mesh(&self, node: usize) -> Placed {
        let node = &self.json["nodes"][node];
        let mut all = Placed::default();
        let Some(mesh) = node.get("mesh") else { return all };
        let mesh = &self.json["meshes"][mesh.as_u64().expect("a mesh") as usize];
        for primitive in list(&mesh["primitives"]) {
            let attributes = &primitive["attributes"];
            let position = &self.json["accessors"][field(attributes, "POSITION")];
            assert!(position["min"].is_array() && position["max"].is_array(), "{position}");
            let first = all.positions.len();
            let stored = self.rows::<3>(&attributes["POSITION"], true);
            all.positions.extend(stored.iter().map(|point| Self::placed(node, *point)));
            all.stored.extend(stored);
            if let Some(at) = attributes.get("NORMAL") {
                all.normals.extend(self.rows::<3>(at, true));
            }
            if let Some(at) = attributes.get("COLOR_0") {
                all.colors.extend(self.rows::<4>(at, true));
            }
            if let Some(at) = attributes.get("TEXCOORD_0") {
                all.places.extend(self.rows::<2>(at, true));
            }
            let corners = self.rows::<1>(&primitive["indices"], false);
            let corner = |at: usize| first + corners[at][0] as usize;
            all.triangles.extend((0..corners.len() / 3).map(|t| [0, 1, 2].map(|i| corner(3 * t + i))));
        }
        assert!(all.triangles.iter().flatten().all(|corner| *corner < all.positions.len()));
        all
    }

    /// Component type of an attribute of the first primitive of a mesh.
    pub(crate) fn kind(&self, mesh: usize, attribute: &str) -> usize {
        let attributes = &self.json["meshes"][mesh]["primitives"][0]["attributes"];
        field(&self.json["accessors"][field(attributes, attribute)], "componentType")
    }
}
