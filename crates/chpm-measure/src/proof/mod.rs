//! Proven distances: whether all points of a triangle, and not samples of them, are near enough to a surface, and how far the farthest is.
//!
//! The distance to *one* triangle of the surface is convex. So over a convex piece it is largest at a corner, and a piece whose corners are
//! all near enough to one triangle is near enough everywhere. A triangle is cut until that is so of all its pieces. Where the middle of a piece lies above the inside of its
//! nearest triangle, what lies over that triangle and is near enough to its plane is cut out and is proven at once; else pieces are halved. So the pieces are
//! about as many as the overlaps of triangles, even where nothing may be farther than rounding. A point that is too far from every triangle is a proof of the opposite.
//!
//! Rounding is on the safe side by [`LOSS`]: what is proven to be within a distance is within it and twice that share of the largest coordinates; what is
//! told to be beyond is beyond it without any allowance.

mod piece;
mod triangle;

pub use triangle::LOSS;

use crate::box_tree::BoxTree;
use crate::searcher::{Hit, Searcher};
use crate::tiles::Tiles;
use nalgebra::Point3;
use piece::{DEEPEST, Piece, Plane};
pub(crate) use triangle::{Corners, Face};
use triangle::{Feature, NearestPoint};

/// A piece wider than so many of the triangles that it lies on is halved first; else the lines of each would cut all others.
const WIDE: f64 = 4.0;

/// Pieces after which it is asked whether to stop.
const ASKED: u64 = 256;

/// How far from a tile is near enough.
#[derive(Debug)]
pub enum Allowed {
    /// From all tiles alike.
    Same(f64),
    /// From every tile its own; a point has to be near enough to one of them.
    Own(OwnDistances),
}

/// A distance for every tile.
#[derive(Debug)]
pub struct OwnDistances {
    of: Vec<f64>,
    near: BoxTree,
}

/// A point that shows that a triangle is too far from a surface.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Witness {
    /// The point, up to rounding.
    pub at: [f64; 3],
    /// How far it is from the whole surface at least; infinite where that has no triangle.
    pub distance: f64,
    /// The tile that is nearest; 0 where there is none.
    pub tile: usize,
}

/// Outcome of a proof for one triangle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Verdict {
    /// All of it is near enough.
    Within,
    /// Some of it is not.
    Beyond(Witness),
    /// Neither was shown with as many pieces as were allowed.
    Undecided,
}

/// Answer for one triangle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Found {
    /// Answer to the question.
    pub verdict: Verdict,
    /// No point is farther from the surface than this, whatever the verdict.
    pub reached: f64,
    /// Pieces that were looked at.
    pub pieces: u64,
}

/// Proves distances from one triangle after the other to a surface.
pub struct Prover<'a> {
    target: Searcher<'a>,
    is_stopped: &'a (dyn Fn() -> bool + Sync),
    stack: Vec<Piece>,
    /// The farthest point so far of those that were looked at, about how far it is, and the largest coordinate of its triangle.
    far: Option<(f64, Point3<f64>, f64)>,
}

impl Allowed {
    /// A distance for each tile of a surface.
    pub fn own(target: &Tiles<'_>, of: Vec<f64>) -> Self {
        let boxes = target.boxes();
        let largest = boxes.iter().flat_map(|b| b.min.into_iter().chain(b.max)).filter(|x| x.is_finite());
        // What rounding hides must be looked at, too.
        let loss = 4.0 * LOSS * largest.map(|x| f64::from(x.abs())).fold(0.0, f64::max);
        let near = BoxTree::reaching(boxes, |tile| of[tile] + loss);
        Allowed::Own(OwnDistances { of, near })
    }

    fn of(&self, tile: usize) -> f64 {
        match self {
            Allowed::Same(distance) => *distance,
            Allowed::Own(own) => own.of[tile],
        }
    }
}

/// Question of a run.
enum Goal<'g> {
    Keep(&'g Allowed),
    /// The largest distance: what is farther than all before raises what is asked for.
    Raise {
        allowed: Allowed,
        lower: f64,
        at: Option<[f64; 3]>,
        tolerance: f64,
    },
}

impl Goal<'_> {
    fn allowed(&self) -> &Allowed {
        match self {
            Goal::Keep(allowed) => allowed,
            Goal::Raise { allowed, .. } => allowed,
        }
    }
}

