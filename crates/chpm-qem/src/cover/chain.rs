//! How far a face is from triangles that lie over it as a sheet.
//!
//! All are projected onto the face's plane. The number of triangles over a point, odd or even, changes only where one of their outer edges is crossed: edges that an odd number
//! of them have. So where no outer edge passes over the face, and the number is odd over one of its points, a triangle is over each of them, no farther
//! away than the triangles rise from the plane there. That is so for any of the triangles: those that edges over the face join are taken together, as one sheet of perhaps many.

use super::islands::top;
use super::reference::Reference;
use chpm_mesh::geom::to_f64;
use nalgebra::{Point3, Vector3};

/// The face is taken smaller by this share, about its middle: so that what meets it along its edges alone does not count as over it.
const SHRUNK: f64 = 1.0 / 1024.0;

/// Where triangles are counted, as weights of the corners: at the second place if an edge is too close to the first.
const PLACES: [[f64; 3]; 2] = [[0.37, 0.34, 0.29], [0.28, 0.31, 0.41]];

/// Triangles whose corners are all farther from the plane than this many times what is allowed, on one side, are of another sheet.
const AWAY: f64 = 4.0;

/// A corner over the face: how far inside of each edge, and how high.
type Over = [f64; 4];
const HEIGHT: usize = 3;

/// One of a cut triangle: where it is, too.
type Cut = [f64; 7];

/// Share of what is added up in an orientation that rounding can hide, with room.
const DOUBT: f64 = 1.0 / (1u64 << 48) as f64;

/// An edge of the reference, for the face for which it was met last.
#[derive(Clone, Copy, Debug, Default)]
struct Met {
    turn: u32,
    /// The first of the triangles that have it.
    first: u32,
    is_odd: bool,
    is_beside: bool,
}

/// Triangles that edges over the face join.
#[derive(Clone, Copy, Debug, Default)]
struct Sheet {
    /// Whether an outer edge passes over the face.
    is_torn: bool,
    /// Whether an odd number of them is over a place, and whether that is in doubt.
    is_odd: bool,
    is_doubtful: bool,
    highest: f64,
}

impl Sheet {
    fn is_over_all(&self) -> bool {
        self.is_odd && !self.is_doubtful && !self.is_torn
    }
}

/// Scratch for one face after another.
#[derive(Debug, Default)]
pub(crate) struct Chain {
    over: Vec<[Over; 3]>,
    /// Which triangles of the reference these are.
    triangles: Vec<u32>,
    /// Per triangle another before it that it is joined with, or itself; and the sheet that they are of.
    above: Vec<u32>,
    of: Vec<u32>,
    sheets: Vec<Sheet>,
    /// Parts of the face over which triangles are too high, which may be near others.
    pub(crate) steep: Vec<[Point3<f64>; 3]>,
    /// Per point and edge of a reference, what was found for the face of a turn.
    points: Vec<(u32, Over)>,
    met: Vec<Met>,
    turn: u32,
    polygon: Vec<Cut>,
    before: Vec<Cut>,
}

/// The face's plane, and its edges in it, as axes along which corners are measured.
struct Frame {
    origin: Point3<f64>,
    inward: [Vector3<f64>; 3],
    /// Where the smaller face's edges are along the axes.
    margins: [f64; 3],
    normal: Vector3<f64>,
    /// How far a point of the face is from the smaller one.
    beyond: f64,
    /// How many times more rounding moves what is measured by these axes: the thinner the face, the less they tell apart.
    stretch: f64,
}

impl Frame {
    /// None for a face without an area.
    fn new(corners: &[Point3<f64>; 3]) -> Option<Self> {
        let [a, b, c] = *corners;
        let across = (b - a).cross(&(c - a));
        let normal = across.try_normalize(0.0)?;
        let longest = (b - a).norm_squared().max((c - a).norm_squared()).max((c - b).norm_squared());
        let mut inward = [Vector3::zeros(); 3];
        for (i, inward) in inward.iter_mut().enumerate() {
            *inward = normal.cross(&(corners[(i + 1) % 3] - corners[i])).try_normalize(0.0)?;
        }
        let middle = nalgebra::center(&nalgebra::center(&a, &b), &c);
        let beyond = corners.map(|corner| (corner - middle).norm()).into_iter().fold(0.0, f64::max);
        let mut margins = [0.0; 3];
        for i in 0..3 {
            let at = |point: &Point3<f64>| inward[i].dot(&(point - a));
            margins[i] = at(&corners[i]) + SHRUNK * (at(&middle) - at(&corners[i]));
        }
        let stretch = longest / across.norm();
        Some(Frame { origin: a, inward, margins, normal, beyond: SHRUNK * beyond, stretch })
    }

