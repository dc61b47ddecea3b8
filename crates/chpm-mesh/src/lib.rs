//! Vocabulary, in-core mesh and progressive mesh of the CHPM toolchain.
//!
//! This crate names things and holds plain data. It opens no file, starts no thread, parses no untrusted bytes, and allocates nothing
//! that is not proportional to its arguments.
#![forbid(unsafe_code)]

#[cfg(target_endian = "big")]
compile_error!("chpm reads its little-endian records in place and supports little-endian hosts only");

pub mod asked;
pub mod chart;
pub mod curve;
pub mod facing;
pub mod geom;
pub mod ids;
pub mod number;
pub mod octahedral;
pub mod pm;
pub mod scalar;
pub mod trimesh;
pub mod units;
pub mod vertices;
pub mod viridis;

pub use asked::{AskedError, Length, LengthError, Triangles};
pub use chart::Chart;
pub use facing::Facing;
pub use geom::{Aabb, FAR, Sphere};
pub use ids::{ClusterId, GroupId, Level};
pub use number::{Number, NumberError};
pub use octahedral::Octahedral;
pub use pm::{Places, ProgressiveMesh};
pub use scalar::{
    MOST_SCALAR_WORDS, Scalar, ScalarKind, ScalarRange, scalar_names, scalar_places, scalar_words,
};
pub use trimesh::TriMesh;
pub use units::{AtLeast, AtMost, Bytes, Counted, Digits, MemorySize, ObjectError, Thousands, Units};
pub use vertices::{Attributes, Vertex, VertexSlices, Vertices};
pub use viridis::viridis;
