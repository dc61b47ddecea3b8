//! Numbers as they are typed on the command line, each kind read in one way wherever it is asked for; and lengths as they
//! are printed.

use crate::report;
use chpm_build::config::Length;
use chpm_mesh::{Counted, Number, NumberError};
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// A parser of counts within `range`: `20000`, `20,000`, `20_000`, `20k`, `1.5M`, `2e4`.
pub(crate) fn count<T>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: TryFrom<u64> + Into<u64> + Copy + Send + Sync + 'static,
{
    move |text| {
        let (least, most) = ((*range.start()).into(), (*range.end()).into());
        match whole(text)? {
            count if count < least => Err(format!("'{text}' is too small: at least {least}")),
            count if count > most => Err(format!("'{text}' is too large: at most {most}")),
            count => T::try_from(count).map_err(|_| format!("'{text}' is too large: at most {most}")),
        }
    }
}

/// A whole number, with k, M or G behind it or not.
fn whole(text: &str) -> Result<u64, String> {
    let told =
        || format!("'{text}' is not a whole number; understood are 20000, 20,000, 20_000, 20k, 1.5M, 2e4");
    let (number, unit) = Number::read(text).map_err(|error| match error {
        NumberError::NoNumber(_) => told(),
        error => error.to_string(),
    })?;
    let factor = match unit {
        "" => 1,
        "k" | "K" => 1_000,
        "m" | "M" => 1_000_000,
        "g" | "G" => 1_000_000_000,
        _ => return Err(told()),
    };
    match number.times(factor) {
        Some((whole, true)) => Ok(whole),
        Some(_) => Err(told()),
        None => Err(format!("'{text}' is too large")),
    }
}

/// A number that is not negative, and finite.
pub(crate) fn decimal(text: &str) -> Result<f64, String> {
    let number = text.parse::<Number>().map_err(|error| error.to_string())?.to_f64();
    if number.is_finite() && !text.contains(',') {
        Ok(number)
    } else {
        Err(format!("'{text}' is not a number as in 0.5"))
    }
}

/// How many triangles a mesh may have: so many, or a share of the model's.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Triangles {
    /// So many.
    Count(u64),
    /// Percent of the model's.
    Percent(f64),
}

impl Triangles {
    /// The count, for a model of so many triangles; at least 1 where a share is asked for.
    pub(crate) fn of(self, model: u64) -> u64 {
        match self {
            Triangles::Count(count) => count,
            Triangles::Percent(percent) => ((percent / 100.0 * model as f64) as u64).max(1),
        }
    }
}

impl FromStr for Triangles {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.trim().strip_suffix('%') {
            Some(percent) => match decimal(percent) {
                Ok(percent) if 0.0 < percent && percent <= 100.0 => Ok(Triangles::Percent(percent)),
                _ => Err(format!(
                    "'{text}' is no share of the model's triangles: more than 0% and at most 100%"
                )),
            },
            None => match count(1..=u64::MAX)(text) {
                Ok(count) => Ok(Triangles::Count(count)),
                Err(error) if whole(text).is_err() => {
                    Err(format!("{error}; or a share of the model's, as in 1%"))
                }
                Err(error) => Err(error),
            },
        }
    }
}

/// A length or an error for people: three digits, without a power of ten where that is readable.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Units(pub(crate) f64);

impl fmt::Display for Units {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scientific = format!("{:.2e}", self.0);
        let power = scientific.split_once('e').and_then(|(_, power)| power.parse::<i32>().ok());
        match power {
            _ if self.0 == 0.0 => f.pad("0"),
            Some(power @ -4..6) => f.pad(&format!("{:.*}", (2 - power).max(0) as usize, self.0)),
            _ => f.pad(&scientific),
        }
    }
}

/// A count for people: exact below ten thousand, then three digits, as in `3.66 M`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Short(pub(crate) u64);

