//! Which closed lines of a plane cross each other. Signs are exact. Lines that touch, along whatever of them, do not cross where each stays on its side of the other.

use robust::{Coord, orient2d};

type Point = [f64; 2];

/// Whether each ring, of points in the plane, crosses another one.
pub(crate) fn crossing(rings: &[&[Point]]) -> Vec<bool> {
    let mut crosses = vec![false; rings.len()];
    if rings.len() > 1 {
        let all = (0..)
            .zip(rings)
            .flat_map(|(ring, points)| (0..points.len() as u32).map(move |start| Segment { ring, start }));
        look(rings, &all.collect::<Vec<_>>(), &mut crosses);
    }
    crosses
}

/// Segments in a cell from which on it is divided, if they are fewer than half of all.
const MANY: usize = 64;

fn look(rings: &[&[Point]], segments: &[Segment], crosses: &mut [bool]) {
    let Some(grid) = Grid::of(rings, segments) else { return };
    let mut entries = Vec::with_capacity(3 * segments.len());
    for segment in segments {
        grid.cells(segment.ends(rings), |cell| entries.push((cell, *segment)));
    }
    entries.sort_unstable();
    for cell in entries.chunk_by(|a, b| a.0 == b.0) {
        if cell.len() > MANY && 2 * cell.len() < segments.len() {
            let inside: Vec<Segment> = cell.iter().map(|(_, segment)| *segment).collect();
            look(rings, &inside, crosses);
            continue;
        }
        // Segments of a ring are one after the other.
        let mut rest = cell;
        while let Some((_, first)) = rest.first() {
            let own = rest.partition_point(|(_, segment)| segment.ring == first.ring);
            let (these, others) = rest.split_at(own);
            for ((_, a), (_, b)) in these.iter().flat_map(|a| others.iter().map(move |b| (a, b))) {
                let [i, j] = [a.ring as usize, b.ring as usize];
                if !(crosses[i] && crosses[j]) && cross(rings, *a, *b) {
                    (crosses[i], crosses[j]) = (true, true);
                }
            }
            rest = others;
        }
    }
}

/// The segment from a point of a ring to the next one.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct Segment {
    ring: u32,
    start: u32,
}

impl Segment {
    fn ends(self, rings: &[&[Point]]) -> [Point; 2] {
        let points = rings[self.ring as usize];
        let start = self.start as usize;
        [points[start], points[(start + 1) % points.len()]]
    }
}

/// Square cells, about as many as there are segments: those that cross have one in common.
struct Grid {
    low: Point,
    /// Cells to a unit.
    scale: f64,
    columns: u32,
}

/// Cells by which a segment reaches farther than it is, since where it passes is rounded.
const SLACK: f64 = 1e-3;

impl Grid {
    /// None of segments that are all in one point.
    fn of(rings: &[&[Point]], segments: &[Segment]) -> Option<Grid> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut length = 0.0;
        for [a, b] in segments.iter().map(|segment| segment.ends(rings)) {
            low = [low[0].min(a[0]).min(b[0]), low[1].min(a[1]).min(b[1])];
            high = [high[0].max(a[0]).max(b[0]), high[1].max(a[1]).max(b[1])];
            length += (b[0] - a[0]).abs().max((b[1] - a[1]).abs());
        }
        let count = segments.len() as f64;
        let [width, height] = [high[0] - low[0], high[1] - low[1]];
        // No shorter than segments are in the mean, and no more of them than 32 bits number.
        let cell = (length / count).max((width * height / count).sqrt()).max(width.max(height) / 32768.0);
        (cell > 0.0 && cell.is_finite()).then(|| Grid {
            low,
            scale: 1.0 / cell,
            columns: (width / cell) as u32 + 3,
        })
    }

    /// Each cell that a segment passes.
    fn cells(&self, ends: [Point; 2], mut each: impl FnMut(u32)) {
        let at = ends.map(|[x, y]| [self.scale * (x - self.low[0]), self.scale * (y - self.low[1])]);
        let [[x, y], [to_x, to_y]] = if at[0][1] <= at[1][1] { at } else { [at[1], at[0]] };
        let slope = (to_x - x) / (to_y - y);
        for row in place(y - SLACK)..=place(to_y + SLACK) {
            let [from, to] = [f64::from(row) - 1.0 - SLACK, f64::from(row) + SLACK]
                .map(|edge| if to_y > y { x + slope * (edge.clamp(y, to_y) - y) } else { x });
            let [from, to] = if to_y > y { [from, to] } else { [x, to_x] };
            for column in place(from.min(to) - SLACK)..=place(from.max(to) + SLACK) {
                each(row * self.columns + column);
            }
        }
    }
}

