//! Planes as they are typed.

use crate::tolerance::{Tolerance, Unit};
use anyhow::{Result, ensure};
use chpm_build::config::Length;
use chpm_mesh::Aabb;
use chpm_section::Planes;
use std::str::FromStr;

/// An axis of a model.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Axis {
    X,
    Y,
    Z,
}

impl Axis {
    pub(crate) fn name(self) -> &'static str {
        ["x", "y", "z"][self as usize]
    }

    pub(crate) fn direction(self) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(u8::from(axis == self as usize)))
    }
}

/// `0,0,1:2.5m`: a normal, and how far from the zero point along it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct PlaneArg {
    normal: [f64; 3],
    is_behind: bool,
    distance: Tolerance,
}

impl PlaneArg {
    /// The plane in a model with such a unit.
    pub(crate) fn planes(self, unit: Option<Unit>) -> Result<Planes> {
        let Length::Units(distance) = self.distance.length(unit)? else {
            unreachable!("refused when it was typed")
        };
        Ok(Planes::new(self.normal, vec![if self.is_behind { -distance } else { distance }])?)
    }
}

impl FromStr for PlaneArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || {
            format!(
                "'{text}' is no plane: write its normal and its distance from the zero point along it, as in 0,0,1:2.5"
            )
        };
        let (normal, distance) = text.split_once(':').ok_or_else(refused)?;
        let numbers: Option<Vec<f64>> = normal
            .split(',')
            .map(|number| number.trim().parse().ok().filter(|x: &f64| x.is_finite()))
            .collect();
        let normal = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok()).ok_or_else(refused)?;
        if normal == [0.0; 3] {
            return Err(format!("'{text}' is no plane: its normal has no direction"));
        }
        let (is_behind, size) = match distance.trim().strip_prefix('-') {
            Some(size) => (true, size),
            None => (false, distance.trim()),
        };
        match size.parse() {
            Ok(Tolerance::OfModel(Length::OfDiagonal(_))) | Err(_) => Err(refused()),
            Ok(distance) => Ok(PlaneArg { normal, is_behind, distance }),
        }
    }
}

/// A plane at every multiple of a step.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Every {
    pub(crate) axis: Axis,
    pub(crate) step: f64,
}

/// Planes at most: a step too small is more likely than a wish for more.
const MOST: f64 = 100_000.0;

impl Every {
    /// The planes that cross a box that is about `origin`.
    pub(crate) fn planes(self, Aabb { min, max }: &Aabb, origin: [f64; 3]) -> Result<Planes> {
        let Every { axis, step } = self;
        let name = axis.name();
        ensure!(step > 0.0, "--every {step}: the planes of a step of 0 are all planes");
        let at = axis as usize;
        let [low, high] = [min, max].map(|corner| f64::from(corner[at]) + origin[at]);
        let (first, last) = ((low / step).ceil(), (high / step).floor());
        ensure!(
            last - first < MOST,
            "--every {step}: {:.0} planes along {name}, from {low} to {high}, are more than {MOST}; take a larger step",
            last - first + 1.0
        );
        let count = (last - first + 1.0).max(0.0) as u32;
        Ok(Planes::new(axis.direction(), (0..count).map(|i| (first + f64::from(i)) * step).collect())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_typed_with_a_normal_and_a_distance() {
        let of = |text: &str, unit| text.parse::<PlaneArg>().unwrap().planes(unit);
        let plane = of("0,0,2:1.5", None).unwrap();
        assert_eq!((plane.normal(), plane.offsets()), ([0.0, 0.0, 1.0], &[1.5][..]));
        assert_eq!(of("1, 0, 0: -20cm", Some(Unit::M)).unwrap().offsets(), [-0.2]);
        assert!(of("1,0,0:1m", None).unwrap_err().to_string().contains("--unit m"));
        for bad in
            ["", "1,0,0", "1,0:2", "0,0,0:1", "1,0,0:x", "1,0,0:5%", "nan,0,1:1", "1,0,0,0:1", "1,0,0:--1"]
        {
            assert!(bad.parse::<PlaneArg>().is_err(), "{bad}");
        }
    }

    #[test]
    fn planes_are_at_multiples_of_the_step() {
        let aabb = Aabb { min: [-1.0, 0.0, 0.25], max: [1.0, 0.1, 3.0] };
        let of = |axis, step, origin| Every { axis, step }.planes(&aabb, origin).unwrap().offsets().to_vec();
        assert_eq!(of(Axis::Z, 1.0, [0.0; 3]), [1.0, 2.0, 3.0]);
        assert_eq!(of(Axis::X, 0.5, [0.0; 3]), [-1.0, -0.5, 0.0, 0.5, 1.0]);
        assert_eq!(of(Axis::Z, 1.0, [0.0, 0.0, 1e6]), [1e6 + 1.0, 1e6 + 2.0, 1e6 + 3.0]);
        assert!(of(Axis::Y, 7.0, [0.0, 1.0, 0.0]).is_empty());
        assert!(Every { axis: Axis::X, step: 1e-9 }.planes(&aabb, [0.0; 3]).is_err());
        assert!(Every { axis: Axis::X, step: 0.0 }.planes(&aabb, [0.0; 3]).is_err());
    }
}
