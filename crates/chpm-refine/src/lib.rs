//! Selection of a mesh from a CHPM: cuts, PM positions, extraction; no I/O.
//!
//! A [`Cut`] says which clusters are drawn and how far each one's progressive mesh is refined; [`extract()`] makes one
//! crack-free mesh of it; a [`PmCursor`] follows one cluster as its position moves from frame to frame.
#![forbid(unsafe_code)]

pub mod active;
pub mod budget;
pub mod cursor;
pub mod cut;
pub mod error;
pub mod extract;
pub mod front;
pub mod hierarchy;
mod lod;
pub mod path;
pub mod random;
pub mod residency;
pub mod select;
mod splits;
pub mod view;

pub use active::ActiveList;
pub use budget::Budgeted;
pub use cursor::PmCursor;
pub use cut::{Cut, Member};
pub use error::RefineError;
pub use extract::{Extraction, VertexBatch, extract};
pub use front::{Changes, Front};
pub use hierarchy::Hierarchy;
pub use path::CameraPath;
pub use random::random_cut;
pub use residency::{Residency, Traffic, Wanted};
pub use select::{is_visible, select, select_by};
pub use view::{Camera, Region, View};
