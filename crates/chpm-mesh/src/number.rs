//! Decimal numbers as people type them, kept exactly: `20,000`, `20_000`, `1.5`, `1e5`, with a unit or not.

use std::str::FromStr;

/// A number that is not negative: `digits` times ten to the power of `exponent`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Number {
    digits: u128,
    exponent: i32,
}

/// Why a text is no number.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NumberError {
    /// It does not begin with a number.
    #[error("'{0}' is not a number")]
    NoNumber(String),
    /// The comma may set thousands apart or begin a fraction.
    #[error(
        "'{0}' is ambiguous: write 1.5 with a point, and 1500 or 1,500 with three digits behind every comma"
    )]
    Comma(String),
    /// More digits or a larger power than any use has.
    #[error("'{0}' has more digits than can be understood")]
    Large(String),
}

/// Digits that are kept; with a factor of up to 2^40 they fit 128 bits.
const MOST_DIGITS: usize = 25;
/// Powers of ten beyond all floating point numbers.
const MOST_EXPONENT: i32 = 400;

impl Number {
    /// Reads the number that a text begins with and answers what stands behind it, without blanks.
    ///
    /// # Errors
    /// [`NumberError`] where there is none or where it can be read in two ways.
    pub fn read(text: &str) -> Result<(Number, &str), NumberError> {
        fn no_number(text: &str) -> NumberError {
            NumberError::NoNumber(text.to_owned())
        }

        let trimmed = text.trim();
        let unsigned = trimmed.strip_prefix('+').unwrap_or(trimmed);
        let (whole, rest) = split(unsigned, |byte| byte.is_ascii_digit() || matches!(byte, b',' | b'_'));
        let (fraction, rest) = match rest.strip_prefix('.') {
            Some(rest) => split(rest, |byte| byte.is_ascii_digit() || byte == b'_'),
            None => ("", rest),
        };

        if whole.contains(',') && !sets_thousands_apart(whole) || rest.starts_with(',') {
            return Err(NumberError::Comma(text.to_owned()));
        }
        fn is_apart(part: &str) -> bool {
            part.is_empty() || part.split('_').all(|digits| !digits.is_empty())
        }
        if whole.is_empty() && fraction.is_empty() || !is_apart(whole) || !is_apart(fraction) {
            return Err(no_number(text));
        }

        let (power, rest) = power(rest);
        fn digits(part: &str) -> Vec<u8> {
            part.bytes().filter(u8::is_ascii_digit).collect::<Vec<_>>()
        }
        let (whole, fraction) = (digits(whole), digits(fraction));

        let mut number = Number {
            digits: 0,
            exponent: power.clamp(-MOST_EXPONENT, MOST_EXPONENT) - fraction.len() as i32,
        };
        let significant = whole.iter().chain(&fraction).skip_while(|digit| **digit == b'0');
        if significant.clone().count() > MOST_DIGITS {
            return Err(NumberError::Large(text.to_owned()));
        }
        for digit in significant {
            number.digits = 10 * number.digits + u128::from(digit - b'0');
        }
        Ok((number, rest.trim()))
    }

    /// The number times `factor`, rounded down, and whether that is exact. `None` where 64 bits do not hold it.
    pub fn times(self, factor: u64) -> Option<(u64, bool)> {
        let product = self.digits.checked_mul(factor.into())?;
        if product == 0 {
            return Some((0, true));
        }
        let power = 10u128.checked_pow(self.exponent.unsigned_abs());
        let (value, exact) = match (self.exponent < 0, power) {
            (false, power) => (product.checked_mul(power?)?, true),
            (true, Some(power)) => (product / power, product.is_multiple_of(power)),
            // Less than one for all the digits that are kept.
            (true, None) => (0, false),
        };
        Some((u64::try_from(value).ok()?, exact))
    }

    /// The nearest floating point number; infinite beyond all.
    pub fn to_f64(self) -> f64 {
        // The parser of the standard library rounds correctly.
        format!("{}e{}", self.digits, self.exponent).parse().unwrap_or(f64::INFINITY)
    }
}

