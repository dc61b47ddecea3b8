//! Counts as they are printed for people.

use chpm_mesh::{Counted, Thousands};
use std::fmt;

/// A count for people: exact below ten thousand, then three digits, as in `3.66 M`.
#[derive(Clone, Copy, Debug)]
pub struct Short(pub u64);

impl Short {
    /// With its noun: `3.66 M triangles`, `1 triangle`.
    pub fn of(self, noun: &str) -> String {
        let counted = Counted(self.0, noun).to_string();
        let noun = counted.split_once(' ').map_or("", |(_, noun)| noun);
        format!("{self} {noun}")
    }
}

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 < 10_000 {
            return f.pad(&Thousands(self.0).to_string());
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