impl Short {
    /// With its noun: `3.66 M triangles`, `1 triangle`.
    pub(crate) fn of(self, noun: &str) -> String {
        let counted = Counted(self.0, noun).to_string();
        let noun = counted.split_once(' ').map_or("", |(_, noun)| noun);
        format!("{self} {noun}")
    }
}

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 < 10_000 {
            return f.pad(&report::count(self.0));
        }
        // Rounded to three digits first, so that 999,999 is a million.
        let digits = self.0.ilog10();
        let step = 10_u64.pow(digits - 2);
        let rounded = (self.0 / step + u64::from(self.0 % step >= step / 2)) as f64 * step as f64;
        let (unit, name) = match rounded {
            1e12.. => (1e12, "T"),
            1e9.. => (1e9, "G"),
            1e6.. => (1e6, "M"),
            _ => (1e3, "k"),
        };
        let value = rounded / unit;
        let places = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
        f.pad(&format!("{value:.places$} {name}"))
    }
}

/// The length as it was asked for, on a model with such a diagonal: `0.0200 units (1% of the diagonal)`.
pub(crate) fn told(length: Length, diagonal: f64) -> String {
    let units = Units(length.of(diagonal));
    match length {
        Length::Units(_) => format!("{units} units"),
        Length::OfDiagonal(percent) => format!("{units} units ({percent}% of the diagonal)"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_read_as_people_type_them() {
        let of = |text| count(1_u32..=2_000_000)(text);
        for text in ["20000", "20,000", "20_000", "20k", "20K", "2e4", "0.02M"] {
            assert_eq!(of(text), Ok(20_000), "{text}");
        }
        for (text, told) in [
            ("1,5", "ambiguous"),
            ("0", "at least 1"),
            ("2.1M", "at most 2000000"),
            ("1e30", "too large"),
            ("1.5", "20,000, 20_000, 20k"),
            ("-3", "not a whole number"),
            ("nan", "not a whole number"),
            ("3%", "not a whole number"),
        ] {
            assert!(of(text).unwrap_err().contains(told), "{text}: {:?}", of(text));
        }
        assert!(count(0..=u32::MAX)("5G").unwrap_err().contains("at most 4294967295"));
    }

    #[test]
    fn triangles_are_a_count_or_a_share() {
        let of = |text: &str| text.parse::<Triangles>().map(|wanted| wanted.of(80_000));
        assert_eq!([of("20k"), of("1%"), of("2.5 %"), of("0.0001%")], [Ok(20_000), Ok(800), Ok(2000), Ok(1)]);
        for bad in ["0", "0%", "101%", "-1%", "nan%", "1,5%", "many", "%"] {
            assert!(of(bad).is_err(), "{bad}");
        }
        assert!(of("many").unwrap_err().contains("1%"));
    }

    #[test]
    fn large_counts_have_three_digits() {
        for (n, text) in [
            (0, "0"),
            (9_999, "9,999"),
            (10_000, "10.0 k"),
            (99_949, "99.9 k"),
            (99_950, "100 k"),
            (999_499, "999 k"),
            (999_500, "1.00 M"),
            (3_661_846, "3.66 M"),
            (372_000_000, "372 M"),
            (9_995_000_000, "10.0 G"),
            (u64::MAX, "18400000 T"),
        ] {
            assert_eq!(Short(n).to_string(), text);
        }
        let told = [1, 2, 20_000].map(|n| Short(n).of("vertex"));
        assert_eq!(told, ["1 vertex", "2 vertices", "20.0 k vertices"]);
    }

    #[test]
    fn lengths_have_three_digits() {
        for (length, text) in [
            (0.0, "0"),
            (0.02, "0.0200"),
            (20.0, "20.0"),
            (19.996, "20.0"),
            (1.0 / 3.0, "0.333"),
            (123.4, "123"),
            (123_456.0, "123456"),
            (999_999.6, "1.00e6"),
            (0.000_123_4, "0.000123"),
            (0.000_099_99, "0.000100"),
            (0.000_012, "1.20e-5"),
            (4.2e7, "4.20e7"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(Units(length).to_string(), text);
        }
    }
}
