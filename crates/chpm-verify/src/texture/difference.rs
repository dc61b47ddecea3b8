//! Sums over samples.

/// Steps of a difference that are counted apart.
const STEPS: usize = 16;
/// Parts of a square of a difference.
const PARTS: f64 = (1u32 << 20) as f64;

/// How far colours are from the source's: of a sample, the root of the mean square over red, green and blue, of 255.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Difference {
    /// Samples where both have a colour.
    pub samples: u64,
    /// Half of them differ by no more, to a sixteenth.
    pub median: f64,
    /// Likewise 95 of 100.
    pub p95: f64,
    /// Likewise 99 of 100.
    pub p99: f64,
    /// Peak signal-to-noise ratio over all of them, decibels; infinite where they are equal.
    pub psnr: f64,
}

/// How far colours are from where they are in the source.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Slide {
    /// Samples whose way to the source is known.
    pub samples: u64,
    /// Samples that lie in no triangle of their chart, or in several, in one of the sheets.
    pub outside: u64,
    /// The longest way, object units.
    pub max: f64,
    /// The largest part of its bound that a way has.
    pub of_bound: f64,
    /// Ways that are longer than their bound.
    pub beyond: u64,
}

/// Samples that were taken.
#[derive(Clone, Debug)]
pub(super) struct Found {
    pub(super) triangles: u64,
    pub(super) slide: Slide,
    samples: u64,
    /// In parts: sums of whole numbers are the same in any order.
    squares: u128,
    counts: Vec<u64>,
}

impl Default for Found {
    fn default() -> Self {
        let counts = vec![0; 255 * STEPS + 1];
        Found { triangles: 0, slide: Slide::default(), samples: 0, squares: 0, counts }
    }
}

impl Found {
    /// No samples yet, of so many triangles.
    pub(super) fn of(triangles: usize) -> Self {
        Found { triangles: triangles as u64, ..Found::default() }
    }

    /// Adds two colours, of 255.
    pub(super) fn add(&mut self, a: [f64; 3], b: [f64; 3]) {
        let square = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / 3.0;
        self.samples += 1;
        self.squares += (square * PARTS) as u128;
        let step = (square.sqrt() * STEPS as f64).ceil() as usize;
        self.counts[step.min(255 * STEPS)] += 1;
    }

    /// Adds a way and its bound; none if the sample has no way.
    pub(super) fn add_way(&mut self, way: Option<(f64, f64)>, slack: f64) {
        let Some((len, bound)) = way else {
            self.slide.outside += 1;
            return;
        };
        self.slide.samples += 1;
        self.slide.max = self.slide.max.max(len);
        let over = (len - slack).max(0.0);
        if over > 0.0 {
            self.slide.of_bound = self.slide.of_bound.max(over / bound);
        }
        self.slide.beyond += u64::from(over > bound);
    }

    pub(super) fn merged(mut self, other: Found) -> Found {
        self.triangles += other.triangles;
        self.samples += other.samples;
        self.squares += other.squares;
        self.counts.iter_mut().zip(other.counts).for_each(|(count, other)| *count += other);
        let (a, b) = (self.slide, other.slide);
        self.slide = Slide {
            samples: a.samples + b.samples,
            outside: a.outside + b.outside,
            max: a.max.max(b.max),
            of_bound: a.of_bound.max(b.of_bound),
            beyond: a.beyond + b.beyond,
        };
        self
    }

    pub(super) fn difference(&self) -> Difference {
        let within = |part: f64| {
            let least = (part * self.samples as f64).ceil() as u64;
            let mut sum = 0;
            let step = self.counts.iter().position(|count| {
                sum += count;
                sum >= least
            });
            step.unwrap_or(0) as f64 / STEPS as f64
        };
        let mean = self.squares as f64 / PARTS / self.samples.max(1) as f64;
        Difference {
            samples: self.samples,
            median: within(0.5),
            p95: within(0.95),
            p99: within(0.99),
            psnr: 10.0 * (255.0 * 255.0 / mean).log10(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_and_the_ratio_are_those_of_the_samples() {
        let mut found = Found::default();
        for value in 1..=100 {
            let mut one = Found::default();
            one.add([10.0; 3], [10.0 + f64::from(value); 3]);
            found = found.merged(one);
        }
        let Difference { samples, median, p95, p99, psnr } = found.difference();
        assert_eq!((samples, median, p95, p99), (100, 50.0, 95.0, 99.0));
        let mean = (1..=100).map(|value| f64::from(value * value)).sum::<f64>() / 100.0;
        assert!((psnr - 10.0 * (65_025.0 / mean).log10()).abs() < 1e-9);
        let mut equal = Found::default();
        equal.add([7.0, 255.0, 0.0], [7.0, 255.0, 0.0]);
        assert_eq!((equal.difference().psnr, equal.difference().p99), (f64::INFINITY, 0.0));
    }

    #[test]
    fn ways_are_held_against_their_bounds() {
        let mut found = Found::default();
        for way in [Some((1.0, 2.0)), Some((3.0, 2.5)), Some((0.125, 0.0)), None] {
            found.add_way(way, 0.25);
        }
        let Slide { samples, outside, max, of_bound, beyond } = found.slide;
        assert_eq!((samples, outside, max, of_bound, beyond), (3, 1, 3.0, 1.1, 1));
    }
}
