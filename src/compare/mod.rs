//! How far each vertex of a scan is from a reference: measured, summed up, coloured.

mod colors;
mod painted;
mod parts;
mod plot;
mod summary;

pub(crate) use colors::Colors;
pub(crate) use painted::Painted;
pub(crate) use parts::{Parts, leaves};
pub(crate) use plot::plot;
pub(crate) use summary::Summary;
