//! GLB with images: parts of a mesh, each with an image of its own.

use crate::error::{ExportError, expect};
use crate::glb::failed;
use crate::gltf::{Facts, Part, framed, padded};
use chpm_mesh::Aabb;
use serde_json::{Value, json};
use std::io::Write;

/// A part of a mesh, and its image.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct TexturedPart {
    /// Positions of vertices.
    pub positions: Vec<[f32; 3]>,
    /// Their normals, or none.
    pub normals: Vec<[f32; 3]>,
    /// Their places in the image, from its upper left corner, 1 being its whole side.
    pub places: Vec<[f32; 2]>,
    /// Corners of triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Bytes of the image, a JPEG, or a PNG.
    pub image: Vec<u8>,
    /// Whether it is a PNG, some of which is not opaque.
    pub is_png: bool,
}

/// Views and accessors while they are listed.
#[derive(Default)]
struct Tables {
    views: Vec<Value>,
    accessors: Vec<Value>,
    len: u64,
}

impl Tables {
    fn view(&mut self, len: u64, target: Option<u32>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.len, "byteLength": len });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        self.len += padded(len);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats(&mut self, kind: &str, parts: u64, count: u64) -> usize {
        let view = self.view(4 * parts * count, Some(34962));
        self.accessor(json!({ "bufferView": view, "componentType": 5126, "type": kind, "count": count }))
    }
}

/// Writes a GLB of parts.
///
/// # Errors
/// [`ExportError::Count`] for parts of other lengths; [`ExportError::TooLarge`] beyond the 4 GiB that a GLB may have; [`ExportError::Write`].
pub fn write_textured<W: Write>(
    mut writer: W,
    facts: &Facts,
    parts: &[TexturedPart],
) -> Result<W, ExportError> {
    for part in parts {
        let count = part.positions.len() as u64;
        expect("places in images", count, part.places.len() as u64)?;
        if !part.normals.is_empty() {
            expect("normals", count, part.normals.len() as u64)?;
        }
    }
    let (mut tables, mut primitives) = (Tables::default(), Vec::new());
    let (mut images, mut materials) = (Vec::new(), Vec::new());
    for (number, part) in parts.iter().enumerate() {
        let count = part.positions.len() as u64;
        let position = tables.floats("VEC3", 3, count);
        let bounds = Aabb::of_points(&part.positions);
        (tables.accessors[position]["min"], tables.accessors[position]["max"]) =
            (json!(bounds.min.map(f64::from)), json!(bounds.max.map(f64::from)));
        let mut attributes = json!({ "POSITION": position });
        if !part.normals.is_empty() {
            attributes["NORMAL"] = tables.floats("VEC3", 3, count).into();
        }
        attributes["TEXCOORD_0"] = tables.floats("VEC2", 2, count).into();
        let (step, component) = if index_len(part) == 2 { (2, 5123) } else { (4, 5125) };
        let corners = 3 * part.triangles.len() as u64;
        let view = tables.view(step * corners, Some(34963));
        let indices = tables.accessor(
            json!({ "bufferView": view, "componentType": component, "type": "SCALAR", "count": corners }),
        );
        primitives.push(json!({ "attributes": attributes, "indices": indices, "material": number }));
        let view = tables.view(part.image.len() as u64, None);
        let kind = if part.is_png { "image/png" } else { "image/jpeg" };
        images.push(json!({ "bufferView": view, "mimeType": kind }));
        let mut material = json!({
            "doubleSided": true,
            "pbrMetallicRoughness": { "metallicFactor": 0, "baseColorTexture": { "index": number } },
        });
        if part.is_png {
            material["alphaMode"] = "BLEND".into();
        }
        materials.push(material);
    }

    let mut node = facts.placement.node();
    let asset = json!({ "version": "2.0", "generator": facts.generator });
    let mut root = json!({ "asset": asset, "scene": 0, "scenes": [{ "nodes": [0] }] });
    if parts.is_empty() {
        node["extras"] = facts.extras.clone().into();
    } else {
        node["mesh"] = 0.into();
        root["meshes"] = json!([{ "primitives": primitives, "extras": facts.extras }]);
        let textures: Vec<Value> = (0..parts.len()).map(|at| json!({ "source": at, "sampler": 0 })).collect();
        root["textures"] = textures.into();
        // Linear, with mip-maps; nothing repeats.
        root["samplers"] = json!([{ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 }]);
        root["images"] = images.into();
        root["materials"] = materials.into();
        root["accessors"] = tables.accessors.into();
        root["bufferViews"] = tables.views.into();
        root["buffers"] = json!([{ "byteLength": tables.len }]);
    }
    root["nodes"] = json!([node]);
    writer.write_all(&framed(&root, tables.len)?).map_err(failed)?;
    for part in parts {
        body(&mut writer, part)?;
    }
    writer.flush().map_err(failed)?;
    Ok(writer)
}

