//! Pointer, wheel, touchpad and fingers as motions of the camera. Times come from outside.

use std::collections::BTreeMap;

/// Seconds and pixels within which a second press is a double click.
const DOUBLE: (f64, f64) = (0.4, 6.0);
/// Factor on the distance for one notch of a wheel.
const NOTCH: f64 = 0.85;
/// Pixels of scrolling that are worth a notch where scrolling is a dolly.
const PIXELS_PER_NOTCH: f64 = 50.0;

/// A button of a mouse, as far as it matters.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Button {
    /// Turns; pans with Shift, dollies with Ctrl, moves the light with both.
    Left,
    /// Pans.
    Middle,
    /// Pans.
    Right,
}

/// How far something was scrolled: to the right and upward.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Scroll {
    /// Notches of a wheel.
    Lines([f64; 2]),
    /// Pixels of a touchpad.
    Pixels([f64; 2]),
}

/// Phase of a finger.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Finger {
    /// It is there, new or not.
    Down,
    /// It is gone.
    Up,
}

/// Motion of the camera. Pixels, to the right and down.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Motion {
    /// A drag begins here: what is there is what it holds.
    Grab([f64; 2]),
    /// Turn.
    Turn([f64; 2]),
    /// Move with what is held.
    Pan([f64; 2]),
    /// Move the light.
    Light([f64; 2]),
    /// Make the distance to what is there this many times as long.
    Dolly {
        /// Below 1 to go nearer.
        factor: f64,
        /// The place in the image.
        at: [f64; 2],
    },
    /// Look at what is there.
    Focus([f64; 2]),
}

/// Follows pointer and fingers.
#[derive(Clone, Debug, Default)]
pub struct Gestures {
    at: [f64; 2],
    pressed: Option<Button>,
    shift: bool,
    ctrl: bool,
    /// When and where the last press was that could become a double click.
    click: Option<(f64, [f64; 2])>,
    fingers: BTreeMap<u64, [f64; 2]>,
}

impl Gestures {
    /// Where the pointer is.
    pub fn pointer(&self) -> [f64; 2] {
        self.at
    }

    /// Which keys are held that change what a drag means.
    pub fn modifiers(&mut self, shift: bool, ctrl: bool) {
        (self.shift, self.ctrl) = (shift, ctrl);
    }

    /// A button goes down at a time in seconds.
    pub fn press(&mut self, button: Button, seconds: f64) -> Option<Motion> {
        if self.pressed.is_some() {
            return None;
        }
        self.pressed = Some(button);
        let again = button == Button::Left
            && self.click.take().is_some_and(|(then, there)| {
                seconds - then <= DOUBLE.0 && length(less(self.at, there)) <= DOUBLE.1
            });
        if again {
            return Some(Motion::Focus(self.at));
        }
        self.click = (button == Button::Left).then_some((seconds, self.at));
        Some(Motion::Grab(self.at))
    }

    /// A button goes up.
    pub fn release(&mut self, button: Button) {
        if self.pressed == Some(button) {
            self.pressed = None;
        }
    }

    /// The window lost sight of pointer and fingers.
    pub fn lose(&mut self) {
        (self.pressed, self.click) = (None, None);
        self.fingers.clear();
    }

    /// Whether something is dragged.
    pub fn is_dragging(&self) -> bool {
        self.pressed.is_some() || !self.fingers.is_empty()
    }

    /// The pointer goes to a pixel.
    pub fn go(&mut self, at: [f64; 2]) -> Option<Motion> {
        let drag = less(at, self.at);
        self.at = at;
        if drag == [0.0; 2] {
            return None;
        }
        match (self.pressed?, self.shift, self.ctrl) {
            (Button::Left, false, false) => Some(Motion::Turn(drag)),
            (Button::Left, true, true) => Some(Motion::Light(drag)),
            (Button::Left, false, true) => {
                Some(Motion::Dolly { factor: NOTCH.powf(-drag[1] / PIXELS_PER_NOTCH), at })
            }
            _ => Some(Motion::Pan(drag)),
        }
    }

    /// A wheel goes nearer or away from what is below the pointer; two fingers on a touchpad pan, or go nearer with Ctrl.
    pub fn scroll(&mut self, scroll: Scroll) -> Option<Motion> {
        fn dolly(notches: f64, self_at: &[f64; 2]) -> Motion {
            Motion::Dolly { factor: NOTCH.powf(notches), at: *self_at }
        }
        let motion = match scroll {
            Scroll::Lines([_, y]) => dolly(y, &self.at),
            Scroll::Pixels([_, y]) if self.ctrl => dolly(y / PIXELS_PER_NOTCH, &self.at),
            Scroll::Pixels([x, y]) => Motion::Pan([x, y]),
        };
        let (Scroll::Lines([x, y]) | Scroll::Pixels([x, y])) = scroll;
        (x != 0.0 || y != 0.0).then_some(motion)
    }

    /// Two fingers on a touchpad go apart by a share of their distance.
    pub fn pinch(&mut self, share: f64) -> Option<Motion> {
        (share.is_finite() && share > -0.9)
            .then_some(Motion::Dolly { factor: 1.0 / (1.0 + share), at: self.at })
    }

