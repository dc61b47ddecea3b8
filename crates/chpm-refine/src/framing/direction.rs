//! Names for directions: which axis is up, and which side is looked at.

use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt;
use std::str::FromStr;

/// One of the six directions along an axis: the one that is upward in the image.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Up {
    axis: usize,
    negative: bool,
}

impl Up {
    /// All six, those that files use most first.
    pub const ALL: [Up; 6] = [
        Up { axis: 1, negative: false },
        Up { axis: 2, negative: false },
        Up { axis: 0, negative: false },
        Up { axis: 1, negative: true },
        Up { axis: 2, negative: true },
        Up { axis: 0, negative: true },
    ];

    /// Which axis: 0 for x, 1 for y, 2 for z.
    pub fn axis(self) -> usize {
        self.axis
    }

    /// Whether it points to the axis's negative end.
    pub fn is_negative(self) -> bool {
        self.negative
    }

    /// As a vector of length 1.
    pub fn vector(self) -> Vector3<f64> {
        let mut vector = Vector3::zeros();
        vector[self.axis] = if self.negative { -1.0 } else { 1.0 };
        vector
    }

    /// The one nearest to a vector.
    pub fn nearest(vector: Vector3<f64>) -> Self {
        let axis = vector.iamax();
        Up { axis, negative: vector[axis] < 0.0 }
    }

    /// The one that comes after it in [`Up::ALL`].
    pub fn next(self) -> Self {
        let place = Up::ALL.iter().position(|up| *up == self).unwrap_or(0);
        Up::ALL[(place + 1) % Up::ALL.len()]
    }

    /// Where the front side is looked at along: -z where y is up, +y where z is, and the other way where these are down: x stays to the
    /// right, as for who turns a model about it. So do cameras of scanners, whose y points down and who look along +z.
    pub fn ahead(self) -> Vector3<f64> {
        match (self.axis, self.negative) {
            (1, true) => Vector3::z(),
            (2, false) => Vector3::y(),
            (2, true) => -Vector3::y(),
            _ => -Vector3::z(),
        }
    }
}

impl fmt::Display for Up {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.negative { "-" } else { "" };
        write!(f, "{sign}{}", ["x", "y", "z"][self.axis])
    }
}

impl FromStr for Up {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let name = text.strip_prefix('+').unwrap_or(text);
        let found = Up::ALL.into_iter().find(|up| up.to_string() == name);
        found.ok_or_else(|| format!("'{text}' is no direction: write x, y, z, -x, -y or -z"))
    }
}

/// A side of a model that stands upright.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Side {
    /// The side at the positive end of z, or at the negative one of y where z is up; the opposite one where y or z is down.
    Front,
    /// The side opposite to it.
    Back,
    /// Left-hand side of who looks at the front.
    Left,
    /// Right-hand side.
    Right,
    /// From above, with the front below in the image.
    Top,
    /// From the front, the right and above, all at the same angle.
    Iso,
}

impl Side {
    /// All of them, by name.
    pub const ALL: [(Side, &'static str); 6] = [
        (Side::Front, "front"),
        (Side::Back, "back"),
        (Side::Left, "left"),
        (Side::Right, "right"),
        (Side::Top, "top"),
        (Side::Iso, "iso"),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(side, _)| *side == self).map_or("", |(_, name)| name)
    }

    /// The one of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known)| *known == name).map(|(side, _)| *side)
    }

    /// Radians that the camera has gone around to the right, and upward, from the front.
    pub(super) fn angles(self) -> (f64, f64) {
        match self {
            Side::Front => (0.0, 0.0),
            Side::Right => (FRAC_PI_2, 0.0),
            Side::Back => (PI, 0.0),
            Side::Left => (-FRAC_PI_2, 0.0),
            // Not quite: the axis that is up has to point somewhere in the image.
            Side::Top => (0.0, FRAC_PI_2 - 1e-3),
            Side::Iso => (0.25 * PI, 0.5_f64.sqrt().atan()),
        }
    }
}

/// Where a camera looks along that has gone around to the right and upward from the front.
pub(super) fn sight(up: Up, (right, upward): (f64, f64)) -> Vector3<f64> {
    let (ahead, up) = (up.ahead(), up.vector());
    let aside = ahead.cross(&up);
    (ahead * right.cos() - aside * right.sin()) * upward.cos() - up * upward.sin()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back() {
        for up in Up::ALL {
            assert_eq!(up.to_string().parse(), Ok(up));
            assert_eq!(Up::nearest(up.vector()), up);
        }
        assert_eq!("+z".parse::<Up>(), "z".parse());
        for (side, name) in Side::ALL {
            assert_eq!(Side::named(name), Some(side));
            assert_eq!(side.name(), name);
        }
        assert!(["", "w", "--x", "zz"].iter().all(|bad| bad.parse::<Up>().is_err()));
    }

    #[test]
    fn all_directions_come_round() {
        let all: Vec<Up> = std::iter::successors(Some(Up::ALL[0]), |up| Some(up.next())).take(7).collect();
        let distinct: std::collections::HashSet<Up> = all.iter().copied().collect();
        assert_eq!((distinct.len(), all[6]), (6, all[0]));
    }

    #[test]
    fn sides_are_where_they_are_in_drawings() {
        let z: Up = "z".parse().unwrap();
        let near = |side: Side, expected: [f64; 3]| {
            (sight(z, side.angles()) - Vector3::from(expected)).norm() < 2e-3
        };
        // From the front one looks along +y; what is at +x is to the right.
        assert!(near(Side::Front, [0.0, 1.0, 0.0]) && near(Side::Back, [0.0, -1.0, 0.0]));
        assert!(near(Side::Right, [-1.0, 0.0, 0.0]) && near(Side::Left, [1.0, 0.0, 0.0]));
        assert!(near(Side::Top, [0.0, 0.0, -1.0]));
        // Whichever of y and z is up or down, x is to the right.
        for up in ["y", "z", "-y", "-z"].map(|up| up.parse::<Up>().unwrap()) {
            let right = sight(up, Side::Front.angles()).cross(&up.vector());
            assert!((right - Vector3::x()).norm() < 1e-9, "{up}");
        }
        let third = 1.0 / 3.0_f64.sqrt();
        assert!(near(Side::Iso, [-third, third, -third]));
    }
}
