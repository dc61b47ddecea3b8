//! Lengths and numbers of triangles, as people type them.

use crate::{Number, NumberError, Units};
use serde::{Deserialize, Serialize};
use std::fmt::{self, Display};
use std::str::FromStr;

/// Why a text is not what was asked for, in a sentence that names it.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{0}")]
pub struct AskedError(String);

/// A whole number, with k, M or G behind it or not.
///
/// # Errors
/// [`AskedError`] for what is none, or more than 64 bits hold; here and below.
pub fn whole(text: &str) -> Result<u64, AskedError> {
    fn not_a_number(text: &&str) -> AskedError {
        let known = "understood are 20000, 20,000, 20_000, 20k, 1.5M, 2e4";
        AskedError(format!("'{text}' is not a whole number; {known}"))
    }

    let (number, unit) = Number::read(text).map_err(|error| match error {
        NumberError::NoNumber(_) => not_a_number(&text),
        error => AskedError(error.to_string()),
    })?;
    let factor = match unit {
        "" => 1,
        "k" | "K" => 1_000,
        "m" | "M" => 1_000_000,
        "g" | "G" => 1_000_000_000,
        _ => return Err(not_a_number(&text)),
    };
    match number.times(factor) {
        Some((whole, true)) => Ok(whole),
        Some(_) => Err(not_a_number(&text)),
        None => Err(AskedError(format!("'{text}' is too large"))),
    }
}

/// A number that is not negative, and finite.
///
/// # Errors
/// As [`whole`].
pub fn decimal(text: &str) -> Result<f64, AskedError> {
    let number = text.parse::<Number>().map_err(|error| AskedError(error.to_string()))?.to_f64();
    if number.is_finite() && !text.contains(',') {
        Ok(number)
    } else {
        Err(AskedError(format!("'{text}' is not a number as in 0.5")))
    }
}

/// A length that is asked for: `0.25` in object units, or `0.1%` of the diagonal of the model's bounding box.
///
/// ```
/// use chpm_mesh::Length;
///
/// let length: Length = "0.1%".parse().unwrap();
/// assert_eq!(length.of(500.0), 0.5);
/// assert_eq!("0.25".parse::<Length>().unwrap().of(500.0), 0.25);
/// ```
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub enum Length {
    /// Object units.
    Units(f64),
    /// Percent of the diagonal of the box around all vertices that triangles use.
    OfDiagonal(f64),
}

impl Length {
    /// In object units, for a model of this diagonal.
    pub fn of(self, diagonal: f64) -> f64 {
        match self {
            Length::Units(length) => length,
            Length::OfDiagonal(percent) => percent / 100.0 * diagonal,
        }
    }

    /// As it was asked for, on a model of this diagonal: `0.0200 units (1% of the diagonal)`.
    pub fn describe(self, diagonal: f64) -> String {
        let units = Units(self.of(diagonal));
        match self {
            Length::Units(_) => format!("{units} units"),
            Length::OfDiagonal(percent) => format!("{units} units ({percent}% of the diagonal)"),
        }
    }
}

impl Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Length::Units(length) => write!(f, "{length}"),
            Length::OfDiagonal(percent) => write!(f, "{percent}%"),
        }
    }
}

impl FromStr for Length {
    type Err = LengthError;

    fn from_str(text: &str) -> Result<Self, LengthError> {
        let (number, length): (_, fn(f64) -> Length) = match text.strip_suffix('%') {
            Some(number) => (number, Length::OfDiagonal),
            None => (text, Length::Units),
        };
        // A comma of thousands is none to be sure of where fractions are usual.
        let number =
            Some(number).filter(|number| !number.contains(',')).and_then(|number| number.parse().ok());
        let value = number.map(Number::to_f64).filter(|value| value.is_finite());
        value.map(length).ok_or_else(|| LengthError { got: text.to_owned() })
    }
}

/// A text that is no [`Length`].
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "'{got}' is no length: write a number of at least 0 in the model's units, as in 0.25 or 1e-3, or a share of the diagonal, as in 0.1%; a fraction begins with a point"
)]
pub struct LengthError {
    /// The text.
    pub got: String,
}

/// How many triangles a mesh may have: so many, or a share of the model's.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Triangles {
    /// So many.
    Count(u64),
    /// Percent of the model's.
    Percent(f64),
}

impl Triangles {
    /// The count, for a model of so many triangles; at least 1 where a share is asked for.
    pub fn of(self, model: u64) -> u64 {
        match self {
            Triangles::Count(count) => count,
            Triangles::Percent(percent) => ((percent / 100.0 * model as f64) as u64).max(1),
        }
    }
}

impl FromStr for Triangles {
    type Err = AskedError;

    fn from_str(text: &str) -> Result<Self, AskedError> {
        if let Some(percent) = text.trim().strip_suffix('%') {
            let share = decimal(percent).ok().filter(|percent| 0.0 < *percent && *percent <= 100.0);
            fn no_share(text: &&str) -> String {
                format!("'{text}' is no share of the model's triangles: more than 0% and at most 100%")
            }
            return share.map(Triangles::Percent).ok_or_else(|| AskedError(no_share(&text)));
        }
        match whole(text) {
            Ok(0) => Err(AskedError(format!("'{text}' is too small: at least 1"))),
            Ok(count) => Ok(Triangles::Count(count)),
            Err(error) => Err(AskedError(format!("{error}; or a share of the model's, as in 1%"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_are_a_count_or_a_share() {
        let of = |text: &str| text.parse::<Triangles>().map(|wanted| wanted.of(80_000));
        assert_eq!([of("20k"), of("1%"), of("2.5 %"), of("0.0001%")], [Ok(20_000), Ok(800), Ok(2000), Ok(1)]);
        for bad in ["0", "0%", "101%", "-1%", "nan%", "1,5%", "many", "%"] {
            assert!(of(bad).is_err(), "{bad}");
        }
        assert!(of("many").unwrap_err().to_string().contains("1%"));
    }

    #[test]
    fn lengths_are_read_as_they_are_told() {
        for (text, length, units) in [
            ("0", Length::Units(0.0), 0.0),
            ("2.5e-3", Length::Units(0.0025), 0.0025),
            ("0.5%", Length::OfDiagonal(0.5), 0.02),
            ("100 %", Length::OfDiagonal(100.0), 4.0),
        ] {
            let read: Length = text.parse().unwrap();
            assert_eq!((read, read.of(4.0)), (length, units), "{text}");
            assert_eq!(read.to_string().parse(), Ok(length));
        }
        for bad in ["", "%", "-1", "-1%", "nan", "inf", "1e999", "1 mm", "1%%"] {
            assert_eq!(bad.parse::<Length>(), Err(LengthError { got: bad.to_owned() }));
        }
        assert_eq!(Length::OfDiagonal(0.5).describe(4.0), "0.0200 units (0.5% of the diagonal)");
    }
}
