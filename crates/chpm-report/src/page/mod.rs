//! Pages of HTML that need nothing else, each with the same head.

mod batch;
mod compared;
mod plots;
mod raster;
mod report;
mod seen;
mod tree;

pub use batch::{Card, index};
pub use compared::Compared;
pub use raster::{Canvas, Lens, Spot};
pub use report::{Shown, html};
pub use seen::thumbnail;

const STYLE: &str = include_str!("../../templates/style.css");
