//! Faces of the mesh, held against the reference.

use super::pieces::Surface;
use super::reference::Reference;
use super::surfaces::{Own, enough};
use super::{Cover, FACES};
use nalgebra::Point3;

/// Triangles over a face that take the time of a piece, and those that are only looked at.
const TRIANGLES: usize = 8;
const LOOKED_AT: usize = 128;

/// Faces after which a way of holding them has to be worth its time: so many times fewer have to be held by it.
const FIRST: u32 = 64;
const WORTH: u32 = 4;

/// How often a way that is tried first has held a face.
#[derive(Debug, Default)]
pub(super) struct Luck {
    tried: u32,
    held: u32,
}

impl Luck {
    fn is_worth_trying(&self) -> bool {
        self.tried < FIRST || WORTH * self.held >= self.tried
    }

    fn note(&mut self, is_held: bool) {
        self.tried += 1;
        self.held += u32::from(is_held);
    }
}

/// Whose scratch it is.
const FINE: usize = 0;
const COARSE: usize = 1;

impl Cover<'_> {
    /// Holds a face: against what of the coarser reference is over it, what of the reference itself is, and the nearest where that is too high or is not shown to be
    /// over all of it.
    pub(super) fn cover(&mut self, face: u32, error: f32) {
        let allowed = self.reached;
        let coarse = self.coarse.filter(|_| self.luck[COARSE].is_worth_trying());
        if let Some(coarse) = coarse {
            let held = self.hold_under(face, coarse, COARSE);
            let is_held = held.is_some() && self.chains[COARSE].steep.is_empty();
            self.luck[COARSE].note(is_held);
            if is_held {
                return;
            }
        }

        let mut held = None;
        if self.luck[FINE].is_worth_trying() {
            held = self.hold_under(face, self.reference, FINE);
            self.luck[FINE].note(held.is_some());
        }
        let far = match held {
            Some(beyond) => {
                let parts = std::mem::take(&mut self.chains[FINE].steep);
                let far =
                    parts.iter().map(|part| self.hold_against_nearest(*part, allowed - beyond) + beyond);
                let far = far.fold(0.0, f64::max);
                self.chains[FINE].steep = parts;
                far
            }
            None => self.hold_against_nearest(self.targets[face as usize].corners, allowed),
        };
        // What was composed is a bound on it for as long as it is there.
        self.reached = self.reached.max(far.min(f64::from(error)));
    }

    /// Holds a face against triangles over it, as [`super::chain::Chain::hold`] does. Of the reference itself those count that are held against it or those around it: others are of another
    /// sheet.
    fn hold_under(&mut self, face: u32, reference: &Reference, which: usize) -> Option<f64> {
        if which == FINE {
            self.seen_faces.begin();
            let mut seen = 0;
            for vertex in self.mesh.faces[face as usize].corners {
                for wing in self.mesh.all_wings(vertex) {
                    seen += 1;
                    self.seen_faces.is_new(wing.face);
                }
            }
            self.pieces.count += seen / FACES as u64;
        }
        let target = &self.targets[face as usize];
        let (over, holders, seen) = (&mut self.over, &self.holders, &self.seen_faces);
        over.clear();
        let around = target.around(self.reached);
        let looked_at = reference.tree.meeting(&reference.targets, &mut self.search, &around, |triangle| {
            let holder = holders[triangle as usize] as usize;
            if which != FINE || seen.at.get(holder).is_some_and(|turn| *turn == seen.turn) {
                over.push(triangle);
            }
        });
        self.pieces.count += (looked_at / LOOKED_AT + over.len() / TRIANGLES) as u64;
        self.chains[which].hold(&target.corners, reference, over, self.reached, self.loss)
    }

    /// How far a face, or part of one, is from the nearest of the reference, at most; what is within `allowed` is not looked at more closely.
    fn hold_against_nearest(&mut self, corners: [Point3<f64>; 3], allowed: f64) -> f64 {
        let Reference { targets, tree, errors, usual_error, .. } = self.reference;
        let enough = enough(allowed, *usual_error);
        let mut own = Own { targets, tree, search: &mut self.search, errors, enough };
        let mut hint = self.hint;
        let served = corners.map(|point| {
            let near = targets[hint as usize].squared(&point);
            let (triangle, squared) = own.nearest(&point, (hint, near));
            hint = triangle;
            (triangle, squared.sqrt())
        });
        self.hint = hint;
        self.pieces.reach(corners, served, allowed, &mut own)
    }
}
