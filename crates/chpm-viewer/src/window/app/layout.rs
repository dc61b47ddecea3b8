//! The panel, dialogs and what else lies over the model.

use super::{App, NOTE};
use crate::window::keys::Command;
use crate::window::overlay;
use crate::window::panel::{self, About};
use crate::window::record::Recorder;
use crate::window::section::Sections;

impl App {
    /// Lays out the panel and dialogs over the model; returns the commands of their buttons.
    pub(super) fn lay_out(&mut self, context: &egui::Context, size: [u32; 2]) -> Vec<Command> {
        if let Some(session) = &self.session {
            let scale = context.pixels_per_point();
            overlay::borders(context, &session.frozen_lines(size), scale);
            if self.settings.rulers {
                overlay::rulers(context, session.camera(), size, scale);
            }
            if let Some(sections) = &mut self.sections {
                sections.want(session.cutting(&self.settings));
                sections.show(context, session.camera(), size, scale);
            }
            overlay::marks(context, &session.marks, session.camera(), size, scale);
            overlay::record(context, &session.inspected);
            if let Some(couple) = &mut self.couple {
                couple.mark(context, session.camera(), size, scale);
            }
        }

        if self.couple.as_mut().is_some_and(|couple| couple.show(context)) {
            self.wake();
        }
        let mut commands = self.show_panel(context);

        if self.session.is_none() && self.building.is_none() {
            overlay::nothing(context);
        }
        if self.help && overlay::keys(context) {
            commands.push(Command::Help);
        }
        if let Some(building) = &self.building
            && overlay::progress(context, &building.what, building.share, self.preview)
        {
            self.options.prepare.cancel();
        }

        if let Some(damage) = self.session.as_ref().and_then(|session| session.viewer.damage()) {
            overlay::damage(context, &damage.to_string());
        }

        self.note = self.note.take().filter(|(_, since)| since.elapsed() < NOTE);
        if let Some((note, _)) = &self.note {
            overlay::note(context, note);
        }
        commands
    }

    fn show_panel(&mut self, context: &egui::Context) -> Vec<Command> {
        let (Some(session), true) = (&self.session, self.settings.panel) else { return Vec::new() };
        let name = session.name();
        let gpu = session.viewer.gpu();
        let adapter = gpu.adapter.get_info();
        let about = About {
            model: &name,
            triangles: session.viewer.files().map(|file| file.header().source_triangle_count).sum(),
            adapter: &adapter.name,
            memory: self.options.budgets.memory,
            gpu_memory: self.options.budgets.gpu_memory,
            smooth: gpu.multisamples().then(|| self.settings.smooths(gpu)),
            shadows: self.settings.shades(gpu),
            up: session.navigator.upward(),
            frozen: session.frozen.is_some(),
            recording: session.recorder.as_ref().map(Recorder::seconds),
            replaying: session.replay.as_ref().map(|replay| replay.progress()),
            can_replay: session.recorded.is_some(),
            scalar: session.viewer.scalar(),
            section: self.sections.as_ref().and_then(Sections::known),
        };
        panel::show(context, &mut self.settings, &session.figures, &about)
    }
}
