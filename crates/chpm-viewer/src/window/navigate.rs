//! Where the viewer is and where it goes: orbit, pan, dolly, look, fly. No window, no clock.
//!
//! A gesture moves a goal, and the camera follows it by a share of the way that depends on the time alone, so that every frame rate
//! shows the same motion. The camera turns about a fixed up axis and never quite reaches it; it rolls when it is told to, until it
//! is home again.

use crate::window::pose::{Frame, Pose};
use chpm_mesh::Aabb;
use chpm_refine::{Camera, Outline, Stance, Up, Window};
use nalgebra::{Point3, Vector3};
use std::f64::consts::{PI, TAU};

#[cfg(test)]
mod tests;

/// Centre of rotation.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Pivot {
    /// The point that is looked at: the camera goes around it.
    Focus,
    /// The eye: the camera looks around.
    Eye,
}

/// Seconds in which a gesture's motion is done but for 1/e of it.
const FOLLOW: f64 = 0.05;
/// The same for a flight to another view.
const TRAVEL: f64 = 0.15;
/// The same for speeding up and slowing down.
const THRUST: f64 = 0.12;
/// Images that the sight goes through for one that the pointer does.
const LOOK: f64 = 2.0;
/// Distance from its goal at which a motion ends: radians, and shares of the distance to the focus.
const SETTLED: f64 = 1e-5;
/// Distances of the focus, in radii of the model.
const NEAREST: f64 = 1e-5;
const FARTHEST: f64 = 1e4;
/// How far the camera may stray from the model, in its radii.
const STRAY: f64 = 1e5;
/// Pixels, or seconds, beyond which an input is a mistake.
const MOST: f64 = 1e4;

/// A camera that follows gestures.
#[derive(Clone, Debug)]
pub struct Navigator {
    frame: Frame,
    pivot: Pivot,
    now: Pose,
    goal: Pose,
    follow: f64,
    /// To the right, upward, forward; distances to the focus a second.
    velocity: Vector3<f64>,
    thrust: Vector3<f64>,
    fov: f64,
    bounds: Aabb,
    origin: Vector3<f64>,
    center: Point3<f64>,
    radius: f64,
    outline: Outline,
    /// Yaw and pitch at home.
    front: (f64, f64),
    /// How far the picture is turned counterclockwise, degrees.
    roll: f64,
}

impl Navigator {
    /// At the [`Camera::framing`] view of a model with these bounds, which are relative to an origin; cameras are not.
    pub fn new(bounds: &Aabb, origin: [f64; 3]) -> Self {
        let camera = Camera::framing(bounds).relative_to(origin.map(|x| -x));
        let radius = Some(0.5 * bounds.diagonal()).filter(|r| *r > 0.0 && r.is_finite()).unwrap_or(1.0);

        let frame = Frame::upward(Vector3::y());
        let pose = Pose { anchor: Point3::from(camera.target), yaw: 0.0, pitch: 0.0, reach: 0.0 };
        let mut navigator = Navigator {
            frame,
            pivot: Pivot::Focus,
            now: pose,
            goal: pose,
            follow: FOLLOW,
            velocity: Vector3::zeros(),
            thrust: Vector3::zeros(),
            fov: camera.fov,
            bounds: *bounds,
            origin: Vector3::from(origin),
            center: Point3::from(camera.target),
            radius,
            outline: Outline::default(),
            front: (0.0, 0.0),
            roll: 0.0,
        };

        navigator.jump(&camera);
        navigator
    }

    /// The model is known: it stands like this from now on, and is seen as a whole; `aspect` as for [`Navigator::home`].
    pub fn stand(&mut self, outline: Outline, stance: &Stance, aspect: f64) {
        self.outline = outline;
        self.take_stance(stance, aspect);
    }

    fn take_stance(&mut self, stance: &Stance, aspect: f64) {
        self.frame = Frame::upward(stance.up().vector());
        self.front = self.frame.angles(stance.sight());
        self.home(aspect);
        self.jump(&self.destination());
    }

    /// The next of the six axes is up, and the whole model is seen, at once.
    pub fn next_up(&mut self, aspect: f64) {
        let up = Up::nearest(self.frame.up()).next();
        let stance = Stance::of(&self.outline, Some(up), None);
        self.take_stance(&stance, aspect);
    }

    /// Where the camera is.
    pub fn camera(&self) -> Camera {
        self.camera_at(&self.now).rolled(self.roll)
    }

