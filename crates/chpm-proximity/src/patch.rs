//! Searches among the triangles of patches: the nearest of two, the nearest to a point, all that are near.

use crate::pose::Between;
use crate::triangle::{self, Near};
use chpm_space::{Corners, FEW, Node, Patch};
use nalgebra::Vector3;
use std::ops::ControlFlow;

/// Result of a search among the triangles of two patches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    /// No triangles of the patches are nearer.
    pub(crate) lower: f64,
    /// The nearest points found, and the places of their triangles in their pages.
    pub(crate) near: Option<(Near, [u32; 2])>,
}

/// Searches of a patch.
pub(crate) trait Search {
    /// The nearest triangles of two patches, if they are nearer than `below`; found to `slack`.
    fn nearest(&self, other: &Patch, between: &Between, below: f64, slack: f64) -> Found;

    /// Goes to the nearest point of the patch, if it is nearer than what was found. Answers its triangle, by its place in the boxes' order.
    fn nearest_to(&self, point: &Vector3<f64>, spot: &mut Spot) -> Option<usize>;

    /// Calls `found` for every pair of triangles that may be within `reach`, until it breaks.
    fn pairs_within<X>(
        &self,
        other: &Patch,
        between: &Between,
        reach: f64,
        found: &mut dyn FnMut(usize, usize) -> ControlFlow<X>,
    ) -> ControlFlow<X>;

    /// The same in the frame of another model.
    fn moved(&self, index: usize, between: &Between) -> (Corners, u32);
}

impl Search for Patch {
    fn nearest(&self, other: &Patch, between: &Between, below: f64, slack: f64) -> Found {
        let mut search = PatchSearch {
            a: self,
            b: other,
            between,
            slack,
            upper: below,
            lower: below,
            near: None,
            along: Vector3::zeros(),
        };
        if !self.is_empty() && !other.is_empty() {
            search.descend(0, 0);
        }
        Found { lower: search.lower, near: search.near }
    }

    fn nearest_to(&self, point: &Vector3<f64>, spot: &mut Spot) -> Option<usize> {
        if self.is_empty() {
            return None;
        }
        let away = |at: usize| self.nodes()[at].squared_from(point);
        let mut nearest = None;
        let mut open = [(0.0, 0); DEEP];
        let mut count = 1;
        open[0] = (away(0), 0);
        while count > 0 {
            count -= 1;
            let (lower, at) = open[count];
            if lower > spot.reach() {
                continue;
            }
            let node = &self.nodes()[at];
            if node.other == 0 {
                for index in node.triangles() {
                    if spot.take(point, &self.triangle(index).0) {
                        nearest = Some(index);
                    }
                }
                continue;
            }
            let (first, second) = (at + 1, node.other as usize);
            let (x, y) = (away(first), away(second));
            // The nearer one is taken first.
            let pair = if x <= y { [(y, second), (x, first)] } else { [(x, first), (y, second)] };
            open[count..count + 2].copy_from_slice(&pair);
            count += 2;
        }
        nearest
    }

    fn pairs_within<X>(
        &self,
        other: &Patch,
        between: &Between,
        reach: f64,
        found: &mut dyn FnMut(usize, usize) -> ControlFlow<X>,
    ) -> ControlFlow<X> {
        if self.is_empty() || other.is_empty() {
            return ControlFlow::Continue(());
        }

        let squared = reach * reach;
        let mut open = vec![(0, 0)];
        while let Some((a, b)) = open.pop() {
            let (x, y) = (&self.nodes()[a], &other.nodes()[b]);
            if between.squared(&x.block(), &y.block()) > squared {
                continue;
            }

            match further(x, y) {
                None => {
                    for i in x.triangles() {
                        for j in y.triangles() {
                            found(i, j)?;
                        }
                    }
                }
                Some(true) => open.extend([(a + 1, b), (x.other as usize, b)]),
                Some(false) => open.extend([(a, b + 1), (a, y.other as usize)]),
            }
        }
        ControlFlow::Continue(())
    }

    fn moved(&self, index: usize, between: &Between) -> (Corners, u32) {
        (self.corners_of(index).map(|corner| between.apply(corner)), self.place(index))
    }
}

/// Boxes that can wait for a point: halves of halves of 65,536 triangles, one of each, and room.
const DEEP: usize = 32;

/// The nearest point that was found, and which side of the surface a point is on there.
///
/// The side is that of the normals of all triangles that have the nearest point, each weighed by the angle that it fills about it (Baerentzen and Aanaes, 2005): at
/// a vertex no single triangle tells it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    squared: f64,
    /// Squared distances up to this are of interest: what is as near may seem as much farther.
    reach: f64,
    /// No triangle that was looked at is nearer, but for rounding.
    lower: f64,
    /// The nearest point.
    at: Option<Vector3<f64>>,
    /// From there to the point.
    way: Vector3<f64>,
    /// Sum of the weighed normals.
    normal: Vector3<f64>,
    /// Whether there are triangles that the point is before, and such that it is behind.
    sides: [bool; 2],
}

impl Spot {
    /// Nothing but what is nearer than `upper` is looked for.
    pub(crate) fn beyond(upper: f64) -> Self {
        let zero = Vector3::zeros();
        let squared = upper * upper;
        Spot { squared, reach: squared, lower: upper, at: None, way: zero, normal: zero, sides: [false; 2] }
    }

    /// The same search from its beginning, for nothing that is farther than what was found: no triangle counts twice.
    pub(crate) fn again(&self) -> Self {
        Spot { squared: self.reach, lower: self.lower, ..Spot::beyond(self.reach.sqrt()) }
    }

