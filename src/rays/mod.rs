//! Rays as files, and what they meet.

mod hits;
mod npy;
mod scalars;
mod table;

pub(crate) use hits::{Answered, HitWriter};
pub(crate) use scalars::{Asked, InsideOut, Measured, ScalarArgs, Scalars, point};
pub(crate) use table::RayFile;
