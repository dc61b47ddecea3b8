//! The window's life: events in, frames out.

mod building;
mod files;
mod input;
mod layout;

use crate::error::ViewerError;
use crate::request::Shading;
use crate::window::browse::Browser;
use crate::window::canvas::{Canvas, clear};
use crate::window::couple::Couple;
use crate::window::gesture::Gestures;
use crate::window::keys::{Command, Flight};
use crate::window::navigate::Pivot;
use crate::window::overlay::Note;
use crate::window::panel;
use crate::window::record::Pace;
use crate::window::relation::Relation;
use crate::window::remember::Remembered;
use crate::window::section::{Cutting, Face, Sections};
use crate::window::session::{Next, Session, Whole};
use crate::window::settings::Settings;
use crate::window::tally::Tally;
use crate::window::{Options, Outcome, save};
use building::{Building, News};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::window::{Window, WindowId};

/// The window of a model that was never opened, pixels.
const SIZE: [u32; 2] = [1280, 800];
/// Seconds that a frame counts for when none came before it, and at most.
const FRAME: (f64, f64) = (1.0 / 60.0, 0.25);
/// Between two looks at what may have changed by itself: missing pages, a signal.
const GLANCE: Duration = Duration::from_millis(250);
/// Step of the clipping plane for one press of a key, a share of the model's box.
const CLIP: f64 = 0.025;
/// Step of the roll for one press of a key, degrees.
const ROLL: f64 = 5.0;
/// How long a note stays.
const NOTE: Duration = Duration::from_secs(6);

/// Messages from other threads.
#[derive(Debug)]
pub(super) enum Event {
    /// Of a build.
    Build(News),
    /// Relation of two models at a step of their motion.
    Related(usize, Result<Relation, String>),
    /// Outline of the clipping plane.
    Cut(Box<Cutting>, Result<Face, String>),
}

/// All of it.
pub(super) struct App {
    options: Options,
    proxy: EventLoopProxy<Event>,
    canvas: Option<Canvas>,
    session: Option<Session>,
    /// Relation of the two models of a session that has two.
    couple: Option<Couple>,
    sections: Option<Sections>,
    settings: Settings,
    gestures: Gestures,
    flight: Flight,
    shift: bool,
    ctrl: bool,
    help: bool,
    browser: Option<(Browser, String)>,
    note: Option<(Note, Instant)>,
    building: Option<Building>,
    started: Instant,
    /// When the last frame began, if the next one follows at once.
    before: Option<Instant>,
    /// When the next frame is due although nothing happens.
    due: Option<Instant>,
    first: Option<Instant>,
    frames: u64,
    tally: Tally,
    forgot: Option<String>,
    /// The model that is shown is a preview of what is built.
    preview: bool,
    /// Whether the build is of the model that the window was opened for.
    is_first: bool,
    fault: Option<ViewerError>,
}

impl App {
    pub(super) fn new(options: Options, proxy: EventLoopProxy<Event>) -> Self {
        App {
            options,
            proxy,
            canvas: None,
            session: None,
            couple: None,
            sections: None,
            settings: Settings::default(),
            gestures: Gestures::default(),
            flight: Flight::default(),
            shift: false,
            ctrl: false,
            help: false,
            browser: None,
            note: None,
            building: None,
            started: Instant::now(),
            before: None,
            due: None,
            first: None,
            frames: 0,
            tally: Tally::default(),
            forgot: None,
            preview: false,
            is_first: false,
            fault: None,
        }
    }

    /// After the last event.
    pub(super) fn finish(mut self) -> Result<Outcome, ViewerError> {
        if let Some(building) = self.building.take() {
            self.options.prepare.cancel();
            building.join();
        }
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        Ok(Outcome {
            frames: self.frames,
            seconds: self.first.map_or(0.0, |first| first.elapsed().as_secs_f64()),
            moving: self.tally.moving(),
            complete: self.tally.complete(),
            adapter: self.canvas.map(|canvas| canvas.gpu.describe()).unwrap_or_default(),
            forgot: self.forgot,
        })
    }

    /// Nobody looks: what fails ends the run.
    fn is_scripted(&self) -> bool {
        self.options.frames.is_some()
    }

    fn remembers(&self) -> bool {
        !self.is_scripted() && self.options.second.is_none() && self.couple.is_none()
    }

    fn size(&self) -> [u32; 2] {
        self.canvas.as_ref().map_or(SIZE, Canvas::size)
    }

