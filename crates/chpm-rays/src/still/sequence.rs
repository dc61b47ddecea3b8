//! Points that are spread evenly, other ones in every pixel: by the pixel alone, so that no thread and no order shows in them.

/// The first coordinates of points of a pixel; each sequence has a salt of its own.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sequence([f64; 3]);

/// Steps of an additive recurrence in two and three dimensions: powers of the root of x^(d+1) = x + 1.
const STEPS_2: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];
const STEPS_3: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3];

impl Sequence {
    /// Of a pixel, by its number in the picture.
    pub(super) fn new(pixel: u64, salt: u64) -> Self {
        let first = mix(pixel.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ mix(salt));
        let [second, third] = [1, 2].map(|n| mix(first.wrapping_add(n)));
        Sequence([first, second, third].map(|bits| (bits >> 11) as f64 / (1_u64 << 53) as f64))
    }

    /// A point of the unit square.
    pub(super) fn square(&self, n: u32) -> [f64; 2] {
        [0, 1].map(|axis| (self.0[axis] + STEPS_2[axis] * f64::from(n)).fract())
    }

    /// A point of the unit cube.
    pub(super) fn cube(&self, n: u32) -> [f64; 3] {
        [0, 1, 2].map(|axis| (self.0[axis] + STEPS_3[axis] * f64::from(n)).fract())
    }
}

/// Mixes bits, as splitmix64 does.
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// How far each of so many rays of a pixel is from its middle, right and up, in pixels: as pictures of the GPU are moved whose mean is drawn.
pub(super) fn shifts(samples: u32) -> Vec<[f64; 2]> {
    fn golden(n: u32) -> f64 {
        (0.618_033_988_749_895 * f64::from(n)).fract()
    }
    let samples = samples.max(1);
    let mean = (0..samples).map(golden).sum::<f64>() / f64::from(samples);
    (0..samples).map(|n| [(f64::from(n) + 0.5) / f64::from(samples) - 0.5, golden(n) - mean]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spread_evenly() {
        let sequence = Sequence::new(77, 3);
        let mut cells = [0_u32; 64];
        for n in 0..6400 {
            let [u, v] = sequence.square(n);
            cells[(8.0 * u) as usize * 8 + (8.0 * v) as usize] += 1;
        }
        assert!(cells.iter().all(|count| (90..=110).contains(count)), "{cells:?}");
        let mean = |axis: usize| (0..64).map(|n| sequence.cube(n)[axis]).sum::<f64>() / 64.0;
        assert!((0..3).all(|axis| (mean(axis) - 0.5).abs() < 0.03));
    }

    #[test]
    fn pixels_have_points_of_their_own() {
        let firsts: Vec<f64> = (0..1000).map(|pixel| Sequence::new(pixel, 0).square(0)[0]).collect();
        let mean = firsts.iter().sum::<f64>() / 1000.0;
        let alike = firsts.windows(2).map(|pair| (pair[0] - mean) * (pair[1] - mean)).sum::<f64>() / 1000.0;
        assert!((mean - 0.5).abs() < 0.05 && alike.abs() < 0.01, "{mean} {alike}");
        assert_ne!(Sequence::new(5, 0).square(0), Sequence::new(5, 1).square(0));
    }

    #[test]
    fn one_ray_goes_through_the_middle() {
        assert_eq!(shifts(1), [[0.0; 2]]);
        let eight = shifts(8);
        assert!((0..2).all(|axis| eight.iter().map(|shift| shift[axis]).sum::<f64>().abs() < 1e-12));
    }
}
