//! Events of the window system, as gestures and commands.

use super::App;
use crate::window::gesture::{Button, Finger, Motion, Scroll};
use crate::window::keys::{self, Command};
use chpm_extmem::platform::HAS_COMMAND_KEY;
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, TouchPhase, WindowEvent};
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::{KeyCode, PhysicalKey};

impl App {
    /// Something happened in the window.
    pub(super) fn hear(&mut self, event: &WindowEvent, events: &ActiveEventLoop) {
        let Some(canvas) = &mut self.canvas else { return };
        let (consumed, repaint) = canvas.hear(event);
        if repaint {
            canvas.window.request_redraw();
        }

        match event {
            WindowEvent::Resized(size) => {
                canvas.resize(size.width, size.height);
                self.wake();
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                let state = modifiers.state();
                // Where there is a Command key, it is the one.
                let ctrl = if HAS_COMMAND_KEY { state.super_key() } else { state.control_key() };
                (self.shift, self.ctrl) = (state.shift_key(), ctrl);
                self.gestures.modifiers(self.shift, self.ctrl);
            }
            WindowEvent::Focused(false) => {
                self.gestures.lose();
                self.flight.lose();
            }
            WindowEvent::DroppedFile(path) => self.take(path),
            WindowEvent::KeyboardInput { event: key, is_synthetic: false, .. } => {
                self.hear_key(key, consumed, events);
            }
            // What is pressed over the panel is the panel's; what is released ends here wherever it is.
            WindowEvent::MouseInput { state, button, .. }
                if !consumed || *state == ElementState::Released =>
            {
                self.hear_button(*state, *button);
            }
            WindowEvent::CursorMoved { position, .. } => {
                let motion = self.gestures.go([position.x, position.y]);
                self.go_all(motion);
            }
            WindowEvent::MouseWheel { delta, .. } if !consumed => {
                let scroll = match *delta {
                    MouseScrollDelta::LineDelta(x, y) => Scroll::Lines([f64::from(x), f64::from(y)]),
                    MouseScrollDelta::PixelDelta(by) => Scroll::Pixels([by.x, by.y]),
                };
                let motion = self.gestures.scroll(scroll);
                self.go_all(motion);
            }
            WindowEvent::PinchGesture { delta, .. } if !consumed => {
                let motion = self.gestures.pinch(*delta);
                self.go_all(motion);
            }
            WindowEvent::Touch(touch) if !consumed => {
                let finger = match touch.phase {
                    TouchPhase::Started | TouchPhase::Moved => Finger::Down,
                    TouchPhase::Ended | TouchPhase::Cancelled => Finger::Up,
                };
                let motion = self.gestures.touch(touch.id, finger, [touch.location.x, touch.location.y]);
                self.go_all(motion);
            }
            _ => {}
        }
    }

    fn hear_key(&mut self, key: &KeyEvent, consumed: bool, events: &ActiveEventLoop) {
        let PhysicalKey::Code(code) = key.physical_key else { return };
        let down = key.state == ElementState::Pressed;

        // A key that goes up is up, whoever saw it go down.
        let dialog = self.browser.is_some();
        let typing = consumed || dialog || self.canvas.as_ref().is_some_and(|canvas| canvas.is_typing());
        if self.flight.hold(code, down && !typing && !self.ctrl) && !self.ctrl {
            return self.wake_camera();
        }
        // Who types at once means the field, which has the focus from the dialog's first frame on.
        if down && dialog && !self.ctrl && !self.canvas.as_ref().is_some_and(|it| it.is_typing()) {
            self.type_early(code, key.text.as_deref().unwrap_or_default());
        }
        // What is typed is no command, but for what ends the window, or closes the dialog.
        if !down || typing {
            match keys::command(code, self.ctrl) {
                Some(Command::Quit) if down => self.handle_command(Command::Quit, events),
                Some(Command::Back) if down && dialog => self.handle_command(Command::Back, events),
                _ => {}
            }
            return;
        }

        if let Some(share) = keys::arrow(code) {
            let height = f64::from(self.size()[1]);
            return self.go(Motion::Turn(share.map(|share| share * height)));
        }
        // A key that is held would switch to and fro.
        if let Some(command) = keys::command(code, self.ctrl).filter(|it| !key.repeat || it.repeats()) {
            self.handle_command(command, events);
        }
    }

    /// A key goes to the dialog's field before that is there.
    fn type_early(&mut self, code: KeyCode, text: &str) {
        let Some((_, typed)) = &mut self.browser else { return };
        match code {
            KeyCode::Enter | KeyCode::NumpadEnter => self.enter_early(),
            KeyCode::Backspace => drop(typed.pop()),
            _ => typed.extend(text.chars().filter(|letter| !letter.is_control())),
        }
    }

    fn hear_button(&mut self, state: ElementState, button: MouseButton) {
        let button = match button {
            MouseButton::Left => Button::Left,
            MouseButton::Middle => Button::Middle,
            MouseButton::Right => Button::Right,
            _ => return,
        };
        match state {
            ElementState::Released => self.gestures.release(button),
            ElementState::Pressed => {
                let motion = self.gestures.press(button, self.started.elapsed().as_secs_f64());
                self.go_all(motion);
            }
        }
    }

    fn go_all(&mut self, motions: impl IntoIterator<Item = Motion>) {
        motions.into_iter().for_each(|motion| self.go(motion));
    }

    fn go(&mut self, motion: Motion) {
        let size = self.size();
        if let Motion::Light(drag) = motion {
            self.settings.move_light(drag, f64::from(size[1]));
            return self.wake();
        }
        if let Some(session) = &mut self.session {
            session.go(motion, size);
        }
        self.wake_camera();
    }

    /// The camera may move: the next frame shows it.
    fn wake_camera(&mut self) {
        if let Some(canvas) = &self.canvas {
            canvas.window.request_redraw();
        }
    }
}
