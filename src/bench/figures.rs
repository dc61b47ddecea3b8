//! The figures of a comparison.

use super::Contender;

/// One mesh of a contender, measured.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Point {
    /// Divisor of the source's triangles.
    pub(crate) divisor: u64,
    /// Triangles that there are.
    pub(crate) triangles: u64,
    /// Measured against the source, the larger of both ways, object units.
    pub(crate) rms: f64,
    pub(crate) max: f64,
}

/// All of one contender.
#[derive(Clone, Debug)]
pub(crate) struct Figure {
    pub(crate) contender: Contender,
    /// Median seconds of the whole process.
    pub(crate) seconds: f64,
    /// Source triangles by `seconds`.
    pub(crate) rate: f64,
    /// Median peak resident memory, bytes.
    pub(crate) peak: u64,
    /// Bytes of the output.
    pub(crate) output: u64,
    pub(crate) points: Vec<Point>,
}

/// The middle value; of two, the smaller one.
pub(crate) fn median<T: Copy + PartialOrd>(values: &[T]) -> Option<T> {
    let mut sorted = values.to_vec();
    sorted.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    sorted.get((sorted.len().max(1) - 1) / 2).copied()
}

/// How many triangles `reference` needs for a root mean square of `rms`: between its two points about it, on a straight line in
/// logarithms. None beyond its ends.
pub(crate) fn equal_deviation(reference: &[Point], rms: f64) -> Option<f64> {
    let mut points: Vec<&Point> = reference.iter().filter(|p| p.rms > 0.0 && p.triangles > 0).collect();
    points.sort_by_key(|p| p.triangles);
    points.windows(2).find_map(|pair| {
        let (coarse, fine) = (pair[0], pair[1]);
        if !(fine.rms..=coarse.rms).contains(&rms) || fine.rms == coarse.rms {
            return None;
        }
        let part = (rms / fine.rms).ln() / (coarse.rms / fine.rms).ln();
        let [few, many] = [coarse, fine].map(|p| (p.triangles as f64).ln());
        Some((many + (few - many) * part).exp())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_a_value_that_is_there() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[4, 1]), Some(1));
        assert_eq!(median::<f64>(&[]), None);
    }

    #[test]
    fn halving_the_triangles_quarters_the_triangles_at_twice_the_deviation() {
        let at = |triangles, rms| Point { divisor: 1, triangles, rms, max: rms };
        // rms * triangles is the same everywhere.
        let reference = [at(1000, 0.01), at(250, 0.04), at(10, 1.0)];
        for (rms, expected) in [(0.01, 1000.0), (0.02, 500.0), (0.04, 250.0), (0.1, 100.0)] {
            let found = equal_deviation(&reference, rms).unwrap();
            assert!((found - expected).abs() < 1e-9 * expected, "{rms}: {found}");
        }
        assert_eq!(equal_deviation(&reference, 0.005), None);
        assert_eq!(equal_deviation(&reference, 2.0), None);
        assert_eq!(equal_deviation(&reference[..1], 0.01), None);
    }
}
