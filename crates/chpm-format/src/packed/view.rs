//! Floats as integers in the same order, so that a difference of neighbours is a small number and every bit comes back.

/// How the floats of an array become integers. Both ways are one to one: two zeros, denormals and what is no number included.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum View {
    /// The bits, with those of negative numbers turned over.
    Binary,
    /// Decimal numbers of at most so many digits, of which at most so many behind the point: what a text had.
    Decimal {
        /// 1 to [`MOST_DIGITS`].
        digits: u8,
        /// 0 to [`MOST_PLACES`].
        places: u8,
    },
}

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
            (1..=MOST_DIGITS, 0..=MOST_PLACES) => Some(View::Decimal { digits, places }),
            _ => None,
        }
    }

    pub(super) fn bytes(self) -> [u8; 2] {
        match self {
            View::Binary => [0, 0],
            View::Decimal { digits, places } => [digits, places],
        }
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
        let same = |number: &f32| {
            view.integer(*number)
                .is_some_and(|i| view.float(i).is_some_and(|f| f.to_bits() == number.to_bits()))
        };
        numbers.iter().all(same).then_some(view)
    }

    /// The integer of a float; none where a decimal view has no such number near it.
    pub(super) fn integer(self, number: f32) -> Option<u32> {
        let View::Decimal { digits, places } = self else { return Some(turned(number.to_bits())) };
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
        let View::Decimal { digits, places } = self else { return Some(f32::from_bits(turned(integer))) };
        let negative = (integer as i32) < 0;
        let size = if negative { !integer } else { integer };
        let all = TENS[usize::from(digits)] as u32;
        let step = all / 10 * 9;
        let decade = if size < all { 0 } else { (size - all) / step.max(1) + 1 };
        let mantissa = f64::from(size - decade * step);
        let ten = |power: u32| TENS.get(power as usize).copied();
        let places = u32::from(places);
        let number = match places.checked_sub(decade) {
            Some(behind) => mantissa / ten(behind)?,
            None => mantissa * ten(decade - places)?,
        };
        Some(if negative { -(number as f32) } else { number as f32 })
    }
}

/// Bits of a float as an integer of the same order; and the other way.
#[inline]
pub(super) fn turned(bits: u32) -> u32 {
    bits ^ (((bits as i32) >> 31) as u32 >> 1)
}
