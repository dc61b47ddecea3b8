//! Plane sections and contours of CHPMs; no I/O.
//!
//! The finest mesh of a file is cut, or a coarser one, by parallel planes. What is read are the pages whose boxes a plane crosses; the tables suffice to know them.
//!
//! 1. A vertex on a plane counts as above it. So a triangle has at most one segment, from the edge that goes down to the edge that goes up, and a closed surface
//!    has closed lines, wherever the plane touches vertices, edges or faces.
//! 2. Where an edge crosses is computed from the vertex above to the one below: all triangles that have the edge find the same bits.
//! 3. Ends are keyed by edges: within a cluster by its own indices, between clusters by shared ids, which an edge has where both of its vertices are shared. An edge of two
//!    triangles joins two segments; of an odd number one end stays open.
//! 4. Where more than two ends meet, and in which order lines and points are told, goes by where they are: neither the order of pages nor that of triangles shows.
//! 5. Segments are exact but for rounding of their ends in f64. Of a coarser mesh, every point of a line is as near to the source as the mesh is, but
//!    how far it is from the source's own line is bounded by nothing: a slope that is nearly level moves it any way.
#![forbid(unsafe_code)]

mod chain;
mod crossing;
pub mod error;
pub mod fill;
pub mod line;
mod nest;
mod pieces;
pub mod planes;
pub mod section;

pub use error::SectionError;
pub use fill::Fill;
pub use line::Line;
pub use planes::Planes;
pub use section::{Pages, Section, Slicer};
