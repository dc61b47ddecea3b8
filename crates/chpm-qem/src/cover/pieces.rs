//! How far a triangle is from a surface, at most: it is cut into pieces, each of which is held against one triangle of the surface.
//!
//! The distance to one triangle is convex, so over a piece it is largest at a corner. A piece whose corners are nearest to different triangles is cut where
//! it goes over from one to the other, until that decides nothing any more.

use super::target::Target;
use nalgebra::Point3;

/// Cuts after which a piece is taken as it is.
const DEEPEST: u8 = 20;
/// Pieces of one triangle after which the rest is taken as it is.
const MOST: u64 = 2000;
/// A piece needs what its corners do, times this.
const SLACK: f64 = 1.01;
/// Cuts keep away from corners by this share of an edge.
const AWAY: f64 = 0.1;

/// The nearest triangle, and how far it is.
pub(crate) type Served = (u32, f64);

#[derive(Clone, Copy, Debug)]
struct Piece {
    corners: [Point3<f64>; 3],
    served: [Served; 3],
    depth: u8,
}

/// A surface that pieces are held against.
pub(crate) trait Surface {
    fn target(&self, index: u32) -> &Target;

    /// Added to a distance from a triangle.
    fn beyond(&self, index: u32) -> f64;

    /// The nearest triangle, if one is nearer than `best`, with the square of its distance.
    fn nearest(&mut self, point: &Point3<f64>, best: (u32, f64)) -> (u32, f64);
}

/// Scratch for one triangle after another.
#[derive(Debug, Default)]
pub(crate) struct Pieces {
    stack: Vec<Piece>,
    /// The triangles of the surface that the pieces were held against.
    pub(crate) used: Vec<u32>,
    /// Pieces so far, of all triangles.
    pub(crate) count: u64,
}

impl Pieces {
    /// No point of the triangle is farther from the surface than the answer. What is within `allowed` is not looked at more closely. `served` are triangles near the
    /// corners.
    pub(crate) fn reach(
        &mut self,
        corners: [Point3<f64>; 3],
        served: [Served; 3],
        allowed: f64,
        surface: &mut impl Surface,
    ) -> f64 {
        self.used.clear();
        self.stack.clear();
        self.stack.push(Piece { corners, served, depth: 0 });
        let (mut reached, mut needed, most) = (0.0_f64, 0.0_f64, self.count + MOST);
        while let Some(piece) = self.stack.pop() {
            self.count += 1;
            for (target, distance) in piece.served {
                needed = needed.max(distance + surface.beyond(target));
            }
            let (far, target) = piece.best(surface);
            if far <= allowed.max(SLACK * needed) || piece.depth == DEEPEST || self.count >= most {
                reached = reached.max(far);
                self.used.push(target);
                continue;
            }
            self.stack.extend(piece.cut(surface));
        }
        reached
    }
}

impl Piece {
    fn distance(&self, corner: usize, target: u32, surface: &impl Surface) -> f64 {
        let (nearest, distance) = self.served[corner];
        if nearest == target {
            return distance;
        }
        surface.target(target).squared(&self.corners[corner]).sqrt()
    }

    /// How far all of it is from one of the triangles that its corners are nearest to, and from which.
    fn best(&self, surface: &impl Surface) -> (f64, u32) {
        let mut best = (f64::INFINITY, self.served[0].0);
        for corner in 0..3 {
            let target = self.served[corner].0;
            if self.served[..corner].iter().any(|(other, _)| *other == target) {
                continue;
            }
            let beyond = surface.beyond(target);
            let mut far = beyond;
            for other in 0..3 {
                far = far.max(beyond + self.distance(other, target, surface));
                if far >= best.0 {
                    break;
                }
            }
            if far < best.0 {
                best = (far, target);
            }
        }
        best
    }

    /// Two halves, cut where the edge that is worst goes over from one triangle to another.
    fn cut(&self, surface: &mut impl Surface) -> [Piece; 2] {
        let mut worst = (f64::NEG_INFINITY, 0, 0.5);
        for i in 0..3 {
            let j = (i + 1) % 3;
            let (from, to) = (self.served[i].0, self.served[j].0);
            if from == to {
                continue;
            }
            // How much nearer each end is to its own.
            let at_i = self.distance(i, to, surface) - self.served[i].1;
            let at_j = self.distance(j, from, surface) - self.served[j].1;
            let (at_i, at_j) = (at_i.max(0.0), at_j.max(0.0));
            if at_i + at_j > worst.0 {
                let share = if at_i + at_j > 0.0 { at_i / (at_i + at_j) } else { 0.5 };
                worst = (at_i + at_j, i, share.clamp(AWAY, 1.0 - AWAY));
            }
        }

        let (_, i, share) = worst;
        let j = (i + 1) % 3;
        let point = self.corners[i] + (self.corners[j] - self.corners[i]) * share;
        let [a, b] = [self.served[i].0, self.served[j].0]
            .map(|target| (target, surface.target(target).squared(&point)));
        let (target, squared) = surface.nearest(&point, if a.1 <= b.1 { a } else { b });
        let at = (target, squared.sqrt());
        let mut halves = [*self; 2];
        for (half, corner) in halves.iter_mut().zip([j, i]) {
            half.corners[corner] = point;
            half.served[corner] = at;
            half.depth += 1;
        }
        halves
    }
}
