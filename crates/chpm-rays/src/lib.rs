//! Rays over CHPMs; no I/O.
//!
//! 1. A group is split by a ray where its error is above what the ray's bound allows in the group's box. Bounds never grow from a group to those above it, so a group that is
//!    split has only split groups above, and their boxes hold its box: a traversal of a tree of groups, in which a group's parent is the one above its first coarse cluster, comes
//!    to each split group once.
//!    Where the bound is common to all rays, so is the mesh, and boxes over its clusters take the place of the groups.
//! 2. A cluster's base mesh is there where its group is not split and the group above is; a leaf of a split group is there as it is. So a ray meets a whole mesh, in which
//!    clusters of different levels share their border vertices bit for bit.
//! 3. Triangles are tested as by Woop, Benthin and Wald (2013), in f64: the sign of an edge is right or zero, the same for both triangles of an edge, and zero counts as a hit. Nothing
//!    passes between triangles that share an edge.
//! 4. Boxes are tested in f32, widened by all that rounding may lose.
//! 5. Leaves are the source, so hits on them are the source's. Of coarse meshes no hit is proven, but with the distance D of the mesh from the source: a ray that stays farther than D from the mesh
//!    misses the source, and the source is not met before the ray first comes within D.
//! 6. A ray stops at a page that is not in memory. When all rays have stopped, the pages that most wait for are read, and so on: whatever the memory, a page is read
//!    once for all rays that have come to it, and each ray takes the same way.
#![forbid(unsafe_code)]

mod bound;
mod caster;
pub mod error;
mod fat;
mod mesh;
mod ray;
mod readers;
mod sides;
pub mod still;
mod tree;
mod walk;
mod wide;

pub use bound::Bound;
pub use caster::{Caster, Memory, Reads};
pub use error::RayError;
pub use ray::{Hit, Ray, Seek};
pub use sides::Sides;
