//! glTF with images: parts of a mesh, each with an image of its own.

use crate::container::{Container, uri};
use crate::error::{ExportError, expect};
use crate::gltf::{Facts, MESHOPT, Part, padded, position, unpacked_nowhere};
use crate::grid::Grid;
use crate::packed_glb::{packed_indices, packed_vertices};
use crate::scene::document;
use crate::vertex::{small_direction, small_position, unit};
use bytemuck::Pod;
use chpm_mesh::Aabb;
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Write;

/// Targets of views: of vertices, and of indices.
const ARRAY: u32 = 34962;
const ELEMENTS: u32 = 34963;

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
    /// Its image.
    pub image: PartImage,
    /// Whether the image is a PNG, some of which is not opaque; a JPEG if not.
    pub is_png: bool,
    /// Whether alpha is to be blended; if not, what is half seen or more is opaque, and the rest is left out.
    pub is_blended: bool,
}

/// Where the image of a part is.
#[derive(Clone, PartialEq, Debug)]
pub enum PartImage {
    /// In the buffer: its bytes.
    Inside(Vec<u8>),
    /// In a file beside it: its name.
    Beside(String),
}

impl Default for PartImage {
    fn default() -> Self {
        PartImage::Inside(Vec::new())
    }
}

/// Triangles whose vertices are there once for each chart that shows them.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Charted {
    /// Each vertex of the mesh that it is made from, and the chart.
    pub vertices: Vec<(u32, u16)>,
    /// Corners, numbers of these vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl Charted {
    /// Takes triangles, each with the chart that shows it. Vertices are in the order of their first triangles.
    pub fn new(triangles: impl IntoIterator<Item = ([u32; 3], u16)>) -> Self {
        let (mut charted, mut known) = (Charted::default(), BTreeMap::new());
        for (corners, chart) in triangles {
            let corners = corners.map(|corner| {
                *known.entry((corner, chart)).or_insert_with(|| {
                    charted.vertices.push((corner, chart));
                    charted.vertices.len() as u32 - 1
                })
            });
            charted.triangles.push(corners);
        }
        charted
    }
}

/// Views and accessors while they are listed, and what is in the views.
#[derive(Default)]
struct Tables<'a> {
    views: Vec<Value>,
    accessors: Vec<Value>,
    blocks: Vec<Cow<'a, [u8]>>,
    /// Bytes of all blocks, and of all views that are packed.
    stored: u64,
    plain: u64,
    is_packed: bool,
    grid: Option<Grid>,
}

