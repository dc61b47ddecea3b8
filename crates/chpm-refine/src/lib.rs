//! Selection of a mesh from a CHPM: cuts, PM positions, extraction; no I/O.
//!
//! A [`Cut`] says which clusters are drawn and how far each one's progressive mesh is refined; [`extract()`] makes one
//! crack-free mesh of it; a [`PmCursor`] follows one cluster as its position moves from frame to frame.
//!
//! What a picture needs, a [`View`] (camera, image, pixels of error) asks of the file's [`Hierarchy`]: [`select()`] gives the cut from
//! nothing, an [`ActiveList`] the same cut from the last frame's, [`select_triangles`] the best cut within so many triangles. [`Residency`]
//! tells which pages to read and to drop when they do not all fit into memory; a [`CameraPath`] is a view for every frame.
//!
//! Why a cut has no cracks: the split groups are closed upward (no group is split before all its clusters are there), all clusters of a group
//! are positioned by one bound, and where a group is there in part, its clusters are at their base meshes, which
//! is what the coarser clusters beside them look like. So nothing else has to be forced, whatever the bounds are; errors that
//! grow and spheres that nest towards the root see to it that nothing that a view asks for is refused.
#![forbid(unsafe_code)]

pub mod active;
pub mod budget;
pub mod cursor;
pub mod cut;
pub mod error;
pub mod extract;
mod fill;
pub mod front;
pub mod hierarchy;
mod lod;
pub mod path;
pub mod random;
pub mod residency;
mod seams;
pub mod select;
mod splits;
mod steps;
pub mod view;

pub use active::ActiveList;
pub use budget::select_triangles;
pub use cursor::PmCursor;
pub use cut::{Cut, Member};
pub use error::RefineError;
pub use extract::{Extraction, VertexBatch, extract};
pub use front::{Changes, Entered, Front};
pub use hierarchy::Hierarchy;
pub use path::CameraPath;
pub use random::random_cut;
pub use residency::{Residency, Traffic, Wanted};
pub use select::{is_visible, select, select_by};
pub use view::{Camera, Region, View};
