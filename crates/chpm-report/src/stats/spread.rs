//! How values are spread: what a quarter, half, three quarters and 95 % of them do not exceed.

use serde::Serialize;

/// Percentiles by nearest rank, so that each is one of the values.
#[derive(Clone, Copy, PartialEq, Serialize, Debug)]
pub struct Spread {
    /// The least.
    pub min: f64,
    /// A quarter of them do not exceed this.
    pub p25: f64,
    /// Half of them do not exceed this.
    pub median: f64,
    /// Three quarters of them do not exceed this.
    pub p75: f64,
    /// 95 of 100 do not exceed this.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// Of nothing there is none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_unstable_by(f64::total_cmp);
        let last = values.last().copied()?;
        Some(Spread::by_rank(values.len() as u64, last, |rank| values[rank as usize]))
    }

    /// Of values 0, 1, 2 ..., each of which occurs so often.
    pub fn of_counts(counts: &[u64]) -> Option<Self> {
        let last = counts.iter().rposition(|count| *count > 0)?;
        Some(Spread::by_rank(counts.iter().sum(), last as f64, |rank| {
            let mut below = 0;
            let found = counts.iter().position(|count| {
                below += count;
                below > rank
            });
            found.unwrap_or(last) as f64
        }))
    }

    fn by_rank(count: u64, max: f64, at: impl Fn(u64) -> f64) -> Self {
        // The least rank that so many percent do not exceed.
        let [p25, median, p75, p95] =
            [25, 50, 75, 95].map(|percent| at((count * percent).div_ceil(100).max(1) - 1));
        Spread { min: at(0), p25, median, p75, p95, max }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values() {
        assert_eq!(Spread::of([]), None);
        let of = |n: u32| {
            let s = Spread::of((1..=n).rev().map(f64::from)).unwrap();
            [s.min, s.p25, s.median, s.p75, s.p95, s.max]
        };
        assert_eq!(of(1), [1.0; 6]);
        assert_eq!(of(2), [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
        assert_eq!(of(100), [1.0, 25.0, 50.0, 75.0, 95.0, 100.0]);
        assert_eq!(of(21), [1.0, 6.0, 11.0, 16.0, 20.0, 21.0]);
    }

    #[test]
    fn counts_are_as_good_as_values() {
        let values = [0, 2, 2, 2, 3, 7, 7];
        let mut counts = [0; 10];
        values.iter().for_each(|value| counts[*value] += 1);
        assert_eq!(Spread::of_counts(&counts), Spread::of(values.map(|value| value as f64)));
        assert_eq!(Spread::of_counts(&[0; 4]), None);
    }
}
