//! Table of keys: the one that the keyboard, the help and the manual agree with.

use winit::keyboard::KeyCode;

/// Command of a key or a button.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Command {
    /// Shows or hides the table of keys.
    Help,
    /// Shows or hides the panel.
    Panel,
    /// The whole model, from the front.
    Home,
    /// The whole model, from where it is seen now.
    Fit,
    /// Turns about the eye, or about the focus.
    Fly,
    /// Another axis upward.
    Up,
    /// The horizon leans to the left.
    RollLeft,
    /// The horizon leans to the right.
    RollRight,
    /// Another clipping plane, or none.
    Clip,
    /// Less of the model is left by the clipping plane.
    ClipMore,
    /// More of it.
    ClipLess,
    /// Writes the outline of the clipping plane.
    Outline,
    /// Twice as fine.
    Finer,
    /// Twice as coarse.
    Coarser,
    /// Flat or smooth.
    Shading,
    /// The next colours.
    Colors,
    /// Edges or none.
    Wireframe,
    /// Shadows and darker corners, or none.
    Shadows,
    /// Draws what is hidden, or not.
    Occlusion,
    /// Draws what is outside the image, or not.
    Frustum,
    /// Holds the selection while the camera goes on, or lets it go.
    Freeze,
    /// Begins a recording, or ends it and writes the path.
    Record,
    /// Goes along the last path, or stops.
    Replay,
    /// Writes the picture.
    Screenshot,
    /// Measures from the point below the pointer, or to it, or ends that.
    Measure,
    /// Tells of the cluster below the pointer, or of none.
    Inspect,
    /// Asks for a file.
    Open,
    /// Closes what is open over the model.
    Back,
    /// Ends.
    Quit,
}

impl Command {
    /// Whether a key that is held does it again and again.
    pub fn repeats(self) -> bool {
        matches!(self, Command::RollLeft | Command::RollRight | Command::ClipMore | Command::ClipLess)
    }
}

/// A key and what it does.
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    code: KeyCode,
    ctrl: bool,
    /// Command of the key.
    pub command: Command,
    /// The key as it is called.
    pub key: &'static str,
    /// Description for the help.
    pub does: &'static str,
}

const fn key(code: KeyCode, key: &'static str, command: Command, does: &'static str) -> Binding {
    Binding { code, ctrl: false, command, key, does }
}

const fn ctrl(code: KeyCode, key: &'static str, command: Command, does: &'static str) -> Binding {
    Binding { code, ctrl: true, command, key, does }
}

/// All keys, but for those of flight.
pub const KEYS: [Binding; 29] = [
    key(KeyCode::Home, "Home", Command::Home, "the whole model, from the front, upright, in the usual light"),
    key(KeyCode::KeyF, "F", Command::Fit, "the whole model, from this side"),
    key(KeyCode::KeyG, "G", Command::Fly, "drags look around (fly) or go around (orbit)"),
    key(KeyCode::KeyU, "U", Command::Up, "another axis points upward"),
    key(KeyCode::Comma, ",", Command::RollLeft, "the picture turns to the left"),
    key(KeyCode::Period, ".", Command::RollRight, "the picture turns to the right"),
    key(KeyCode::KeyK, "K", Command::Clip, "clipping plane across x, y, z, from either side, or none"),
    key(KeyCode::BracketLeft, "[", Command::ClipMore, "the clipping plane leaves less"),
    key(KeyCode::BracketRight, "]", Command::ClipLess, "the clipping plane leaves more"),
    key(KeyCode::KeyV, "V", Command::Outline, "write the outline of the clipping plane: an SVG, to scale"),
    key(KeyCode::Minus, "-", Command::Coarser, "half the detail"),
    key(KeyCode::Equal, "+", Command::Finer, "twice the detail"),
    key(KeyCode::KeyN, "N", Command::Shading, "flat or smooth shading"),
    key(KeyCode::KeyC, "C", Command::Colors, "next colours"),
    key(KeyCode::KeyL, "L", Command::Wireframe, "edges"),
    key(KeyCode::KeyH, "H", Command::Shadows, "shadows"),
    key(KeyCode::KeyO, "O", Command::Occlusion, "occlusion culling"),
    key(KeyCode::KeyB, "B", Command::Frustum, "frustum culling"),
    key(KeyCode::KeyX, "X", Command::Freeze, "freeze the selection and look at it from elsewhere"),
    key(KeyCode::KeyR, "R", Command::Record, "record a camera path; again: write it"),
    key(KeyCode::KeyT, "T", Command::Replay, "replay the last path; again: stop"),
    key(
        KeyCode::KeyM,
        "M",
        Command::Measure,
        "measure from the point below the pointer; again: to this one; again: end",
    ),
    key(
        KeyCode::KeyI,
        "I",
        Command::Inspect,
        "the record of the cluster below the pointer; beside the model: none",
    ),
    key(KeyCode::F12, "F12", Command::Screenshot, "screenshot, without the panel"),
    ctrl(KeyCode::KeyO, "Ctrl+O", Command::Open, "open a file; dropping one works, too"),
    key(KeyCode::KeyP, "P", Command::Panel, "panel"),
    key(KeyCode::F1, "F1", Command::Help, "these keys"),
    key(KeyCode::Escape, "Esc", Command::Back, "close what is open, stop what runs"),
    ctrl(KeyCode::KeyQ, "Ctrl+Q", Command::Quit, "quit"),
];

