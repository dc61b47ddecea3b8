//! Statistics of distances: the largest and where, the mean, the root mean square.

use nalgebra::Point3;

/// Distances of one surface's samples to another surface, in object units.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Side {
    /// The largest, over vertices, edges and triangles: never above the true one-sided Hausdorff distance.
    pub max: f64,
    /// The sample that is so far away; none without samples.
    pub at: Option<[f64; 3]>,
    /// The mean over the surface, by area; over samples alike, if it has none.
    pub mean: f64,
    /// The root of the mean square, likewise.
    pub rms: f64,
    /// Samples taken.
    pub samples: u64,
}

/// Sums over samples, to be merged in an order that does not depend on threads.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Tally {
    farthest: Option<(f64, [f64; 3])>,
    samples: u64,
    area: f64,
    sum: f64,
    squares: f64,
}

impl Tally {
    /// Counts a sample that stands for `area`, which is 0 for those that only the maximum shall know.
    pub fn add(&mut self, point: Point3<f64>, distance: f64, area: f64) {
        if self.farthest.is_none_or(|(max, _)| distance > max) {
            self.farthest = Some((distance, point.coords.into()));
        }
        self.samples += 1;
        if area > 0.0 {
            self.area += area;
            self.sum += area * distance;
            self.squares += area * distance * distance;
        }
    }

    /// Counts what another one has counted after this one.
    pub fn merge(&mut self, other: &Tally) {
        let max = self.farthest.map(|(max, _)| max);
        if other.farthest.is_some_and(|(theirs, _)| max.is_none_or(|max| theirs > max)) {
            self.farthest = other.farthest;
        }
        self.samples += other.samples;
        self.area += other.area;
        self.sum += other.sum;
        self.squares += other.squares;
    }

    /// The largest distance; 0 without samples.
    pub fn max(&self) -> f64 {
        self.farthest.map_or(0.0, |(max, _)| max)
    }

    /// Statistics so far.
    pub fn side(&self) -> Side {
        fn per_area(sum: f64, area: f64) -> f64 {
            if area > 0.0 { sum / area } else { 0.0 }
        }
        Side {
            max: self.max(),
            at: self.farthest.map(|(_, at)| at),
            mean: per_area(self.sum, self.area),
            rms: per_area(self.squares, self.area).sqrt(),
            samples: self.samples,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_sum_are_the_sum() {
        let samples = [([0.0; 3], 1.0, 2.0), ([1.0; 3], 4.0, 0.0), ([2.0; 3], 3.0, 6.0)];
        let mut whole = Tally::default();
        let mut parts = [Tally::default(); 3];
        for (part, (point, distance, area)) in parts.iter_mut().zip(samples) {
            whole.add(point.into(), distance, area);
            part.add(point.into(), distance, area);
        }
        let mut merged = Tally::default();
        parts.iter().for_each(|part| merged.merge(part));
        assert_eq!(merged, whole);
        let side = merged.side();
        assert_eq!((side.max, side.at, side.mean, side.samples), (4.0, Some([1.0; 3]), 2.5, 3));
        assert_eq!(side.rms, 7f64.sqrt());
        assert_eq!(Tally::default().side(), Side::default());
    }
}
