//! Floats as integers in the same order, so that a difference of neighbours is a small number and every bit comes back.

use crate::page::Page;

/// How the floats of an array become integers. Both ways are one to one: two zeros, denormals and what is no number included.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum View {
    /// The bits, with those of negative numbers turned over.
    Binary,
    /// Multiples of two to this power, each as how many.
    Lattice {
        /// [`LEAST_POWER`] to [`LEAST_POWER`] + 255.
        power: i16,
    },
    /// Decimal numbers of at most so many digits, of which at most so many behind the point: what a text had.
    Decimal {
        /// 1 to [`MOST_DIGITS`].
        digits: u8,
        /// 0 to [`MOST_PLACES`].
        places: u8,
    },
}

/// The first byte of a lattice, and the least power, that of the least float above 0.
const LATTICE: u8 = 8;
const LEAST_POWER: i16 = -149;
/// Multiples up to this many are floats.
const MOST_MULTIPLES: u32 = 1 << 24;
/// A number whose last bit is a one's.
const TO_WHOLE: f64 = 1.5 * (1u64 << 52) as f64;
/// More digits would be no shorter than bits.
pub(super) const MOST_DIGITS: u8 = 7;
/// Ten to this power and all below are f64 values.
pub(super) const MOST_PLACES: u8 = 22;

const TENS: [f64; MOST_PLACES as usize + 1] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18,
    1e19, 1e20, 1e21, 1e22,
];

impl View {
    /// From the two bytes that a page says it by.
    pub(super) fn of_bytes([digits, places]: [u8; 2]) -> Option<Self> {
        match (digits, places) {
            (0, 0) => Some(View::Binary),
            (LATTICE, power) => Some(View::Lattice { power: i16::from(power) + LEAST_POWER }),
            (1..=MOST_DIGITS, 0..=MOST_PLACES) => Some(View::Decimal { digits, places }),
            _ => None,
        }
    }

    pub(super) fn bytes(self) -> [u8; 2] {
        match self {
            View::Binary => [0, 0],
            View::Lattice { power } => [LATTICE, (power - LEAST_POWER) as u8],
            View::Decimal { digits, places } => [digits, places],
        }
    }

    /// The view by which these numbers are short.
    pub(super) fn of(numbers: &[f32]) -> Self {
        Self::lattice_of(numbers).or_else(|| Self::decimal_of(numbers)).unwrap_or(View::Binary)
    }

    /// One of the words of a page's vertices, as floats, and their view.
    pub(super) fn of_word(page: &Page<'_>, word: usize) -> (Vec<f32>, Self) {
        let rows = page.scalars.chunks_exact(page.attributes().scalar_words.into());
        let numbers: Vec<f32> = rows.map(|row| f32::from_bits(row[word])).collect();
        let view = Self::of(&numbers);
        (numbers, view)
    }

    /// The lattice with the largest step that has all these numbers, if they are few enough multiples of it.
    pub(super) fn lattice_of(numbers: &[f32]) -> Option<Self> {
        let (mut size, mut power) = (0, i16::MAX);
        for number in numbers {
            let whole = number.to_bits();
            // Other zeros than the one of a lattice have the highest bit alone.
            if whole == 1 << 31 {
                return None;
            }
            let (exponent, mantissa) = ((whole >> 23 & 0xff) as i16, whole & 0x7f_ffff);
            size = size.max(whole << 1);
            let (least, significant) = match exponent {
                0 => (LEAST_POWER, mantissa),
                _ => (exponent - 1 + LEAST_POWER, mantissa | 0x80_0000),
            };
            if significant != 0 {
                power = power.min(least + significant.trailing_zeros() as i16);
            }
        }
        let view = View::Lattice { power: power.clamp(LEAST_POWER, LEAST_POWER + 255) };
        let largest = f32::from_bits(size >> 1);
        view.multiples(largest).map(|_| view)
    }

    /// The integers of some floats.
    #[inline]
    pub(super) fn integers<const N: usize>(self, floats: [f32; N]) -> Option<[u32; N]> {
        let mut integers = [0; N];
        let View::Lattice { power } = self else {
            for (integer, float) in integers.iter_mut().zip(floats) {
                *integer = self.integer(float)?;
            }
            return Some(integers);
        };
        let (steps, mut are_there) = (power_of_two(-power), true);
        for (integer, float) in integers.iter_mut().zip(floats) {
            let multiples = f64::from(float) * steps;
            // The sum has no bits behind the point, and the low ones are the whole number's.
            let sum = multiples + TO_WHOLE;
            are_there &= sum - TO_WHOLE == multiples && multiples.abs() <= f64::from(MOST_MULTIPLES);
            *integer = sum.to_bits() as u32;
        }
        are_there.then_some(integers)
    }

