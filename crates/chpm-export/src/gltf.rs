//! The JSON of a glTF.

use crate::grid::Grid;
use crate::scene::{Level, document as scene, use_extension};
use crate::turn::Turn;
use crate::vertex::Stride;
use chpm_mesh::{Attributes, Scalar, scalar_names};
use serde_json::{Map, Value, json};

/// Name of the extension `EXT_meshopt_compression`.
pub(crate) const MESHOPT: &str = "EXT_meshopt_compression";

/// Where a mesh stands: at its positions and what they are relative to, turned so that y is up.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Placement {
    /// The point that positions are relative to, before the turn.
    pub origin: [f64; 3],
    /// The turn that makes y point up.
    pub turn: Turn,
}

impl Placement {
    /// At its positions.
    pub const HERE: Placement = Placement { origin: [0.0; 3], turn: Turn::NONE };

    /// A node without a mesh.
    pub(crate) fn node(&self, grid: Option<&Grid>) -> Value {
        let (low, step) = grid.map_or(([0.0; 3], 1.0), Grid::place);
        let zero: [f64; 3] = std::array::from_fn(|axis| self.origin[axis] + low[axis]);
        let (is_moved, is_scaled) = (zero != [0.0; 3], step != 1.0);
        if self.turn == Turn::NONE {
            let mut node = json!({});
            if is_moved {
                node["translation"] = json!(zero);
            }
            if is_scaled {
                node["scale"] = vec![step; 3].into();
            }
            return node;
        }
        let columns = self.turn.columns();
        let [x, y, z] = columns;
        let mut matrix = json!([x[0], x[1], x[2], 0, y[0], y[1], y[2], 0, z[0], z[1], z[2], 0, 0, 0, 0, 1]);
        if is_scaled {
            for (at, number) in columns.as_flattened().iter().enumerate().filter(|(_, number)| **number != 0)
            {
                matrix[4 * (at / 3) + at % 3] = (f64::from(*number) * step).into();
            }
        }
        if is_moved {
            let zero = self.turn.apply(zero);
            (0..3).for_each(|axis| matrix[12 + axis] = zero[axis].into());
        }
        json!({ "matrix": matrix })
    }
}

/// Facts of a glTF beside its mesh.
#[derive(Clone, Debug)]
pub struct Facts {
    /// The program that wrote it.
    pub generator: String,
    /// Where the mesh stands.
    pub placement: Placement,
    /// The mesh; or several, as levels of detail, the finest first.
    pub levels: Vec<Level>,
    /// Named scalars of the vertices, each an attribute `_NAME`.
    pub scalars: Vec<Scalar>,
    /// The lattice that positions are rounded to; normals and colours are bytes then.
    pub grid: Option<Grid>,
}

/// A stretch of vertices and the triangles over them.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Part {
    pub(crate) vertices: u64,
    pub(crate) triangles: u64,
    pub(crate) low: [f32; 3],
    pub(crate) high: [f32; 3],
    /// Bytes of its vertices and of its indices where they are compressed.
    pub(crate) packed: Option<[u64; 2]>,
}

impl Part {
    /// Bytes of a corner's index.
    pub(crate) fn index_len(&self) -> u64 {
        // The greatest index of 16 bits has a meaning of its own.
        if self.vertices <= 0xffff { 2 } else { 4 }
    }

    /// Bytes of the vertices and of the indices, not compressed; each begins at a multiple of four.
    pub(crate) fn plain(&self, stride: Stride) -> [u64; 2] {
        [self.vertices * stride.bytes as u64, 3 * self.triangles * self.index_len()]
    }

    /// Bytes in the file.
    fn stored(&self, stride: Stride) -> [u64; 2] {
        self.packed.unwrap_or_else(|| self.plain(stride))
    }
}

/// Component type of positions, and the ends of their box as they are stored.
pub(crate) fn position(grid: Option<&Grid>, ends: [[f32; 3]; 2]) -> (u32, [Value; 2]) {
    match grid {
        Some(grid) => (5123, ends.map(|end| json!(grid.nearest(end)))),
        None => (5126, ends.map(|end| json!(end.map(f64::from)))),
    }
}

/// The length up to which zeros go.
pub(crate) fn padded(len: u64) -> u64 {
    len.next_multiple_of(4)
}

/// The JSON of the parts of each level, and how many bytes of them follow it.
pub(crate) fn document(facts: &Facts, attributes: Attributes, parts: &[Vec<Part>]) -> (Value, u64) {
    let stride = Stride::of(attributes, facts.scalars.len(), facts.grid.is_some());
    let body: u64 = parts.iter().flatten().flat_map(|part| part.stored(stride)).map(padded).sum();
    (root(facts, stride, parts, body), body)
}

