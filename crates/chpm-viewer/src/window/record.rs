//! Camera paths from a person's motion, and back: sixty cameras a second, whatever the frame rate was.

use chpm_refine::{Camera, CameraPath, Up};
use nalgebra::Vector3;

/// Cameras a second in a path.
pub const RATE: f64 = 60.0;
/// The most cameras of a recording: some four hours.
const MOST: usize = 1_000_000;
/// Seconds that a frame counts for at most: a rest is not recorded.
const LONGEST: f64 = 0.25;

/// Takes down where the camera goes.
#[derive(Clone, Debug)]
pub struct Recorder {
    path: CameraPath,
    last: Camera,
    /// Ticks that passed since the last camera that was taken down; below 1.
    phase: f64,
}

impl Recorder {
    /// Begins here.
    pub fn new(camera: &Camera) -> Self {
        Recorder { path: CameraPath { cameras: vec![*camera] }, last: *camera, phase: 0.0 }
    }

    /// So many seconds later the camera is here; it went straight.
    pub fn go(&mut self, camera: &Camera, seconds: f64) {
        let ticks = if seconds.is_finite() { seconds.clamp(0.0, LONGEST) * RATE } else { 0.0 };
        let mut next = 1.0 - self.phase;
        while next <= ticks && self.path.cameras.len() < MOST {
            self.path.cameras.push(between(&self.last, camera, next / ticks));
            next += 1.0;
        }
        // From what was compared above, so that rounding neither loses nor doubles a camera.
        self.phase = 1.0 - (next - ticks);
        self.last = *camera;
    }

    /// Seconds that were recorded.
    pub fn seconds(&self) -> f64 {
        (self.path.cameras.len() - 1) as f64 / RATE
    }

    /// The path.
    pub fn finish(self) -> CameraPath {
        self.path
    }
}

/// Goes along a path.
#[derive(Clone, Debug)]
pub struct Replay {
    path: CameraPath,
    /// Seconds since the beginning, where time decides.
    time: f64,
    /// Frames that were shown.
    frame: usize,
    pace: Pace,
}

/// Rule that chooses the next camera.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Pace {
    /// Time: slow frames leave cameras out.
    Clock,
    /// The frames: each shows the next camera, however long it takes.
    Frames,
}

impl Replay {
    /// From the beginning. None for a path without cameras.
    pub fn new(path: CameraPath, pace: Pace) -> Option<Self> {
        (!path.cameras.is_empty()).then_some(Replay { path, time: 0.0, frame: 0, pace })
    }

    /// The camera of the frame that comes so many seconds after the last one; none after the last camera.
    pub fn next(&mut self, seconds: f64) -> Option<Camera> {
        if self.frame > 0 && seconds.is_finite() {
            self.time += seconds.max(0.0);
        }
        let index = match self.pace {
            Pace::Frames => self.frame,
            Pace::Clock => (self.time * RATE).round() as usize,
        };
        self.frame += 1;
        self.path.cameras.get(index).copied()
    }

    /// The share of the path that is done, from 0 to 1.
    pub fn progress(&self) -> f32 {
        let done = match self.pace {
            Pace::Frames => self.frame as f64,
            Pace::Clock => self.time * RATE,
        };
        (done / self.path.cameras.len() as f64).clamp(0.0, 1.0) as f32
    }

    /// The axis that is upward all along the path, if one is.
    pub fn upward(&self) -> Option<Up> {
        let up = self.path.cameras[0].up;
        let is_same = self.path.cameras.iter().all(|camera| camera.up == up);
        Up::ALL.into_iter().find(|axis| is_same && axis.vector() == Vector3::from(up))
    }

    /// The camera that the path ends at.
    pub fn last(&self) -> Option<&Camera> {
        self.path.cameras.last()
    }
}

