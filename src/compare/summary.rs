//! Distances of all vertices, summed up.

use crate::json::near;

/// Statistics of a set of distances.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Summary {
    pub(crate) count: u64,
    pub(crate) min: f64,
    pub(crate) max: f64,
    pub(crate) mean: f64,
    pub(crate) rms: f64,
    /// Of the sizes, in [`PERCENTS`].
    pub(crate) percentiles: [f64; 5],
    /// Numbers of vertices in bins of one width, from `range[0]` to `range[1]`.
    pub(crate) bins: Vec<u64>,
    pub(crate) range: [f64; 2],
    /// How many are below and above the range, and in no bin.
    pub(crate) outside: [u64; 2],
}

/// How many vertices are no farther than allowed, by size.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Pass {
    pub(crate) tolerance: f64,
    pub(crate) within: u64,
    pub(crate) beyond: u64,
    /// So near to the tolerance that rounding decides.
    pub(crate) undecided: u64,
}

impl Pass {
    /// Of distances; those near to the tolerance may each be off by `rounding`.
    pub(crate) fn new(values: &[f64], tolerance: f64, rounding: f64) -> Self {
        let mut pass = Pass { tolerance, within: 0, beyond: 0, undecided: 0 };
        for size in values.iter().map(|x| x.abs()) {
            let slack = rounding + 2.0 * f64::EPSILON * size;
            let count = match size {
                size if size + slack <= tolerance => &mut pass.within,
                size if size - slack > tolerance => &mut pass.beyond,
                _ => &mut pass.undecided,
            };
            *count += 1;
        }
        pass
    }

    /// Of all, what is certainly within.
    pub(crate) fn share(&self) -> f64 {
        let all = self.within + self.beyond + self.undecided;
        if all == 0 { 1.0 } else { self.within as f64 / all as f64 }
    }

    /// The same for programs.
    pub(crate) fn json(&self) -> near::Pass {
        near::Pass {
            tolerance: self.tolerance,
            share: self.share(),
            within: self.within,
            beyond: self.beyond,
            undecided: self.undecided,
        }
    }
}

/// Percent of the vertices that have no larger distance, by size.
pub(crate) const PERCENTS: [f64; 5] = [50.0, 90.0, 95.0, 99.0, 99.9];

/// Bins of a histogram.
const BINS: usize = 64;

impl Summary {
    /// Without a range, it goes to the 99th percentile: from 0, or where distances are signed as far to the other side.
    pub(crate) fn new(values: &[f64], signed: bool, range: Option<[f64; 2]>) -> Self {
        let mut sizes: Vec<f64> = values.iter().map(|x| x.abs()).collect();
        let percentiles = PERCENTS.map(|percent| {
            // In whole numbers, so that 99.9 % of a thousand are not one more.
            let rank = ((10.0 * percent).round() as usize * sizes.len()).div_ceil(1000);
            let at = rank.clamp(1, sizes.len().max(1)) - 1;
            if at < sizes.len() { *sizes.select_nth_unstable_by(at, f64::total_cmp).1 } else { 0.0 }
        });
        let range = range.unwrap_or(match percentiles[3] {
            most if signed => [-most, most],
            most => [0.0, most],
        });
        let mut found = Summary {
            count: values.len() as u64,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            mean: 0.0,
            rms: 0.0,
            percentiles,
            bins: vec![0; BINS],
            range,
            outside: [0; 2],
        };
        let width = range[1] - range[0];
        let (mut sum, mut squares) = (Sum::default(), Sum::default());
        for value in values.iter().copied() {
            found.min = found.min.min(value);
            found.max = found.max.max(value);
            sum.add(value);
            squares.add(value * value);
            let share = if width > 0.0 { (value - range[0]) / width } else { 0.0 };
            match value {
                value if value < range[0] => found.outside[0] += 1,
                value if value > range[1] => found.outside[1] += 1,
                _ => found.bins[((share * BINS as f64).max(0.0) as usize).min(BINS - 1)] += 1,
            }
        }
        let count = values.len().max(1) as f64;
        (found.mean, found.rms) = (sum.total() / count, (squares.total() / count).sqrt());
        found
    }

    /// Rounding of these numbers at most, however many distances there are.
    pub(crate) fn lost(&self) -> f64 {
        8.0 * f64::EPSILON * self.min.abs().max(self.max.abs())
    }

    /// The same for programs.
    pub(crate) fn json(&self) -> near::CompareSummary {
        let [p50, p90, p95, p99, p99_9] = self.percentiles;
        let of_some = |x: f64| (self.count > 0).then_some(x);
        near::CompareSummary {
            vertices: self.count,
            min: of_some(self.min),
            max: of_some(self.max),
            mean: of_some(self.mean),
            rms: of_some(self.rms),
            percentiles: (self.count > 0).then_some(near::Percentiles { p50, p90, p95, p99, p99_9 }),
            range: self.range,
            histogram: self.bins.clone(),
            below: self.outside[0],
            above: self.outside[1],
        }
    }
}

/// A sum that keeps what each addition loses, as Neumaier does.
#[derive(Default)]
struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        let (large, small) =
            if self.sum.abs() >= value.abs() { (self.sum, value) } else { (value, self.sum) };
        self.lost += (large - sum) + small;
        self.sum = sum;
    }

    fn total(&self) -> f64 {
        self.sum + self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_do_not_lose_what_is_small() {
        let values: Vec<f64> = [1e16, 1.0, 1.0, -1e16].into_iter().cycle().take(4000).collect();
        assert_eq!(Summary::new(&values, true, None).mean, 0.5);
    }

    #[test]
    fn distances_are_summed_up_by_size_and_sign() {
        let values: Vec<f64> = (1..=1000).map(|i| if i % 2 == 0 { i.into() } else { (-i).into() }).collect();
        let found = Summary::new(&values, true, None);
        assert_eq!((found.count, found.min, found.max), (1000, -999.0, 1000.0));
        assert_eq!(found.percentiles, [500.0, 900.0, 950.0, 990.0, 999.0]);
        assert_eq!(found.range, [-990.0, 990.0]);
        assert!((found.mean - 0.5).abs() < 1e-12 && (found.rms - 577.78).abs() < 0.01, "{found:?}");
        // The farthest have no bin: its height would be theirs and not that of its distances.
        assert_eq!((found.bins.iter().sum::<u64>(), found.outside), (990, [5, 5]));
        let given = Summary::new(&values, true, Some([0.0, 10.0]));
        assert_eq!((given.range, given.bins.iter().sum::<u64>()), ([0.0, 10.0], 5));
        assert_eq!(given.outside, [500, 495]);
        assert_eq!(Summary::new(&[0.0; 3], false, None).bins[0], 3);
    }

    #[test]
    fn what_rounding_decides_is_not_within() {
        let pass = Pass::new(&[0.0, -0.1, 0.25, 0.5, -0.5, 2.0], 0.5, 1e-3);
        assert_eq!((pass.within, pass.beyond, pass.undecided), (3, 1, 2));
        assert_eq!(pass.share(), 0.5);
        assert_eq!(Pass::new(&[], 0.5, 0.0).share(), 1.0);
    }
}
