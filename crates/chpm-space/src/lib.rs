//! A CHPM as questions of space see it: groups with the space that they hold, clusters as triangles in boxes, pages that are kept; no I/O.
#![forbid(unsafe_code)]

pub mod block;
pub mod error;
pub mod model;
pub mod patch;
mod shelf;

pub use block::Block;
pub use error::Unproven;
pub use model::{Model, Reads, Wrong};
pub use patch::{Corners, FEW, Node, Patch};
