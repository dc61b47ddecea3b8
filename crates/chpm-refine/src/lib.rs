//! Selection of a mesh from a CHPM: cuts, PM positions, extraction; no I/O.
//!
//! A [`Cut`] says which clusters are drawn and how far each one's progressive mesh is refined; [`extract()`] makes one
//! crack-free mesh of it; a [`PmCursor`] follows one cluster as its position moves from frame to frame.
#![forbid(unsafe_code)]

pub mod cursor;
pub mod cut;
pub mod error;
pub mod extract;
mod lod;
pub mod random;
mod splits;

pub use cursor::PmCursor;
pub use cut::{Cut, Member};
pub use error::RefineError;
pub use extract::{Extraction, VertexBatch, extract};
pub use random::random_cut;
