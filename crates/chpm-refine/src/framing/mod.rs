//! Where a whole model is looked at from: which axis is up, which side is shown, and how near the camera may come.
//!
//! All of it is decided by an [`Outline`], a coarse mesh of the model, and by nothing else: the same file gives the same picture.

mod apart;
mod direction;
mod ground;
mod heights;
mod outline;
mod portrait;
mod sight;
mod stance;

pub use direction::{Side, Up};
pub use outline::{Outline, Window};
pub use portrait::{Portrait, told_by};
pub use stance::Stance;
