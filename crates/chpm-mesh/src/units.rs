//! Units: byte counts as people write them, and distances in the model's own length.

use crate::number::Number;
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// A distance in object units by which a mesh may deviate from the original surface.
#[derive(Clone, Copy, PartialEq, PartialOrd, Debug, Default, Serialize, Deserialize)]
pub struct ObjectError(pub f32);

impl fmt::Display for ObjectError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.4e}", self.0)
    }
}

/// A number of bytes. Parses `4096`, `512K`, `256M`, `256MB`, `1.5GiB`; every suffix is a power of 1024, and parts of a byte are
/// left out.
///
/// ```
/// use chpm_mesh::Bytes;
///
/// let memory: Bytes = "1.5GiB".parse().unwrap();
/// assert_eq!(memory, Bytes::mib(1536));
/// assert_eq!(memory.to_string(), "1.5 GiB");
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default, Serialize, Deserialize)]
pub struct Bytes(pub u64);

impl Bytes {
    /// `n` mebibytes.
    pub const fn mib(n: u64) -> Self {
        Bytes(n << 20)
    }
}

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const UNITS: [&str; 5] = ["B", "KiB", "MiB", "GiB", "TiB"];
        let mut value = self.0 as f64;
        let mut unit = 0;
        while value >= 1024.0 && unit + 1 < UNITS.len() {
            value /= 1024.0;
            unit += 1;
        }
        if unit == 0 { write!(f, "{} B", self.0) } else { write!(f, "{value:.1} {}", UNITS[unit]) }
    }
}

/// A size of memory that prints as it is typed: `1G`, not `1.0 GiB`.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct MemorySize(pub Bytes);

impl fmt::Display for MemorySize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.0 {
            n if n > 0 && n.is_multiple_of(1 << 30) => write!(f, "{}G", n >> 30),
            n if n > 0 && n.is_multiple_of(1 << 20) => write!(f, "{}M", n >> 20),
            n => write!(f, "{n}"),
        }
    }
}

impl FromStr for MemorySize {
    type Err = <Bytes as FromStr>::Err;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        text.parse().map(MemorySize)
    }
}

/// A number with a comma between thousands: `3,664,152`.
///
/// ```
/// assert_eq!(chpm_mesh::Thousands(3_664_152).to_string(), "3,664,152");
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Thousands(pub u64);

impl fmt::Display for Thousands {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, group) in self.0.to_string().as_bytes().rchunks(3).rev().enumerate() {
            let comma = if place > 0 { "," } else { "" };
            write!(f, "{comma}{}", String::from_utf8_lossy(group))?;
        }
        Ok(())
    }
}

/// So many of something, in words: `1 cluster`, `3,664,152 triangles`, `0 vertices`.
///
/// ```
/// use chpm_mesh::Counted;
///
/// assert_eq!(Counted(1, "cluster").to_string(), "1 cluster");
/// assert_eq!(Counted(0, "vertex").to_string(), "0 vertices");
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Counted<'a>(pub u64, pub &'a str);

impl fmt::Display for Counted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Counted(n, noun) = *self;
        write!(f, "{}", Thousands(n))?;
        // Of a phrase, the noun is what a preposition follows.
        let (head, tail) = noun.find(" of ").map_or((noun, ""), |at| noun.split_at(at));
        // The endings of the nouns that are counted.
        let endings = [("vertex", "vertices"), ("leaf", "leaves"), ("copy", "copies"), ("mesh", "meshes")];
        let irregular = endings.iter().find_map(|(one, many)| Some((head.strip_suffix(one)?, many)));
        match irregular {
            _ if n == 1 => write!(f, " {noun}"),
            Some((lead, many)) => write!(f, " {lead}{many}{tail}"),
            None => write!(f, " {head}s{tail}"),
        }
    }
}

/// A length or an error for people: three digits, without a power of ten where that is readable.
#[derive(Clone, Copy, Debug)]
pub struct Units(pub f64);

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

/// A length that is told as an upper bound: as [`Units`], rounded up.
#[derive(Clone, Copy, Debug)]
pub struct AtMost(pub f64);

/// A length that is told as a lower bound: as [`Units`], rounded down.
#[derive(Clone, Copy, Debug)]
pub struct AtLeast(pub f64);

impl fmt::Display for AtMost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        directed(self.0, |told, true_one| told < true_one, 0.5).fmt(f)
    }
}

impl fmt::Display for AtLeast {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        directed(self.0, |told, true_one| told > true_one, -0.5).fmt(f)
    }
}

/// The length that is told for another: itself, or where that is told wrong, the next one that is not, by steps of the last digit.
fn directed(length: f64, is_wrong: impl Fn(f64, f64) -> bool, step: f64) -> Units {
    let power = format!("{length:e}").split_once('e').and_then(|(_, power)| power.parse().ok()).unwrap_or(0);
    // Of a large number without a power of ten, it is a whole one.
    let last = 10f64.powi(if (0..6).contains(&power) { power.min(2) } else { power } - 2);
    let (mut told, mut away) = (Units(length), step * last);
    while told.to_string().parse().is_ok_and(|told| is_wrong(told, length)) {
        told = Units(length + away);
        away *= 4.0;
    }
    told
}

/// How many decimals numbers are printed with: so many that what is cut off is little beside what they are known to.
#[derive(Clone, Copy, Debug)]
pub struct Digits {
    /// After the point; none where all that there are are printed.
    decimals: Option<usize>,
    largest: f64,
}

impl Digits {
    /// For numbers up to `largest` that are known to within `tolerance`.
    pub fn within(tolerance: f64, largest: f64) -> Digits {
        let wanted = (1.0 - libm::log10(tolerance)).ceil();
        let there = 16.0 - libm::log10(largest.max(f64::MIN_POSITIVE));
        let decimals = (wanted < there).then_some(wanted.max(0.0) as usize);
        Digits { decimals, largest }
    }

