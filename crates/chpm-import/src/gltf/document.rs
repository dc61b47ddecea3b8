//! The JSON of a glTF: what of it says where triangles are.

use crate::error::ImportError;
use serde::Deserialize;

/// All of it.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Document {
    pub(super) scene: Option<u32>,
    pub(super) scenes: Vec<Scene>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<View>,
    pub(super) buffers: Vec<Buffer>,
    extensions_required: Vec<String>,
}

/// The version, which is asked before all else.
#[derive(Deserialize)]
struct Head {
    asset: Asset,
}

#[derive(Deserialize)]
struct Asset {
    version: String,
}

#[derive(Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub(super) nodes: Vec<u32>,
}

#[derive(Deserialize)]
pub(super) struct Node {
    pub(super) mesh: Option<u32>,
    pub(super) skin: Option<u32>,
    #[serde(default)]
    pub(super) children: Vec<u32>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<Box<[f64; 3]>>,
    /// A quaternion, its real part last.
    pub(super) rotation: Option<Box<[f64; 4]>>,
    pub(super) scale: Option<Box<[f64; 3]>>,
    #[serde(default)]
    pub(super) extensions: NodeExtensions,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub(super) instancing: Option<Present>,
    #[serde(rename = "KHR_node_visibility")]
    pub(super) visibility: Option<Visibility>,
}

/// Whether a node, with all below it, is shown.
#[derive(Deserialize, Clone, Copy)]
pub(super) struct Visibility {
    #[serde(default = "shown")]
    pub(super) visible: bool,
}

fn shown() -> bool {
    true
}

/// An object that is there, whatever it holds.
#[derive(Deserialize, Clone, Copy)]
pub(super) struct Present {}

#[derive(Deserialize)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    pub(super) attributes: Attributes,
    pub(super) indices: Option<u32>,
    pub(super) material: Option<u32>,
    #[serde(default = "triangles")]
    pub(super) mode: u8,
    #[serde(default)]
    pub(super) targets: Vec<Present>,
    #[serde(default)]
    pub(super) extensions: PrimitiveExtensions,
}

fn triangles() -> u8 {
    4
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub(super) draco: Option<Present>,
}

#[derive(Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub(super) struct Attributes {
    pub(super) position: Option<u32>,
    pub(super) normal: Option<u32>,
    pub(super) color_0: Option<u32>,
    pub(super) texcoord_0: Option<u32>,
    texcoord_1: Option<u32>,
    texcoord_2: Option<u32>,
    texcoord_3: Option<u32>,
    texcoord_4: Option<u32>,
    texcoord_5: Option<u32>,
    texcoord_6: Option<u32>,
    texcoord_7: Option<u32>,
}

impl Attributes {
    /// Texture coordinates by their number; more than these are not seen.
    pub(super) fn texcoord(&self, set: u32) -> Option<u32> {
        let Attributes { texcoord_0: a, texcoord_1: b, texcoord_2: c, texcoord_3: d, .. } = *self;
        let Attributes { texcoord_4: e, texcoord_5: f, texcoord_6: g, texcoord_7: h, .. } = *self;
        [a, b, c, d, e, f, g, h].get(set as usize).copied().flatten()
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<u32>,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) shape: Shape,
    pub(super) sparse: Option<Box<Sparse>>,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq, Debug)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum Shape {
    Scalar,
    Vec2,
    Vec3,
    Vec4,
    Mat2,
    Mat3,
    Mat4,
}

#[derive(Deserialize)]
pub(super) struct Sparse {
    pub(super) count: u64,
    pub(super) indices: SparseIndices,
    pub(super) values: SparseValues,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub(super) buffer_view: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub(super) buffer_view: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct View {
    pub(super) buffer: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
    #[serde(default)]
    pub(super) extensions: ViewExtensions,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub(super) meshopt: Option<Box<Compressed>>,
}

/// Stand-in for a view whose bytes are compressed.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Compressed {
    pub(super) buffer: u32,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: u64,
    pub(super) count: u64,
    pub(super) mode: Mode,
    #[serde(default)]
    pub(super) filter: Filter,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq, Debug)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq, Debug, Default)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum Filter {
    #[default]
    None,
    Octahedral,
    Quaternion,
    Exponential,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: u64,
}

/// Extensions whose geometry is read, and beginnings of names of those that have none.
const READ: [&str; 3] = ["KHR_mesh_quantization", "EXT_meshopt_compression", "KHR_node_visibility"];
const WITHOUT_GEOMETRY: [&str; 13] = [
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "MSFT_packing_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_animation_",
    "KHR_xmp",
    "EXT_mesh_features",
    "EXT_instance_features",
    "EXT_structural_metadata",
    "ADOBE_materials_",
];

impl Document {
    /// Reads the text, and refuses what it requires and is not read.
    pub(super) fn parse(text: &[u8]) -> Result<Document, ImportError> {
        let wrong = |error: serde_json::Error| ImportError::Json(error.to_string());
        let Head { asset } = serde_json::from_slice(text).map_err(wrong)?;
        if !asset.version.starts_with("2.") {
            let version = crate::location::excerpt(asset.version.as_bytes());
            return Err(refused(format!("glTF {version} is not read: save it as glTF 2.0")));
        }
        let document: Document = serde_json::from_slice(text).map_err(wrong)?;
        let is_known = |name: &String| {
            READ.contains(&name.as_str()) || WITHOUT_GEOMETRY.iter().any(|known| name.starts_with(known))
        };
        if let Some(name) = document.extensions_required.iter().find(|name| !is_known(name)) {
            let name = crate::location::excerpt(name.as_bytes());
            return Err(refused(format!(
                "it requires the extension {name}, which is not read: save it without"
            )));
        }
        Ok(document)
    }
}

/// Refusal of an invalid glTF, or of one that is not read.
pub(super) fn refused(what: impl Into<String>) -> ImportError {
    ImportError::Unsupported(what.into())
}

/// An entry of a list by its number.
pub(super) fn entry<'a, T>(list: &'a [T], number: u32, what: &'static str) -> Result<&'a T, ImportError> {
    let missing = || refused(format!("it names {what} {number}, and has {}", list.len()));
    list.get(number as usize).ok_or_else(missing)
}