fn between(from: &Camera, to: &Camera, share: f64) -> Camera {
    fn mix(a: f64, b: f64, share: f64) -> f64 {
        if share == 1.0 { b } else { a + (b - a) * share }
    }
    fn point(a: [f64; 3], b: [f64; 3], share: f64) -> [f64; 3] {
        std::array::from_fn(|axis| mix(a[axis], b[axis], share))
    }
    Camera {
        position: point(from.position, to.position, share),
        target: point(from.target, to.target, share),
        up: to.up,
        fov: mix(from.fov, to.fov, share),
        near: to.near,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(x: f64) -> Camera {
        Camera::looking([x, 0.0, 9.0], [x, 0.0, 0.0])
    }

    fn places(path: &CameraPath) -> Vec<f64> {
        path.cameras.iter().map(|camera| camera.position[0]).collect()
    }

    #[test]
    fn slow_frames_are_filled_in() {
        let mut recorder = Recorder::new(&at(0.0));
        recorder.go(&at(4.0), 4.0 / RATE);
        assert!((recorder.seconds() - 4.0 / RATE).abs() < 1e-12);
        let places = places(&recorder.finish());
        assert_eq!(places.len(), 5);
        assert!(places.iter().zip(0..).all(|(x, n)| (x - f64::from(n)).abs() < 1e-9), "{places:?}");
    }

    #[test]
    fn a_rest_is_short() {
        let mut recorder = Recorder::new(&at(0.0));
        recorder.go(&at(0.0), 3600.0);
        recorder.go(&at(0.0), f64::NAN);
        assert!(recorder.seconds() <= LONGEST);
    }

    #[test]
    fn by_frames_every_camera_comes_once() {
        let path = CameraPath { cameras: (0..5).map(|n| at(f64::from(n))).collect() };
        let mut replay = Replay::new(path.clone(), Pace::Frames).unwrap();
        let seen: Vec<Camera> = std::iter::from_fn(|| replay.next(7.0)).collect();
        assert_eq!(seen, path.cameras);
        assert_eq!((replay.progress(), replay.last()), (1.0, path.cameras.last()));
        assert!(Replay::new(CameraPath::default(), Pace::Frames).is_none());
    }

    #[test]
    fn a_path_is_upright_along_one_axis_or_leans() {
        let z = Camera { up: [0.0, 0.0, 1.0], ..at(1.0) };
        let upward = |cameras: &[Camera]| {
            let path = CameraPath { cameras: cameras.to_vec() };
            Replay::new(path, Pace::Clock).unwrap().upward().map(|up| up.to_string())
        };
        assert_eq!(upward(&[at(1.0), at(2.0)]), Some("y".to_owned()));
        assert_eq!(upward(&[z, z]), Some("z".to_owned()));
        for cameras in [[z, at(2.0)], [at(1.0), at(2.0).rolled(90.0)], [at(1.0).rolled(3.0); 2]] {
            assert_eq!(upward(&cameras), None);
        }
    }

    #[test]
    fn by_the_clock_slow_frames_leave_cameras_out() {
        let path = CameraPath { cameras: (0..7).map(|n| at(f64::from(n))).collect() };
        let mut replay = Replay::new(path, Pace::Clock).unwrap();
        let seen: Vec<f64> =
            std::iter::from_fn(|| replay.next(2.0 / RATE).map(|camera| camera.position[0])).collect();
        assert_eq!(seen, [0.0, 2.0, 4.0, 6.0]);
    }

    proptest! {
        /// A steady motion is recorded the same at any frame rate, even an uneven one, and is text and back.
        #[test]
        fn frame_rates_do_not_show(frames in prop::collection::vec(0.001..0.2f64, 1..60)) {
            let mut recorder = Recorder::new(&at(0.0));
            let mut time = 0.0;
            for seconds in &frames {
                time += seconds;
                recorder.go(&at(time), *seconds);
            }
            let path = recorder.finish();
            prop_assert!((path.cameras.len() as f64 - (1.0 + (time * RATE).floor())).abs() <= 1.0);
            for (n, x) in places(&path).into_iter().enumerate() {
                prop_assert!((x - n as f64 / RATE).abs() < 1e-6, "{n}: {x}");
            }
            prop_assert_eq!(path.to_string().parse::<CameraPath>().unwrap(), path);
        }
    }
}