    /// How many steps of a lattice a float is.
    fn multiples(self, number: f32) -> Option<u32> {
        let View::Lattice { power } = self else { return None };
        let multiples = f64::from(number) * power_of_two(-power);
        let whole = multiples as i32;
        (f64::from(whole) == multiples && whole.unsigned_abs() <= MOST_MULTIPLES).then_some(whole as u32)
    }

    /// The decimal view of all these numbers, if they have one.
    pub(super) fn decimal_of(numbers: &[f32]) -> Option<Self> {
        let (mut digits, mut places) = (1, 0);
        let mut text = String::new();
        for number in numbers {
            if !number.is_finite() {
                return None;
            }

            text.clear();
            use std::fmt::Write;
            write!(text, "{:e}", number.abs()).ok()?;
            let (mantissa, exponent) = text.split_once('e')?;
            let behind = mantissa.len().saturating_sub(2) as i32;
            digits = digits.max(behind + 1);
            places = places.max(behind - exponent.parse::<i32>().ok()?);
            if digits > i32::from(MOST_DIGITS) || places > i32::from(MOST_PLACES) {
                return None;
            }
        }

        let view = View::Decimal { digits: digits as u8, places: places as u8 };
        numbers
            .iter()
            .all(|number| {
                view.integer(*number)
                    .is_some_and(|i| view.float(i).is_some_and(|f| f.to_bits() == number.to_bits()))
            })
            .then_some(view)
    }

    /// The integer of a float; none where a decimal view has no such number near it.
    pub(super) fn integer(self, number: f32) -> Option<u32> {
        let (digits, places) = match self {
            View::Binary => return Some(turned(number.to_bits())),
            View::Lattice { .. } => return self.multiples(number),
            View::Decimal { digits, places } => (digits, places),
        };
        // All numbers with as many places as there can be come first, then decade by decade those with one place less.
        let all = TENS[usize::from(digits)];
        let (mut size, mut decade) = (f64::from(number.abs()) * TENS[usize::from(places)], 0);
        while size.round() >= all {
            size = f64::from(number.abs()) * TENS[usize::from(places)] / TENS.get(decade + 1)?;
            decade += 1;
        }
        let step = (all / 10.0 * 9.0) as u64;
        let integer = size.round() as u64 + decade as u64 * step;
        let integer = i32::try_from(integer).ok()? as u32;
        Some(if number.is_sign_negative() { !integer } else { integer })
    }

    /// The float of an integer; none where a decimal view ends.
    #[inline]
    pub(super) fn float(self, integer: u32) -> Option<f32> {
        let (digits, places) = match self {
            View::Binary => return Some(f32::from_bits(turned(integer))),
            View::Lattice { power } => return Some((f64::from(integer as i32) * power_of_two(power)) as f32),
            View::Decimal { digits, places } => (digits, places),
        };
        let negative = (integer as i32) < 0;
        let size = if negative { !integer } else { integer };
        let all = TENS[usize::from(digits)] as u32;
        let step = all / 10 * 9;
        let decade = if size < all { 0 } else { (size - all) / step.max(1) + 1 };
        let mantissa = f64::from(size - decade * step);
        fn ten(power: u32) -> Option<f64> {
            TENS.get(power as usize).copied()
        }
        let places = u32::from(places);
        let number = match places.checked_sub(decade) {
            Some(behind) => mantissa / ten(behind)?,
            None => mantissa * ten(decade - places)?,
        };
        Some(if negative { -(number as f32) } else { number as f32 })
    }
}

/// Two to a power that a double has.
fn power_of_two(power: i16) -> f64 {
    f64::from_bits(((1023 + i64::from(power)) as u64) << 52)
}

/// Bits of a float as an integer of the same order; and the other way.
#[inline]
pub(super) fn turned(bits: u32) -> u32 {
    bits ^ (((bits as i32) >> 31) as u32 >> 1)
}