    /// Width by height of the middle of the window that the panel leaves free.
    fn aspect(&self) -> f64 {
        let [width, height] = self.size().map(f64::from);
        let scale = self.canvas.as_ref().map_or(1.0, Canvas::scale);
        let beside = width - 2.0 * scale * f64::from(panel::TAKES);
        let free = if self.settings.panel && beside > 0.3 * width { beside } else { width };
        free / height
    }

    fn tell(&mut self, text: impl Into<String>, is_fault: bool) {
        self.note = Some((Note { text: text.into(), is_fault }, Instant::now()));
        self.wake();
    }

    /// The next frame is another one.
    fn wake(&mut self) {
        if let Some(session) = &mut self.session {
            session.wake();
        }
        if let Some(canvas) = &self.canvas {
            canvas.window.request_redraw();
        }
    }

    fn fail(&mut self, error: ViewerError, events: &ActiveEventLoop) {
        // Without its device, a window cannot even show a note.
        let is_lost = matches!(error, ViewerError::Device { .. });
        if self.is_scripted() || self.canvas.is_none() || is_lost {
            self.fault = Some(error);
            events.exit();
        } else {
            self.tell(error.to_string(), true);
        }
    }

    fn begin(&mut self, events: &ActiveEventLoop) -> Result<(), ViewerError> {
        // The window is as large as it was for this model.
        let model = self.options.model.clone();
        let remembered = model.as_deref().and_then(|model| self.recall(model));
        let [width, height] = remembered.as_ref().map_or(SIZE, |remembered| remembered.window);
        let attributes = Window::default_attributes()
            .with_title("chpm")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_min_inner_size(PhysicalSize::new(320, 200));
        let window = events
            .create_window(attributes)
            .map_err(|e| ViewerError::Window(super::plain_message(&e.to_string())))?;
        self.canvas = Some(Canvas::new(
            Arc::new(window),
            Box::new(events.owned_display_handle()),
            &self.options.adapter,
        )?);

        // What was asked for goes before what was remembered.
        self.settings = self.asked(self.settings.clone());
        if let Some(model) = model.as_deref().filter(|model| self.options.prepare.takes(model)) {
            self.build(model);
            self.is_first = true;
        } else if let Some(model) = model {
            self.open(&model, remembered)?;
            if let (Some(path), Some(session)) = (self.options.path.take(), &mut self.session) {
                session.follow(&path, Pace::Frames);
                session.recorded = Some(path);
            }
        }
        Ok(())
    }

    /// Settings with what was asked for in their place.
    fn asked(&self, mut settings: Settings) -> Settings {
        if let Some(shading) = self.options.shading {
            settings.smooth = shading == Shading::Smooth;
        }
        match self.options.accuracy {
            Some(accuracy) => settings.with_accuracy(accuracy),
            None => settings,
        }
    }

    fn recall(&mut self, model: &Path) -> Option<Remembered> {
        if !self.options.recall || !self.remembers() {
            return None;
        }
        match self.options.memory.recall(model) {
            Ok(remembered) => remembered,
            Err(note) => {
                self.note = Some((Note { text: note, is_fault: true }, Instant::now()));
                None
            }
        }
    }

    fn open(&mut self, model: &Path, remembered: Option<Remembered>) -> Result<(), ViewerError> {
        let Some(canvas) = &self.canvas else { return Ok(()) };
        let Options { up, side, budgets, .. } = self.options;
        let color_by = self.options.color_by.as_deref();
        let whole = Whole { up, side, aspect: self.aspect() };
        // The second model goes with the first one that is opened.
        let second = self.options.second.take();
        let mut session = Session::open(&canvas.gpu, model, second.as_ref(), budgets, color_by, &whole)?;
        let name = model.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        canvas.window.set_title(&format!("{name} - chpm"));
        if let Some(remembered) = remembered {
            self.settings = self.asked(remembered.settings.clone());
            if (up, side) == (None, None) {
                let (camera, roll) = remembered.camera();
                if session.navigator.jump(&camera) {
                    session.navigator.roll(roll);
                }
            }
        }
        self.keep();
        if let Some(canvas) = &mut self.canvas {
            canvas.forget();
        }
        self.preview = false;
        self.couple = second.and_then(|second| self.pair_up(&second));
        self.sections = self.outlines(&session);
        self.session = Some(session);
        self.before = None;
        self.wake();
        Ok(())
    }

