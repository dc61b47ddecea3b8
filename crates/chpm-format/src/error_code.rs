//! Errors as 16 bits: an unsigned float relative to the page's scale, always rounded up.
//!
//! The scale is a power of two, so scaling keeps the mantissa: pages with different scales decode one error alike,
//! unless it is below 2^-31 of a scale. Codes order as the errors do.

/// Bits of the f32 2^-31: what code 1 stands for, relative to the scale.
const BASE: u32 = (127 - 31) << 23;
/// Bits of the f32 1.
const ONE: u32 = 127 << 23;
/// Mantissa bits that are dropped.
const DROP: u32 = 12;
/// The code of an error that equals the scale; larger codes are illegal.
pub const MAX_CODE: u16 = 1 + ((ONE - BASE) >> DROP) as u16;
/// Largest error that can be stored, 2^127: the scale must be a finite power of two.
pub const MAX_ERROR: f32 = f32::from_bits(254 << 23);

/// The smallest power of two that is at least `error`; 0 for 0. `error` is at most [`MAX_ERROR`].
pub fn scale_for(error: f32) -> f32 {
    debug_assert!((0.0..=MAX_ERROR).contains(&error));
    if error == 0.0 {
        return 0.0;
    }
    let bits = error.to_bits();
    let exponent = bits >> 23;
    if exponent == 0 {
        // A subnormal is an integer number of 2^-149.
        return f32::from_bits(bits.next_power_of_two());
    }
    f32::from_bits(if bits & 0x7f_ffff == 0 { bits } else { (exponent + 1) << 23 })
}

/// Whether a page may carry this scale: 0 or a positive finite power of two.
pub fn is_scale(scale: f32) -> bool {
    scale.is_finite() && scale.is_sign_positive() && scale_for(scale.min(MAX_ERROR)) == scale
}

/// The least code whose decoded error is at least `error`, which lies in `0..=scale`.
pub fn encode(error: f32, scale: f32) -> u16 {
    debug_assert!((0.0..=scale).contains(&error));
    if error == 0.0 {
        return 0;
    }
    let bits = (error / scale).to_bits();
    if bits <= BASE {
        return 1;
    }
    1 + (bits - BASE).div_ceil(1 << DROP) as u16
}

/// The error that a code of at most [`MAX_CODE`] stands for.
pub fn decode(code: u16, scale: f32) -> f32 {
    debug_assert!(code <= MAX_CODE);
    if code == 0 {
        return 0.0;
    }
    scale * f32::from_bits(BASE + ((u32::from(code) - 1) << DROP))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn scales_are_the_next_powers_of_two() {
        for (error, scale) in [(0.0, 0.0), (1.0, 1.0), (0.75, 1.0), (1.5, 2.0), (MAX_ERROR, MAX_ERROR)] {
            assert_eq!(scale_for(error), scale);
        }
        assert_eq!(scale_for(f32::from_bits(1)), f32::from_bits(1));
        assert_eq!(scale_for(f32::from_bits(0x7f_ffff)), f32::MIN_POSITIVE);
        assert!(is_scale(0.0) && is_scale(0.5) && is_scale(MAX_ERROR) && is_scale(f32::from_bits(4)));
        for bad in [-0.0, -1.0, 3.0, f32::MAX, f32::INFINITY, f32::NAN] {
            assert!(!is_scale(bad), "{bad}");
        }
    }

    #[test]
    fn ends_of_the_range_are_exact() {
        assert_eq!((MAX_CODE, decode(MAX_CODE, 4.0)), (63_489, 4.0));
        assert_eq!((encode(4.0, 4.0), encode(0.0, 4.0), encode(0.0, 0.0)), (MAX_CODE, 0, 0));
        assert_eq!((encode(1e-30, 4.0), decode(1, 4.0)), (1, 4.0 / 2_147_483_648.0));
        // The scale is so large that error / scale underflows: still not 0.
        assert_eq!(encode(f32::from_bits(1), MAX_ERROR), 1);
    }

    #[test]
    fn every_code_survives_a_round_trip() {
        for code in 0..=MAX_CODE {
            assert_eq!(encode(decode(code, 0.125), 0.125), code);
        }
    }

    proptest! {
        #[test]
        fn codes_bound_from_above_and_are_tight(a in 0u32..=254 << 23, b in 0u32..=254 << 23) {
            let (low, high) = (f32::from_bits(a.min(b)), f32::from_bits(a.max(b)));
            let scale = scale_for(high);
            prop_assert!(scale >= high && (scale == 0.0 || f64::from(scale) < 2.0 * f64::from(high)));
            let (low_code, high_code) = (encode(low, scale), encode(high, scale));
            prop_assert!(low_code <= high_code && high_code <= MAX_CODE);
            for (error, code) in [(low, low_code), (high, high_code)] {
                let decoded = decode(code, scale);
                prop_assert!(decoded >= error);
                if code > 1 && scale >= 1e-20 {
                    prop_assert!(f64::from(decoded) <= f64::from(error) * (1.0 + f64::from(2.0_f32.powi(-11))));
                }
            }
        }
    }
}