    /// Where a point is.
    #[inline]
    fn over(&self, point: &Point3<f64>) -> Over {
        let way = point - self.origin;
        let [a, b, c] = [0, 1, 2].map(|edge| self.inward[edge].dot(&way) - self.margins[edge]);
        [a, b, c, self.normal.dot(&way)]
    }

    /// How far inside of the face's edges a point of it is.
    fn place(&self, point: &Point3<f64>) -> [f64; 3] {
        [0, 1, 2].map(|edge| self.inward[edge].dot(&(point - self.origin)) - self.margins[edge])
    }

    /// The point of the plane below.
    fn foot(&self, over: &Cut) -> Point3<f64> {
        Point3::new(over[4], over[5], over[6]) - self.normal * over[HEIGHT]
    }
}

impl Chain {
    /// Holds a face against triangles, each with its error; none if these are not shown to cover it. Points of the face are then within `allowed` of the triangles, or
    /// within the answer of a part that is `steep`. `loss` is more than rounding hides.
    pub(crate) fn hold(
        &mut self,
        face: &[Point3<f64>; 3],
        reference: &Reference,
        triangles: &[u32],
        allowed: f64,
        loss: f64,
    ) -> Option<f64> {
        let frame = Frame::new(face)?;
        let loss = loss * frame.stretch;
        let beyond = frame.beyond + 4.0 * loss;
        let allowed = allowed - beyond;
        // What is far above or below is of another sheet, and its outer edges would be over the face.
        self.gather(reference, triangles, &frame, AWAY * allowed, loss);
        self.join(reference, loss);
        let sheet = PLACES.iter().find_map(|weights| self.over_all(&frame, face, weights, loss))?;
        self.steep.clear();
        for index in 0..self.triangles.len() {
            if self.of[index] == sheet {
                self.part(index, reference, &frame, allowed, loss);
            }
        }
        Some(beyond)
    }

    /// Takes the triangles over the face: not those beside it, or all of which is farther than `far` from the plane on one side.
    fn gather(&mut self, reference: &Reference, triangles: &[u32], frame: &Frame, far: f64, loss: f64) {
        self.turn += 1;
        if self.points.len() < reference.points.len() {
            self.points.resize(reference.points.len(), (0, [0.0; 4]));
        }
        self.over.clear();
        self.triangles.clear();
        for triangle in triangles {
            let over = reference.triangles[*triangle as usize].map(|point| {
                let (turn, over) = &mut self.points[point as usize];
                if *turn != self.turn {
                    (*turn, *over) = (self.turn, frame.over(&to_f64(reference.points[point as usize])));
                }
                *over
            });
            let is_beside = (0..HEIGHT).any(|edge| over.iter().all(|corner| corner[edge] < -loss));
            let is_away = over.iter().all(|corner| corner[HEIGHT] > far)
                || over.iter().all(|corner| corner[HEIGHT] < -far);
            if !is_beside && !is_away {
                self.over.push(over);
                self.triangles.push(*triangle);
            }
        }
    }

    /// Joins them to sheets, each by the first of its triangles.
    fn join(&mut self, reference: &Reference, loss: f64) {
        let Chain { over, triangles, above, of, sheets, met, turn, .. } = self;
        if met.len() < reference.edge_count {
            met.resize(reference.edge_count, Met::default());
        }
        above.clear();
        above.extend(0..triangles.len() as u32);
        for (index, (triangle, over)) in (0..).zip(triangles.iter().zip(over.iter())) {
            for (corner, edge) in reference.edges[*triangle as usize].into_iter().enumerate() {
                let met = &mut met[edge as usize];
                if met.turn != *turn {
                    let is_beside = is_beside(&over[corner], &over[(corner + 1) % 3], loss);
                    *met = Met { turn: *turn, first: index, is_odd: true, is_beside };
                    continue;
                }
                met.is_odd = !met.is_odd;
                if !met.is_beside {
                    let (one, other) = (top(above, index), top(above, met.first));
                    above[one.max(other) as usize] = one.min(other);
                }
            }
        }

        of.clear();
        sheets.clear();
        for (index, (triangle, over)) in triangles.iter().zip(over.iter()).enumerate() {
            let first = top(above, index as u32) as usize;
            if first == index {
                of.push(sheets.len() as u32);
                sheets.push(Sheet::default());
            } else {
                of.push(of[first]);
            }
            let sheet = &mut sheets[of[index] as usize];
            sheet.highest = sheet.highest.max(highest(over));
            let edges = reference.edges[*triangle as usize].map(|edge| &met[edge as usize]);
            sheet.is_torn |= edges.iter().any(|met| met.is_odd && !met.is_beside);
        }
    }

