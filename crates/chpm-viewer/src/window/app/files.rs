//! What is opened, built and written from within the window.

use super::{App, Event};
use crate::window::browse::Browser;
use crate::window::overlay::{self, Choice};
use crate::window::record::{Pace, Recorder};
use crate::window::save;
use chpm_refine::CameraPath;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{env, fs, thread};

impl App {
    /// Opens what was dropped or chosen: a CHPM, a camera path, or a mesh, which is built first.
    pub(super) fn take(&mut self, path: &Path) {
        let is = |wanted: &str| path.extension().is_some_and(|extension| extension == wanted);
        if is("path") {
            match read_path(path) {
                Ok(camera_path) => self.replay(camera_path),
                Err(told) => self.tell(told, true),
            }
        } else if self.options.prepare.takes(path) {
            self.build(path);
        } else {
            let remembered = self.recall(path);
            if let Err(error) = self.open(path, remembered) {
                self.tell(error.to_string(), true);
            }
        }
    }

    fn replay(&mut self, path: CameraPath) {
        match &mut self.session {
            Some(session) => {
                session.follow(&path, Pace::Clock);
                session.recorded = Some(path);
                self.stir();
            }
            None => self.tell("a path needs a model: open one first", true),
        }
    }

    fn build(&mut self, source: &Path) {
        if self.building.is_some() {
            return self.tell("a build runs already", true);
        }
        let (prepare, proxy) = (Arc::clone(&self.options.prepare), self.proxy.clone());
        let path = source.to_owned();
        let work = move || {
            // A window that is closed hears nothing more.
            let tell =
                |what: &str, share: f32| drop(proxy.send_event(Event::Progress(what.to_owned(), share)));
            let built = prepare.prepare(&path, &tell);
            let _ = proxy.send_event(Event::Built(built));
        };
        let what = format!("building {}", source.display());
        match thread::Builder::new().name("build".to_owned()).spawn(work) {
            Ok(thread) => self.building = Some((what, 0.0, thread)),
            Err(error) => self.tell(format!("cannot start a build: {error}"), true),
        }
        self.stir();
    }

    /// Shows the open dialog, if there is one; answers the file that was chosen.
    pub(super) fn choose(&mut self, context: &egui::Context) -> Option<PathBuf> {
        let (browser, typed) = self.browser.as_mut()?;
        match overlay::browse(context, browser, typed) {
            Choice::Open => {}
            Choice::Closed => self.browser = None,
            Choice::Folder(folder) => self.browse(Some(folder)),
            Choice::File(path) => {
                self.browser = None;
                return Some(path);
            }
        }
        None
    }

    pub(super) fn browse(&mut self, folder: Option<PathBuf>) {
        let here = self.session.as_ref().and_then(|session| session.path.parent().map(Path::to_owned));
        let folder = folder.or(here).filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or_else(|| PathBuf::from("."));
        let prepare = &self.options.prepare;
        let wanted =
            |path: &Path| prepare.takes(path) || path.extension().is_some_and(|e| e == "chpm" || e == "path");
        self.browser = Some((Browser::new(&folder, wanted), String::new()));
    }

    pub(super) fn record(&mut self) {
        let Some(session) = &mut self.session else { return };
        let Some(recorder) = session.recorder.take() else {
            session.recorder = Some(Recorder::new(session.camera()));
            return self.tell("recording; R ends it", false);
        };
        let path = recorder.finish();
        let saved = self.save("path", path.to_string().as_bytes());
        if let Some(session) = &mut self.session {
            session.recorded = Some(path);
        }
        self.tell_saved(saved);
    }

    pub(super) fn screenshot(&mut self) {
        let size = self.size();
        let Some(session) = &mut self.session else { return };
        let image = session.image(&self.settings, size).map_err(|error| error.to_string());
        let bytes = image.and_then(|image| save::png(&image).map_err(|error| error.to_string()));
        let saved = bytes.and_then(|bytes| self.save("png", &bytes));
        self.tell_saved(saved);
    }

    /// Writes a file named after the model into the folder that the command was called in.
    fn save(&self, extension: &str, bytes: &[u8]) -> Result<PathBuf, String> {
        let folder = env::current_dir().map_err(|error| error.to_string())?;
        let stem = self.session.as_ref().and_then(|session| session.path.file_stem());
        let stem = stem.map_or("chpm".into(), |stem| stem.to_string_lossy());
        save::numbered(&folder, &stem, extension, bytes).map_err(|error| error.to_string())
    }

    fn tell_saved(&mut self, saved: Result<PathBuf, String>) {
        match saved {
            Ok(path) => self.tell(format!("written: {}", path.display()), false),
            Err(error) => self.tell(error, true),
        }
    }
}

fn read_path(path: &Path) -> Result<CameraPath, String> {
    let told = |error: &dyn std::fmt::Display| format!("cannot read '{}': {error}", path.display());
    let text = fs::read_to_string(path).map_err(|error| told(&error))?;
    let camera_path: CameraPath = text.parse().map_err(|error| told(&error))?;
    if camera_path.cameras.is_empty() { Err(told(&"it has no camera")) } else { Ok(camera_path) }
}
