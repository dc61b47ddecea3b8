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
mod lines;
mod obj;
pub mod ply;
pub mod polygon;
mod stl;

pub use conf::{Pose, RangeScans, Scan};
pub use error::ImportError;
pub use foreign::Foreign;
pub use format::Format;
pub use obj::ObjReader;
pub use ply::{PlyError, PlyReader, PlyWriter};
pub use polygon::{Polygons, Triangulator};
pub use stl::{Corners, StlReader};