    /// Turns the picture by so many degrees counterclockwise, at once.
    pub fn roll(&mut self, degrees: f64) {
        self.roll = (self.roll + sane(degrees) + 180.0).rem_euclid(360.0) - 180.0;
    }

    /// A drag, to the right and down in the picture, as it would be without roll.
    fn upright(&self, drag: [f64; 2]) -> [f64; 2] {
        let [right, down] = drag.map(sane);
        let (sin, cos) = self.roll.to_radians().sin_cos();
        [right * cos - down * sin, right * sin + down * cos]
    }

    /// Where it comes to rest, but for what flight adds; upright.
    pub fn destination(&self) -> Camera {
        self.camera_at(&self.goal)
    }

    fn camera_at(&self, pose: &Pose) -> Camera {
        let (eye, focus) = (self.eye(pose), self.focus(pose));
        Camera {
            position: eye.into(),
            target: focus.into(),
            up: self.frame.up().into(),
            fov: self.fov,
            near: 0.0,
        }
    }

    /// Centre of rotation.
    pub fn pivot(&self) -> Pivot {
        self.pivot
    }

    /// Turns about something else; the camera stays.
    pub fn set_pivot(&mut self, pivot: Pivot) {
        if pivot == self.pivot {
            return;
        }
        let anchor = |pose: &Pose| match pivot {
            Pivot::Focus => self.focus(pose),
            Pivot::Eye => self.eye(pose),
        };
        (self.now.anchor, self.goal.anchor) = (anchor(&self.now), anchor(&self.goal));
        self.pivot = pivot;
    }

    /// The axis that is nearest to upward in the image.
    pub fn upward(&self) -> Up {
        Up::nearest(self.frame.up())
    }

    /// The direction that points upward in the image.
    pub fn up(&self) -> [f64; 3] {
        self.frame.up().into()
    }

    /// Another axis upward; the camera stays where it is and looks where it did, as far as the new axis lets it.
    pub fn set_up(&mut self, up: [f64; 3]) {
        let camera = self.camera();
        self.jump(&Camera { up, ..camera });
    }

    /// From here on at this camera, at once. One that none can be (infinite, or looking nowhere) is not heeded, and answered with false.
    pub fn jump(&mut self, camera: &Camera) -> bool {
        let Some((frame, pose)) = self.pose_of(camera) else { return false };
        (self.frame, self.now, self.goal) = (frame, pose, pose);
        (self.velocity, self.fov, self.roll) = (Vector3::zeros(), camera.fov, 0.0);
        true
    }

    /// The same, but the axis that is upward stays so: a camera that leans is one whose picture was rolled.
    pub fn resume(&mut self, camera: &Camera) -> bool {
        let resumed = self.jump(&Camera { up: self.frame.up().into(), ..*camera });
        if resumed {
            let ([right, upward, _], [_, leant, _]) = (self.camera().axes(), camera.axes());
            self.roll = f64::atan2(leant.dot(&right), leant.dot(&upward)).to_degrees();
        }
        resumed
    }

    /// How far the picture is turned counterclockwise, degrees.
    pub fn rolled(&self) -> f64 {
        self.roll
    }

    /// Travels to a camera; see [`Navigator::jump`] for what is not heeded.
    pub fn travel(&mut self, camera: &Camera) -> bool {
        let here = self.camera();
        let Some((frame, goal)) = self.pose_of(camera) else { return false };
        let Some((_, now)) = self.pose_of(&Camera { up: frame.up().into(), ..here }) else { return false };
        (self.frame, self.now, self.goal, self.fov) = (frame, now, goal, camera.fov);
        self.goal.yaw = now.yaw + shortest(goal.yaw - now.yaw);
        (self.velocity, self.follow) = (Vector3::zeros(), TRAVEL);
        true
    }

    /// Travels to the view of the whole model from the front; `aspect` is width by height of the part of the image that it may take.
    pub fn home(&mut self, aspect: f64) {
        let (yaw, pitch) = self.front;
        self.roll = 0.0;
        self.goal.pitch = pitch;
        self.goal.yaw = self.now.yaw + shortest(yaw - self.now.yaw);
        self.fit(aspect);
    }

    /// Travels to where the whole model fits into the image, without turning.
    pub fn fit(&mut self, aspect: f64) {
        let window = Window::of_image(positive(aspect).clamp(0.01, 100.0), self.fov);
        let ([_, _, sight], up) = (self.frame.axes(&self.goal), self.frame.up());
        let camera = self.outline.fit(&self.bounds, sight, up, self.fov, window);
        let (eye, focus) = (Point3::from(camera.position), Point3::from(camera.target));
        self.goal.reach = self.reach((focus - eye).norm());
        self.settle_anchor(focus + self.origin);
        self.follow = TRAVEL;
        self.bound();
    }