    /// The lowest sheet that is over all of the face, as far as one of its points tells.
    fn over_all(
        &mut self,
        frame: &Frame,
        face: &[Point3<f64>; 3],
        weights: &[f64; 3],
        loss: f64,
    ) -> Option<u32> {
        let point = face.iter().zip(weights).fold(Vector3::zeros(), |sum, (p, w)| sum + p.coords * *w);
        let point = frame.place(&Point3::from(point));
        self.sheets.iter_mut().for_each(|sheet| (sheet.is_odd, sheet.is_doubtful) = (false, false));
        for (over, of) in self.over.iter().zip(&self.of) {
            let sheet = &mut self.sheets[*of as usize];
            if !sheet.is_torn {
                match is_inside(over, &point, loss) {
                    Some(is_inside) => sheet.is_odd ^= is_inside,
                    None => sheet.is_doubtful = true,
                }
            }
        }
        let over_all = (0..).zip(&self.sheets).filter(|(_, sheet)| sheet.is_over_all());
        over_all.min_by(|(_, a), (_, b)| a.highest.total_cmp(&b.highest)).map(|(index, _)| index)
    }

    /// Takes the part of the face that is under a triangle that is too high.
    fn part(&mut self, index: usize, reference: &Reference, frame: &Frame, allowed: f64, loss: f64) {
        let (over, triangle) = (self.over[index], self.triangles[index]);
        let error = f64::from(reference.errors[triangle as usize]);
        if highest(&over) + error <= allowed {
            return;
        }
        self.cut(&over, &reference.targets[triangle as usize].corners, loss);
        if let Some((first, others)) = self.polygon.split_first()
            && highest(&self.polygon) + error > allowed
        {
            let fan = others.windows(2);
            self.steep.extend(fan.map(|pair| [first, &pair[0], &pair[1]].map(|over| frame.foot(over))));
        }
    }

    /// The part of a triangle that is over the face, into `polygon`.
    fn cut(&mut self, over: &[Over; 3], corners: &[Point3<f64>; 3], loss: f64) {
        let Chain { polygon, before, .. } = self;
        polygon.clear();
        polygon.extend(
            over.iter().zip(corners).map(|([a, b, c, height], at)| [*a, *b, *c, *height, at.x, at.y, at.z]),
        );
        for edge in 0..3 {
            if polygon.iter().all(|corner| corner[edge] >= -loss) {
                continue;
            }
            std::mem::swap(polygon, before);
            polygon.clear();
            for (i, from) in before.iter().enumerate() {
                let to = &before[(i + 1) % before.len()];
                let (inside, next) = (from[edge] + loss, to[edge] + loss);
                if inside >= 0.0 {
                    polygon.push(*from);
                }
                if (inside >= 0.0) != (next >= 0.0) {
                    let share = inside / (inside - next);
                    polygon.push(std::array::from_fn(|k| from[k] + share * (to[k] - from[k])));
                }
            }
        }
    }
}

/// The largest distance from the plane.
fn highest<const N: usize>(corners: &[[f64; N]]) -> f64 {
    corners.iter().fold(0.0, |most: f64, corner| most.max(corner[HEIGHT].abs()))
}

/// Whether all of an edge is beside the smaller face.
fn is_beside(from: &Over, to: &Over, loss: f64) -> bool {
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for edge in 0..3 {
        let (a, b) = (from[edge] + loss, to[edge] + loss);
        match (a >= 0.0, b >= 0.0) {
            (true, true) => {}
            (false, false) => return true,
            (true, false) => last = last.min(a / (a - b)),
            (false, true) => first = first.max(a / (a - b)),
        }
    }
    first > last
}

