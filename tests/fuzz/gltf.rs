//! A mesh as glTF, in the odder ways of writing one.

use crate::dialect::Source;
use crate::draw::Draw;
use crate::model::Model;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};

/// JSON and data while they grow.
#[derive(Default)]
struct File {
    data: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl File {
    /// An accessor of elements of `width` numbers, by a view with a stride, and some of them sparse.
    fn accessor(&mut self, elements: &[Vec<u8>], kind: (u32, &str, bool), draw: &mut Draw<'_>) -> usize {
        let (component, shape, normalized) = kind;
        let len = elements.first().map_or(0, Vec::len);
        let stride = if draw.once_in(3) { Some(len.next_multiple_of(4) + 4 * draw.below(3)) } else { None };
        let (pad, replaced) = (draw.below(5), draw.once_in(6) && !elements.is_empty());
        let kept = |at: usize| !replaced || !at.is_multiple_of(3);

        let mut bytes = vec![0x55; pad];
        for (at, element) in elements.iter().enumerate() {
            let end = bytes.len() + stride.unwrap_or(len);
            if kept(at) {
                bytes.extend(element)
            } else {
                bytes.resize(bytes.len() + len, 0xee)
            }
            bytes.resize(end, 0);
        }
        let mut accessor = json!({
            "bufferView": self.view(&bytes, stride), "byteOffset": pad, "componentType": component,
            "count": elements.len(), "type": shape,
        });
        if normalized {
            accessor["normalized"] = true.into();
        }
        if replaced {
            let others = (0..elements.len()).filter(|at| !kept(*at));
            let indices: Vec<u8> = others.clone().flat_map(|at| (at as u32).to_le_bytes()).collect();
            let values: Vec<u8> = others.flat_map(|at| elements[at].clone()).collect();
            let count = indices.len() / 4;
            let (indices, values) = (self.view(&indices, None), self.view(&values, None));
            accessor["sparse"] = json!({
                "count": count, "indices": { "bufferView": indices, "componentType": 5125 },
                "values": { "bufferView": values },
            });
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len() });
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        self.data.extend(bytes);
        self.views.push(view);
        self.views.len() - 1
    }
}

pub(crate) fn write(model: &Model, draw: &mut Draw<'_>) -> Source {
    let mut file = File::default();
    let floats = |numbers: &[f32]| -> Vec<u8> { numbers.iter().flat_map(|x| x.to_le_bytes()).collect() };
    let positions: Vec<Vec<u8>> = model.positions.iter().map(|p| floats(&p.map(|x| x as f32))).collect();
    let mut attributes = json!({ "POSITION": file.accessor(&positions, (5126, "VEC3", false), draw) });
    if !model.normals.is_empty() {
        let normals: Vec<Vec<u8>> = model.normals.iter().map(|n| floats(n)).collect();
        attributes["NORMAL"] = file.accessor(&normals, (5126, "VEC3", false), draw).into();
    }
    if !model.colors.is_empty() {
        let width = draw.pick(&[3, 4]);
        let shape = if width == 3 { "VEC3" } else { "VEC4" };
        let kind = draw.pick(&[5121, 5123, 5126]);
        let of = |color: &[u8; 4]| -> Vec<u8> {
            let channels = color[..width].iter();
            match kind {
                5121 => channels.copied().collect(),
                5123 => channels.flat_map(|x| (257 * u16::from(*x)).to_le_bytes()).collect(),
                _ => channels.flat_map(|x| (f32::from(*x) / 255.0).to_le_bytes()).collect(),
            }
        };
        let colors: Vec<Vec<u8>> = model.colors.iter().map(of).collect();
        attributes["COLOR_0"] = file.accessor(&colors, (kind, shape, kind != 5126), draw).into();
    }

    let mut primitives = Vec::new();
    let parts = draw.between(1, 3);
    for faces in model.faces.chunks(model.faces.len().div_ceil(parts).max(1)) {
        let fans = faces.iter().filter(|face| face.len() >= 3);
        let corners = fans.flat_map(|face| face.windows(2).skip(1).map(|pair| [face[0], pair[0], pair[1]]));
        let corners: Vec<[i64; 3]> = corners.collect();
        let (kind, size) = draw.pick(&[(5125, 4), (5125, 4), (5123, 2), (5121, 1)]);
        let mode = draw.pick(&[4, 4, 4, 4, 5, 6, 0]);
        let indices = corners.as_flattened().iter().map(|v| v.to_le_bytes()[..size].to_vec());
        let indices: Vec<Vec<u8>> = indices.collect();
        let indices = file.accessor(&indices, (kind, "SCALAR", false), draw);
        primitives.push(json!({ "attributes": attributes, "indices": indices, "mode": mode }));
    }
    if draw.once_in(6) {
        primitives.push(json!({ "attributes": attributes }));
    }

    let nodes = match draw.below(5) {
        0 => json!([{ "mesh": 0, "scale": [-1, 1, 1] }]),
        1 => json!([{ "children": [1, 2], "rotation": [0.5, 0.5, 0.5, 0.5] }, { "mesh": 0 },
            { "mesh": 0, "translation": [3, 0, 1e6], "scale": [1, 0, 2] }]),
        2 => json!([{ "mesh": 0, "matrix": [2, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0.1, 0, 0, 1] }]),
        3 => json!([{ "children": [1] }, { "mesh": 0, "children": [draw.below(3)] }]),
        _ => json!([{ "mesh": 0 }]),
    };
    let text = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": nodes,
        "meshes": [{ "primitives": primitives }], "accessors": file.accessors, "bufferViews": file.views,
        "buffers": [{ "byteLength": file.data.len() }],
    });
    contained(text, file.data, draw)
}

/// The container: one file, or two.
fn contained(mut text: Value, data: Vec<u8>, draw: &mut Draw<'_>) -> Source {
    let name = |name: &str| name.to_owned();
    match draw.below(4) {
        0 => {
            text["buffers"][0]["uri"] = format!("data:;base64,{}", BASE64_STANDARD.encode(&data)).into();
            Source { name: name("mesh.gltf"), bytes: text.to_string().into_bytes(), beside: vec![] }
        }
        1 => {
            text["buffers"][0]["uri"] = "a%2ebin".into();
            let bytes = format!("{text:#}").into_bytes();
            Source { name: name("mesh.gltf"), bytes, beside: vec![(name("a.bin"), data)] }
        }
        _ => {
            let mut json = text.to_string().into_bytes();
            json.resize(json.len().next_multiple_of(4), b' ');
            let mut bytes = b"glTF".to_vec();
            for word in [2, 28 + json.len() + data.len(), json.len()] {
                bytes.extend((word as u32).to_le_bytes());
            }
            bytes.extend(b"JSON");
            bytes.extend(json);
            bytes.extend((data.len() as u32).to_le_bytes());
            bytes.extend(b"BIN\0");
            bytes.extend(data);
            Source { name: name("mesh.glb"), bytes, beside: vec![] }
        }
    }
}
