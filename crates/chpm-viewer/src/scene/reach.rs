//! Beams of light on what is seen, and the boxes that they go through.

use chpm_refine::Region;

/// Numbers from one to another; none where the first is larger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// The least.
    pub low: f64,
    /// The most.
    pub high: f64,
}

impl Span {
    /// No numbers.
    pub const NONE: Span = Span { low: f64::INFINITY, high: f64::NEG_INFINITY };

    /// Takes in a number.
    pub fn add(&mut self, x: f64) {
        *self = Span { low: self.low.min(x), high: self.high.max(x) };
    }

    /// Takes in all of another one.
    pub fn join(&mut self, other: &Span) {
        if other.low <= other.high {
            *self = Span { low: self.low.min(other.low), high: self.high.max(other.high) };
        }
    }

    /// Numbers that both have.
    pub fn cut(&self, other: &Span) -> Span {
        Span { low: self.low.max(other.low), high: self.high.min(other.high) }
    }

    /// Whether both have something.
    pub fn meets(&self, other: &Span) -> bool {
        self.low <= other.high && other.low <= self.high
    }
}

/// All from where a shadow may fall on what is seen: beams toward the light, from what is farthest from it.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    /// Across the light and toward it, for coordinates of the file.
    pub axes: [[f64; 3]; 3],
    /// Offset along each, to be taken off.
    pub shifts: [f64; 3],
    /// The beams, across the light.
    pub parts: Vec<[Span; 2]>,
    /// Where they begin.
    pub from: f64,
}

impl Reach {
    /// A box along an axis. Each step is monotone, so that a box in another one never reaches further.
    pub fn along(axis: &[f64; 3], shift: f64, low: [f64; 3], high: [f64; 3]) -> Span {
        let mut span = Span { low: 0.0, high: 0.0 };
        for i in 0..3 {
            let (a, b) = (axis[i] * low[i], axis[i] * high[i]);
            span = Span { low: span.low + a.min(b), high: span.high + a.max(b) };
        }
        Span { low: span.low - shift, high: span.high - shift }
    }

    /// Whether something in a region may throw a shadow on what is seen.
    pub fn takes(&self, region: &Region) -> bool {
        let across =
            [0, 1, 2].map(|axis| Reach::along(&self.axes[axis], self.shifts[axis], region.low, region.high));
        let is_before = across[2].high >= self.from;
        is_before && self.parts.iter().any(|part| (0..2).all(|axis| across[axis].meets(&part[axis])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_before_the_receivers_is_taken() {
        let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let part = [Span { low: -1.0, high: 1.0 }, Span { low: 0.0, high: 2.0 }];
        let reach = Reach { axes: unit, shifts: [0.0, 0.0, 5.0], parts: vec![part], from: -3.0 };
        let at = |x: f64, y: f64, z: f64| {
            let sphere = Region::sphere([x, y, z], 0.5);
            let corner = |by: f64| [x + by, y + by, z + by];
            reach.takes(&Region { low: corner(-0.5), high: corner(0.5), ..sphere })
        };
        assert!(at(0.0, 1.0, 2.0) && at(0.0, 1.0, 1e9) && at(1.4, 2.4, 1.6));
        assert!(!at(0.0, 1.0, 1.0) && !at(1.6, 1.0, 9.0) && !at(0.0, -0.6, 9.0));
    }

    #[test]
    fn spans_join_and_meet() {
        let (a, b) = (Span { low: 0.0, high: 2.0 }, Span { low: 1.0, high: 3.0 });
        assert!(a.meets(&b) && !a.meets(&Span { low: 2.5, high: 3.0 }) && !Span::NONE.meets(&a));
        let mut all = Span::NONE;
        all.join(&Span::NONE);
        assert_eq!(all, Span::NONE);
        all.join(&a.cut(&b));
        assert_eq!(all, Span { low: 1.0, high: 2.0 });
        all.join(&a.cut(&Span { low: 5.0, high: 6.0 }));
        all.add(-1.0);
        assert_eq!(all, Span { low: -1.0, high: 2.0 });
    }
}
