//! How far each vertex of a scan is from a reference: measured, summed up, coloured.

mod page;
mod painted;
mod parts;
mod plot;
mod summary;

pub(crate) use page::{Told, page};
pub(crate) use painted::Painted;
pub(crate) use parts::{Parts, leaves};
pub(crate) use plot::{plot, signed};
pub(crate) use summary::{PERCENTS, Pass, Summary};