/// Some triangle that is near enough to a point, or the nearest of all.
struct Candidate {
    hit: Hit,
    face: Face,
    place: NearestPoint,
    keeps: bool,
}

impl Candidate {
    fn new(target: &mut Searcher<'_>, hit: Hit, point: Point3<f64>, allowed: &Allowed, scale: f64) -> Self {
        let face = Face::new(target.corners(hit));
        let place = face.nearest(point);
        let keeps = place.distance <= allowed.of(hit.tile) + LOSS * scale.max(face.largest);
        Candidate { hit, face, place, keeps }
    }
}

impl<'a> Prover<'a> {
    /// To a surface. When `is_stopped`, asked now and then, nothing more is decided.
    pub fn new(target: &'a Tiles<'a>, is_stopped: &'a (dyn Fn() -> bool + Sync)) -> Self {
        Prover { target: Searcher::new(target), is_stopped, stack: Vec::new(), far: None }
    }

    /// Whether all of a triangle is near enough; gives up after `limit` pieces.
    pub fn within(&mut self, triangle: [[f32; 3]; 3], allowed: &Allowed, limit: u64) -> Found {
        self.run(triangle, &mut Goal::Keep(allowed), limit)
    }

    /// Raises `lower`, a distance that some point is known to have from the surface at least, by this triangle's farthest point, to within the
    /// share `tolerance` of it. The answer tells what no point of the triangle is beyond, and where a point is that is as far as the raised `lower`.
    pub fn farthest(
        &mut self,
        triangle: [[f32; 3]; 3],
        lower: &mut f64,
        tolerance: f64,
        limit: u64,
    ) -> (f64, Option<[f64; 3]>) {
        let allowed = Allowed::Same(*lower * (1.0 + tolerance));
        let mut goal = Goal::Raise { allowed, lower: *lower, at: None, tolerance };
        let found = self.run(triangle, &mut goal, limit);
        let Goal::Raise { lower: raised, at, .. } = goal else { return (found.reached, None) };
        *lower = raised;
        (found.reached, at)
    }

    /// A point of the triangles so far that is far from the surface, and how far it is at least; none if no piece was looked at.
    pub fn far(&mut self) -> Option<(f64, [f64; 3])> {
        let (_, at, scale) = self.far?;
        Some(((self.target.lower_bound(at) - LOSS * scale).max(0.0), at.coords.into()))
    }

    fn run(&mut self, triangle: Corners, goal: &mut Goal<'_>, limit: u64) -> Found {
        let scale = triangle.as_flattened().iter().map(|x| f64::from(x.abs())).fold(0.0, f64::max);
        let whole = Piece::of(triangle);
        self.stack.clear();
        self.stack.push(whole);
        let mut found = Found { verdict: Verdict::Within, reached: 0.0, pieces: 0 };
        while let Some(piece) = self.stack.pop() {
            found.pieces += 1;
            let Some(candidate) = self.candidate(piece.middle(), goal.allowed(), scale) else {
                let at = piece.middle().coords.into();
                found.verdict = Verdict::Beyond(Witness { at, distance: f64::INFINITY, tile: 0 });
                found.reached = f64::INFINITY;
                return found;
            };
            self.look(piece.middle(), candidate, &piece, goal, scale, &mut found);
            if matches!(found.verdict, Verdict::Beyond(_)) {
                self.stack.push(piece);
                break;
            }
            // What is farthest is most often a corner.
            if found.pieces == 1 && !self.stack.is_empty() {
                for corner in whole.corners() {
                    if let Some(candidate) = self.candidate(*corner, goal.allowed(), scale)
                        && !candidate.keeps
                    {
                        self.refute(*corner, &candidate, goal, scale, &mut found);
                    }
                }
                if matches!(found.verdict, Verdict::Beyond(_)) {
                    break;
                }
            }
            let is_over = found.pieces >= limit || found.pieces.is_multiple_of(ASKED) && (self.is_stopped)();
            if is_over && !self.stack.is_empty() {
                found.verdict = Verdict::Undecided;
                break;
            }
        }
        // What is left counts by its widest.
        while let Some(piece) = self.stack.pop() {
            found.reached = found.reached.max(self.reach(&piece, scale));
        }
        found
    }

