//! Meshes from the world: PLY ([`ply`]), STL, OBJ, and Stanford's lists of range scans.
//!
//! Everything here takes untrusted bytes. The readers stream, open no file, start no thread, are total on hostile bytes, and allocate
//! nothing by a number that the input states. [`Format::detect`] tells by the first bytes what an input is; faces of more than three
//! corners are cut by one [`Triangulator`], whatever the format. The writer of PLY is here too, beside its reader.
#![forbid(unsafe_code)]

mod conf;
mod error;
mod foreign;
mod format;
pub mod input;
mod lines;
mod obj;
pub mod ply;
pub mod polygon;
mod reader;
mod scans;
mod steps;
mod stl;
#[cfg(test)]
mod stopping;
mod stream;
mod supply;
mod weld;

pub use conf::{Pose, RangeScans, Scan};
pub use error::{ImportError, SourceError};
pub use foreign::Foreign;
pub use format::{COMPRESSED, FORMATS, Format, extension, extensions, read_formats};
pub use input::Input;
pub use obj::ObjReader;
pub use ply::{PlyError, PlyReader, PlyWriter};
pub use polygon::{Polygons, Triangulator};
pub use reader::{Beside, MeshReader, Opening, SourceInfo, Start};
pub use stl::{Corners, StlReader};
pub use stream::Stream;
pub use supply::Supply;