impl FromStr for Number {
    type Err = NumberError;

    /// A number with nothing behind it.
    fn from_str(text: &str) -> Result<Self, NumberError> {
        match Number::read(text)? {
            (number, "") => Ok(number),
            _ => Err(NumberError::NoNumber(text.to_owned())),
        }
    }
}

fn split(text: &str, belongs: impl Fn(u8) -> bool) -> (&str, &str) {
    text.split_at(text.bytes().take_while(|byte| belongs(*byte)).count())
}

/// `20,000` and `1,234,567`: three digits behind every comma, one to three before the first, and no zero in front.
fn sets_thousands_apart(whole: &str) -> bool {
    fn is_digits(part: &str) -> bool {
        part.bytes().all(|byte| byte.is_ascii_digit())
    }
    let mut parts = whole.split(',');
    let first = parts.next().unwrap_or_default();
    let leads = (1..=3).contains(&first.len()) && is_digits(first) && !first.starts_with('0');
    leads && parts.all(|part| part.len() == 3 && is_digits(part))
}

/// The power of ten in front of a text, and the rest.
fn power(text: &str) -> (i32, &str) {
    let none = (0, text);
    let Some(behind) = text.strip_prefix(['e', 'E']) else { return none };
    let (sign, digits) = match behind.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, behind.strip_prefix('+').unwrap_or(behind)),
    };
    let (digits, rest) = split(digits, |byte| byte.is_ascii_digit());
    if digits.is_empty() { none } else { (sign * digits.parse().unwrap_or(MOST_EXPONENT), rest) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_exactly_in_every_way_they_are_written() {
        for (text, value) in [
            ("20000", 20_000),
            ("20,000", 20_000),
            ("1,234,567", 1_234_567),
            ("20_000", 20_000),
            ("2e4", 20_000),
            ("2.5E+3", 2500),
            ("+1500.", 1500),
            ("0.5e1", 5),
            ("18446744073709551615", u64::MAX),
            ("0e999999999999", 0),
            (" 007 ", 7),
        ] {
            assert_eq!(text.parse::<Number>().unwrap().times(1), Some((value, true)), "{text}");
        }
    }

    #[test]
    fn what_is_left_over_is_told_and_what_is_too_large_too() {
        let (number, rest) = Number::read("1.5 GiB").unwrap();
        assert_eq!((number.times(1 << 30), rest), (Some((3 << 29, true)), "GiB"));
        assert_eq!(Number::read("1e").unwrap().1, "e", "no power of ten");
        assert_eq!("0.3".parse::<Number>().unwrap().times(1024), Some((307, false)));
        assert_eq!("1e-500".parse::<Number>().unwrap().times(1), Some((0, false)));
        for large in ["18446744073709551616", "1e20", "1e999999999999"] {
            assert_eq!(large.parse::<Number>().unwrap().times(1), None, "{large}");
        }
        assert_eq!("0.1".parse::<Number>().unwrap().to_f64(), 0.1);
        assert_eq!("1e999".parse::<Number>().unwrap().to_f64(), f64::INFINITY);
    }

    #[test]
    fn commas_that_may_mean_two_things_are_refused() {
        for text in ["1,5", "1,50", "1,5000", "0,500", "1.234,5", ",500", "1,,500", "1,234_567", "20000,000"]
        {
            assert_eq!(Number::read(text), Err(NumberError::Comma(text.to_owned())));
        }
    }

    #[test]
    fn what_is_no_number_is_refused() {
        for text in ["", ".", "k", "-1", "nan", "inf", "_1", "1__0", "1_", "1._5", "e5", "\u{0661}"] {
            assert_eq!(Number::read(text), Err(NumberError::NoNumber(text.to_owned())));
        }
        let long = "1".repeat(30);
        assert_eq!(Number::read(&long), Err(NumberError::Large(long.clone())));
    }
}
