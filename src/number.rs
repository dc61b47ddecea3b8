//! Numbers as they are typed on the command line, each kind read in one way wherever it is asked for; and counts as they
//! are printed.

use crate::report;
pub(crate) use chpm_mesh::{AtLeast, AtMost, Digits, Triangles, Units};
use chpm_mesh::{Counted, asked};
use std::fmt;
use std::ops::RangeInclusive;

/// A parser of counts within `range`: `20000`, `20,000`, `20_000`, `20k`, `1.5M`, `2e4`.
pub(crate) fn count<T>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: TryFrom<u64> + Into<u64> + Copy + Send + Sync + 'static,
{
    move |text| {
        let (least, most) = ((*range.start()).into(), (*range.end()).into());
        match asked::whole(text).map_err(|error| error.to_string())? {
            count if count < least => Err(format!("'{text}' is too small: at least {least}")),
            count if count > most => Err(format!("'{text}' is too large: at most {most}")),
            count => T::try_from(count).map_err(|_| format!("'{text}' is too large: at most {most}")),
        }
    }
}

/// A number that is not negative, and finite.
pub(crate) fn decimal(text: &str) -> Result<f64, String> {
    asked::decimal(text).map_err(|error| error.to_string())
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
}
