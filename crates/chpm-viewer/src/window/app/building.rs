//! A build that runs beside the window, and what it tells.

use super::{App, Event};
use crate::error::ViewerError;
use crate::window::Prepare;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use winit::event_loop::{ActiveEventLoop, EventLoopProxy};

/// Messages of a build.
#[derive(Debug)]
pub(in crate::window) enum News {
    /// It does this, and has done this share of it.
    Progress(String, f32),
    /// It has something to look at meanwhile.
    Preview(PathBuf),
    /// It is done: the CHPM, or what to tell.
    Built(Result<PathBuf, String>),
}

/// A build that runs.
pub(super) struct Building {
    /// Present step.
    pub(super) what: String,
    /// The share of that which is done.
    pub(super) share: f32,
    thread: JoinHandle<()>,
    /// Another model was opened since: what is built does not take its place.
    is_aside: bool,
}

impl Building {
    /// Waits for its end.
    pub(super) fn join(self) {
        // A build that panicked has told so.
        let _ = self.thread.join();
    }
}

/// A build, in a thread of its own. A window that is closed hears nothing more.
fn run(prepare: &dyn Prepare, path: &Path, proxy: &EventLoopProxy<Event>) {
    fn send(news: News, proxy: &EventLoopProxy<Event>) {
        drop(proxy.send_event(Event::Build(news)))
    }
    let built = prepare.prepare(
        path,
        &|what: &str, share: f32| send(News::Progress(what.to_owned(), share), proxy),
        &|preview: PathBuf| send(News::Preview(preview), proxy),
    );
    send(News::Built(built), proxy);
}

impl App {
    pub(super) fn build(&mut self, source: &Path) {
        if self.building.is_some() {
            return self.tell("a build runs already", true);
        }
        let (prepare, proxy) = (Arc::clone(&self.options.prepare), self.proxy.clone());
        let path = source.to_owned();
        // Whoever cancels from now on means this one, even before its thread runs.
        prepare.begin();
        let what = format!("building {}", source.display());
        if let Some(canvas) = &self.canvas {
            let name = source.file_name().unwrap_or_default().to_string_lossy();
            canvas.window.set_title(&format!("{name} - chpm"));
        }
        match thread::Builder::new().name("build".to_owned()).spawn(move || run(&*prepare, &path, &proxy)) {
            Ok(thread) => self.building = Some(Building { what, share: 0.0, thread, is_aside: false }),
            Err(error) => self.tell(format!("cannot start a build: {error}"), true),
        }
        self.wake();
    }

    /// Another model was opened: what is built is not shown in its place, and if it fails, the window stays.
    pub(super) fn set_build_aside(&mut self) {
        self.is_first = false;
        if let Some(building) = &mut self.building {
            building.is_aside = true;
        }
    }

    pub(super) fn hear_of_build(&mut self, news: News, events: &ActiveEventLoop) {
        match news {
            News::Progress(what, share) => {
                if let Some(building) = &mut self.building {
                    (building.what, building.share) = (what, share);
                }
            }
            News::Preview(path) => {
                // What cannot be drawn early need not be.
                let is_shown = self.building.as_ref().is_some_and(|building| !building.is_aside);
                if is_shown && self.open(&path, None).is_ok() {
                    self.preview = true;
                    if let Some(canvas) = &self.canvas {
                        canvas.window.set_title("preview - chpm");
                    }
                }
            }
            News::Built(built) => {
                let is_aside = self.building.take().is_some_and(|building| building.is_aside);
                let is_first = std::mem::take(&mut self.is_first);
                match built {
                    Ok(path) if is_aside => self.tell(format!("built: {}", path.display()), false),
                    Ok(path) => self.take_built(&path),
                    Err(told) if is_first => {
                        self.fault = Some(ViewerError::Model(told));
                        events.exit();
                    }
                    Err(told) => self.tell(told, true),
                }
            }
        }
    }

    /// Opens what was built; seen as its preview was, if that is what is shown.
    fn take_built(&mut self, path: &Path) {
        let seen = self.session.as_ref().filter(|_| self.preview).map(|session| *session.camera());
        let remembered = if seen.is_some() { None } else { self.recall(path) };
        if let Err(error) = self.open(path, remembered) {
            return self.tell(error.to_string(), true);
        }
        if let (Some(session), Some(camera)) = (&mut self.session, seen) {
            session.navigator.resume(&camera);
        }
    }
}