/// The row or column of something; there is one before the first.
fn place(at: f64) -> u32 {
    (at + 1.0).floor() as u32
}

/// Positive where a point is on the left of a way.
fn side(from: Point, to: Point, point: Point) -> f64 {
    let [from, to, point] = [from, to, point].map(|[x, y]| Coord { x, y });
    orient2d(from, to, point)
}

/// Whether a point on the line of a segment is on it, its ends included.
fn is_between([a, b]: [Point; 2], point: Point) -> bool {
    (0..2).all(|axis| a[axis].min(b[axis]) <= point[axis] && point[axis] <= a[axis].max(b[axis]))
}

/// Whether two segments of different rings cross, or these do where they touch or from there on.
fn cross(rings: &[&[Point]], a: Segment, b: Segment) -> bool {
    let ([p, q], [r, s]) = (a.ends(rings), b.ends(rings));
    let is_apart = |axis: usize| {
        p[axis].max(q[axis]) < r[axis].min(s[axis]) || r[axis].max(s[axis]) < p[axis].min(q[axis])
    };
    if is_apart(0) || is_apart(1) {
        return false;
    }
    let ends = [side(r, s, p), side(r, s, q), side(p, q, r), side(p, q, s)];
    if ends.iter().all(|end| *end != 0.0) {
        return (ends[0] > 0.0) != (ends[1] > 0.0) && (ends[2] > 0.0) != (ends[3] > 0.0);
    }
    // Each point where a ring begins a segment is looked at once.
    let of = |segment: Segment| Way { points: rings[segment.ring as usize], segment: segment.start as usize };
    let (a, b) = (of(a), of(b));
    let a_is_on = ends[0] == 0.0 && p != s && is_between([r, s], p);
    let b_is_on = ends[2] == 0.0 && r != p && r != q && is_between([p, q], r);
    (a_is_on && a.passes(b, p)) || (b_is_on && a.passes(b, r))
}

/// A ring that is at a point of a segment, which may be the segment's first, and is not its last.
#[derive(Clone, Copy)]
struct Way<'a> {
    points: &'a [Point],
    segment: usize,
}

/// Where a direction leads beside a way through a point.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Beside {
    Left,
    Right,
    Ahead,
    Back,
}

impl<'a> Way<'a> {
    /// The points before and behind a point of the segment.
    fn around(self, at: Point) -> [Point; 2] {
        let count = self.points.len();
        let begins = self.points[self.segment] == at;
        let before = if begins { (self.segment + count - 1) % count } else { self.segment };
        [self.points[before], self.points[(self.segment + 1) % count]]
    }

    /// Whether another ring changes sides here. One that goes along this one for a while is looked at where that begins.
    fn passes(self, other: Way<'_>, at: Point) -> bool {
        let [before, behind] = self.around(at);
        let [from, to] = other.around(at);
        let Some(start) = beside([before, at, behind], from).and_then(Beside::side) else { return false };
        let Some(next) = beside([before, at, behind], to) else { return false };
        let end = match next {
            Beside::Ahead => other.leaves(self.points_from(at, true), at, true),
            Beside::Back => other.leaves(self.points_from(at, false), at, false),
            next => next.side(),
        };
        end.is_some_and(|end| end != start)
    }