    /// Remembers the model that is open.
    fn keep(&mut self) {
        let (Some(session), Some(canvas)) = (&self.session, &self.canvas) else { return };
        if self.remembers() && !self.preview {
            let size = canvas.window.inner_size().into();
            let (camera, roll) = (session.navigator.destination(), session.navigator.rolled());
            let remembered = Remembered::new(&session.path, size, &camera, roll, &self.settings);
            self.forgot = self.options.memory.keep(&session.path, &remembered).err();
        }
    }

    fn handle_command(&mut self, command: Command, events: &ActiveEventLoop) {
        let (size, aspect) = (self.size(), self.aspect());
        let settings = &mut self.settings;
        match command {
            Command::Help => self.help = !self.help,
            Command::Panel => settings.panel = !settings.panel,
            Command::Fly => settings.fly = !settings.fly,
            Command::Finer => settings.step_accuracy(false),
            Command::Coarser => settings.step_accuracy(true),
            Command::Shading => settings.smooth = !settings.smooth,
            Command::Colors => settings.next_colors(),
            Command::Wireframe => settings.wireframe = !settings.wireframe,
            Command::Shadows => {
                let now = self.canvas.as_ref().is_some_and(|canvas| settings.shades(&canvas.gpu));
                settings.shadows = Some(!now);
            }
            Command::Occlusion => settings.occlusion_culling = !settings.occlusion_culling,
            Command::Frustum => settings.frustum_culling = !settings.frustum_culling,
            Command::Clip => settings.next_clip(),
            Command::ClipMore => settings.move_clip(-CLIP),
            Command::ClipLess => settings.move_clip(CLIP),
            Command::Outline => self.draw_outline(),
            Command::Open => self.browse(None),
            Command::Back => self.back(),
            Command::Quit => events.exit(),
            Command::Measure | Command::Inspect => {
                let at = self.gestures.pointer();
                let Some(session) = &mut self.session else { return };
                let done = match command {
                    Command::Measure => session.measure(at, size),
                    _ => session.inspect(at, size),
                };
                if let Err(error) = done {
                    self.tell(error.to_string(), true);
                }
            }
            // These are about a model.
            Command::Home
            | Command::Fit
            | Command::Up
            | Command::RollLeft
            | Command::RollRight
            | Command::Freeze
            | Command::Replay => {
                let Some(session) = &mut self.session else { return };
                match command {
                    Command::Home => {
                        session.lead().home(aspect);
                        self.settings.light = crate::request::Look::LIGHT;
                    }
                    Command::RollLeft => session.lead().roll(ROLL),
                    Command::RollRight => session.lead().roll(-ROLL),
                    Command::Fit => session.lead().fit(aspect),
                    Command::Freeze => session.freeze(size),
                    Command::Replay if session.replay.is_some() => session.stop_replay(),
                    Command::Replay => match session.recorded.clone() {
                        Some(path) => session.follow(&path, Pace::Clock),
                        None => self.tell("no path yet: record one with R, or drop a .path file", false),
                    },
                    _ => session.lead().next_up(aspect),
                }
            }
            Command::Record => self.record(),
            Command::Screenshot => self.screenshot(),
        }
        self.wake();
    }

    fn back(&mut self) {
        let mut closes = self.help || self.browser.is_some();
        if !closes && self.building.is_some() {
            self.options.prepare.cancel();
            closes = true;
        }
        (self.help, self.browser) = (false, None);
        if let (false, Some(session)) = (closes, &mut self.session) {
            session.stop_replay();
        }
    }

