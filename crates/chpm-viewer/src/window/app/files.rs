//! Opening, building and writing files from within the window.

use super::{App, Event};
use crate::window::browse::Browser;
use crate::window::couple::Couple;
use crate::window::overlay::{self, Choice};
use crate::window::record::{Pace, Recorder};
use crate::window::relation::Second;
use crate::window::save;
use crate::window::section::Sections;
use crate::window::session::Session;
use chpm_extmem::read_text;
use chpm_refine::CameraPath;
use std::env;
use std::path::{Path, PathBuf};

impl App {
    /// Opens what was dropped or chosen: a CHPM, a camera path, or a mesh, which is built first.
    pub(super) fn take(&mut self, path: &Path) {
        match Given::by_name(path, |path| self.options.prepare.takes(path)) {
            Given::Path => match read_path(path) {
                Ok(camera_path) => self.replay(camera_path),
                Err(told) => self.tell(told, true),
            },
            Given::Mesh => self.build(path),
            Given::Model => {
                let remembered = self.recall(path);
                match self.open(path, remembered) {
                    Ok(()) => self.set_build_aside(),
                    Err(error) => self.tell(error.to_string(), true),
                }
            }
        }
    }

    fn replay(&mut self, path: CameraPath) {
        match &mut self.session {
            Some(session) => {
                session.follow(&path, Pace::Clock);
                session.recorded = Some(path);
                self.wake();
            }
            None => self.tell("a path needs a model: open one first", true),
        }
    }

    /// Has somebody look how the two models lie.
    pub(super) fn pair_up(&mut self, second: &Second) -> Option<Couple> {
        let proxy = self.proxy.clone();
        // A window that is closed hears nothing more.
        let couple =
            Couple::new(second, move |step, answer| drop(proxy.send_event(Event::Related(step, answer))));
        match couple {
            Ok(couple) => Some(couple),
            Err(told) => {
                self.tell(told, true);
                None
            }
        }
    }

    /// Has outlines of the clipping plane cut, unless nobody looks.
    pub(super) fn outlines(&mut self, session: &Session) -> Option<Sections> {
        if self.is_scripted() {
            return None;
        }
        let models = session.viewer.files().map(|file| file.get_ref().path().to_owned()).collect();
        let proxy = self.proxy.clone();
        let hear = move |cutting, answer| drop(proxy.send_event(Event::Cut(Box::new(cutting), answer)));
        match Sections::new(&self.options.slice, models, hear) {
            Ok(sections) => Some(sections),
            Err(told) => {
                self.tell(told, true);
                None
            }
        }
    }

    /// Writes the outline of the clipping plane.
    pub(super) fn draw_outline(&mut self) {
        let Some(session) = &self.session else { return };
        let plane = self.settings.plane(&session.viewer.bounds(), session.viewer.origin());
        let Some(plane) = plane else {
            return self.tell("no clipping plane: K sets one", false);
        };
        // Each has coordinates of its own.
        if session.viewer.files().nth(1).is_some() {
            return self.tell("the outline of two models is not written: open one of them alone", true);
        }
        let drawing = self.options.slice.draw(session.viewer.file().get_ref().path(), &plane);
        let saved = drawing.and_then(|drawing| self.save("svg", &drawing));
        self.tell_saved(saved);
    }

    /// Shows the open dialog, if there is one; answers the file that was chosen.
    pub(super) fn choose(&mut self, context: &egui::Context) -> Option<PathBuf> {
        let (browser, typed) = self.browser.as_mut()?;
        let choice = overlay::browse(context, browser, typed);
        let chosen = self.follow_choice(choice);
        if self.browser.is_none() {
            // Else the field that is gone would take the next keys.
            context.memory_mut(egui::Memory::stop_text_input);
        }
        chosen
    }

    /// Return was pressed before the dialog's first frame, which alone could have heard it.
    pub(super) fn enter_early(&mut self) {
        let choice = self.browser.as_ref().map(|(browser, typed)| overlay::entered(browser, typed));
        if let Some(path) = choice.and_then(|choice| self.follow_choice(choice)) {
            self.take(&path);
        }
    }

    fn follow_choice(&mut self, choice: Choice) -> Option<PathBuf> {
        match choice {
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
        let browser = Browser::new(&folder, |path: &Path| {
            prepare.takes(path) || path.extension().is_some_and(|e| e == "chpm" || e == "path")
        });
        self.browser = Some((browser, String::new()));
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

/// Kind of a file that was dropped or chosen.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Given {
    /// A camera path.
    Path,
    /// To be built first.
    Mesh,
    /// A CHPM, or something that will be refused as one.
    Model,
}

impl Given {
    fn by_name(path: &Path, is_mesh: impl Fn(&Path) -> bool) -> Self {
        if path.extension().is_some_and(|extension| extension == "path") {
            Given::Path
        } else if is_mesh(path) {
            Given::Mesh
        } else {
            Given::Model
        }
    }
}

/// Most bytes of a file of cameras.
const MOST_PATH: u64 = 64 << 20;

fn read_path(path: &Path) -> Result<CameraPath, String> {
    let told = |error: &dyn std::fmt::Display| format!("cannot read '{}': {error}", path.display());
    let text = read_text(path, MOST_PATH).map_err(|error| told(&error))?;
    let camera_path: CameraPath = text.parse().map_err(|error| told(&error))?;
    if camera_path.cameras.is_empty() { Err(told(&"it has no camera")) } else { Ok(camera_path) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_refine::Camera;
    use std::fs;

    #[test]
    fn what_is_dropped_is_told_by_its_name() {
        let is_mesh = |path: &Path| path.extension().is_some_and(|extension| extension == "ply");
        let given = |name: &str| Given::by_name(Path::new(name), is_mesh);
        assert_eq!(given("a/walk.path"), Given::Path);
        assert_eq!(given("a/mesh.ply"), Given::Mesh);
        // What is neither is opened, and says why it cannot be.
        for name in ["model.chpm", "a.png", "path", "ply", ""] {
            assert_eq!(given(name), Given::Model, "{name}");
        }
    }

    #[test]
    fn a_dropped_path_is_read_whole_or_told_of() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.path");
        let camera_path = CameraPath { cameras: vec![Camera::looking([1.0, 2.0, 3.0], [0.0; 3]); 3] };
        fs::write(&file, camera_path.to_string()).unwrap();
        assert_eq!(read_path(&file), Ok(camera_path));
        fs::write(&file, CameraPath::default().to_string()).unwrap();
        assert!(read_path(&file).unwrap_err().contains("no camera"));
        fs::write(&file, [0xff, 0xfe]).unwrap();
        let told = read_path(&file).unwrap_err();
        assert!(told.contains("cannot read") && told.contains("a.path"), "{told}");
        assert!(read_path(&folder.path().join("none.path")).is_err());
    }
}