/// Whether a triangle is over a place; none where that is too close to tell.
fn is_inside(triangle: &[Over; 3], place: &[f64; 3], loss: f64) -> Option<bool> {
    if (0..2).any(|axis| {
        triangle.iter().all(|corner| corner[axis] < place[axis] - loss)
            || triangle.iter().all(|corner| corner[axis] > place[axis] + loss)
    }) {
        return Some(false);
    }
    let (mut left, mut right, mut unknown) = (false, false, false);
    for corner in 0..3 {
        let (p, q) = (&triangle[corner], &triangle[(corner + 1) % 3]);
        let (one, other) = ((q[0] - p[0]) * (place[1] - p[1]), (q[1] - p[1]) * (place[0] - p[0]));
        let turn = one - other;
        if turn.abs() <= DOUBT * (one.abs() + other.abs()) {
            unknown = true;
        } else if turn > 0.0 {
            left = true;
        } else {
            right = true;
        }
    }
    match (left && right, unknown) {
        (true, _) => Some(false),
        (false, true) => None,
        (false, false) => Some(true),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_mesh::geom::to_f64;

    const LOSS: f64 = 1e-12;

    /// A square of 6 x 6 squares about a face, at a height; with the triangles for which `is_there`.
    fn sheets(heights: &[f32], is_there: impl Fn(&[[f32; 3]; 3]) -> bool) -> (Reference, Vec<u32>) {
        let mut reference = Reference::default();
        for height in heights {
            let points: Vec<[f32; 3]> =
                (0..49_u16).map(|i| [f32::from(i % 7) - 3.0, f32::from(i / 7) - 3.0, *height]).collect();
            let corners = (0..36_u16).map(|i| 7 * (i / 6) + i % 6);
            let triangles = corners.flat_map(|a| [[a, a + 1, a + 8], [a, a + 8, a + 7]]);
            reference.add(&points, triangles.map(|triangle| (triangle, 0.125)));
        }
        reference.join();
        let all = 0..reference.triangle_count() as u32;
        let kept = all.filter(|triangle| is_there(&reference.corners(*triangle))).collect();
        (reference, kept)
    }

    fn held((reference, over): &(Reference, Vec<u32>), allowed: f64) -> Option<usize> {
        let face = [[-1.3_f32, -1.1, 0.0], [1.4, -0.9, 0.0], [0.2, 1.7, 0.0]].map(to_f64);
        let mut chain = Chain::default();
        chain.hold(&face, reference, over, allowed, LOSS).map(|beyond| {
            assert!(beyond > 0.0 && beyond < 0.01);
            chain.steep.len()
        })
    }

    #[test]
    fn a_face_is_held_by_a_sheet_over_all_of_it() {
        let sheet = sheets(&[0.5], |_| true);
        assert_eq!(held(&sheet, 0.7), Some(0));
        // With its error it is 0.625 away: all of the face is said to be under what is too high.
        assert!(held(&sheet, 0.6).is_some_and(|steep| steep > 8));
        assert_eq!(held(&sheet, 0.1), None, "that is another sheet's");
    }

    #[test]
    fn a_face_is_not_held_by_a_sheet_with_a_hole() {
        // The triangle over the middle, and one beside the face.
        let whole = sheets(&[0.5], |_| true);
        let over = |x: f32, y: f32| {
            let is_over = |index: &u32| {
                let corners = whole.0.corners(*index);
                let sides = [0, 1, 2].map(|i| {
                    let ([a, b, _], [c, d, _]) = (corners[i], corners[(i + 1) % 3]);
                    (c - a) * (y - b) - (d - b) * (x - a)
                });
                sides.iter().all(|side| *side > 0.0) || sides.iter().all(|side| *side < 0.0)
            };
            whole.0.corners(whole.1.iter().copied().find(is_over).unwrap())
        };
        let (middle, beside) = (over(0.1, 0.2), over(-2.4, -2.7));
        assert_eq!(held(&sheets(&[0.5], |corners| *corners != middle), 0.7), None);
        assert_eq!(held(&sheets(&[0.5], |corners| *corners != beside), 0.7), Some(0));
    }

    #[test]
    fn one_of_several_sheets_is_enough() {
        assert_eq!(held(&sheets(&[0.5, 0.25], |_| true), 0.7), Some(0));
        assert_eq!(held(&sheets(&[0.5, 9.0], |_| true), 0.7), Some(0), "one is far away");
        // Half of one is there: the other is over all of the face.
        let is_half = |corners: &[[f32; 3]; 3]| corners.iter().all(|corner| corner[0] <= 0.0);
        let one =
            |height: f32| sheets(&[0.5, 0.25], move |corners| corners[0][2] == height || is_half(corners));
        assert_eq!(held(&one(0.5), 0.7), Some(0));
        assert!(held(&one(0.5), 0.6).is_some_and(|steep| steep > 8));
        assert_eq!(held(&one(0.25), 0.6), Some(0));
        assert_eq!(held(&sheets(&[0.5, 0.25], is_half), 0.7), None);
    }

    #[test]
    fn a_sheet_that_lies_there_twice_shows_nothing_and_three_times_does() {
        let twice = |count| sheets(&vec![0.5; count], |_| true);
        assert_eq!(held(&twice(2), 0.7), None);
        assert_eq!(held(&twice(3), 0.7), Some(0));
    }
}