    /// Puts a point into the middle of the image: from as far away as now, or, about the eye, by looking at it.
    pub fn focus_on(&mut self, point: [f64; 3]) {
        if !point.iter().all(|x| x.is_finite()) {
            return;
        }
        let (point, eye) = (Point3::from(point), self.eye(&self.now));
        let sight = point - eye;
        if sight.norm() <= NEAREST * self.radius {
            return;
        }
        if self.pivot == Pivot::Eye {
            let (yaw, pitch) = self.frame.angles(sight / sight.norm());
            (self.goal.yaw, self.goal.pitch) = (self.now.yaw + shortest(yaw - self.now.yaw), pitch);
        }
        self.goal.reach = self.reach(sight.norm());
        self.settle_anchor(point);
        self.follow = TRAVEL;
        self.bound();
    }

    /// Turns for a pointer that went so many pixels (right, down) of an image of this height. About the focus the model follows it, a
    /// height for half a turn; about the eye the sight does, twice as fast as the image moves.
    pub fn turn(&mut self, drag: [f64; 2], height: f64) {
        let [right, down] = self.upright(drag);
        let angle = match self.pivot {
            Pivot::Focus => PI / positive(height),
            Pivot::Eye => LOOK * self.fov.to_radians() / positive(height),
        };
        self.goal.yaw -= right * angle;
        self.goal.pitch -= down * angle;
        self.gesture();
    }

    /// Drags what is at `depth` (the distance to the focus if none is told) along with the pointer.
    pub fn pan(&mut self, drag: [f64; 2], height: f64, depth: Option<f64>) {
        let [right, up, _] = self.frame.axes(&self.goal);
        let depth = depth.filter(|d| *d > 0.0 && d.is_finite()).unwrap_or(self.goal.distance());
        let unit = 2.0 * (0.5 * self.fov.to_radians()).tan() * depth / positive(height);
        let [x, y] = self.upright(drag);
        self.goal.anchor += unit * (y * up - x * right);
        self.gesture();
    }

    /// Shrinks the distance to a point (the focus if none is told) by a factor.
    pub fn dolly(&mut self, factor: f64, toward: Option<[f64; 3]>) {
        let factor = if factor.is_finite() { factor.clamp(0.01, 100.0) } else { 1.0 };
        let toward = toward.filter(|p| p.iter().all(|x| x.is_finite())).map(Point3::from);
        let point = toward.unwrap_or_else(|| self.focus(&self.goal));
        let reach = self.goal.reach;
        self.goal.reach += factor.ln();
        self.bound();
        // At the limits the anchor stays, too.
        let factor = (self.goal.reach - reach).exp();
        self.goal.anchor = point + (self.goal.anchor - point) * factor;
        self.gesture();
    }

    /// Flies to the right, upward and forward, each from -1 to 1, from now on; 1 is the distance to the focus a second.
    pub fn fly(&mut self, thrust: [f64; 3]) {
        self.thrust = Vector3::from(thrust.map(|x| sane(x).clamp(-16.0, 16.0)));
    }

    /// Sets the distance to the focus: the measure of every speed. The camera stays.
    pub fn set_distance(&mut self, distance: f64) {
        if !(distance > 0.0 && distance.is_finite()) {
            return;
        }
        let (pivot, reach) = (self.pivot, self.reach(distance));
        self.set_pivot(Pivot::Eye);
        (self.now.reach, self.goal.reach) = (reach, reach);
        self.set_pivot(pivot);
    }

    /// Goes on by so many seconds. Answers whether the camera moved.
    pub fn step(&mut self, seconds: f64) -> bool {
        let seconds = sane(seconds).max(0.0);
        if !self.is_moving() || seconds == 0.0 {
            return false;
        }
        let flown = self.flight(seconds);
        let [right, up, forward] = self.camera().axes();
        let way = flown * self.now.distance();
        let way = right * way.x + up * way.y + forward * way.z;
        self.now.anchor += way;
        self.goal.anchor += way;
        let share = 1.0 - (-seconds / self.follow).exp();
        self.now = self.now.toward(&self.goal, share);
        if self.now.differs(&self.goal) < SETTLED {
            self.now = self.goal;
            self.follow = FOLLOW;
        }
        self.bound();
        true
    }