    /// A finger on the screen. One turns; of two the middle pans and the distance dollies.
    pub fn touch(&mut self, id: u64, finger: Finger, at: [f64; 2]) -> Vec<Motion> {
        if finger == Finger::Up {
            self.fingers.remove(&id);
            return Vec::new();
        }
        let before = self.fingers.insert(id, at);
        let mut others = self.fingers.iter().filter(|(other, _)| **other != id).map(|(_, at)| *at);
        let (other, third) = (others.next(), others.next());
        match (before, other, third) {
            (None, ..) => vec![Motion::Grab(at)],
            (Some(before), None, _) => vec![Motion::Turn(less(at, before))],
            (Some(before), Some(other), None) => {
                let middle = [0, 1].map(|i| 0.5 * (at[i] + other[i]));
                let (was, is) = (length(less(before, other)), length(less(at, other)));
                let pan = Motion::Pan(less(at, before).map(|x| 0.5 * x));
                let dolly = Motion::Dolly { factor: was.max(1.0) / is.max(1.0), at: middle };
                vec![pan, dolly]
            }
            _ => Vec::new(),
        }
    }
}

fn less(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn length([x, y]: [f64; 2]) -> f64 {
    x.hypot(y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_drag_means() {
        for (button, shift, ctrl, motion) in [
            (Button::Left, false, false, Motion::Turn([3.0, -4.0])),
            (Button::Left, true, false, Motion::Pan([3.0, -4.0])),
            (Button::Left, true, true, Motion::Light([3.0, -4.0])),
            (Button::Middle, false, false, Motion::Pan([3.0, -4.0])),
            (Button::Right, false, true, Motion::Pan([3.0, -4.0])),
        ] {
            let mut gestures = Gestures::default();
            assert_eq!(gestures.go([10.0, 20.0]), None, "nothing is pressed");
            gestures.modifiers(shift, ctrl);
            assert_eq!(gestures.press(button, 0.0), Some(Motion::Grab([10.0, 20.0])));
            assert_eq!(gestures.go([13.0, 16.0]), Some(motion));
            assert_eq!(gestures.go([13.0, 16.0]), None);
            gestures.release(button);
            assert_eq!(gestures.go([0.0, 0.0]), None);
        }
    }

    #[test]
    fn the_first_button_wins_and_its_release_counts() {
        let mut gestures = Gestures::default();
        gestures.press(Button::Left, 0.0);
        assert_eq!(gestures.press(Button::Right, 0.1), None);
        gestures.release(Button::Right);
        assert_eq!(gestures.go([1.0, 0.0]), Some(Motion::Turn([1.0, 0.0])));
        gestures.lose();
        assert!(!gestures.is_dragging());
    }

    #[test]
    fn two_presses_are_a_double_click_if_soon_and_near() {
        let second = |seconds: f64, pixels: f64| {
            let mut gestures = Gestures::default();
            gestures.press(Button::Left, 5.0);
            gestures.release(Button::Left);
            gestures.go([pixels, 0.0]);
            gestures.press(Button::Left, 5.0 + seconds)
        };
        assert_eq!(second(0.3, 2.0), Some(Motion::Focus([2.0, 0.0])));
        assert_eq!(second(0.5, 2.0), Some(Motion::Grab([2.0, 0.0])));
        assert_eq!(second(0.3, 20.0), Some(Motion::Grab([20.0, 0.0])));
        let mut gestures = Gestures::default();
        for expected in [false, true, false, true] {
            let is_focus = matches!(gestures.press(Button::Left, 1.0), Some(Motion::Focus(_)));
            assert_eq!(is_focus, expected, "three clicks are not two double clicks");
            gestures.release(Button::Left);
        }
    }

    #[test]
    fn a_wheel_undoes_itself() {
        let mut gestures = Gestures::default();
        gestures.go([7.0, 8.0]);
        let factor = |scroll, gestures: &mut Gestures| match gestures.scroll(scroll) {
            Some(Motion::Dolly { factor, at: [7.0, 8.0] }) => factor,
            other => panic!("{other:?}"),
        };
        let (near, far) = (
            factor(Scroll::Lines([0.0, 2.0]), &mut gestures),
            factor(Scroll::Lines([0.0, -2.0]), &mut gestures),
        );
        assert!(near < 1.0 && (near * far - 1.0).abs() < 1e-12);
        assert_eq!(gestures.scroll(Scroll::Pixels([3.0, 4.0])), Some(Motion::Pan([3.0, 4.0])));
        assert_eq!(gestures.scroll(Scroll::Pixels([0.0, 0.0])), None);
        gestures.modifiers(false, true);
        assert!((factor(Scroll::Pixels([0.0, 100.0]), &mut gestures) - near).abs() < 1e-12);
        assert_eq!(gestures.pinch(0.25), Some(Motion::Dolly { factor: 0.8, at: [7.0, 8.0] }));
        assert_eq!([gestures.pinch(f64::NAN), gestures.pinch(-1.0)], [None, None]);
    }

    #[test]
    fn fingers_turn_pan_and_pinch() {
        let mut gestures = Gestures::default();
        assert_eq!(gestures.touch(1, Finger::Down, [100.0, 100.0]), [Motion::Grab([100.0, 100.0])]);
        assert_eq!(gestures.touch(1, Finger::Down, [110.0, 100.0]), [Motion::Turn([10.0, 0.0])]);
        assert_eq!(gestures.touch(2, Finger::Down, [210.0, 100.0]), [Motion::Grab([210.0, 100.0])]);
        let motions = gestures.touch(2, Finger::Down, [310.0, 100.0]);
        let expected = [Motion::Pan([50.0, 0.0]), Motion::Dolly { factor: 0.5, at: [210.0, 100.0] }];
        assert_eq!(motions, expected);
        assert!(gestures.touch(1, Finger::Up, [0.0; 2]).is_empty());
        assert_eq!(gestures.touch(2, Finger::Down, [310.0, 90.0]), [Motion::Turn([0.0, -10.0])]);
        gestures.touch(2, Finger::Up, [0.0; 2]);
        assert!(!gestures.is_dragging());
    }
}
