//! How far each vertex of a scan is from a reference: measured, summed up, coloured.

mod colors;
mod plot;
mod summary;

pub(crate) use colors::Colors;
pub(crate) use plot::plot;
pub(crate) use summary::Summary;
