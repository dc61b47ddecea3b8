//! Faces of the mesh, held against the reference.

use super::Cover;
use super::pieces::Surface;
use super::reference::Reference;
use super::surfaces::{Own, enough};
use nalgebra::Point3;

/// Triangles over a face that take the time of a piece, and those that are only looked at.
const TRIANGLES: usize = 8;
const LOOKED_AT: usize = 128;

/// Faces after which a way of holding them has to be worth its time: so many times fewer have to be held by it.
const FIRST: u32 = 64;
const WORTH: u32 = 2;
/// Half of them are forgotten when there are so many.
const LAST: u32 = 256;
/// One of so many faces is held by it even if it is not, since that may change.
const AGAIN: u32 = 64;
/// A reference is tried where what is allowed is so many times the error of most of its triangles.
const ABOVE: f64 = 2.5;

/// How often a way that is tried first has held a face.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Luck {
    asked: u32,
    tried: u32,
    held: u32,
}

impl Luck {
    fn is_worth_trying(&mut self) -> bool {
        self.asked += 1;
        self.tried < FIRST || WORTH * self.held >= self.tried || self.asked.is_multiple_of(AGAIN)
    }

    fn note(&mut self, is_held: bool) {
        self.tried += 1;
        self.held += u32::from(is_held);
        if self.tried == LAST {
            (self.tried, self.held) = (LAST / 2, self.held / 2);
        }
    }
}

/// Whose luck it is: those of coarser references follow.
const FINE: usize = 0;

impl Cover<'_> {
    /// Holds a face: against what of the coarsest references is over it, what of the reference itself is, and the nearest where that is too high or is not shown to be
    /// over all of it.
    pub(super) fn cover(&mut self, face: u32, error: f32) {
        let allowed = self.reached;
        for (index, coarse) in self.coarser.iter().enumerate().rev() {
            let which = 1 + index;
            if ABOVE * coarse.usual_error > allowed || !self.luck[which].is_worth_trying() {
                continue;
            }
            let is_held = self.hold_under(face, coarse).is_some() && self.chain.steep.is_empty();
            self.luck[which].note(is_held);
            if is_held {
                return;
            }
        }

        let mut held = None;
        if self.luck[FINE].is_worth_trying() {
            held = self.hold_under(face, self.reference);
            self.luck[FINE].note(held.is_some());
        }
        let far = match held {
            Some(beyond) => {
                let parts = std::mem::take(&mut self.chain.steep);
                let far =
                    parts.iter().map(|part| self.hold_against_nearest(*part, allowed - beyond) + beyond);
                let far = far.fold(0.0, f64::max);
                self.chain.steep = parts;
                far
            }
            None => self.hold_against_nearest(self.targets[face as usize].corners, allowed),
        };
        // What was composed is a bound on it for as long as it is there.
        self.reached = self.reached.max(far.min(f64::from(error)));
    }

    /// Holds a face against triangles over it, as [`super::chain::Chain::hold`] does.
    fn hold_under(&mut self, face: u32, reference: &Reference) -> Option<f64> {
        let target = &self.targets[face as usize];
        let over = &mut self.over;
        over.clear();
        let around = target.around(self.reached);
        let looked_at = reference.tree.meeting(&mut self.search, &around, |triangle| over.push(triangle));
        self.pieces.count += (looked_at / LOOKED_AT + over.len() / TRIANGLES) as u64;
        self.chain.hold(&target.corners, reference, over, self.reached, self.loss)
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