impl<'a> Tables<'a> {
    /// A view of bytes as they are.
    fn view(&mut self, bytes: impl Into<Cow<'a, [u8]>>, target: Option<u32>) -> usize {
        let bytes = bytes.into();
        let mut view = json!({ "buffer": 0, "byteOffset": self.stored, "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.push(view, bytes)
    }

    fn push(&mut self, view: Value, bytes: Cow<'a, [u8]>) -> usize {
        self.stored += padded(bytes.len() as u64);
        self.blocks.push(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    /// A view of `count` items of `step` bytes, which `bytes` unpack to.
    fn packed(&mut self, bytes: Vec<u8>, [count, step]: [usize; 2], mode: &str) -> usize {
        let (len, target) = (count * step, if mode == "ATTRIBUTES" { ARRAY } else { ELEMENTS });
        let mut view = json!({ "buffer": 1, "byteOffset": self.plain, "byteLength": len, "target": target });
        if mode == "ATTRIBUTES" {
            view["byteStride"] = step.into();
        }
        view["extensions"] = json!({ MESHOPT: {
            "buffer": 0, "byteOffset": self.stored, "byteLength": bytes.len(), "byteStride": step, "count": count, "mode": mode,
        } });
        self.plain += padded(len as u64);
        self.push(view, bytes.into())
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Rows of numbers of a kind; small ones have bytes that are no numbers.
    fn vertices<T: Pod>(&mut self, items: Cow<'a, [T]>, kind: &str) -> Result<usize, ExportError> {
        let count = items.len();
        let view = match self.is_packed {
            true => self.packed(packed_vertices(&items)?, [count, size_of::<T>()], "ATTRIBUTES"),
            false => {
                let bytes: Cow<'a, [u8]> = match items {
                    Cow::Borrowed(items) => bytemuck::cast_slice::<T, u8>(items).into(),
                    Cow::Owned(items) => bytemuck::cast_slice::<T, u8>(&items).to_vec().into(),
                };
                self.view(bytes, Some(ARRAY))
            }
        };
        let accessor = json!({ "bufferView": view, "componentType": 5126, "type": kind, "count": count });
        Ok(self.accessor(accessor))
    }

    /// Tells that rows are small: of a component type, so many bytes from one to the next.
    fn tell_small(&mut self, accessor: usize, component: u32, step: usize) {
        self.accessors[accessor]["componentType"] = component.into();
        if let Some(view) = self.accessors[accessor]["bufferView"].as_u64() {
            self.views[view as usize]["byteStride"] = step.into();
        }
    }

    /// Positions, normals and places of a part.
    fn attributes(&mut self, part: &'a TexturedPart) -> Result<Value, ExportError> {
        let count = part.positions.len() as u64;
        expect("places in images", count, part.places.len() as u64)?;
        let grid = self.grid;
        let at = match &grid {
            Some(grid) => {
                let small = part.positions.iter().map(|at| small_position(grid, *at)).collect::<Vec<_>>();
                let at = self.vertices(small.into(), "VEC3")?;
                self.tell_small(at, 5123, 8);
                at
            }
            None => self.vertices(part.positions.as_slice().into(), "VEC3")?,
        };
        let bounds = Aabb::of_points(&part.positions);
        let (_, [low, high]) = position(grid.as_ref(), [bounds.min, bounds.max]);
        (self.accessors[at]["min"], self.accessors[at]["max"]) = (low, high);
        let mut attributes = json!({ "POSITION": at });
        if !part.normals.is_empty() {
            expect("normals", count, part.normals.len() as u64)?;
            let at = if grid.is_some() {
                let small =
                    part.normals.iter().map(|normal| small_direction(unit(*normal))).collect::<Vec<_>>();
                let at = self.vertices(small.into(), "VEC3")?;
                self.tell_small(at, 5120, 4);
                self.accessors[at]["normalized"] = true.into();
                at
            } else {
                self.vertices(part.normals.as_slice().into(), "VEC3")?
            };
            attributes["NORMAL"] = at.into();
        }
        attributes["TEXCOORD_0"] = self.vertices(part.places.as_slice().into(), "VEC2")?.into();
        Ok(attributes)
    }

    fn image(&mut self, part: &'a TexturedPart) -> Value {
        match &part.image {
            PartImage::Inside(bytes) => {
                let kind = if part.is_png { "image/png" } else { "image/jpeg" };
                json!({ "bufferView": self.view(bytes.as_slice(), None), "mimeType": kind })
            }
            PartImage::Beside(name) => json!({ "uri": uri(name) }),
        }
    }

    fn corners(&mut self, part: &'a TexturedPart) -> Result<usize, ExportError> {
        let corners = part.triangles.as_flattened();
        let is_short = index_len(part) == 2;
        let view = match (self.is_packed, is_short) {
            (true, _) => {
                let step = if is_short { 2 } else { 4 };
                let bytes = packed_indices(&part.triangles, part.positions.len())?;
                self.packed(bytes, [corners.len(), step], "TRIANGLES")
            }
            (false, true) => {
                let short: Vec<u16> = corners.iter().map(|v| *v as u16).collect();
                self.view(bytemuck::cast_slice::<u16, u8>(&short).to_vec(), Some(ELEMENTS))
            }
            (false, false) => self.view(bytemuck::cast_slice::<u32, u8>(corners), Some(ELEMENTS)),
        };
        let component = if is_short { 5123 } else { 5125 };
        let accessor = json!({ "bufferView": view, "componentType": component, "type": "SCALAR", "count": corners.len() });
        Ok(self.accessor(accessor))
    }
}

/// Writes a glTF of the parts of each level; `is_packed` with `EXT_meshopt_compression`.
///
/// # Errors
/// [`ExportError::Count`] for parts of other lengths, and for other levels than the facts are of; [`ExportError::TooLarge`] beyond the 4 GiB that a GLB may have; [`ExportError::Compression`];
/// [`ExportError::Write`].
pub fn write_textured<W: Write>(
    mut container: Container<W>,
    facts: &Facts,
    levels: &[Vec<TexturedPart>],
    is_packed: bool,
) -> Result<Container<W>, ExportError> {
    expect("levels", facts.levels.len() as u64, levels.len() as u64)?;
    let mut tables = Tables { is_packed, grid: facts.grid, ..Tables::default() };
    let (mut images, mut materials) = (Vec::new(), Vec::new());
    let mut primitives = Vec::new();
    for parts in levels {
        let mut level = Vec::new();
        for part in parts.iter().filter(|part| !part.triangles.is_empty()) {
            let (attributes, indices) = (tables.attributes(part)?, tables.corners(part)?);
            let number = materials.len();
            level.push(json!({ "attributes": attributes, "indices": indices, "material": number }));
            images.push(tables.image(part));
            materials.push(material(part, number));
        }
        primitives.push(level);
    }

    let mut root = document(facts, primitives);
    if !materials.is_empty() {
        let textures: Vec<Value> =
            (0..materials.len()).map(|at| json!({ "source": at, "sampler": 0 })).collect();
        root["textures"] = textures.into();
        // Linear, with mip-maps; nothing repeats.
        root["samplers"] = json!([{ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 }]);
        root["images"] = images.into();
        root["materials"] = materials.into();
        root["accessors"] = tables.accessors.into();
        root["bufferViews"] = tables.views.into();
        root["buffers"] = json!([{ "byteLength": tables.stored }]);
        if is_packed {
            unpacked_nowhere(&mut root, tables.plain);
        }
    }
    container.begin(root, tables.stored)?;
    for block in tables.blocks {
        let zeros = padded(block.len() as u64) as usize - block.len();
        container.write(&block)?;
        container.write(&[0; 4][..zeros])?;
    }
    container.finish()
}

/// The material of a part, which shows the texture of this number.
fn material(part: &TexturedPart, number: usize) -> Value {
    let mut material = json!({
        "doubleSided": true,
        "pbrMetallicRoughness": { "metallicFactor": 0, "baseColorTexture": { "index": number } },
    });
    if part.is_png {
        material["alphaMode"] = if part.is_blended { "BLEND" } else { "MASK" }.into();
    }
    material
}

fn index_len(part: &TexturedPart) -> u64 {
    let (vertices, triangles) = (part.positions.len() as u64, part.triangles.len() as u64);
    Part { vertices, triangles, low: [0.0; 3], high: [0.0; 3], packed: None }.index_len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Level, Placement};

    #[test]
    fn views_are_where_their_bytes_are() {
        let facts = Facts {
            generator: "test".to_owned(),
            placement: Placement::HERE,
            levels: vec![Level::default()],
            scalars: Vec::new(),
            grid: None,
        };
        let part = |x: f32, image: &[u8]| TexturedPart {
            positions: vec![[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, -2.0]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            places: vec![[0.0, 0.5], [1.0, 0.25], [0.125, x]],
            triangles: vec![[0, 1, 2]],
            image: PartImage::Inside(image.to_vec()),
            is_png: x > 0.0,
            is_blended: x > 0.0,
        };
        let parts = [part(0.0, b"first"), part(7.0, b"second!")];
        let bytes =
            write_textured(Container::Glb(Vec::new()), &facts, &[parts.to_vec()], false).unwrap().into_main();
        let len = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let json: Value = serde_json::from_slice(&bytes[20..20 + len]).unwrap();
        assert_eq!(u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize, bytes.len());
        let view = |number: &Value| {
            let view = &json["bufferViews"][number.as_u64().unwrap() as usize];
            let [offset, len] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
            bytes[28 + len_of(&bytes) + offset..][..len].to_vec()
        };
        for (number, part) in parts.iter().enumerate() {
            assert_eq!(PartImage::Inside(view(&json["images"][number]["bufferView"])), part.image);
            let primitive = &json["meshes"][0]["primitives"][number];
            let accessor = |value: &Value| &json["accessors"][value.as_u64().unwrap() as usize];
            let places = accessor(&primitive["attributes"]["TEXCOORD_0"]);
            let found: Vec<f32> =
                view(&places["bufferView"]).as_chunks().0.iter().map(|x| f32::from_le_bytes(*x)).collect();
            assert_eq!(found, part.places.as_flattened());
            assert_eq!(view(&accessor(&primitive["indices"])["bufferView"]), [0, 0, 1, 0, 2, 0]);
        }

        // Packed, views unpack to the same.
        let bytes =
            write_textured(Container::Glb(Vec::new()), &facts, &[parts.to_vec()], true).unwrap().into_main();
        let len = len_of(&bytes);
        let json: Value = serde_json::from_slice(&bytes[20..20 + len]).unwrap();
        assert_eq!(json["buffers"][1]["extensions"][MESHOPT]["fallback"], true);
        for (number, part) in parts.iter().enumerate() {
            let primitive = &json["meshes"][0]["primitives"][number];
            let stored = |value: &Value| {
                let at = |value: &Value| value.as_u64().unwrap() as usize;
                let told = &json["bufferViews"][at(&json["accessors"][at(value)]["bufferView"])]["extensions"]
                    [MESHOPT];
                bytes[28 + len + at(&told["byteOffset"])..][..at(&told["byteLength"])].to_vec()
            };
            let places = stored(&primitive["attributes"]["TEXCOORD_0"]);
            assert_eq!(meshopt::decode_vertex_buffer::<[f32; 2]>(&places, 3).unwrap(), part.places);
            let indices = stored(&primitive["indices"]);
            let found = meshopt::decode_index_buffer::<u32>(&indices, 3).unwrap();
            // The codec may begin a triangle with another corner.
            let turned = |first: usize| [0, 1, 2].map(|at| found[(first + at) % 3]);
            assert!((0..3).any(|first| turned(first) == part.triangles[0]), "{found:?}");
        }

        let mut wrong = part(0.0, b"");
        wrong.places.pop();
        assert!(matches!(
            write_textured(Container::Glb(Vec::new()), &facts, &[vec![wrong]], false),
            Err(ExportError::Count { .. })
        ));
    }

    fn len_of(bytes: &[u8]) -> usize {
        u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize
    }
}