fn index_len(part: &TexturedPart) -> u64 {
    let (vertices, triangles) = (part.positions.len() as u64, part.triangles.len() as u64);
    Part { vertices, triangles, low: [0.0; 3], high: [0.0; 3], packed: None }.index_len()
}

fn body<W: Write>(writer: &mut W, part: &TexturedPart) -> Result<(), ExportError> {
    let mut put = |bytes: &[u8]| {
        let zeros = padded(bytes.len() as u64) as usize - bytes.len();
        writer.write_all(bytes).and_then(|()| writer.write_all(&[0; 4][..zeros])).map_err(failed)
    };
    let floats = |numbers: &[f32]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    put(&floats(part.positions.as_flattened()))?;
    if !part.normals.is_empty() {
        put(&floats(part.normals.as_flattened()))?;
    }
    put(&floats(part.places.as_flattened()))?;
    let corners = part.triangles.as_flattened().iter();
    match index_len(part) {
        2 => put(&corners.flat_map(|v| (*v as u16).to_le_bytes()).collect::<Vec<u8>>())?,
        _ => put(&corners.flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())?,
    }
    put(&part.image)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Placement;

    #[test]
    fn views_are_where_their_bytes_are() {
        let facts = Facts {
            generator: "test".to_owned(),
            placement: Placement::HERE,
            extras: serde_json::Map::new(),
            scalars: Vec::new(),
        };
        let part = |x: f32, image: &[u8]| TexturedPart {
            positions: vec![[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, -2.0]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            places: vec![[0.0, 0.5], [1.0, 0.25], [0.125, x]],
            triangles: vec![[0, 1, 2]],
            image: image.to_vec(),
            is_png: x > 0.0,
        };
        let parts = [part(0.0, b"first"), part(7.0, b"second!")];
        let bytes = write_textured(Vec::new(), &facts, &parts).unwrap();
        let len = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let json: Value = serde_json::from_slice(&bytes[20..20 + len]).unwrap();
        assert_eq!(u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize, bytes.len());
        let view = |number: &Value| {
            let view = &json["bufferViews"][number.as_u64().unwrap() as usize];
            let [offset, len] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
            bytes[28 + len_of(&bytes) + offset..][..len].to_vec()
        };
        for (number, part) in parts.iter().enumerate() {
            assert_eq!(view(&json["images"][number]["bufferView"]), part.image);
            let primitive = &json["meshes"][0]["primitives"][number];
            let accessor = |value: &Value| &json["accessors"][value.as_u64().unwrap() as usize];
            let places = accessor(&primitive["attributes"]["TEXCOORD_0"]);
            let found: Vec<f32> =
                view(&places["bufferView"]).as_chunks().0.iter().map(|x| f32::from_le_bytes(*x)).collect();
            assert_eq!(found, part.places.as_flattened());
            assert_eq!(view(&accessor(&primitive["indices"])["bufferView"]), [0, 0, 1, 0, 2, 0]);
        }
        let mut wrong = part(0.0, b"");
        wrong.places.pop();
        assert!(matches!(write_textured(Vec::new(), &facts, &[wrong]), Err(ExportError::Count { .. })));
    }

    fn len_of(bytes: &[u8]) -> usize {
        u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize
    }
}