    /// How much nearer than what was found a triangle may be, where the formulas cannot tell.
    pub(crate) fn unsure(&self) -> f64 {
        (self.squared.sqrt() - self.lower).max(0.0)
    }

    /// Squared distances up to this are of interest.
    pub(crate) fn reach(&self) -> f64 {
        self.reach
    }

    /// Negative behind the surface.
    pub(crate) fn distance(&self) -> f64 {
        if self.normal.dot(&self.way) < 0.0 { -self.squared.sqrt() } else { self.squared.sqrt() }
    }

    /// Whether triangles that have the nearest point do not agree about the side.
    pub(crate) fn is_disputed(&self) -> bool {
        self.sides == [true; 2]
    }

    /// Answers whether the triangle is nearer than all before.
    pub(crate) fn take(&mut self, point: &Vector3<f64>, corners: &Corners) -> bool {
        let mut way = point - triangle::nearest_point(point, corners);
        let mut squared = way.norm_squared();
        let noise = SURE * (point.amax() + corners[0].amax());
        // What lies beyond the corners along the way, too, is no nearer than it seems.
        let nearest = corners.iter().map(|corner| way.dot(&(point - corner))).fold(f64::INFINITY, f64::min);
        if nearest.max(0.0).powi(2) < self.squared * squared {
            let away = squared.sqrt();
            let mut lower = nearest.max(0.0) / away;
            if away - lower > noise {
                let (careful, shortest) = triangle::distance_of_point(point, corners);
                lower = lower.max(careful);
                if shortest.norm_squared() < squared {
                    (way, squared) = (shortest, shortest.norm_squared());
                }
            }
            self.lower = self.lower.min(lower);
        }
        if squared > self.reach {
            return false;
        }
        let at = point - way;
        let is_there = self.at.is_some_and(|before| (before - at).amax() <= noise);
        let is_nearer = squared < self.squared;
        if is_nearer {
            if !is_there {
                (self.normal, self.sides) = (Vector3::zeros(), [false; 2]);
            }
            (self.squared, self.at, self.way) = (squared, Some(at), way);
            self.reach = (squared.sqrt() + noise).powi(2);
        }
        if is_nearer || is_there {
            let normal = triangle::facing(&at, corners, noise);
            self.normal += normal;
            let upright = normal.dot(&way);
            self.sides = [self.sides[0] || upright > 0.0, self.sides[1] || upright < 0.0];
        }
        is_nearer
    }
}

/// Relative width of an interval that needs no further work, and how far apart one point may come out in two triangles.
const SURE: f64 = 1e-13;

/// Whether to divide the first box (or the second); none where neither is divided.
fn further(x: &Node, y: &Node) -> Option<bool> {
    match (x.other > 0, y.other > 0) {
        (false, false) => None,
        (true, true) => Some(x.block().size() >= y.block().size()),
        (first, _) => Some(first),
    }
}

struct PatchSearch<'a> {
    a: &'a Patch,
    b: &'a Patch,
    between: &'a Between,
    slack: f64,
    /// Distance from which on nothing matters.
    upper: f64,
    lower: f64,
    near: Option<(Near, [u32; 2])>,
    /// From the second of the nearest points to the first.
    along: Vector3<f64>,
}

impl PatchSearch<'_> {
    /// Whether boxes that are so far apart have nothing to add; then they are not nearer than what is told.
    fn is_done(&mut self, away: f64) -> bool {
        let done = away >= self.upper - self.slack;
        if done {
            self.lower = self.lower.min(away);
        }
        done
    }

    fn descend(&mut self, a: usize, b: usize) {
        let (x, y) = (self.a.nodes()[a], self.b.nodes()[b]);
        let pairs = match further(&x, &y) {
            None => return self.compare(&x, &y),
            Some(true) => [(a + 1, b), (x.other as usize, b)],
            Some(false) => [(a, b + 1), (a, y.other as usize)],
        };
        let away = pairs.map(|(a, b)| {
            self.between.squared(&self.a.nodes()[a].block(), &self.b.nodes()[b].block()).sqrt()
        });
        // The nearer one first.
        let order = if away[1] < away[0] { [1, 0] } else { [0, 1] };
        for i in order {
            if !self.is_done(away[i]) {
                self.descend(pairs[i].0, pairs[i].1);
            }
        }
    }

    fn compare(&mut self, x: &Node, y: &Node) {
        let mut moved = [([Vector3::zeros(); 3], 0); FEW];
        for (slot, j) in moved.iter_mut().zip(y.triangles()) {
            *slot = self.b.moved(j, self.between);
        }
        for i in x.triangles() {
            let (t, place) = self.a.triangle(i);
            for (u, other) in &moved[..y.count as usize] {
                // Along the way of the nearest points so far, most are far enough apart.
                if self.is_done(triangle::apart_along(self.along, &t, u)) || self.is_done(boxes_apart(&t, u))
                {
                    continue;
                }
                let near = triangle::distance(&t, u);
                self.lower = self.lower.min(near.lower);
                if near.upper < self.upper {
                    self.upper = near.upper;
                    self.along = near.a - near.b;
                    self.near = Some((near, [place, *other]));
                }
            }
        }
    }
}

/// The distance of the boxes of two triangles.
fn boxes_apart(t: &Corners, u: &Corners) -> f64 {
    fn low(c: &Corners) -> Vector3<f64> {
        c[0].inf(&c[1]).inf(&c[2])
    }
    fn high(c: &Corners) -> Vector3<f64> {
        c[0].sup(&c[1]).sup(&c[2])
    }
    let away = (low(u) - high(t)).sup(&(low(t) - high(u)));
    away.map(|x| x.max(0.0)).norm()
}
