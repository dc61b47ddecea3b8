//! The scale of a drawing.

use crate::number;
use crate::tolerance::Unit;
use std::str::FromStr;

/// A scale as it is typed: `1:200`, `2:1`, `200`.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Ratio(f64);

impl FromStr for Ratio {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (drawn, real) = text.split_once(':').unwrap_or(("1", text));
        let [drawn, real] = [drawn, real].map(|number| number::decimal(number).ok().filter(|x| *x > 0.0));
        match drawn.zip(real) {
            Some((drawn, real)) => Ok(Ratio(real / drawn)),
            None => Err(format!("'{text}' is no scale: write 1:200, or 2:1")),
        }
    }
}

/// How large a model is drawn.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Scale {
    /// Millimetres of paper for a unit of the model.
    pub(crate) paper: f64,
    pub(crate) unit: Option<Unit>,
}

/// Sides of a drawing on a sheet of A4 with a margin, in millimetres.
const LONG: f64 = 270.0;
const SHORT: f64 = 180.0;

impl Scale {
    /// The largest round scale at which something of such a width and height is on one sheet of A4, unless one is asked for: one to 1, 2 or 5 times a power of ten. Where the unit
    /// is not known, so many millimetres for each.
    pub(crate) fn of([width, height]: [f64; 2], unit: Option<Unit>, asked: Option<Ratio>) -> Self {
        let long = width.max(height);
        let fits = (LONG / long).min(SHORT / width.min(height));
        // A drawing without an extent is drawn at any scale.
        let fits = if fits.is_finite() { fits } else { 1.0 };
        let Some(known) = unit else { return Scale { paper: round_below(fits), unit } };
        let millimetres = 1000.0 * known.metres();
        let ratio = asked.map_or_else(|| 1.0 / round_below(fits / millimetres), |Ratio(ratio)| ratio);
        Scale { paper: millimetres / ratio, unit }
    }

    /// In words: `1:200`, or `1 unit = 5 mm`.
    pub(crate) fn describe(self) -> String {
        let Some(unit) = self.unit else { return format!("1 unit = {} mm", digits(self.paper)) };
        let ratio = 1000.0 * unit.metres() / self.paper;
        if ratio >= 1.0 { format!("1:{}", digits(ratio)) } else { format!("{}:1", digits(1.0 / ratio)) }
    }

    /// The length of a scale bar in the model's units, at most so many millimetres long, and its label.
    pub(crate) fn bar(self, millimetres: f64) -> (f64, String) {
        let length = round_below(millimetres / self.paper);
        (length, format!("{} {}", digits(length), self.unit.map_or("units", Unit::symbol)))
    }
}

/// The largest 1, 2 or 5 times a power of ten that is no more.
fn round_below(x: f64) -> f64 {
    let power = 10_f64.powi(x.log10().floor() as i32);
    // The logarithm is rounded.
    let found = [10.0, 5.0, 2.0, 1.0, 0.5]
        .map(|digit| digit * power)
        .into_iter()
        .find(|round| *round <= x * (1.0 + 1e-9));
    found.unwrap_or(power)
}

/// A round number without what arithmetic has left behind its digits.
fn digits(x: f64) -> String {
    format!("{:.6e}", x).parse::<f64>().map_or_else(|_| x.to_string(), |x| x.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_round_and_fit_a_sheet() {
        for (extent, unit, expected) in [
            ([20.0, 10.0], Some(Unit::M), "1:100"),
            ([10.0, 30.0], Some(Unit::M), "1:200"),
            ([3.0, 3.0], Some(Unit::Mm), "50:1"),
            ([1500.0, 900.0], Some(Unit::Km), "1:10000000"),
            ([0.1, 0.15], None, "1 unit = 1000 mm"),
            ([30.0, 7.0], None, "1 unit = 5 mm"),
            ([0.0, 0.0], None, "1 unit = 1 mm"),
        ] {
            assert_eq!(Scale::of(extent, unit, None).describe(), expected, "{extent:?}");
        }
        let asked = Scale::of([1.0, 1.0], Some(Unit::Cm), Some("1:25".parse().unwrap()));
        assert_eq!((asked.describe().as_str(), asked.paper), ("1:25", 0.4));
        assert_eq!(asked.bar(50.0), (100.0, "100 cm".to_owned()));
        assert_eq!("4:1".parse(), Ok(Ratio(0.25)));
        assert!(["", "0", "1:0", "a:b", "-1:5"].iter().all(|bad| bad.parse::<Ratio>().is_err()));
    }
}
