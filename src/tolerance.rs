//! How near is near enough: in units of the model, in percent of it, or in a unit that people measure in.

use crate::number;
use anyhow::{Context, Result};
use chpm_build::config::Length;
use std::str::FromStr;

/// Unit of a model. No format that is read says so.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Unit {
    /// Micrometre
    Um,
    /// Millimetre
    Mm,
    /// Centimetre
    Cm,
    /// Metre
    M,
    /// Kilometre
    Km,
    /// Inch
    In,
    /// Foot
    Ft,
}

impl Unit {
    const ALL: [(Unit, &str, f64); 7] = [
        (Unit::Um, "um", 1e-6),
        (Unit::Mm, "mm", 1e-3),
        (Unit::Cm, "cm", 1e-2),
        (Unit::M, "m", 1.0),
        (Unit::Km, "km", 1e3),
        (Unit::In, "in", 0.0254),
        (Unit::Ft, "ft", 0.3048),
    ];

    /// As it is typed.
    pub(crate) fn symbol(self) -> &'static str {
        Self::ALL.iter().find(|(unit, ..)| *unit == self).map_or("", |(_, symbol, _)| symbol)
    }

    /// How long it is.
    pub(crate) fn metres(self) -> f64 {
        Self::ALL.iter().find(|(unit, ..)| *unit == self).map_or(1.0, |(.., metres)| *metres)
    }
}

/// A distance as it is typed: `0.5`, `0.05%`, `1mm`.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Tolerance {
    /// In the model's units, or percent of its diagonal.
    OfModel(Length),
    /// So many of a unit.
    Measured(f64, Unit),
}

impl Tolerance {
    /// As it was typed, with its unit, if it has one.
    pub(crate) fn measured(self) -> Option<(f64, Unit)> {
        match self {
            Tolerance::OfModel(_) => None,
            Tolerance::Measured(count, unit) => Some((count, unit)),
        }
    }

    /// The same for a model with such a unit.
    pub(crate) fn length(self, unit: Option<Unit>) -> Result<Length> {
        match self {
            Tolerance::OfModel(length) => Ok(length),
            Tolerance::Measured(count, of) => {
                let unit = unit.with_context(|| {
                    let symbol = of.symbol();
                    format!(
                        "'{count}{symbol}' is a length, and a mesh does not say how long its unit is: add --unit {symbol} if it is one {symbol}, \
                         or another; or leave the unit out"
                    )
                })?;
                Ok(Length::Units(if of == unit { count } else { count * of.metres() / unit.metres() }))
            }
        }
    }
}

impl FromStr for Tolerance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        // The e of a power of ten is none of a unit: it has digits behind.
        let unit = text[number.len()..].to_ascii_lowercase();
        if unit.is_empty() {
            return text
                .parse()
                .map(Tolerance::OfModel)
                .map_err(|error: chpm_build::config::LengthError| error.to_string());
        }
        let known = Unit::ALL.iter().find(|(_, symbol, _)| *symbol == unit).map(|(unit, ..)| *unit);
        match (number::decimal(number.trim_end()), known) {
            (Ok(count), Some(unit)) => Ok(Tolerance::Measured(count, unit)),
            _ => Err(format!(
                "'{text}' is no distance: write 0.5 (the model's units), 0.05% (of its diagonal), or 1mm with --unit"
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_have_a_unit_or_are_the_models() {
        let units = |text: &str, unit| match text.parse::<Tolerance>().unwrap().length(unit) {
            Ok(Length::Units(units)) => units,
            other => panic!("{other:?}"),
        };
        assert_eq!(units("1mm", Some(Unit::Mm)), 1.0);
        assert_eq!(units("0.3 mm", Some(Unit::Mm)), 0.3);
        assert_eq!(units("1MM", Some(Unit::M)), 0.001);
        assert_eq!(units("2in", Some(Unit::Cm)), 5.08);
        assert_eq!(units("1e-3m", Some(Unit::Mm)), 1.0);
        assert_eq!(
            (units("0.5", None), units("0.5", Some(Unit::Km)), units("1e-3", None)),
            (0.5, 0.5, 0.001)
        );
        assert_eq!("0.05%".parse(), Ok(Tolerance::OfModel(Length::OfDiagonal(0.05))));
        let told = "1mm".parse::<Tolerance>().unwrap().length(None).unwrap_err().to_string();
        assert!(told.contains("--unit mm"), "{told}");
        for bad in ["", "mm", "1 parsec", "-1mm", "-1", "nan", "nanmm", "1,5mm", "1%mm", "infm"] {
            assert!(bad.parse::<Tolerance>().is_err(), "{bad}");
        }
    }
}