    /// Proves a piece, or cuts it, or shows that it cannot be proven.
    fn look(
        &mut self,
        middle: Point3<f64>,
        candidate: Candidate,
        piece: &Piece,
        goal: &mut Goal<'_>,
        scale: f64,
        found: &mut Found,
    ) {
        if self.far.is_none_or(|(distance, ..)| candidate.place.distance > distance) {
            self.far = Some((candidate.place.distance, middle, scale));
        }

        // Does the middle keep to what is allowed? If not, it is a witness, or nobody can tell.
        let Candidate { hit, face, place, mut keeps } = candidate;
        if !keeps {
            keeps = self.refute(middle, &candidate, goal, scale, found);
        }
        if !keeps {
            if !matches!(found.verdict, Verdict::Beyond(_)) {
                found.verdict = Verdict::Undecided;
                found.reached = found.reached.max(self.reach(piece, scale));
            }
            return;
        }

        // Are all corners within reach of the same face? A face is convex, so all between them is, too.
        let allowed = goal.allowed().of(hit.tile);
        let loss = LOSS * scale.max(face.largest);
        if let Some(upper) = farthest_corner(piece, &face, allowed + loss) {
            found.reached = found.reached.max(upper + loss);
            return;
        }
        // Where another tile has more room, what is nearest may be as far as it may be, all along the border between both.
        if 2.0 * place.distance > allowed
            && let Some(other) = self.roomiest(middle, goal.allowed(), scale)
        {
            let loss = LOSS * scale.max(other.face.largest);
            if let Some(upper) = farthest_corner(piece, &other.face, goal.allowed().of(other.hit.tile) + loss)
            {
                found.reached = found.reached.max(upper + loss);
                return;
            }
        }

        // The piece is cut: what a ball about the middle proves goes, the rest is looked at again.
        if piece.depth() >= DEEPEST {
            found.verdict = Verdict::Undecided;
            found.reached = found.reached.max(self.reach(piece, scale));
            return;
        }
        let ball = (allowed * allowed - place.distance * place.distance).max(0.0).sqrt();
        let width = face.radius();
        let is_wide = ball >= width || piece.radius(middle) >= WIDE * width;
        let cut_out = if is_wide { None } else { self.cut_out(piece, &face, place.feature, allowed, loss) };
        if let Some(upper) = cut_out {
            found.reached = found.reached.max(upper + loss);
            return;
        }
        // Along an edge again and again, a piece would get thinner only.
        let is_halved = is_wide || !piece.depth().is_multiple_of(2);
        let parts = if is_halved { None } else { along_edge(piece, &face, &place, middle) };
        if let Some(parts) = parts.or_else(|| piece.halves()) {
            self.stack.extend(parts);
        } else {
            found.verdict = Verdict::Undecided;
            found.reached = found.reached.max(self.reach(piece, scale));
        }
    }

    /// Takes out what lies over a part of a triangle, near enough, and leaves the rest for later; answers how far that is.
    fn cut_out(
        &mut self,
        piece: &Piece,
        face: &Face,
        feature: Feature,
        allowed: f64,
        loss: f64,
    ) -> Option<f64> {
        let mut planes = [Plane { normal: face.normal, at: face.corners[0] }; 5];
        let planes = match feature {
            Feature::Inside => {
                let up = face.normal.normalize();
                for (i, plane) in planes[..3].iter_mut().enumerate() {
                    *plane = Plane { normal: face.edges[i].cross(&up).normalize(), at: face.corners[i] };
                }
                planes[3] = Plane { normal: up, at: face.corners[0] + up * allowed };
                planes[4] = Plane { normal: -up, at: face.corners[0] - up * allowed };
                &planes[..]
            }
            Feature::Edge(i) => {
                let along = face.edges[i].normalize();
                planes[0] = Plane { normal: along, at: face.corners[(i + 1) % 3] };
                planes[1] = Plane { normal: -along, at: face.corners[i] };
                &planes[..2]
            }
            Feature::Corner => return None,
        };

        let (mut part, before) = (*piece, self.stack.len());
        for plane in planes {
            let Some([Some(inside), outside]) = part.cut(plane, 0.25 * loss) else {
                self.stack.truncate(before);
                return None;
            };
            part = inside;
            self.stack.extend(outside);
        }

        let upper = farthest_corner(&part, face, allowed + loss).filter(|_| self.stack.len() > before);
        if upper.is_none() {
            self.stack.truncate(before);
        }
        upper
    }

