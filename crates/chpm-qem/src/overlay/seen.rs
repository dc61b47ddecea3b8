//! The vertices of a loop as they are seen along a normal.

use crate::ring::{PAIRS, Pairs, Ring, each, following};
use nalgebra::Vector3;
use wide::f64x2;

/// A point, seen along the normal.
#[derive(Clone, Copy, Default, Debug)]
pub(super) struct Projected {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) height: f64,
}

impl Projected {
    pub(super) fn cross(self, other: Projected) -> f64 {
        self.x * other.y - self.y * other.x
    }
}

/// The vertices of a loop l_0 = v, l_1, ..., v, seen along the normal, by coordinate. What is done with all of them is done with so many
/// pairs as it has.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub(super) x: Pairs,
    pub(super) y: Pairs,
    pub(super) height: Pairs,
    /// The area that the edge from u to v makes with each.
    pub(super) beside: Pairs,
}

impl Default for Seen {
    fn default() -> Self {
        const NOTHING: Pairs = [f64x2::ZERO; PAIRS];
        Seen { x: NOTHING, y: NOTHING, height: NOTHING, beside: NOTHING }
    }
}

impl Seen {
    #[inline]
    pub(super) fn at(&self, i: usize) -> Projected {
        Projected { x: each(&self.x)[i], y: each(&self.y)[i], height: each(&self.height)[i] }
    }

    /// Takes in a loop relative to u, seen in a frame whose third axis is the normal. Answers with the least and the largest height, that
    /// of u among them.
    #[inline]
    pub(super) fn project(&mut self, ring: &Ring, frame: [Vector3<f64>; 3]) -> (f64, f64) {
        let [x, y, z] = ring.arms();
        let [across, up, normal] = frame.map(|axis| [axis.x, axis.y, axis.z].map(f64x2::splat));
        let (mut low, mut high) = (f64x2::ZERO, f64x2::ZERO);
        for pair in 0..ring.pairs() {
            let (x, y, z) = (x[pair], y[pair], z[pair]);
            self.x[pair] = across[0] * x + across[1] * y + across[2] * z;
            self.y[pair] = up[0] * x + up[1] * y + up[2] * z;
            let height = normal[0] * x + normal[1] * y + normal[2] * z;
            self.height[pair] = height;
            (low, high) = (low.fast_min(height), high.fast_max(height));
        }
        let ([a, b], [c, d]) = (low.to_array(), high.to_array());
        (if a < b { a } else { b }, if c > d { c } else { d })
    }

    /// Takes in others, relative to a point.
    #[inline]
    pub(super) fn relative_to(&mut self, from: Projected, of: &Seen, pairs: usize) {
        let from = [from.x, from.y, from.height].map(f64x2::splat);
        for pair in 0..pairs.min(PAIRS) {
            self.x[pair] = of.x[pair] - from[0];
            self.y[pair] = of.y[pair] - from[1];
            self.height[pair] = of.height[pair] - from[2];
        }
    }

    /// Makes them relative to a point.
    pub(super) fn move_to(&mut self, from: Projected, pairs: usize) {
        let from = [from.x, from.y, from.height].map(f64x2::splat);
        for pair in 0..pairs.min(PAIRS) {
            self.x[pair] -= from[0];
            self.y[pair] -= from[1];
            self.height[pair] -= from[2];
        }
    }

    /// Finds the areas that an edge makes with them, and answers with a bit for each that is negative.
    #[inline]
    pub(super) fn find_beside(&mut self, edge: Projected, pairs: usize) -> u64 {
        let edge = [edge.x, edge.y].map(f64x2::splat);
        let mut negative = 0;
        for pair in 0..pairs.min(PAIRS) {
            let area = edge[0] * self.y[pair] - edge[1] * self.x[pair];
            self.beside[pair] = area;
            negative |= u64::from(area.simd_lt(f64x2::ZERO).to_bitmask()) << (2 * pair);
        }
        negative
    }

    /// A bit for each triangle, which a vertex and the next make with the point in the middle, that is larger than an area.
    #[inline]
    pub(super) fn larger(&self, least_area: f64, pairs: usize) -> u64 {
        let (least_area, mut larger) = (f64x2::splat(least_area), 0);
        for pair in 0..pairs.min(PAIRS - 1) {
            let area = self.x[pair] * following(&self.y, pair) - self.y[pair] * following(&self.x, pair);
            larger |= u64::from(area.simd_gt(least_area).to_bitmask()) << (2 * pair);
        }
        larger
    }

    /// A bit for each that lies below the axis.
    #[inline]
    pub(super) fn below(&self, pairs: usize) -> u64 {
        let bit = |pair: usize| u64::from(self.y[pair].simd_lt(f64x2::ZERO).to_bitmask()) << (2 * pair);
        (0..pairs.min(PAIRS)).fold(0, |below, pair| below | bit(pair))
    }
}
