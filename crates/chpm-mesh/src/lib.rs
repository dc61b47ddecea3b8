//! Vocabulary, in-core mesh, progressive mesh and PLY of the CHPM toolchain.
//!
//! This crate names things and holds plain data. It opens no file, starts no thread and allocates nothing
//! that is not proportional to its arguments; the PLY parser is total on hostile bytes.
#![forbid(unsafe_code)]

#[cfg(target_endian = "big")]
compile_error!("chpm reads its little-endian records in place and supports little-endian hosts only");

pub mod geom;
pub mod ids;
pub mod import;
pub mod number;
pub mod ply;
pub mod pm;
pub mod polygon;
pub mod synth;
pub mod trimesh;
pub mod units;

pub use geom::{Aabb, FAR, Sphere};
pub use ids::{ClusterId, GroupId, Level};
pub use number::{Number, NumberError};
pub use ply::{PlyError, PlyReader, PlyWriter};
pub use pm::ProgressiveMesh;
pub use polygon::{Polygons, Triangulator};
pub use trimesh::{Attributes, TriMesh};
pub use units::{Bytes, Counted, ObjectError};
