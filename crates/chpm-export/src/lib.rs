//! Meshes and hierarchies for other programs: STL, OBJ, glTF 2.0, 3D Tiles 1.1 and meshlets.
//!
//! [`StlWriter`], [`ObjWriter`] and [`GlbWriter`] take a mesh in batches and write it front to back, so that none has to be in memory;
//! [`PackedGlb`] does the same in two passes, with `EXT_meshopt_compression`. [`Atlases`] packs sheets of a cut into images, and [`TexturedPart`]s with
//! these are written as a whole. [`tiles`] makes a tree of tiles of a whole `.chpm`, [`meshlets`] a file for mesh shaders. Nothing here opens a file or starts a thread. PLY is written by `chpm-import`, beside its reader.
#![forbid(unsafe_code)]

mod atlas;
mod container;
mod error;
mod finer;
mod glb;
mod gltf;
mod grid;
pub mod meshlets;
mod obj;
mod packed_glb;
mod scene;
mod stl;
mod textured;
mod textured_text;
pub mod tiles;
mod turn;
mod vertex;

pub use atlas::Atlases;
pub use container::{Container, uri};
pub use error::ExportError;
pub use glb::{Extent, GlbWriter};
pub use gltf::{Facts, Placement};
pub use grid::Grid;
pub use obj::ObjWriter;
pub use packed_glb::{PIECE_VERTICES, PackedGlb, PackedGlbWriter};
pub use scene::{Level, coverage};
pub use stl::{StlWriter, rounding};
pub use textured::{Charted, PartImage, TexturedPart, write_textured};
pub use textured_text::{textured_mtl, write_textured_obj, write_textured_ply};
pub use turn::Turn;
