//! `chpm view`: a window on a model.
//!
//! What can be tried without a window has none: [`navigate`] and [`gesture`] (the camera), [`record`] (camera paths), [`remember`]
//! and [`settings`] (what stays), [`figures`] (what the panel tells). The rest is winit, a surface and egui. A frame is drawn when
//! something moves, changes or arrives, and at no other time.

mod app;
pub mod browse;
mod canvas;
mod couple;
pub mod desk;
pub mod detail;
pub mod figures;
pub mod frustum;
pub mod gesture;
pub mod keys;
pub mod navigate;
mod overlay;
mod panel;
mod pose;
pub mod record;
pub mod relation;
pub mod remember;
pub mod rulers;
mod save;
pub mod section;
mod session;
pub mod settings;
mod style;
mod tally;

use crate::error::ViewerError;
use crate::gpu::AdapterChoice;
use crate::request::{Accuracy, Budgets, Shading};
use app::{App, Event};
use chpm_refine::{CameraPath, Side, Up};
use relation::Second;
use remember::Memory;
use section::Slice;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use winit::event_loop::{ControlFlow, EventLoop};

/// Options of a window.
pub struct Options {
    /// The model, a CHPM or what one is made of; one can be opened later.
    pub model: Option<PathBuf>,
    /// Another one beside it, for as long as no other model is opened. The first is a CHPM then, and nothing is remembered.
    pub second: Option<Second>,
    /// Memory that it may use.
    pub budgets: Budgets,
    /// Who draws.
    pub adapter: AdapterChoice,
    /// How fine, whatever was remembered.
    pub accuracy: Option<Accuracy>,
    /// A named scalar that colours show, in models that have it.
    pub color_by: Option<String>,
    /// How light falls on triangles, whatever was remembered.
    pub shading: Option<Shading>,
    /// Upward axis, whatever was remembered; chosen by the model if not given.
    pub up: Option<Up>,
    /// The side that is shown first, whatever was remembered.
    pub side: Option<Side>,
    /// The camera goes along this path first, one camera a frame.
    pub path: Option<CameraPath>,
    /// Ends after so many frames, which are then drawn one after the other. Nothing is remembered from or for such a run.
    pub frames: Option<u64>,
    /// Writes the last picture of such a run, complete and without the panel, as a PNG. A file of this name is replaced.
    pub screenshot: Option<PathBuf>,
    /// Settings that were kept of models from earlier.
    pub memory: Memory,
    /// Whether what is known is used.
    pub recall: bool,
    /// Makes a CHPM of a mesh that is the model, or dropped on the window.
    pub prepare: Arc<dyn Prepare>,
    /// Cuts models for the outline of the clipping plane.
    pub slice: Arc<dyn Slice>,
    /// Whether the process was told to end.
    pub stop: Box<dyn Fn() -> bool>,
}

/// Makes CHPMs of meshes.
pub trait Prepare: Send + Sync {
    /// Whether a file is, by its name, a mesh that can be built.
    fn takes(&self, path: &Path) -> bool;

    /// A build is about to start, in another thread: [`Prepare::cancel`] means that one from now on.
    fn begin(&self);

    /// Builds, and answers the CHPM. `tell` hears what is done, and which share of it, from any thread; `show` is given a coarse CHPM of
    /// the same model, if there is one before.
    ///
    /// # Errors
    /// What to tell the user.
    fn prepare(
        &self,
        source: &Path,
        tell: &(dyn Fn(&str, f32) + Sync),
        show: &dyn Fn(PathBuf),
    ) -> Result<PathBuf, String>;

    /// Asks the build that was begun last to end early, or not to start.
    fn cancel(&self);
}

/// Result of a session.
#[derive(Clone, PartialEq, Debug)]
pub struct Outcome {
    /// Frames that were drawn.
    pub frames: u64,
    /// From the first to the last of them, seconds.
    pub seconds: f64,
    /// Milliseconds from one frame to the next while the camera moved: the median, and what nineteen of twenty keep to.
    pub moving: Option<[f64; 2]>,
    /// Seconds from the end of the motion until the picture was complete.
    pub complete: Option<f64>,
    /// Adapter that drew the frames.
    pub adapter: String,
    /// Why what was set was not remembered, if it was not.
    pub forgot: Option<String>,
}

/// Opens a window and stays until it is closed. To be called from the main thread.
///
/// # Errors
/// [`ViewerError::Window`] where there is no window system; where nobody looks (`frames`), whatever a picture fails with.
pub fn run(options: Options) -> Result<Outcome, ViewerError> {
    let events = EventLoop::<Event>::with_user_event().build().map_err(refused)?;
    events.set_control_flow(ControlFlow::Wait);
    let mut app = App::new(options, events.create_proxy());
    events.run_app(&mut app).map_err(refused)?;
    app.finish()
}

fn refused(error: winit::error::EventLoopError) -> ViewerError {
    let why = plain_message(&error.to_string());
    ViewerError::Window(format!(
        "{}; a window needs a display, a picture does not",
        why.trim_end_matches('.')
    ))
}

/// Message of winit without the place in its own sources, which comes first: `os error at FILE:LINE: `.
fn plain_message(error: &str) -> String {
    let why = error.strip_prefix("os error at ").and_then(|rest| rest.split_once(": "));
    why.map_or(error, |(_, why)| why).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_the_window_system_name_no_source_file() {
        assert_eq!(plain_message("os error at /a/b.rs:765: no DISPLAY: set it"), "no DISPLAY: set it");
        assert_eq!(plain_message("no window: too large"), "no window: too large");
    }
}
