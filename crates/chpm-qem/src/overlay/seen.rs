//! The vertices of a loop as they are seen along a normal.

use crate::ring::MAX_LOOP;
use std::ops::Range;

/// Room for a loop, and for its first vertex again.
pub(super) const ROOM: usize = MAX_LOOP + 1;

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

/// The vertices of a loop l_0 = v, l_1, ..., v, seen along the normal, by coordinate.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub(super) x: [f64; ROOM],
    pub(super) y: [f64; ROOM],
    pub(super) height: [f64; ROOM],
    /// The area that the edge from u to v makes with each.
    pub(super) beside: [f64; ROOM],
}

impl Default for Seen {
    fn default() -> Self {
        Seen { x: [0.0; ROOM], y: [0.0; ROOM], height: [0.0; ROOM], beside: [0.0; ROOM] }
    }
}

impl Seen {
    #[inline]
    pub(super) fn at(&self, i: usize) -> Projected {
        Projected { x: self.x[i], y: self.y[i], height: self.height[i] }
    }

    /// The first `count` of others, relative to a point.
    #[inline]
    pub(super) fn relative_to(&mut self, from: Projected, of: &Seen, count: usize) {
        for i in 0..count.min(ROOM) {
            self.x[i] = of.x[i] - from.x;
            self.y[i] = of.y[i] - from.y;
            self.height[i] = of.height[i] - from.height;
        }
    }

    /// Makes them relative to a point.
    pub(super) fn move_to(&mut self, from: Projected) {
        self.x.iter_mut().for_each(|x| *x -= from.x);
        self.y.iter_mut().for_each(|y| *y -= from.y);
        self.height.iter_mut().for_each(|height| *height -= from.height);
    }

    /// Finds the areas that an edge makes with the first `count` of them.
    #[inline]
    pub(super) fn find_beside(&mut self, edge: Projected, count: usize) {
        for i in 0..count.min(ROOM) {
            self.beside[i] = edge.x * self.y[i] - edge.y * self.x[i];
        }
    }

    /// The least and the largest height of the first `count` of them and of the middle.
    #[inline]
    pub(super) fn heights(&self, count: usize) -> (f64, f64) {
        let (mut low, mut high) = (0f64, 0f64);
        for height in &self.height[..count] {
            low = if *height < low { *height } else { low };
            high = if *height > high { *height } else { high };
        }
        (low, high)
    }

    /// How often the loop of `count` of them goes up across the axis.
    #[inline]
    pub(super) fn rises(&self, count: usize) -> u32 {
        let y = &self.y[..=count];
        (1..y.len()).map(|i| u32::from((y[i - 1] < 0.0) & (y[i] >= 0.0))).sum()
    }

    /// Whether all of the given triangles, which each vertex and the next make with the point in the middle, are larger than an area.
    #[inline]
    pub(super) fn are_larger(&self, triangles: Range<usize>, least_area: f64) -> bool {
        let (x, y) =
            (&self.x[triangles.start..triangles.end + 1], &self.y[triangles.start..triangles.end + 1]);
        let mut larger = 0;
        for i in 1..x.len() {
            larger += usize::from(x[i - 1] * y[i] - y[i - 1] * x[i] > least_area);
        }
        larger == triangles.len()
    }
}