    /// The points that follow, or that come before, once around.
    fn points_from(self, at: Point, is_ahead: bool) -> impl Iterator<Item = Point> + use<'a> {
        let (points, count) = (self.points, self.points.len());
        let begins = usize::from(points[self.segment] == at);
        let first = if is_ahead { self.segment + 1 } else { self.segment + count - begins };
        (0..count).map(move |step| points[if is_ahead { first + step } else { first + count - step } % count])
    }

    /// The side, with its own direction, of a way on which this ring leaves it, that goes along it from a point on; none if it never does.
    fn leaves(self, way: impl Iterator<Item = Point>, at: Point, is_ahead: bool) -> Option<bool> {
        let mut own = self.points_from(at, true).peekable();
        let mut way = way.peekable();
        let mut at = at;
        while let (Some(next), Some(goal)) = (own.peek().copied(), way.peek().copied()) {
            // Both are in one direction from here: to the nearer of them.
            let before = at;
            at = if is_between([at, goal], next) { next } else { goal };
            own.next_if(|point| *point == at);
            way.next_if(|point| *point == at);
            match beside([before, at, *way.peek()?], *own.peek()?)? {
                Beside::Ahead => {}
                found => return found.side().map(|is_left| is_left == is_ahead),
            }
        }
        None
    }
}

impl Beside {
    /// Whether it is on the left.
    fn side(self) -> Option<bool> {
        match self {
            Beside::Left => Some(true),
            Beside::Right => Some(false),
            _ => None,
        }
    }
}

