//! One picture of several, each moved by a part of a pixel: edges become smooth.

/// How far each of so many pictures is moved, right and up, in pixels: evenly over one pixel, its middle in the mean.
pub(super) fn shifts(samples: u32) -> impl Iterator<Item = [f64; 2]> {
    // The golden section spreads the heights, whatever the number; a single picture stays where it is.
    fn golden(n: u32) -> f64 {
        (0.618_033_988_749_895 * f64::from(n)).fract()
    }
    let mean = (0..samples).map(golden).sum::<f64>() / f64::from(samples.max(1));
    fn along(n: u32, samples: u32) -> f64 {
        (f64::from(n) + 0.5) / f64::from(samples) - 0.5
    }
    (0..samples).map(move |n| [along(n, samples), golden(n) - mean])
}

/// The mean of pictures of one size.
#[derive(Clone, Debug, Default)]
pub(super) struct Mean {
    sums: Vec<u32>,
    count: u32,
}

impl Mean {
    /// One more picture, four bytes a pixel.
    pub(super) fn add(&mut self, pixels: &[u8]) {
        self.sums.resize(pixels.len(), 0);
        self.count += 1;
        for (sum, byte) in self.sums.iter_mut().zip(pixels) {
            *sum += u32::from(*byte);
        }
    }

    /// The mean. Where there is nothing behind the model, colours are the mean of the pictures that show it.
    pub(super) fn pixels(&self, transparent: bool) -> Vec<u8> {
        fn whole(sum: u32, of: u32) -> u8 {
            ((sum + of / 2) / of.max(1)) as u8
        }
        self.sums
            .chunks_exact(4)
            .flat_map(|sums| {
                let shown = if transparent { sums[3].div_ceil(255) } else { self.count };
                let [r, g, b] = [0, 1, 2].map(|channel| whole(sums[channel], shown));
                [r, g, b, whole(sums[3], self.count)]
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_moved_all_over_a_pixel_and_on_the_whole_not_at_all() {
        assert_eq!(shifts(1).collect::<Vec<_>>(), [[0.0; 2]]);
        for samples in [2, 4, 9, 16, 64] {
            let all: Vec<_> = shifts(samples).collect();
            assert_eq!(all.len(), samples as usize);
            for axis in 0..2 {
                let mean = all.iter().map(|shift| shift[axis]).sum::<f64>() / all.len() as f64;
                assert!(mean.abs() < 1e-12, "{samples}: {mean}");
                let (low, high) = all.iter().fold((0.0, 0.0), |(low, high): (f64, f64), shift| {
                    (low.min(shift[axis]), high.max(shift[axis]))
                });
                assert!(high - low < 1.0 && high - low >= 0.5, "{samples}: {low} to {high}");
            }
        }
    }

    #[test]
    fn what_is_half_covered_is_half_there() {
        let mut mean = Mean::default();
        mean.add(&[100, 50, 0, 255, 9, 9, 9, 255]);
        assert_eq!(mean.pixels(false), [100, 50, 0, 255, 9, 9, 9, 255]);
        mean.add(&[0, 0, 0, 0, 10, 10, 10, 255]);
        assert_eq!(mean.pixels(true), [100, 50, 0, 128, 10, 10, 10, 255]);
        let mut nothing = Mean::default();
        nothing.add(&[0; 4]);
        assert_eq!(nothing.pixels(true), [0; 4]);
    }
}
