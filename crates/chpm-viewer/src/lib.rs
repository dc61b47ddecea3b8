//! Draws a CHPM with wgpu: in a window, or without one into an image.
//!
//! A [`Viewer`] is a picture of one model, or of several, each at its [`Transform`]: what of each is selected, in memory and on the GPU, and
//! what is known to be hidden. Each [`Viewer::frame`] is the loop of Quick-VDR 5.4: refine, draw what was visible before, test the boxes of the rest against that
//! depth, draw what has come into sight. The [`headless`] functions do the same without a window and bring the picture back.
//!
//! Nothing in here has unsafe code, prints, or knows the command line.
#![forbid(unsafe_code)]

mod caption;
pub mod error;
#[allow(unreachable_pub, reason = "`internals` shows it")]
mod fetch;
mod frame;
#[allow(unreachable_pub, reason = "`internals` shows it")]
mod gpu;
pub mod headless;
pub mod request;
#[allow(unreachable_pub, reason = "`gpu` and `frame` use it")]
mod scene;
pub mod stats;
#[allow(unreachable_pub, reason = "`gpu` and `frame` use it")]
mod tint;
mod transform;
pub mod window;

pub use error::ViewerError;
pub use frame::{Spot, Viewer};
pub use gpu::{AdapterChoice, Gpu};
pub use headless::{IdImage, Image, TriangleId};
pub use request::{Accuracy, Budgets, Clip, Coloring, FrameRequest, Look, Shading, Target};
pub use stats::{Stats, Times};
pub use transform::Transform;

/// Access for tests and benches.
#[cfg(feature = "internals")]
pub mod internals {
    pub use crate::fetch::{Arrival, Fetch, PageData};
    pub use crate::gpu::{Block, buffers, camera_uniform, passes};
}