/// Where a point leads beside a way of three points, as seen from the middle one; none where the way turns back on itself, and has no sides.
fn beside([before, at, behind]: [Point; 3], point: Point) -> Option<Beside> {
    let is_same = |a: Point, b: Point| {
        side(at, a, b) == 0.0 && (0..2).all(|axis| (a[axis] - at[axis]) * (b[axis] - at[axis]) >= 0.0)
    };
    if is_same(before, behind) {
        return None;
    }
    if is_same(behind, point) {
        return Some(Beside::Ahead);
    }
    if is_same(before, point) {
        return Some(Beside::Back);
    }
    let [of_first, of_second] = [side(before, at, point) > 0.0, side(at, behind, point) > 0.0];
    let is_left = if side(before, at, behind) >= 0.0 { of_first && of_second } else { of_first || of_second };
    Some(if is_left { Beside::Left } else { Beside::Right })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxed(low: Point, high: Point) -> Vec<Point> {
        // With points in the middle of sides, as triangulated faces have them.
        let middle = [low[0].midpoint(high[0]), low[1].midpoint(high[1])];
        let [[x, y], [to_x, to_y], [mid_x, mid_y]] = [low, high, middle];
        vec![[x, y], [mid_x, y], [to_x, y], [to_x, mid_y], [to_x, to_y], [mid_x, to_y], [x, to_y], [x, mid_y]]
    }

    /// Whichever way each of two is turned, wherever it begins, and whichever comes first.
    fn told(a: &[Point], b: &[Point]) -> bool {
        let mut found = Vec::new();
        for turn in 0..a.len() * b.len() * 8 {
            let [mut a, mut b] = [a.to_vec(), b.to_vec()];
            let begin = turn / 8 % a.len();
            b.rotate_left(turn / 8 / a.len());
            a.rotate_left(begin);
            if turn & 1 == 1 {
                a.reverse();
            }
            if turn & 2 == 2 {
                b.reverse();
            }
            let both = if turn & 4 == 4 { [&b[..], &a[..]] } else { [&a[..], &b[..]] };
            let crosses = crossing(&both);
            assert_eq!(crosses[0], crosses[1]);
            found.push(crosses[0]);
        }
        assert!(found.windows(2).all(|pair| pair[0] == pair[1]), "{a:?} {b:?}");
        found[0]
    }

    #[test]
    fn boxes_that_overlap_cross() {
        let unit = boxed([0.0, 0.0], [1.0, 1.0]);
        for x in [0.3, 0.5, 0.7, 0.9, -0.35] {
            assert!(told(&unit, &boxed([x, 0.11], [x + 0.9, 1.01])), "{x}");
        }
        // Along two sides, and through points alone.
        assert!(told(&unit, &boxed([0.5, 0.0], [1.5, 1.0])));
        assert!(told(&unit, &boxed([0.25, 0.0], [0.75, 2.0])));
        assert!(told(&unit, &boxed([-0.5, 0.25], [0.5, 0.75])));
        assert!(told(&unit, &[[0.5, 0.0], [1.0, 0.5], [2.0, -2.0]]));
        assert!(told(&unit, &[[0.0, 0.0], [1.0, 1.0], [3.0, 0.0]]));
    }

    #[test]
    fn rings_that_touch_do_not_cross() {
        let unit = boxed([0.0, 0.0], [1.0, 1.0]);
        for (low, high) in [
            // The same one, beside it along a side, a part of one or in a corner, apart, in it along none to all sides, around it.
            ([0.0, 0.0], [1.0, 1.0]),
            ([1.0, 0.0], [2.0, 1.0]),
            ([1.0, 0.25], [1.5, 0.75]),
            ([-1.0, 0.3], [0.0, 1.7]),
            ([1.0, 1.0], [2.0, 2.0]),
            ([1.5, 0.0], [2.0, 1.0]),
            ([0.25, 0.25], [0.75, 0.75]),
            ([0.0, 0.25], [0.75, 0.75]),
            ([0.5, 0.0], [1.0, 1.0]),
            ([0.0, 0.2], [1.0, 0.6]),
            ([-1.0, -1.0], [2.0, 2.0]),
        ] {
            assert!(!told(&unit, &boxed(low, high)), "{low:?} {high:?}");
        }
        // By a point on a side, from within and from outside.
        assert!(!told(&unit, &[[0.5, 0.0], [0.75, 0.5], [0.25, 0.5]]));
        assert!(!told(&unit, &[[0.25, 0.0], [0.75, -0.5], [0.1, -0.5]]));
        assert!(!told(&unit, &[[0.5, 0.0], [1.0, 0.5], [0.5, 1.0], [0.0, 0.5]]));
    }

    /// Rings with many segments, long and short ones, beside all pairs of segments.
    #[test]
    fn the_grid_finds_what_all_pairs_have() {
        let mut seed = 7_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 40) as f64 / f64::from(1 << 24)
        };
        let mut some = [0; 2];
        for _ in 0..300 {
            let rings: Vec<Vec<Point>> = (0..6)
                .map(|_| {
                    let (x, y, size) = (3.0 * random(), 3.0 * random(), 0.05 + 0.6 * random() * random());
                    let (low, high) = ([x, y], [x + size, y + size * (0.02 + random())]);
                    let mut ring = boxed(low, high);
                    // One side in many steps.
                    let steps = (40.0 * random()) as u32;
                    ring.splice(
                        2..2,
                        (1..steps)
                            .map(|step| {
                                let [from, to] = [ring[1], ring[2]];
                                let share = f64::from(step) / f64::from(steps);
                                [from[0] + share * (to[0] - from[0]), from[1] - 0.01 * size * random()]
                            })
                            .collect::<Vec<_>>(),
                    );
                    ring
                })
                .collect();
            let rings: Vec<&[Point]> = rings.iter().map(Vec::as_slice).collect();
            let mut expected = vec![false; rings.len()];
            for i in 0..rings.len() {
                for j in 0..i {
                    let all = |ring: usize| {
                        (0..rings[ring].len() as u32).map(move |start| Segment { ring: ring as u32, start })
                    };
                    if all(i).any(|a| all(j).any(|b| cross(&rings, a, b))) {
                        (expected[i], expected[j]) = (true, true);
                    }
                }
            }
            expected.iter().for_each(|crosses| some[usize::from(*crosses)] += 1);
            assert_eq!(crossing(&rings), expected);
        }
        assert!(some.iter().all(|count| *count > 100), "{some:?}");
    }
}