    /// Whether flight goes on, or has not come to rest.
    pub fn is_flying(&self) -> bool {
        self.velocity != Vector3::zeros() || self.thrust != Vector3::zeros()
    }

    /// Whether the next step will move the camera.
    pub fn is_moving(&self) -> bool {
        self.now != self.goal || self.is_flying()
    }

    /// How far the flight goes in so many seconds, in distances to the focus; the velocity nears the thrust meanwhile.
    fn flight(&mut self, seconds: f64) -> Vector3<f64> {
        let rest = (-seconds / THRUST).exp();
        let late = self.velocity - self.thrust;
        self.velocity = self.thrust + late * rest;
        if self.thrust == Vector3::zeros() && self.velocity.norm() < 1e-3 {
            self.velocity = Vector3::zeros();
        }
        self.thrust * seconds + late * (THRUST * (1.0 - rest))
    }

    /// The goal shall look at this point.
    fn settle_anchor(&mut self, focus: Point3<f64>) {
        self.goal.anchor = focus;
        if self.pivot == Pivot::Eye {
            let [_, _, forward] = self.frame.axes(&self.goal);
            self.goal.anchor -= forward * self.goal.distance();
        }
    }

    /// The logarithm of a distance of the focus, within its limits.
    fn reach(&self, distance: f64) -> f64 {
        distance.clamp(NEAREST * self.radius, FARTHEST * self.radius).ln()
    }

    fn gesture(&mut self) {
        self.follow = FOLLOW;
        self.bound();
    }

    /// Keeps both poses where numbers are sound.
    fn bound(&mut self) {
        let radius = self.radius;
        for pose in [&mut self.now, &mut self.goal] {
            pose.pitch = pose.pitch.clamp(-Pose::STEEPEST, Pose::STEEPEST);
            pose.reach = pose.reach.clamp((NEAREST * radius).ln(), (FARTHEST * radius).ln());
            for axis in 0..3 {
                let stray = STRAY * radius;
                let (low, high) = (self.center[axis] - stray, self.center[axis] + stray);
                pose.anchor[axis] = pose.anchor[axis].clamp(low, high);
            }
        }
        let turns = TAU * (self.goal.yaw / TAU).round();
        self.now.yaw -= turns;
        self.goal.yaw -= turns;
    }

    fn eye(&self, pose: &Pose) -> Point3<f64> {
        match self.pivot {
            Pivot::Eye => pose.anchor,
            Pivot::Focus => pose.anchor - self.sight(pose),
        }
    }

    fn focus(&self, pose: &Pose) -> Point3<f64> {
        match self.pivot {
            Pivot::Eye => pose.anchor + self.sight(pose),
            Pivot::Focus => pose.anchor,
        }
    }

    /// From the eye to the focus.
    fn sight(&self, pose: &Pose) -> Vector3<f64> {
        let [_, _, forward] = self.frame.axes(pose);
        forward * pose.distance()
    }

    fn pose_of(&self, camera: &Camera) -> Option<(Frame, Pose)> {
        let (eye, focus) = (Point3::from(camera.position), Point3::from(camera.target));
        let sight = focus - eye;
        let distance = sight.norm();
        let sound = (distance > 0.0 && distance.is_finite()) && (1e-3..179.0).contains(&camera.fov);
        if !sound || (eye - self.center).norm() > STRAY * self.radius {
            return None;
        }
        let up = Vector3::from(camera.up);
        let frame = Some(up).filter(|up| up.norm() > 0.0 && up.norm().is_finite());
        let frame = frame.map_or(self.frame, Frame::upward);
        let (yaw, pitch) = frame.angles(sight / distance);
        let pitch = pitch.clamp(-Pose::STEEPEST, Pose::STEEPEST);
        let mut pose = Pose { anchor: eye, yaw, pitch, reach: self.reach(distance) };
        if self.pivot == Pivot::Focus {
            let [_, _, forward] = frame.axes(&pose);
            pose.anchor += forward * pose.distance();
        }
        Some((frame, pose))
    }
}

/// The same turn by at most half a circle.
fn shortest(turn: f64) -> f64 {
    turn - TAU * (turn / TAU).round()
}

fn sane(x: f64) -> f64 {
    if x.is_finite() { x.clamp(-MOST, MOST) } else { 0.0 }
}

fn positive(x: f64) -> f64 {
    if x.is_finite() && x > 0.0 { x } else { 1.0 }
}
