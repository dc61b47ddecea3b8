//! A place and a direction as numbers that can be moved one by one.

use nalgebra::{Point3, Unit, Vector3};
use std::f64::consts::FRAC_PI_2;

/// The axes that yaw and pitch are measured in.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Frame {
    up: Unit<Vector3<f64>>,
    /// Where yaw 0 and pitch 0 look.
    front: Vector3<f64>,
    right: Vector3<f64>,
}

impl Frame {
    /// The axes for an up axis of any length but 0. For +y the front is -z, for +z it is +y.
    pub(super) fn upward(up: Vector3<f64>) -> Self {
        let up = Unit::new_normalize(up);
        let front = if up.z.abs() < 0.9 { -Vector3::z() } else { Vector3::y() };
        let right = front.cross(&up).normalize();
        Frame { up, front: up.cross(&right), right }
    }

    pub(super) fn up(&self) -> Vector3<f64> {
        self.up.into_inner()
    }

    /// To the right, upward and forward in the image of a pose, each of length 1.
    pub(super) fn axes(&self, pose: &Pose) -> [Vector3<f64>; 3] {
        let ((sy, cy), (sp, cp)) = (pose.yaw.sin_cos(), pose.pitch.sin_cos());
        let ahead = self.front * cy - self.right * sy;
        let right = self.right * cy + self.front * sy;
        [right, self.up() * cp - ahead * sp, ahead * cp + self.up() * sp]
    }

    /// Yaw (to the left) and pitch (upward) of a direction of length 1; yaw 0 along the up axis.
    pub(super) fn angles(&self, direction: Vector3<f64>) -> (f64, f64) {
        let (ahead, aside) = (direction.dot(&self.front), -direction.dot(&self.right));
        let yaw = if ahead.hypot(aside) > 1e-12 { aside.atan2(ahead) } else { 0.0 };
        // Exact near the poles, where the arc sine is not.
        (yaw, direction.dot(&self.up()).atan2(ahead.hypot(aside)))
    }
}

/// A place and a direction. Whether the anchor is the eye or the focus, its owner knows.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Pose {
    pub(super) anchor: Point3<f64>,
    /// Radians to the left.
    pub(super) yaw: f64,
    /// Radians upward.
    pub(super) pitch: f64,
    /// Logarithm of the distance from the eye to the focus.
    pub(super) reach: f64,
}

impl Pose {
    /// The largest pitch: so much before the up axis that the image's axes stay sound.
    pub(super) const STEEPEST: f64 = FRAC_PI_2 - 1e-3;

    pub(super) fn distance(&self) -> f64 {
        self.reach.exp()
    }

    /// A share of the way to another pose.
    pub(super) fn toward(&self, other: &Pose, share: f64) -> Pose {
        fn between(a: f64, b: f64, share: f64) -> f64 {
            a + (b - a) * share
        }
        Pose {
            anchor: self.anchor + (other.anchor - self.anchor) * share,
            yaw: between(self.yaw, other.yaw, share),
            pitch: between(self.pitch, other.pitch, share),
            reach: between(self.reach, other.reach, share),
        }
    }

    /// How much two poses differ, in radians and shares of the distance, whichever is most.
    pub(super) fn differs(&self, other: &Pose) -> f64 {
        let way = (other.anchor - self.anchor).norm() / self.distance().min(other.distance());
        let angles = [self.yaw - other.yaw, self.pitch - other.pitch, self.reach - other.reach];
        angles.into_iter().fold(way, |most, angle| most.max(angle.abs()))
    }
}
