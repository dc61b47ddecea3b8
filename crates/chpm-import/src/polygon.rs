//! Polygons, and the triangles that they are cut into.

use earcut::Earcut;

/// Corners at which a fan is tried before the polygon is cut ear by ear.
const APEXES: usize = 8;

/// Polygons of any number of corners, one after the other: each is the number of its corners, then these.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Polygons(Vec<u32>);

impl Polygons {
    /// Appends a polygon.
    pub fn push(&mut self, corners: &[u32]) {
        self.0.push(corners.len() as u32);
        self.0.extend_from_slice(corners);
    }

    /// The polygons in their order.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        each(&self.0)
    }

    /// All numbers, as they lie: what [`each`] takes apart.
    pub fn as_words(&self) -> &[u32] {
        &self.0
    }

    /// All corners of all polygons, to be renumbered.
    pub fn corners_mut(&mut self) -> impl Iterator<Item = &mut u32> {
        let (mut words, mut left) = (self.0.iter_mut(), 0);
        std::iter::from_fn(move || {
            while left == 0 {
                left = *words.next()?;
            }
            left -= 1;
            words.next()
        })
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Drops all of them.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

/// The polygons at the beginning of `words` that are whole.
pub fn each(mut words: &[u32]) -> impl Iterator<Item = &[u32]> {
    std::iter::from_fn(move || {
        let (count, rest) = words.split_first()?;
        let corners = rest.get(..*count as usize)?;
        words = &rest[corners.len()..];
        Some(corners)
    })
}

/// Cuts polygons into triangles; keeps its scratch from one to the next.
///
/// A polygon is looked at along the axis that its area vector (Newell) is steepest to. If all triangles of the fan about
/// its first corner, or about one of the next few, turn the polygon's way, that fan is taken: so it is with all that are
/// convex. Others are cut ear by ear. A simple polygon of n corners becomes n - 2 triangles, and any polygon triangles that
/// have its sides as their border: corners that lie on a straight line are no exception, since a
/// neighbour may use them too. More corners than
/// [`Self::EARS`] become the fan about the first, whatever their shape.
#[derive(Default)]
pub struct Triangulator {
    earcut: Earcut<f64>,
    /// Corners without those that follow themselves: vertex, and position in the plane.
    ring: Vec<u32>,
    plane: Vec<[f64; 2]>,
    ears: Vec<u32>,
    /// Sides of the polygon that no triangle has yet, from and to.
    open: Vec<[u32; 2]>,
    /// For each corner, the first of the open sides from it that was not walked along.
    begins: Vec<usize>,
    walk: Vec<u32>,
}

impl Triangulator {
    /// Corners of a polygon that is cut ear by ear, at most: the time for it can grow with their square.
    pub const EARS: usize = 1 << 14;

    /// Appends the triangles of a polygon. `positions` are those of its corners, one for each; they are not looked at where
    /// there are more than [`Self::EARS`]. Triangles with two corners in
    /// one vertex are left out; the number of triangles that is missing to `corners.len() - 2` is returned.
    pub fn cut(&mut self, corners: &[u32], positions: &[[f64; 3]], triangles: &mut Vec<[u32; 3]>) -> u64 {
        let before = triangles.len();
        if corners.len() > Self::EARS {
            corners.windows(2).skip(1).for_each(|side| push(triangles, [corners[0], side[0], side[1]]));
            return (corners.len() - 2 - (triangles.len() - before)) as u64;
        }

        self.flatten(corners, positions);
        let count = self.ring.len();

        if let Some(apex) = (0..count.min(APEXES)).find(|apex| self.is_fan(*apex)) {
            (1..count.saturating_sub(1)).for_each(|i| {
                let at = |i: usize| self.ring[(apex + i) % count];
                push(triangles, [at(0), at(i), at(i + 1)]);
            });
        } else {
            self.cut_ears();
            for ear in self.ears.chunks_exact(3) {
                push(triangles, [ear[0], ear[1], ear[2]].map(|i| self.ring[i as usize]));
            }
            self.fill(triangles);
        }

        corners.len().saturating_sub(2 + triangles.len() - before) as u64
    }

    /// Lays the corners into the plane in which the polygon runs counterclockwise.
    fn flatten(&mut self, corners: &[u32], positions: &[[f64; 3]]) {
        self.ring.clear();
        self.plane.clear();
        let origin = positions.first().copied().unwrap_or_default();
        fn local(p: [f64; 3], origin: &[f64; 3]) -> [f64; 3] {
            std::array::from_fn(|axis| p[axis] - origin[axis])
        }

        let mut area = [0.0f64; 3];
        for (p, q) in positions.iter().zip(positions.iter().cycle().skip(1)) {
            let (p, q) = (local(*p, &origin), local(*q, &origin));
            for (axis, sum) in area.iter_mut().enumerate() {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                *sum += p[u] * q[v] - p[v] * q[u];
            }
        }

        let axis = (0..3).fold(0, |best, axis| if area[axis].abs() > area[best].abs() { axis } else { best });
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let sign = if area[axis] < 0.0 { -1.0 } else { 1.0 };

        for (at, (corner, position)) in corners.iter().zip(positions).enumerate() {
            if *corner != corners[(at + 1) % corners.len()] {
                let p = local(*position, &origin);
                self.ring.push(*corner);
                self.plane.push([sign * p[u], p[v]]);
            }
        }
    }

    /// Whether all triangles of the fan about a corner have area on the polygon's side.
    fn is_fan(&self, apex: usize) -> bool {
        let count = self.ring.len();
        let at = |i: usize| self.plane[(apex + i) % count];
        (1..count.saturating_sub(1)).all(|i| twice_area(at(0), at(i), at(i + 1)) > 0.0)
    }

    fn cut_ears(&mut self) {
        self.earcut.earcut_slice(&self.plane, &[], &mut self.ears);
        // Of three corners of a simple polygon, the order of the polygon is its sense.
        self.ears.chunks_exact_mut(3).for_each(<[u32]>::sort_unstable);
    }

    /// Ears leave out corners on straight lines, and all that is no simple polygon: closes what is open between them and the
    /// polygon's sides, by fans that have no area on straight lines.
    fn fill(&mut self, triangles: &mut Vec<[u32; 3]>) {
        let count = self.ring.len() as u32;
        self.open.clear();
        self.open.extend((0..count).map(|i| [i, (i + 1) % count]));
        for ear in self.ears.chunks_exact(3) {
            self.open.extend([[ear[1], ear[0]], [ear[2], ear[1]], [ear[0], ear[2]]]);
        }
        cancel(&mut self.open);
        self.open.sort_unstable();
        self.begins.clear();
        self.begins.extend((0..count).map(|i| self.open.partition_point(|side| side[0] < i)));
        // As many sides begin at a corner as end there, so that walks along them return.
        for start in 0..self.open.len() {
            let [first, _] = self.open[start];
            if self.begins[first as usize] > start {
                continue;
            }
            self.walk.clear();
            let mut at = first;
            loop {
                self.walk.push(at);
                let side = &mut self.begins[at as usize];
                at = self.open[*side][1];
                *side += 1;
                if at == first {
                    break;
                }
            }
            for side in self.walk.windows(2).skip(1) {
                push(triangles, [self.walk[0], side[0], side[1]].map(|i| self.ring[i as usize]));
            }
        }
    }
}

/// Removes sides that are there in both senses.
fn cancel(sides: &mut Vec<[u32; 2]>) {
    fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
        [a.min(b), a.max(b)]
    }
    sides.sort_unstable_by_key(|side| (sorted(*side), side[0]));
    let mut kept = 0;
    let mut at = 0;
    while at < sides.len() {
        let same = sides[at..].iter().take_while(|side| sorted(**side) == sorted(sides[at])).count();
        let up = sides[at..at + same].iter().filter(|[a, b]| a < b).count();
        let [low, high] = sorted(sides[at]);
        let (surplus, side) =
            if 2 * up > same { (2 * up - same, [low, high]) } else { (same - 2 * up, [high, low]) };
        sides[kept..kept + surplus].fill(side);
        kept += surplus;
        at += same;
    }
    sides.truncate(kept);
}