/// Input without a row in [`KEYS`]: flight and the pointer.
pub const MOTIONS: [(&str, &str); 9] = [
    ("W A S D", "fly forward, left, back, right; Shift: faster"),
    ("Q E", "fly down, up"),
    ("arrows", "turn"),
    ("left drag", "turn; with Shift: pan; with Ctrl: nearer, away"),
    ("Shift+Ctrl+left drag", "move the light"),
    ("right, middle drag", "pan"),
    ("wheel", "nearer, away, at the pointer"),
    ("touchpad", "two fingers: pan; pinch, or Ctrl: nearer, away"),
    ("double click", "focus on the point"),
];

/// Command of a key that went down.
pub fn command(code: KeyCode, ctrl: bool) -> Option<Command> {
    let code = match code {
        KeyCode::NumpadAdd => KeyCode::Equal,
        KeyCode::NumpadSubtract => KeyCode::Minus,
        code => code,
    };
    KEYS.iter().find(|binding| binding.code == code && binding.ctrl == ctrl).map(|binding| binding.command)
}

/// Keys of flight that are held.
#[derive(Clone, Copy, Default, Debug)]
pub struct Flight {
    held: [bool; 6],
}

/// To the right, left, upward, down, forward, back.
const FLIGHT: [KeyCode; 6] =
    [KeyCode::KeyD, KeyCode::KeyA, KeyCode::KeyE, KeyCode::KeyQ, KeyCode::KeyW, KeyCode::KeyS];
/// How many times as fast with Shift.
const FAST: f64 = 4.0;

impl Flight {
    /// A key goes down or up; answers whether it is one of these.
    pub fn hold(&mut self, code: KeyCode, down: bool) -> bool {
        let place = FLIGHT.iter().position(|key| *key == code);
        if let Some(held) = place.and_then(|place| self.held.get_mut(place)) {
            *held = down;
        }
        place.is_some()
    }

    /// All keys are up: the window lost them.
    pub fn lose(&mut self) {
        self.held = [false; 6];
    }

    /// The thrust to the right, upward, forward.
    pub fn thrust(&self, fast: bool) -> [f64; 3] {
        let speed = if fast { FAST } else { 1.0 };
        std::array::from_fn(|axis| {
            let [plus, minus] = [self.held[2 * axis], self.held[2 * axis + 1]].map(f64::from);
            speed * (plus - minus)
        })
    }
}

/// How far an arrow key turns, as shares of the image's height: to the right and down.
pub fn arrow(code: KeyCode) -> Option<[f64; 2]> {
    const STEP: f64 = 1.0 / 24.0;
    match code {
        KeyCode::ArrowLeft => Some([-STEP, 0.0]),
        KeyCode::ArrowRight => Some([STEP, 0.0]),
        KeyCode::ArrowUp => Some([0.0, -STEP]),
        KeyCode::ArrowDown => Some([0.0, STEP]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_does_one_thing() {
        for (place, binding) in KEYS.iter().enumerate() {
            assert_eq!(command(binding.code, binding.ctrl), Some(binding.command));
            let same = |other: &&Binding| {
                (other.code, other.ctrl) == (binding.code, binding.ctrl) || other.command == binding.command
            };
            assert_eq!(KEYS.iter().filter(same).count(), 1, "{place}: {binding:?}");
            assert!(binding.ctrl || !FLIGHT.contains(&binding.code), "{binding:?} flies");
        }
        assert_eq!(command(KeyCode::KeyQ, false), None);
        assert_eq!(command(KeyCode::NumpadAdd, false), Some(Command::Finer));
    }

    #[test]
    fn opposite_keys_cancel() {
        let mut flight = Flight::default();
        assert!(flight.hold(KeyCode::KeyW, true) && flight.hold(KeyCode::KeyA, true));
        assert!(!flight.hold(KeyCode::KeyP, true));
        assert_eq!(flight.thrust(false), [-1.0, 0.0, 1.0]);
        assert_eq!(flight.thrust(true), [-FAST, 0.0, FAST]);
        flight.hold(KeyCode::KeyS, true);
        flight.hold(KeyCode::KeyA, false);
        assert_eq!(flight.thrust(true), [0.0; 3]);
        flight.hold(KeyCode::KeyW, false);
        assert_eq!(flight.thrust(false), [0.0, 0.0, -1.0]);
        flight.lose();
        assert_eq!(flight.thrust(false), [0.0; 3]);
    }
}