fn root(facts: &Facts, stride: Stride, parts: &[Vec<Part>], body: u64) -> Value {
    let names = scalar_names(&facts.scalars, &[], attribute_name);
    let mut tables = Tables { stride, names, grid: facts.grid, ..Tables::default() };
    let primitives = parts.iter().map(|parts| parts.iter().map(|part| tables.primitive(part)).collect());
    let mut root = scene(facts, primitives.collect());
    if tables.accessors.is_empty() {
        return root;
    }
    root["materials"] = json!([{ "doubleSided": true, "pbrMetallicRoughness": { "metallicFactor": 0 } }]);
    root["accessors"] = tables.accessors.into();
    root["bufferViews"] = tables.views.into();
    root["buffers"] = json!([{ "byteLength": body }]);
    if parts.iter().flatten().any(|part| part.packed.is_some()) {
        unpacked_nowhere(&mut root, tables.plain);
    }
    root
}

/// Lists a second buffer, of what a reader would have that unpacks nothing. It is not there.
pub(crate) fn unpacked_nowhere(root: &mut Value, bytes: u64) {
    let buffer = json!({ "byteLength": bytes, "extensions": { MESHOPT: { "fallback": true } } });
    if let Some(buffers) = root["buffers"].as_array_mut() {
        buffers.push(buffer);
    }
    use_extension(root, MESHOPT, true);
}

/// The name of an attribute of its own: an underscore and capitals.
fn attribute_name(name: &str) -> String {
    let fit = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' };
    format!("_{}", name.chars().map(fit).collect::<String>())
}

#[derive(Default)]
struct Tables {
    accessors: Vec<Value>,
    views: Vec<Value>,
    /// Bytes of all views up to now, as they are in the file and unpacked.
    stored: u64,
    plain: u64,
    stride: Stride,
    /// Attributes of the scalars.
    names: Vec<String>,
    grid: Option<Grid>,
}

impl Tables {
    fn primitive(&mut self, part: &Part) -> Value {
        let (stride, [vertices, indices]) = (self.stride, part.plain(self.stride));
        let [packed_vertices, packed_indices] = part.packed.map_or([None; 2], |packed| packed.map(Some));
        let view = self.view(vertices, packed_vertices, stride.bytes as u64, part.vertices, true);
        let count = part.vertices;
        let mut attributes = Map::new();
        attributes.insert("POSITION".to_owned(), {
            let (component, [low, high]) = position(self.grid.as_ref(), [part.low, part.high]);
            self.accessor(json!({
                "bufferView": view, "componentType": component, "type": "VEC3", "count": count, "min": low, "max": high,
            }))
        });

        let is_small = self.grid.is_some();
        if let Some(offset) = stride.normal {
            let mut normal = json!({ "bufferView": view, "byteOffset": offset, "componentType": 5126, "type": "VEC3", "count": count });
            if is_small {
                (normal["componentType"], normal["normalized"]) = (5120.into(), true.into());
            }
            attributes.insert("NORMAL".to_owned(), self.accessor(normal));
        }

        if let Some(offset) = stride.color {
            let component = if is_small { 5121 } else { 5123 };
            let color = json!({
                "bufferView": view, "byteOffset": offset, "componentType": component, "normalized": true, "type": "VEC4",
                "count": count,
            });
            attributes.insert("COLOR_0".to_owned(), self.accessor(color));
        }
        for (at, name) in self.names.clone().into_iter().enumerate() {
            let scalar = json!({
                "bufferView": view, "byteOffset": stride.scalars + 4 * at, "componentType": 5126, "type": "SCALAR",
                "count": count,
            });
            attributes.insert(name, self.accessor(scalar));
        }

        let (len, count) = (part.index_len(), 3 * part.triangles);
        let view = self.view(indices, packed_indices, len, count, false);
        let component = if len == 2 { 5123 } else { 5125 };
        let indices =
            json!({ "bufferView": view, "componentType": component, "type": "SCALAR", "count": count });
        json!({ "attributes": attributes, "indices": self.accessor(indices), "material": 0 })
    }

    fn accessor(&mut self, accessor: Value) -> Value {
        self.accessors.push(accessor);
        (self.accessors.len() - 1).into()
    }

    /// A view of `len` bytes in steps of `step`, or of so many packed ones.
    fn view(&mut self, len: u64, packed: Option<u64>, step: u64, count: u64, of_vertices: bool) -> usize {
        let target = if of_vertices { 34962 } else { 34963 };
        let offset = if packed.is_some() { self.plain } else { self.stored };
        let mut view = json!({
            "buffer": u8::from(packed.is_some()), "byteOffset": offset, "byteLength": len, "target": target,
        });
        if of_vertices {
            view["byteStride"] = step.into();
        }
        if let Some(packed) = packed {
            let mode = if of_vertices { "ATTRIBUTES" } else { "TRIANGLES" };
            view["extensions"] = json!({ MESHOPT: {
                "buffer": 0, "byteOffset": self.stored, "byteLength": packed, "byteStride": step, "count": count, "mode": mode,
            } });
        }
        self.stored += padded(packed.unwrap_or(len));
        self.plain += padded(len);
        self.views.push(view);
        self.views.len() - 1
    }
}
