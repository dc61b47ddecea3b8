//! Between sRGB of 8 bits and linear light.

use std::sync::LazyLock;

/// Linear light of the brightest.
const FULL: f64 = 65_535.0;

/// Linear light of each value, to the next whole number.
static LINEAR: LazyLock<[u16; 256]> =
    LazyLock::new(|| std::array::from_fn(|value| (light(value as f64 / 255.0) * FULL).round() as u16));

/// Light of a bucket of [`Values`]: less than there is between two steps.
const BUCKET: usize = 16;

/// Which value is nearest to a light.
struct Values {
    /// By value, light from which on the next one is nearer.
    steps: [f64; 256],
    /// The values at the begins of buckets; within one, there is one step at most.
    of_bucket: [u8; 65_536 / BUCKET],
}

static VALUES: LazyLock<Values> = LazyLock::new(|| {
    let step = |value: usize| light((value as f64 + 0.5) / 255.0) * FULL;
    let steps = std::array::from_fn(|value| if value < 255 { step(value) } else { f64::INFINITY });
    let value = |light: f64| steps.partition_point(|step| *step <= light) as u8;
    Values { steps, of_bucket: std::array::from_fn(|bucket| value((bucket * BUCKET) as f64)) }
});

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
    let Values { steps, of_bucket } = &*VALUES;
    let value = of_bucket[(light as usize / BUCKET).min(of_bucket.len() - 1)];
    value + u8::from(steps[value as usize] <= light)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back() {
        for value in 0..=255u8 {
            assert_eq!(encode(linear()[value as usize].into()), value);
        }
        assert_eq!([encode(-1.0), encode(1e9), encode(f64::NAN)], [0, 255, 0]);
        for eighth in 0..8 * 65_536 {
            let light = f64::from(eighth) / 8.0;
            assert_eq!(encode(light), VALUES.steps.partition_point(|step| *step <= light) as u8, "{light}");
        }
        // 188 of 255 are 0.503 of the light, and the square of that is 138.
        assert_eq!(
            [srgb_product(188, 188), srgb_product(188, 0), srgb_product(255, 7), srgb_product(9, 255)],
            [138, 0, 7, 9]
        );
        // Half of the light is brighter than half of the value.
        assert_eq!(encode(FULL / 2.0), 188);
    }
}