    /// One frame.
    fn redraw(&mut self, events: &ActiveEventLoop) -> Result<(), ViewerError> {
        // Taken out meanwhile: the panel is laid out by what else is in here.
        let Some(mut canvas) = self.canvas.take() else { return Ok(()) };
        let now = Instant::now();
        let since = self.before.map_or(FRAME.0, |before| (now - before).as_secs_f64());
        let seconds = since.min(FRAME.1);

        let before = self.settings.clone();
        let (mut asked, mut chosen) = (Vec::new(), None);
        let size = canvas.size();
        // A layout may take several passes; what was asked for in any of them counts once.
        let over = canvas.lay_out(|context| {
            asked.extend(self.lay_out(context, size));
            chosen = chosen.take().or(self.choose(context));
        });

        // The camera moves by what is held, and the model is drawn below the panel.
        let shown = match &mut self.session {
            Some(session) => {
                session.navigator.set_pivot(if self.settings.fly { Pivot::Eye } else { Pivot::Focus });
                session.navigator.fly(self.flight.thrust(self.shift));
                if before != self.settings {
                    session.wake();
                }
                session.step(seconds, size);
                if let Some(place) = self.couple.as_mut().and_then(|couple| couple.place(seconds)) {
                    session.put(place);
                }
                let request = session.request(&self.settings, size, self.before.map(|_| since));
                let shown = canvas.show(over, |target, kept| session.draw(&request, target, kept));
                shown.map(|drawn| {
                    drawn.map(|stats| {
                        if let Some(stats) = stats {
                            session.shown(&stats, now.elapsed(), since);
                        }
                    })
                })
            }
            None => {
                let gpu = Arc::clone(&canvas.gpu);
                canvas.show(over, |target, _| {
                    clear(&gpu, target.color);
                    Ok(())
                })
            }
        };
        if let (Some(session), true) = (&self.session, self.options.frames.is_some()) {
            let since = self.before.map(|_| since);
            self.tally.take(since, session.is_moving(), session.next() == Next::Rest);
        }
        let repaint = canvas.repaint;
        self.canvas = Some(canvas);
        let shown = shown?;

        for command in asked {
            self.handle_command(command, events);
        }
        if let Some(path) = chosen {
            self.take(&path);
        }

        // When the next frame is due: at once, or when a note ends, something may have come, or the panel moves by itself.
        let next = match (&shown, &self.session) {
            // The window cannot be drawn into: it is hidden.
            (None, _) => Next::Look,
            (Some(()), _) if self.is_scripted() => Next::Frame,
            (Some(()), Some(session)) => session.next(),
            (Some(()), None) => Next::Rest,
        };
        self.before = (next == Next::Frame).then_some(now);
        self.due = match next {
            Next::Frame => Some(now),
            Next::Look => Some(now + GLANCE),
            Next::Rest => None,
        };
        let until = self.note.as_ref().map(|(_, since)| *since + NOTE);
        let repaint = now.checked_add(repaint).filter(|_| repaint < Duration::from_secs(3600));
        self.due = [self.due, until, repaint].into_iter().flatten().min();

        if shown.is_some() {
            self.count(now, events)?;
        }
        Ok(())
    }

    /// A frame was shown. The last of a script leaves its picture.
    fn count(&mut self, now: Instant, events: &ActiveEventLoop) -> Result<(), ViewerError> {
        self.first.get_or_insert(now);
        self.frames += 1;
        if self.options.frames.is_some_and(|frames| self.frames >= frames) && !events.exiting() {
            events.exit();
            let size = self.size();
            if let (Some(path), Some(session)) = (&self.options.screenshot, &mut self.session) {
                let image = session.image(&self.settings, size)?;
                save::write(
                    path,
                    true,
                    &save::png(&image)
                        .map_err(|error| ViewerError::Window(format!("no picture: {error}")))?,
                )?;
            }
        }
        Ok(())
    }
}

impl ApplicationHandler<Event> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.canvas.is_none()
            && let Err(error) = self.begin(events)
        {
            // Without the model that was asked for there is nothing to look at.
            self.fault = Some(error);
            events.exit();
        }
    }

    fn new_events(&mut self, events: &ActiveEventLoop, _: StartCause) {
        if (self.options.stop)() {
            events.exit();
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, event: Event) {
        match event {
            Event::Build(news) => self.hear_of_build(news, events),
            Event::Cut(cutting, answer) => {
                if let Some(sections) = &mut self.sections {
                    sections.hear(*cutting, answer);
                }
            }
            Event::Related(step, answer) => {
                if let Some(couple) = &mut self.couple {
                    couple.hear(step, answer);
                }
            }
        }
        self.wake();
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.redraw(events) {
                    self.session = self.session.take().filter(|_| self.is_scripted());
                    self.fail(error, events);
                }
            }
            event => self.hear(&event, events),
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let now = Instant::now();
        match (&self.canvas, self.due) {
            (Some(canvas), Some(due)) if due <= now => {
                self.due = None;
                canvas.window.request_redraw();
            }
            _ => {}
        }
        // A signal wakes nobody up; somebody has to look.
        let glance = now + GLANCE;
        events.set_control_flow(ControlFlow::WaitUntil(self.due.map_or(glance, |due| due.min(glance))));
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        self.keep();
    }
}
