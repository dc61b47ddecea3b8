//! Colours of numbers: viridis, and for signed ones equal steps in the space of Björn Ottosson's Oklab.

use chpm_mesh::viridis;

/// From the least to the largest number of a range.
#[derive(Clone, Copy, Debug)]
pub struct Colors {
    low: f64,
    high: f64,
    /// Whether 0 lies in the middle and has a colour of its own.
    signed: bool,
}

/// Lightness, and how green or red and how blue or yellow.
type Lab = [f64; 3];

/// From blue by a light grey to red, evenly lighter and darker again.
const SIGNED: [Lab; 3] = [[0.40, -0.02, -0.16], [0.92, 0.0, 0.0], [0.40, 0.16, 0.07]];

/// Stops of a gradient, but for the last.
const STOPS: usize = 16;

impl Colors {
    /// Of a range; of a signed one zero lies in the middle.
    pub fn new([low, high]: [f64; 2], signed: bool) -> Self {
        Colors { low, high, signed }
    }

    /// The range.
    pub fn range(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// All of them from the first to the last, as stops of a gradient in CSS.
    pub fn gradient(&self) -> String {
        let stops = (0..=STOPS).map(|n| {
            let [r, g, b, _] = self.of(self.low + (self.high - self.low) * n as f64 / STOPS as f64);
            format!("#{r:02x}{g:02x}{b:02x}")
        });
        stops.collect::<Vec<_>>().join(",")
    }

    /// Red, green, blue, opaque. What is out of the range has the colour of its end; what is no number is grey.
    pub fn of(&self, value: f64) -> [u8; 4] {
        if value.is_nan() {
            return [128, 128, 128, 255];
        }
        let width = self.high - self.low;
        let share = if width > 0.0 { ((value - self.low) / width).clamp(0.0, 1.0) } else { 0.5 };
        if !self.signed {
            let [r, g, b] = viridis(share);
            return [r, g, b, 255];
        }
        let (from, part) = if share < 0.5 { (0, 2.0 * share) } else { (1, 2.0 * share - 1.0) };
        let mixed = [0, 1, 2].map(|i| SIGNED[from][i] + part * (SIGNED[from + 1][i] - SIGNED[from][i]));
        let [r, g, b] = to_srgb(mixed);
        [r, g, b, 255]
    }
}

fn to_srgb([lightness, a, b]: Lab) -> [u8; 3] {
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b).powi(3);
    let linear = [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ];
    linear.map(|x| {
        let x = x.clamp(0.0, 1.0);
        let curved = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (curved * 255.0).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_colors_are_what_they_are() {
        assert_eq!(to_srgb([1.0, 0.0, 0.0]), [255, 255, 255]);
        assert_eq!(to_srgb([0.0, 0.0, 0.0]), [0, 0, 0]);
        // Pure red, as the space is published.
        let [r, g, b] = to_srgb([0.627_955, 0.224_863, 0.125_846]);
        assert!(r >= 254 && g <= 1 && b <= 1, "{r} {g} {b}");
    }

    #[test]
    fn ends_and_middle_of_a_range_are_told_apart() {
        let signed = Colors::new([-2.0, 2.0], true);
        let [low, middle, high] = [-2.0, 0.0, 2.0].map(|x| signed.of(x));
        assert!(low[2] > low[0] && high[0] > high[2], "{low:?} {high:?}");
        assert!(middle[0] == middle[1] && middle[1] == middle[2] && middle[0] > 200, "{middle:?}");
        assert_eq!((signed.of(-9.0), signed.of(9.0), signed.of(f64::NAN)), (low, high, [128, 128, 128, 255]));
        let plain = Colors::new([0.0, 1.0], false);
        let light = |x: f64| plain.of(x).map(u32::from)[..3].iter().sum::<u32>();
        assert!((0..10).all(|i| light(f64::from(i) / 10.0) < light(f64::from(i + 1) / 10.0)));
        assert_eq!(Colors::new([1.0, 1.0], false).of(1.0), plain.of(0.5));
        let gradient = plain.gradient();
        let [r, g, b, _] = plain.of(1.0);
        assert!(
            gradient.split(',').count() == STOPS + 1
                && gradient.ends_with(&format!("#{r:02x}{g:02x}{b:02x}"))
        );
    }
}
