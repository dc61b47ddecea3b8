//! Proven distances, clearances and contacts of two CHPMs; no I/O.
//!
//! A coarse mesh with a bound on how far it is from the source proves things about the source. With S a part of a source, M what is drawn for it,
//! every point of S within D of M, and every point of M within E of the source:
//!
//! 1. No point of S is nearer to a thing than M is, less D. So what is far from all meshes of a cut is proven far from the source.
//! 2. Some point of the source is as near as M is, and E more.
//! 3. The groups of a file are an acyclic graph, and what a group stands for is what its fine clusters' groups stand for, or less. So a question goes
//!    from the roots downward, and only to where it is not decided yet.
//! 4. A group's box, wider by what its leaves are wrong by, holds all that it stands for, so most pairs of groups are settled by the tables, without a page.
//! 5. Two triangles' distance is between how far apart they are along some direction and the distance of two of their points. Both hold for whatever
//!    direction and points a search in f64 comes up with, up to the rounding of a few sums, which is added.
#![forbid(unsafe_code)]

mod boxes;
pub mod contacts;
mod cross;
pub mod crossing;
pub mod error;
pub mod front;
pub mod gauge;
mod patch;
pub mod pose;
pub mod search;
mod triangle;
mod wanted;

pub use chpm_space::{Model, Reads};
pub use contacts::{Contacts, Region, contacts};
pub use crossing::{Crossing, crossings};
pub use error::ProximityError;
pub use front::Front;
pub use gauge::Gauge;
pub use pose::Pose;
pub use search::{Answer, ClosestPoints, End, Question, distance, follow};
