//! Meshes that are no PLY: STL, OBJ, and Stanford's lists of range scans. Like the PLY reader, these readers stream, open no file,
//! are total on hostile bytes, and allocate nothing by a number that the input states.
//!
//! [`Format::detect`] tells by the first bytes what an input is.

mod conf;
mod error;
mod format;
mod lines;
mod obj;
mod stl;

pub use conf::{Pose, RangeScans, Scan};
pub use error::ImportError;
pub use format::Format;
pub use obj::ObjReader;
pub use stl::{Corners, StlReader};