    /// A number with its sign; what is printed as zero has none.
    pub fn of(&self, number: f64) -> String {
        let number = number + 0.0;
        match self.decimals {
            Some(decimals) if decimals <= READABLE => {
                let text = format!("{number:.decimals$}");
                let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
                if is_zero { text.replace('-', "") } else { text }
            }
            // As many digits from the first one on, so that zeros do not have to be counted.
            Some(decimals) => {
                let power = libm::log10(number.abs().max(f64::MIN_POSITIVE)).floor() as i32;
                let digits = (decimals as i32 + power).clamp(0, 17) as usize;
                if number == 0.0 { "0".to_owned() } else { format!("{number:.digits$e}") }
            }
            None if number == 0.0 || (1e-4..1e17).contains(&number.abs()) => format!("{number}"),
            None => format!("{number:e}"),
        }
    }

    /// By how much a printed number differs from what it stands for, at most.
    pub fn lost(&self) -> f64 {
        match self.decimals {
            Some(decimals) => 0.5 * 10f64.powi(-(decimals as i32)) * (1.0 + 1e-12),
            None => f64::EPSILON * self.largest,
        }
    }
}

/// Decimals that are read without counting zeros.
const READABLE: usize = 9;

/// Why a text is not a byte count.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("'{0}' is not a size: write a number with an optional K, M, G or T, as in 512M or 1.5GiB")]
pub struct ParseBytesError(String);

impl FromStr for Bytes {
    type Err = ParseBytesError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let error = || ParseBytesError(text.to_owned());
        let (number, unit) = Number::read(text).map_err(|_| error())?;
        let shift = match unit.to_ascii_lowercase().as_str() {
            "" | "b" => 0,
            "k" | "kb" | "kib" => 10,
            "m" | "mb" | "mib" => 20,
            "g" | "gb" | "gib" => 30,
            "t" | "tb" | "tib" => 40,
            _ => return Err(error()),
        };
        number.times(1 << shift).map(|(bytes, _)| Bytes(bytes)).ok_or_else(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_parse_as_people_write_them() {
        assert_eq!("4096".parse(), Ok(Bytes(4096)));
        assert_eq!("256M".parse(), Ok(Bytes::mib(256)));
        assert_eq!("256 MiB".parse(), Ok(Bytes::mib(256)));
        assert_eq!("4gb".parse(), Ok(Bytes(4 << 30)));
        assert_eq!("1.5G".parse(), Ok(Bytes::mib(1536)));
        assert_eq!("20,000".parse(), Ok(Bytes(20_000)));
        for bad in ["", "M", "-1", "1,5G", "3X", "nan", "99999999999T"] {
            assert!(bad.parse::<Bytes>().is_err(), "{bad}");
        }
    }

    #[test]
    fn one_is_one_and_others_are_many() {
        for (n, noun, text) in [
            (1, "cluster", "1 cluster"),
            (0, "shared vertex", "0 shared vertices"),
            (2, "leaf", "2 leaves"),
            (3, "copy", "3 copies"),
            (999, "normal of corner", "999 normals of corner"),
            (3_664_152, "triangle", "3,664,152 triangles"),
        ] {
            assert_eq!(Counted(n, noun).to_string(), text);
        }
    }

    #[test]
    fn bytes_print_with_the_fitting_unit() {
        assert_eq!(Bytes(512).to_string(), "512 B");
        assert_eq!(Bytes::mib(384).to_string(), "384.0 MiB");
    }

    #[test]
    fn bounds_are_told_on_their_side() {
        for (length, most, least) in [
            (0.0, "0", "0"),
            (0.5, "0.500", "0.500"),
            (1.001, "1.01", "1.00"),
            (1.009, "1.01", "1.00"),
            (123.4, "124", "123"),
            (123_456.4, "123457", "123456"),
            (9.999, "10.0", "9.99"),
            (9.94e5, "994000", "994000"),
            (1_234_567.0, "1.24e6", "1.23e6"),
            (0.000_123_41, "0.000124", "0.000123"),
            (5.701e-7, "5.71e-7", "5.70e-7"),
            (f64::INFINITY, "inf", "inf"),
        ] {
            assert_eq!(
                (AtMost(length).to_string().as_str(), AtLeast(length).to_string().as_str()),
                (most, least)
            );
        }
    }

    #[test]
    fn numbers_have_the_digits_that_are_known() {
        for (tolerance, largest, number, text) in [
            (5.7e-4, 141_420.4, 141_420.356_237_309_5, "141420.35624"),
            (0.01, 141_420.4, -0.123_456, "-0.123"),
            (100.0, 141_420.4, 141_420.356, "141420"),
            (1e-12, 1e-6, 1.234_567_890_123_45e-7, "1.234568e-7"),
            (1e-12, 1e-6, 0.0, "0"),
            (0.01, 1.0, -0.000_4, "0.000"),
            (1.0, 1.0, -0.0, "0.0"),
            (0.0, 0.0, -0.0, "0"),
            (1e-12, 141_420.4, 1.234_567_890_123_45e-7, "1.23456789012345e-7"),
            (1e-30, 0.2, 0.1, "0.1"),
            (0.0, 141_420.4, 141_420.356_237_309_5, "141420.3562373095"),
        ] {
            let digits = Digits::within(tolerance, largest);
            assert_eq!(digits.of(number), text);
            let told: f64 = text.parse().unwrap();
            assert!((told - number).abs() <= digits.lost(), "{text}");
            assert!(digits.lost() <= 0.06 * tolerance || largest > 1e11 * tolerance);
        }
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
