//! Deviation, cracks and layout misses; shares no code with the simplifier that it judges.
//!
//! Everything here measures from outside: it takes plain meshes, triangle sequences and byte ranges and knows
//! nothing of clusters or quadrics. Meshes are valid in one sense only, that every corner names a vertex; functions
//! panic where one does not. Any other oddity (non-manifold, open, degenerate, empty) is measured, not refused.
#![forbid(unsafe_code)]

pub mod box_tree;
pub mod bvh;
pub mod cache;
pub mod crack;
pub mod hausdorff;
pub mod naive;
mod parting;
pub mod proof;
pub mod sample;
mod searcher;
mod shell;
pub mod sweep;
pub mod tally;
pub mod tiles;

pub use bvh::Bvh;
pub use crack::{Crack, EdgeCounts, Topology, boundary_vertices, cracks, edge_counts, topology, weld};
pub use hausdorff::{Deviation, deviation, deviation_while};
pub use searcher::{Hit, Searcher};
pub use tally::{Side, Tally};
pub use tiles::Tiles;
