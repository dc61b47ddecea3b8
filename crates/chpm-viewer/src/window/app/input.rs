//! What the window system reports, as gestures and commands.

use super::App;
use crate::window::gesture::{Button, Finger, Motion, Scroll};
use crate::window::keys;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, TouchPhase, WindowEvent};
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::PhysicalKey;

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
                self.stir();
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                let state = modifiers.state();
                // Where there is a Command key, it is the one.
                let ctrl = if cfg!(target_os = "macos") { state.super_key() } else { state.control_key() };
                (self.shift, self.ctrl) = (state.shift_key(), ctrl);
                self.gestures.modifiers(self.shift, self.ctrl);
            }
            WindowEvent::Focused(false) => {
                self.gestures.lose();
                self.flight.lose();
            }
            WindowEvent::DroppedFile(path) => self.take(path),
            WindowEvent::KeyboardInput { event: key, is_synthetic: false, .. } => {
                let PhysicalKey::Code(code) = key.physical_key else { return };
                let down = key.state == ElementState::Pressed;
                // A key that goes up is up, whoever saw it go down.
                let typing = consumed || self.canvas.as_ref().is_some_and(|canvas| canvas.is_typing());
                if self.flight.hold(code, down && !typing && !self.ctrl) && !self.ctrl {
                    return self.stir_camera();
                }
                if !down || typing {
                    return;
                }
                if let Some(share) = keys::arrow(code) {
                    let height = f64::from(self.size()[1]);
                    return self.go(Motion::Turn(share.map(|share| share * height)));
                }
                if let (Some(command), false) = (keys::command(code, self.ctrl), key.repeat) {
                    self.obey(command, events);
                }
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let button = match button {
                    MouseButton::Left => Button::Left,
                    MouseButton::Middle => Button::Middle,
                    MouseButton::Right => Button::Right,
                    _ => return,
                };
                if *state == ElementState::Released {
                    self.gestures.release(button);
                } else if !consumed {
                    let seconds = self.started.elapsed().as_secs_f64();
                    let motion = self.gestures.press(button, seconds);
                    motion.into_iter().for_each(|motion| self.go(motion));
                }
            }
            WindowEvent::CursorMoved { position, .. } => {
                let motion = self.gestures.go([position.x, position.y]);
                motion.into_iter().for_each(|motion| self.go(motion));
            }
            WindowEvent::MouseWheel { delta, .. } if !consumed => {
                let scroll = match *delta {
                    MouseScrollDelta::LineDelta(x, y) => Scroll::Lines([f64::from(x), f64::from(y)]),
                    MouseScrollDelta::PixelDelta(by) => Scroll::Pixels([by.x, by.y]),
                };
                let motion = self.gestures.scroll(scroll);
                motion.into_iter().for_each(|motion| self.go(motion));
            }
            WindowEvent::PinchGesture { delta, .. } if !consumed => {
                let motion = self.gestures.pinch(*delta);
                motion.into_iter().for_each(|motion| self.go(motion));
            }
            WindowEvent::Touch(touch) if !consumed => {
                let finger = match touch.phase {
                    TouchPhase::Started | TouchPhase::Moved => Finger::Down,
                    TouchPhase::Ended | TouchPhase::Cancelled => Finger::Up,
                };
                let at = [touch.location.x, touch.location.y];
                self.gestures.touch(touch.id, finger, at).into_iter().for_each(|motion| self.go(motion));
            }
            _ => {}
        }
    }

    fn go(&mut self, motion: Motion) {
        let size = self.size();
        if let Some(session) = &mut self.session {
            session.go(motion, size);
        }
        self.stir_camera();
    }

    /// The camera may move: the next frame shows it.
    fn stir_camera(&mut self) {
        if let Some(canvas) = &self.canvas {
            canvas.window.request_redraw();
        }
    }
}