fn push(triangles: &mut Vec<[u32; 3]>, [a, b, c]: [u32; 3]) {
    if a != b && b != c && c != a {
        triangles.push([a, b, c]);
    }
}

fn twice_area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The triangles of a polygon in the plane z = 0 that is then turned so that it lies askew.
    fn cut(points: &[[f64; 2]]) -> Vec<[u32; 3]> {
        let positions: Vec<[f64; 3]> = points.iter().map(|[x, y]| [*x, *y, 0.5 * x - 0.25 * y]).collect();
        let corners: Vec<u32> = (0..points.len() as u32).collect();
        let mut triangles = Vec::new();
        let missing = Triangulator::default().cut(&corners, &positions, &mut triangles);
        assert!(missing as usize + triangles.len() >= points.len() - 2);
        triangles
    }

    /// Areas of the triangles; their sum must be the polygon's, which needs all of them on one side and none twice.
    fn assert_tiles(points: &[[f64; 2]], triangles: &[[u32; 3]]) {
        let total: f64 = (1..points.len() - 1).map(|i| twice_area(points[0], points[i], points[i + 1])).sum();
        let areas = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| points[i as usize]);
            twice_area(a, b, c) * total.signum()
        });
        let areas: Vec<f64> = areas.collect();
        assert!(areas.iter().all(|area| *area >= 0.0), "{triangles:?}: {areas:?}");
        assert!((areas.iter().sum::<f64>() - total.abs()).abs() <= 1e-12 * total.abs(), "{triangles:?}");
    }

    /// The border of the triangles is the polygon.
    fn assert_closed(count: usize, triangles: &[[u32; 3]]) {
        let mut sides: Vec<[u32; 2]> =
            triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect();
        cancel(&mut sides);
        sides.sort_unstable();
        let count = count as u32;
        assert_eq!(sides, (0..count).map(|i| [i, (i + 1) % count]).collect::<Vec<_>>());
    }

    #[test]
    fn convex_polygons_are_fans_about_their_first_corner() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        assert_eq!(cut(&square), [[0, 1, 2], [0, 2, 3]]);
        let hexagon: Vec<[f64; 2]> =
            (0..6).map(f64::from).map(|angle: f64| [angle.cos(), angle.sin()]).collect();
        assert_eq!(cut(&hexagon), [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]);
    }

    #[test]
    fn concave_polygons_are_tiled_in_either_sense() {
        let arrow = vec![[0.0, 0.0], [4.0, -2.0], [1.0, 0.0], [4.0, 2.0]];
        let comb: Vec<[f64; 2]> = (0..40)
            .map(|i| [f64::from(i), if i % 2 == 0 { 0.0 } else { 5.0 }])
            .chain([[39.0, 9.0], [0.0, 9.0]])
            .collect();
        let spiral: Vec<[f64; 2]> = (0..60)
            .map(|i| (f64::from(i) * 0.3, 1.0 + f64::from(i) * 0.2))
            .chain((0..60).rev().map(|i| (f64::from(i) * 0.3, 1.5 + f64::from(i) * 0.2)))
            .map(|(angle, radius)| [radius * angle.cos(), radius * angle.sin()])
            .collect();

        let step = vec![
            [0.0, 0.0],
            [1.0, 0.0],
            [2.0, 0.0],
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [0.0, 2.0],
            [0.0, 1.0],
        ];

        for mut points in [arrow, comb, spiral, step] {
            for _ in 0..2 {
                for first in 0..points.len() {
                    points.rotate_left(1);
                    let triangles = cut(&points);
                    assert_tiles(&points, &triangles);
                    assert_closed(points.len(), &triangles);
                    assert_eq!(triangles.len(), points.len() - 2, "from {first}");
                }
                points.reverse();
            }
        }
    }

    #[test]
    fn corners_on_straight_lines_keep_their_sides() {
        // A frame with a keyhole cut, and many corners on each straight side.
        let mut points = Vec::new();
        let ring = |size: f64, points: &mut Vec<[f64; 2]>, sense: f64| {
            for [from, to] in [
                [[-1.0, -1.0], [1.0, -1.0]],
                [[1.0, -1.0], [1.0, 1.0]],
                [[1.0, 1.0], [-1.0, 1.0]],
                [[-1.0, 1.0], [-1.0, -1.0]],
            ] {
                points.extend((0..4).map(|i| {
                    let s = f64::from(i) / 4.0;
                    let [x, y]: [f64; 2] =
                        std::array::from_fn(|axis| from[axis] + s * (to[axis] - from[axis]));
                    [size * x, size * sense * y]
                }));
            }
            points.push([-size, -size * sense]);
        };
        ring(2.0, &mut points, 1.0);
        ring(1.0, &mut points, -1.0);
        let triangles = cut(&points);
        assert_eq!(triangles.len(), points.len() - 2);
        assert_tiles(&points, &triangles);
        assert_closed(points.len(), &triangles);
    }

    #[test]
    fn what_is_no_simple_polygon_is_closed_all_the_same() {
        let bow_tie = vec![[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        let star: Vec<[f64; 2]> =
            (0..5).map(|i| f64::from(i) * 0.8 * std::f64::consts::PI).map(|a| [a.cos(), a.sin()]).collect();
        let line: Vec<[f64; 2]> = (0..7).map(|i| [f64::from(i), 0.0]).collect();
        let point = vec![[1.0, 1.0]; 6];
        let nowhere = vec![[f64::MAX, 0.0], [-f64::MAX, 1.0], [f64::MAX, f64::MAX], [1.0, 1.0], [0.0, 0.0]];
        for points in [bow_tie, star, line, point, nowhere] {
            let triangles = cut(&points);
            assert_closed(points.len(), &triangles);
        }
    }

    #[test]
    fn a_corner_that_follows_itself_makes_no_triangle() {
        let positions = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0; 3]];
        let mut triangles = Vec::new();
        let missing = Triangulator::default().cut(&[7, 8, 8, 9, 7], &positions, &mut triangles);
        assert_eq!((missing, &triangles[..]), (2, &[[7, 8, 9]][..]));
        assert_eq!(Triangulator::default().cut(&[3, 3, 3, 3], &[[0.0; 3]; 4], &mut triangles), 2);
        assert_eq!(Triangulator::default().cut(&[3, 4], &[[0.0; 3]; 2], &mut triangles), 0);
    }

    #[test]
    fn lists_of_polygons_are_read_as_they_were_written() {
        let mut polygons = Polygons::default();
        polygons.push(&[1, 2, 3, 4]);
        polygons.push(&[5, 6, 7, 8, 9]);
        polygons.corners_mut().for_each(|corner| *corner += 10);
        assert_eq!(polygons.iter().collect::<Vec<_>>(), [&[11, 12, 13, 14][..], &[15, 16, 17, 18, 19]]);
        let words = polygons.as_words();
        assert_eq!(each(&words[..words.len() - 1]).count(), 1, "one of them is not whole");
    }
}
