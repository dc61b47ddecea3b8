//! The one door from bytes to triangles.
//!
//! [`FORMATS`] is the table of formats that are read: each row has its name, its extensions, how it is told by the first bytes, and how a
//! [`MeshReader`] of it is opened. [`Input`] opens a file of any of them, unpacks and hashes it on the way, and hands over
//! batches of vertices and faces.
//!
//! Everything here takes untrusted bytes. The readers stream, start no thread, are total on hostile bytes, and allocate
//! nothing by a number that the input states; what a format has to hold is asked of the memory budget, and goes to disk where that
//! refuses. Faces of more than three corners are cut by one [`Triangulator`], whatever the format. The writer of PLY is here too,
//! beside its reader.
#![forbid(unsafe_code)]

mod batch;
mod color_scale;
mod conf;
mod corner_normals;
mod error;
mod file_set;
mod foreign;
mod format;
mod gltf;
pub mod input;
mod joined;
mod kept_polygons;
mod lines;
mod location;
mod obj;
mod off;
mod options;
pub mod ply;
pub mod polygon;
mod reader;
mod seams;
mod steps;
mod stl;
#[cfg(test)]
mod stopping;
mod stream;
mod supply;
mod texture;
mod tiles;
mod vertex_format;
mod vertex_set;
mod weld;

pub use batch::{Batch, BatchKind, MAX_CORNERS, MAX_VERTICES, Tally};
pub use conf::{Pose, RangeScans, Scan};
pub use corner_normals::{CornerNormals, Joined};
pub use error::{ImportError, SourceError};
pub use foreign::Foreign;
pub use format::{COMPRESSED, FORMATS, Format, extension, extensions, read_formats};
pub use input::Input;
pub use kept_polygons::KeptPolygons;
pub use location::SourceLocation;
pub use obj::ObjReader;
pub use options::{Invalid, Keep, Options};
pub use ply::{PlyError, PlyReader, PlyWriter};
pub use polygon::{Polygons, Triangulator};
pub use reader::{Beside, MeshReader, Opening, SourceInfo, Start};
pub use stl::{Corners, StlReader};
pub use stream::Stream;
pub use supply::Supply;
pub use texture::{Image, Images, Textures};
pub use tiles::Tiles;
pub use vertex_format::{Coordinates, VertexFormat};
