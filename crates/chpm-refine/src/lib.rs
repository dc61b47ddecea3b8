//! Selection of a mesh from a CHPM: cuts, PM positions, extraction; no I/O.
//!
//! A [`Cut`] says which clusters are drawn and how far each one's progressive mesh is refined; [`extract()`] makes one
//! crack-free mesh of it; a [`PmCursor`] follows one cluster as its position moves from frame to frame.
//!
//! What a picture needs, a [`View`] (camera, image, pixels of error) asks of the file's [`Hierarchy`]: [`select()`] gives the cut from
//! nothing, an [`ActiveList`] the same cut from the last frame's, [`select_triangles`] the best cut within so many triangles. A [`Pager`]
//! tells which pages to read and to drop when they do not all fit into memory; a [`CameraPath`] is a view for every frame.
//!
//! # The rule of selection
//!
//! 1. A *bound* is the error in object units that is allowed in a group's sphere: one number for all, or what a camera allows at the
//!    sphere's nearest point. It never grows from a group to those of its fine clusters, since spheres nest.
//! 2. The cut begins with the roots. A group whose coarse clusters are all in the cut is split, all of them replaced by its fine clusters,
//!    while its bound is below its `min_error`.
//! 3. A cluster of the cut is drawn at the first position whose error is at most the bound of its group; where the group is there in part
//!    only, since another group has taken some of its clusters' places, at its base mesh.
//!
//! # Why no cut has a crack
//!
//! 1. No vertex moves (I8): a vertex that two clusters share is at one place in both, or it is gone in one of them.
//! 2. A shared vertex collapses in one group only (I7). In all clusters of that group that have it, it goes to the same place and at the
//!    same error; clusters outside the group do not have it at that level or above.
//! 3. All clusters of a group have one bound. So by 2 a shared vertex is there in all of the group's clusters, or gone in all of them.
//! 4. Between clusters of two groups of one level the border is the same in both, whatever their positions: by 2 neither group may collapse its vertices.
//! 5. A group's finest meshes together are its fine clusters' base meshes (I4). So a cluster beside a group that is not split meets the same
//!    group border as before the split, as long as it is at its base mesh; and that is where rule 3 keeps it.
//! 6. By 3, 4 and 5, in every cut each border is the same edges on both sides. That holds whatever the bounds are; nested spheres and errors
//!    that grow (I6) only see to it that no split that a view asks for has to wait for another that it does not.
//!
//! The numbers I1 to I12 are those of the format. `chpm verify` checks them, and with `--cuts` the conclusion.
#![forbid(unsafe_code)]

pub mod active;
pub mod budget;
pub mod cursor;
pub mod cut;
pub mod error;
pub mod extract;
mod fill;
pub mod framing;
pub mod front;
mod group_borders;
pub mod hierarchy;
mod lod;
pub mod pager;
pub mod path;
mod pieces;
mod profile;
pub mod random;
mod remnants;
pub mod request;
pub mod residency;
pub mod select;
mod splits;
mod steps;
mod surface;
pub mod view;

pub use active::ActiveList;
pub use budget::select_triangles;
pub use cursor::PmCursor;
pub use cut::{Cut, Member};
pub use error::RefineError;
pub use extract::{Extraction, coincident, extract};
pub use framing::{Outline, Portrait, Side, Stance, Up, Window, told_by};
pub use front::{Changes, Entered, Front};
pub use hierarchy::Hierarchy;
pub use pager::Pager;
pub use path::CameraPath;
pub use pieces::pieces;
pub use random::random_cut;
pub use request::{Request, Shortfall};
pub use residency::{Residency, Traffic, Wanted};
pub use select::{is_visible, select, select_by};
pub use view::{Camera, Region, View};
