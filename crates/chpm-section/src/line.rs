//! Lines: pieces of all clusters, joined.

use crate::chain::{End, Link, chains};
use crate::pieces::{Piece, Pieces, SharedEdge};
use std::cmp::Ordering;

/// A line of a section.
#[derive(Clone, PartialEq, Debug)]
pub struct Line {
    /// Relative to the file's origin; each differs from the one before, and where it is closed the last from the first. The outermost closed lines turn
    /// left for whoever looks against the normal, those in them right, and so on.
    pub points: Vec<[f64; 3]>,
    /// Whether the last point is joined to the first.
    pub is_closed: bool,
    /// Length.
    pub length: f64,
    /// Area that it encloses, whatever lies in it; 0 where it is open.
    pub area: f64,
    /// How many closed lines it lies in, if it is closed; where it crosses any, one of its points.
    pub depth: u32,
    /// The innermost of them.
    pub parent: Option<u32>,
    /// Whether it is closed and crosses another closed one, as those of solids do that overlap.
    pub crosses: bool,
}

/// A piece with the points that it is of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part<'a> {
    points: &'a [[f64; 3]],
    ends: [Option<SharedEdge>; 2],
    is_closed: bool,
}

impl<'a> Part<'a> {
    pub(crate) fn new(of: &'a Pieces, piece: &Piece) -> Self {
        Part { points: &of.points[piece.points.clone()], ends: piece.ends, is_closed: piece.is_closed }
    }

    /// The points from an end on.
    fn from(&self, side: usize) -> impl Iterator<Item = &'a [f64; 3]> {
        let last = self.points.len() - 1;
        let points = self.points;
        (0..points.len()).map(move |i| &points[if side == 0 { i } else { last - i }])
    }
}

/// Joins the pieces of one plane, in an order of lines and points that hangs on where they are alone. What is a single point is left out.
pub(crate) fn joined(parts: &[Part<'_>]) -> Vec<Line> {
    let (whole, open): (Vec<Part<'_>>, Vec<Part<'_>>) = parts.iter().partition(|part| part.is_closed);
    let mut lines: Vec<Line> =
        whole.iter().filter_map(|part| Line::new(part.points.to_vec(), true)).collect();

    let ends: Vec<_> = open.iter().map(|part| part.ends).collect();
    let compare = |(a, i): End, (b, j): End| {
        let by_place = open[a].from(i).partial_cmp(open[b].from(j)).unwrap_or(Ordering::Equal);
        by_place.then_with(|| open[a].ends[1 - i].cmp(&open[b].ends[1 - j]))
    };
    chains(
        &ends,
        |_| false,
        compare,
        |chain, is_closed| {
            let mut points: Vec<[f64; 3]> = Vec::new();
            for Link { index, is_turned } in chain {
                for point in open[*index].from(usize::from(*is_turned)) {
                    if points.last() != Some(point) {
                        points.push(*point);
                    }
                }
            }
            lines.extend(Line::new(points, is_closed));
        },
    );
    lines.sort_by(|a, b| order(&a.points, &b.points));
    lines
}

fn order<T: PartialOrd + ?Sized>(a: &T, b: &T) -> Ordering {
    a.partial_cmp(b).unwrap_or(Ordering::Equal)
}

impl Line {
    fn new(mut points: Vec<[f64; 3]>, is_closed: bool) -> Option<Self> {
        if is_closed && points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        if points.len() < 2 {
            return None;
        }
        settle(&mut points, is_closed);
        let mut line =
            Line { points, is_closed, length: 0.0, area: 0.0, depth: 0, parent: None, crosses: false };
        line.length = line.segments().map(|[a, b]| distance(a, b)).sum();
        Some(line)
    }

    /// Its segments, from point to point.
    pub fn segments(&self) -> impl Iterator<Item = [[f64; 3]; 2]> + '_ {
        let last = self.is_closed.then(|| [*self.points.last().unwrap_or(&[0.0; 3]), self.points[0]]);
        self.points.windows(2).map(|pair| [pair[0], pair[1]]).chain(last)
    }
}

/// Begins at the first point in space, of an open line at the first of its ends, and goes to the first of its neighbours.
fn settle(points: &mut [[f64; 3]], is_closed: bool) {
    let n = points.len();
    if !is_closed {
        if order(&points[n - 1], &points[0]).is_lt() {
            points.reverse();
        }
        return;
    }
    fn beside(points: &[[f64; 3]], i: usize) -> [[f64; 3]; 3] {
        let n = points.len();
        let [before, after] = [points[(i + n - 1) % n], points[(i + 1) % n]];
        let [a, b] = if order(&before, &after).is_lt() { [before, after] } else { [after, before] };
        [points[i], a, b]
    }
    let first = (0..n).min_by(|i, j| order(&beside(points, *i), &beside(points, *j))).unwrap_or(0);
    points.rotate_left(first);
    if order(&points[n - 1], &points[1]).is_lt() {
        points[1..].reverse();
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]) * (a[axis] - b[axis])).sum::<f64>().sqrt()
}
