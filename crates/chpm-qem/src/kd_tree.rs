//! Vertices that are near to a place: a k-d tree (Bentley 1975) with small leaves.

use nalgebra::Point3;
use std::ops::Range;

/// Some vertices of a patch. In every part that is no leaf the middle one lies between the two halves, by one coordinate after the
/// other.
#[derive(Debug, Default)]
pub(crate) struct KdTree {
    vertices: Vec<u16>,
    /// Where they are, in the same order.
    places: Vec<[f32; 3]>,
    /// Parts that a search has yet to visit.
    later: Vec<Part>,
}

/// A part of the tree as a search sees it.
#[derive(Clone, Debug)]
struct Part {
    range: Range<usize>,
    /// The vertex between it and the half on this side.
    middle: usize,
    /// By which coordinate it is halved.
    axis: usize,
    /// How far away it is, by coordinate.
    aside: [f64; 3],
}

/// The coordinate after each.
const NEXT: [usize; 3] = [1, 2, 0];

/// Most vertices of a leaf, which are looked at one by one.
const LEAF: usize = 16;

impl KdTree {
    /// Refills it.
    pub(crate) fn fill(&mut self, positions: &[[f32; 3]], vertices: impl Iterator<Item = u16>) {
        self.vertices.clear();
        self.vertices.extend(vertices);
        divide(positions, &mut self.vertices, 0);
        self.places.clear();
        self.places.extend(self.vertices.iter().map(|v| positions[usize::from(*v)]));
    }

    /// The vertex nearest to a place of those that are accepted, and the square of its distance, which is less than `within`. Only what
    /// is nearer than all accepted so far is asked about.
    pub(crate) fn nearest(
        &mut self,
        at: Point3<f64>,
        within: f64,
        accept: impl FnMut(u16) -> bool,
    ) -> Option<(f64, u16)> {
        let KdTree { vertices, places, later } = self;
        let at = at.coords.into();
        let mut search = NearestSearch { vertices, places, at, accept, least: within, nearest: None };
        later.clear();
        let mut part = Part { range: 0..vertices.len(), middle: 0, axis: 0, aside: [0.0; 3] };
        loop {
            // Down to the leaf on this side of everything; what is beyond the middle ones comes later.
            while part.range.len() > LEAF {
                let middle = part.range.start + part.range.len() / 2;
                let beyond = at[part.axis] - f64::from(places[middle][part.axis]);
                let (before, after) = (part.range.start..middle, middle + 1..part.range.end);
                let (near, far) = if beyond < 0.0 { (before, after) } else { (after, before) };
                let mut aside = part.aside;
                // As it is rounded, this is never more than what is found for a vertex there.
                aside[part.axis] = beyond;
                let axis = NEXT[part.axis];
                later.push(Part { range: far, middle, axis, aside });
                (part.range, part.axis) = (near, axis);
            }
            part.range.for_each(|index| search.visit(index));
            part = loop {
                let Some(part) = later.pop() else {
                    return search.nearest.map(|vertex| (search.least, vertex));
                };
                if squared(part.aside) < search.least {
                    break part;
                }
            };
            search.visit(part.middle);
        }
    }
}

/// Puts the middle vertex by a coordinate between the two halves, and so on with the next coordinate in both.
fn divide(positions: &[[f32; 3]], part: &mut [u16], axis: usize) {
    if part.len() > LEAF {
        let middle = part.len() / 2;
        let place = |v: u16| positions[usize::from(v)][axis];
        part.select_nth_unstable_by(middle, |a, b| place(*a).total_cmp(&place(*b)).then(a.cmp(b)));
        let (before, rest) = part.split_at_mut(middle);
        divide(positions, before, (axis + 1) % 3);
        divide(positions, &mut rest[1..], (axis + 1) % 3);
    }
}

struct NearestSearch<'a, F> {
    vertices: &'a [u16],
    places: &'a [[f32; 3]],
    at: [f64; 3],
    accept: F,
    /// The square of the distance to the nearest so far.
    least: f64,
    nearest: Option<u16>,
}

impl<F: FnMut(u16) -> bool> NearestSearch<'_, F> {
    #[inline(always)]
    fn visit(&mut self, index: usize) {
        let [x, y, z] = self.places[index];
        let [a, b, c] = self.at;
        let squared = squared([f64::from(x) - a, f64::from(y) - b, f64::from(z) - c]);
        if squared < self.least {
            let vertex = self.vertices[index];
            if (self.accept)(vertex) {
                (self.least, self.nearest) = (squared, Some(vertex));
            }
        }
    }
}

fn squared([x, y, z]: [f64; 3]) -> f64 {
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_mesh::geom::to_f64;
    use proptest::prelude::*;

    proptest! {
        /// Same answer as brute force, with few vertices tested.
        #[test]
        fn it_is_the_nearest_and_few_are_asked_about(
            places in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 1..2000),
            at in prop::array::uniform3(-1.5f64..1.5),
            passed in 1u16..5,
        ) {
            let mut tree = KdTree::default();
            tree.fill(&places, 0..places.len() as u16);
            let at = Point3::from(at);
            let mut asked = 0;
            let found = tree.nearest(at, f64::INFINITY, |v| { asked += 1; v % passed == 0 });
            let accepted = places.iter().step_by(passed.into());
            let least = accepted.map(|p| (to_f64(*p) - at).norm_squared()).fold(f64::INFINITY, f64::min);
            prop_assert_eq!(found.map(|(squared, _)| squared), Some(least));
            prop_assert!(asked <= 100, "{}", asked);
            // What is no nearer than a limit is not found.
            prop_assert_eq!(tree.nearest(at, least, |v| v % passed == 0), None);
        }
    }
}