    /// Verdict on a point that no triangle keeps to: a proof that none does, or a larger distance to prove instead, which
    /// may hold.
    fn refute(
        &mut self,
        point: Point3<f64>,
        candidate: &Candidate,
        goal: &mut Goal<'_>,
        scale: f64,
        found: &mut Found,
    ) -> bool {
        let loss = LOSS * scale;
        match goal {
            Goal::Keep(allowed) => {
                let is_beyond = match allowed {
                    Allowed::Same(distance) => self.target.lower_bound(point) - loss > *distance,
                    Allowed::Own(own) => self.target.is_beyond(point, &own.near, |tile| own.of[tile] + loss),
                };

                if is_beyond {
                    let distance = (self.target.lower_bound(point) - loss).max(0.0);
                    let witness = Witness { at: point.coords.into(), distance, tile: candidate.hit.tile };
                    if !matches!(found.verdict, Verdict::Beyond(other) if other.distance >= distance) {
                        found.verdict = Verdict::Beyond(witness);
                    }
                }
                false
            }

            Goal::Raise { allowed, lower, at, tolerance } => {
                let distance = self.target.lower_bound(point) - loss;
                if distance > *lower {
                    (*lower, *at) = (distance, Some(point.coords.into()));
                    *allowed = Allowed::Same(distance * (1.0 + *tolerance));
                }
                let loss = LOSS * scale.max(candidate.face.largest);
                candidate.place.distance <= allowed.of(candidate.hit.tile) + loss
            }
        }
    }

    /// A triangle that a point is near enough to, or else the nearest one; none where there is none.
    fn candidate(&mut self, point: Point3<f64>, allowed: &Allowed, scale: f64) -> Option<Candidate> {
        let hit = self.target.nearest(point)?;
        let nearest = Candidate::new(&mut self.target, hit, point, allowed, scale);
        if nearest.keeps {
            return Some(nearest);
        }
        Some(self.roomiest(point, allowed, scale).filter(|other| other.keeps).unwrap_or(nearest))
    }

    /// Where tiles have distances of their own: the triangle that leaves a point most room to its distance.
    fn roomiest(&mut self, point: Point3<f64>, allowed: &Allowed, scale: f64) -> Option<Candidate> {
        let Allowed::Own(own) = allowed else { return None };
        let hit = self.target.roomiest(point, &own.near, |tile| own.of[tile])?;
        Some(Candidate::new(&mut self.target, hit, point, allowed, scale))
    }

    /// Upper bound on how far any point of a piece is.
    fn reach(&mut self, piece: &Piece, scale: f64) -> f64 {
        let middle = piece.middle();
        let Some(hit) = self.target.nearest(middle) else { return f64::INFINITY };
        let face = Face::new(self.target.corners(hit));
        farthest_corner(piece, &face, f64::INFINITY).unwrap_or(f64::INFINITY) + LOSS * scale.max(face.largest)
    }
}

/// Two parts of a piece whose middle is nearest to an edge: on either side of that, so that each lies on one triangle.
fn along_edge(piece: &Piece, face: &Face, place: &NearestPoint, middle: Point3<f64>) -> Option<[Piece; 2]> {
    let Feature::Edge(edge) = place.feature else { return None };
    let up = if place.distance > 0.0 { middle - place.at } else { face.normal };
    match piece.cut(&Plane { normal: face.edges[edge].cross(&up), at: place.at }, 0.0)? {
        [Some(inside), Some(outside)] => Some([inside, outside]),
        _ => None,
    }
}

/// How far the corners of a piece are from a triangle; none if that is more than `most`.
fn farthest_corner(piece: &Piece, face: &Face, limit: f64) -> Option<f64> {
    let mut farthest = 0.0;
    for corner in piece.corners() {
        let distance = face.nearest(*corner).distance;
        if distance.is_nan() || distance > limit {
            return None;
        }
        farthest = distance.max(farthest);
    }
    Some(farthest)
}

#[cfg(test)]
mod tests;
