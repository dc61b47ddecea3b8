//! Sheets: an image of a cluster's surface, made of orthogonal projections.
//!
//! [`Plan::new`] divides the triangles of a progressive mesh into charts, each of which faces its direction at every position, and packs their rectangles;
//! [`Plan::bake`] fills the image from what each triangle shows: an image of the source, the sheet of a finer cluster, or colours of its corners. All of it is
//! plain arithmetic of whole numbers and of floating point that is not fused, so that the same bytes come out on every machine.

mod bake;
mod below;
mod charts;
mod directions;
mod fill;
mod halve;
mod pack;
mod painted;
mod plan;
mod raster;
mod sample;
mod sizes;
mod vector;

pub use crate::texels::Texel;
pub use below::{Below, Sampled, texel_side};
pub use halve::halved;
pub use pack::pack;
pub use painted::Painted;
pub use plan::{Paint, Plan, Surface};
pub use sample::{Pixels, Region, rows};
pub use sizes::{LEVELS, Sizes, fitted};
