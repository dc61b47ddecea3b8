//! Between sRGB of 8 bits and linear light.

use std::sync::LazyLock;

/// Linear light of the brightest.
const FULL: f64 = 65_535.0;

/// Linear light of each value, to the next whole number.
static LINEAR: LazyLock<[u16; 256]> =
    LazyLock::new(|| std::array::from_fn(|value| (light(value as f64 / 255.0) * FULL).round() as u16));

/// Light from which on a value is nearer than the one before.
static STEPS: LazyLock<[f64; 255]> =
    LazyLock::new(|| std::array::from_fn(|value| light((value as f64 + 0.5) / 255.0) * FULL));

/// Linear light of an sRGB value, both from 0 to 1.
pub(crate) fn light(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { libm::pow((value + 0.055) / 1.055, 2.4) }
}

/// The product of two sRGB values as light: what a tint of one makes of a surface of the other.
pub fn srgb_product(a: u8, b: u8) -> u8 {
    match (a, b) {
        (255, x) | (x, 255) => x,
        _ => encode(light(f64::from(a) / 255.0) * light(f64::from(b) / 255.0) * FULL),
    }
}

/// Linear light of all values, from 0 to 65,535.
pub(crate) fn linear() -> &'static [u16; 256] {
    &LINEAR
}

/// The sRGB value that is nearest to a linear light from 0 to 65,535.
pub(crate) fn encode(light: f64) -> u8 {
    STEPS.partition_point(|step| *step <= light) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back() {
        for value in 0..=255u8 {
            assert_eq!(encode(linear()[value as usize].into()), value);
        }
        assert_eq!([encode(-1.0), encode(1e9)], [0, 255]);
        // 188 of 255 are 0.503 of the light, and the square of that is 138.
        assert_eq!(
            [srgb_product(188, 188), srgb_product(188, 0), srgb_product(255, 7), srgb_product(9, 255)],
            [138, 0, 7, 9]
        );
        // Half of the light is brighter than half of the value.
        assert_eq!(encode(FULL / 2.0), 188);
    }
}
