//! The list of tests that a collapse has to pass; what fails has a reason that is counted.

use crate::decimate::Decimator;
use crate::fan::{FanKind, MAX_VALENCE};
use crate::patch::Patch;
use crate::refusal::Refusal;
use chpm_mesh::geom::area_vector;

/// A collapse is a flip if the cosine between a face's normals before and after is not above this.
const MIN_COSINE: f64 = 0.25;
/// What is so much beyond the square of the limit is beyond the limit, whatever rounding does; products above this have all their digits.
const CLEAR: f64 = 1.000_001;
const LEAST_SQUARES: f64 = 1e-250;

impl Decimator {
    /// Whether u -> v may be carried out. The tests go from cheap to dear.
    pub(crate) fn check(&mut self, patch: &Patch<'_>, fan: FanKind, u: u16, v: u16) -> Result<(), Refusal> {
        match fan {
            FanKind::Broken => return Err(Refusal::NonManifold),
            FanKind::Open(first, last) if v != first && v != last => return Err(Refusal::Boundary),
            _ => {}
        }
        let degree = self.fan.wings.len();
        if self.adjacency.count(v) > 4 * MAX_VALENCE {
            return Err(Refusal::Valence);
        }
        let (mut before, mut after) = (None, None);
        for &(a, b) in &self.fan.wings {
            if b == v {
                before = Some(a);
            }
            if a == v {
                after = Some(b);
            }
        }
        if patch.locked[usize::from(v)] && self.joins_locked(patch, v, before, after) {
            return Err(Refusal::LockedEdge);
        }
        let (remaining, keeps_apex) = self.check_link(v, u, before, after)?;
        if remaining + degree > MAX_VALENCE + 4 {
            return Err(Refusal::Valence);
        }
        let dying = usize::from(before.is_some()) + usize::from(after.is_some());
        if degree == dying && !keeps_apex {
            return Err(Refusal::Component);
        }
        self.check_flips(patch, u, v)
    }

    /// Whether a new edge at the locked vertex `v` would end at another locked vertex, or the last of three faces would have
    /// locked corners only: another cluster may own such an edge or face.
    fn joins_locked(&self, patch: &Patch<'_>, v: u16, before: Option<u16>, after: Option<u16>) -> bool {
        if self.fan.wings.len() == 3 && self.fan.wings.iter().all(|(a, _)| patch.locked[usize::from(*a)]) {
            return true;
        }
        let apex = |w: u16| w == v || Some(w) == before || Some(w) == after;
        self.fan
            .wings
            .iter()
            .any(|&(a, b)| [a, b].into_iter().any(|w| !apex(w) && patch.locked[usize::from(w)]))
    }

    /// The link condition: besides the apexes of the edge, u and v have no neighbour in common, and no face of v lies opposite to
    /// the edge. Answers how many faces v has apart from those of u, and whether one of them is at an apex.
    fn check_link(
        &mut self,
        v: u16,
        u: u16,
        before: Option<u16>,
        after: Option<u16>,
    ) -> Result<(usize, bool), Refusal> {
        let (ids, faces) = self.adjacency.living(v);
        let (mut remaining, mut keeps_apex) = (0, false);
        for &id in ids {
            let (x, y) = faces[id as usize].others(v);
            if x == u || y == u {
                continue;
            }
            remaining += 1;
            let apex = |w: u16| Some(w) == before || Some(w) == after;
            let common = |w: u16| self.fan.has(w) && !apex(w);
            if common(x) || common(y) || (apex(x) && apex(y)) {
                return Err(Refusal::Link);
            }
            keeps_apex |= apex(x) || apex(y);
        }
        Ok((remaining, keeps_apex))
    }

    /// No face may turn by more than the limit or lose its area. A face that has none already cannot get worse.
    fn check_flips(&self, patch: &Patch<'_>, u: u16, v: u16) -> Result<(), Refusal> {
        let position = |w: u16| patch.positions[usize::from(w)];
        let (from, to) = (position(u), position(v));
        for &(a, b) in &self.fan.wings {
            if a == v || b == v {
                continue;
            }
            let old = area_vector(from, position(a), position(b));
            let new = area_vector(to, position(a), position(b));
            let (old_squared, new_squared) = (old.norm_squared(), new.norm_squared());
            if old_squared == 0.0 {
                continue;
            }
            if new_squared == 0.0 {
                return Err(Refusal::Degenerate);
            }
            let dot = old.dot(&new);
            // Most are far from the limit, and need no root to tell.
            let squares = old_squared * new_squared;
            if dot > 0.0 && squares > LEAST_SQUARES && dot * dot > CLEAR * MIN_COSINE * MIN_COSINE * squares {
                continue;
            }
            // Two roots: the product of the squares could underflow.
            if dot <= MIN_COSINE * old_squared.sqrt() * new_squared.sqrt() {
                return Err(Refusal::Flip);
            }
        }
        Ok(())
    }
}
