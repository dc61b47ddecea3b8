//! The displacements that a collapse would leave behind: what its error rests on. And, once it is carried out, the looks.
//!
//! Where the last faces of a component go, their points go on with the nearest face of another, at the price of the way there; so pieces that
//! lie beside each other open no hole that the error does not tell. Only what lies apart, by many times its own size, vanishes at a
//! price by its size, and stays behind as a [`Remnant`].

use crate::decimate::Decimator;
use crate::displacement::Displacement;
use crate::fan::FanKind;
use crate::overlay::{NO_FACE, Place, Sweep};
use crate::patch::Patch;
use crate::remnant::Remnant;
use chpm_mesh::geom::{round_up, to_f64};
use nalgebra::Point3;

/// A component lies apart if its points would have to go so many times as far as it is large to end on another. It is also what a
/// component that vanishes costs, as a multiple of its size.
const APART: f64 = 4.0;

/// What a collapse would do to the faces about it.
#[derive(Debug, Default)]
pub(crate) struct Proposal {
    /// Faces that would be displaced, and how far they would then be.
    pub(crate) faces: Vec<(u32, Displacement)>,
    /// The price of what would vanish; 0 if nothing would.
    vanished: f64,
    /// What would vanish.
    pub(crate) remnant: Option<Remnant>,
    /// Where the faces that lose their area put their points; only where the fans do not lie over each other.
    pub(crate) handed: Vec<Handed>,
}

/// Points of a face that becomes the edge from v to `other`, or that is folded onto it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Handed {
    /// The face.
    pub(crate) from: u32,
    /// The face that has them after that; none if they vanish.
    pub(crate) to: Option<u32>,
    pub(crate) other: u16,
    /// u goes to the place of the edge that is so far from v.
    pub(crate) share: f64,
    /// Whether the points go on to an end of the edge.
    pub(crate) to_end: bool,
    /// The vertex of another component that they go on to from v.
    pub(crate) beyond: Option<u16>,
}

impl Proposal {
    /// The longest displacement.
    pub(crate) fn norm(&self) -> f64 {
        let squares = self.faces.iter().map(|(_, d)| d.norm_squared());
        let longest = squares.fold(0.0, |most: f64, square| if square > most { square } else { most });
        longest.sqrt().max(self.vanished)
    }

    /// Hands points over to a face; `before` is what the face has now.
    fn hand_over(&mut self, face: u32, before: &Displacement, points: &Displacement) {
        match self.faces.iter_mut().find(|(id, _)| *id == face) {
            Some((_, displacement)) => displacement.merge(points),
            None => {
                let mut all = *before;
                all.merge(points);
                self.faces.push((face, all));
            }
        }
    }
}

impl Decimator {
    /// Fills the proposal for u -> v, whose fan was classified last; returns the bound on the displacements, or none if a component
    /// would vanish that has to stay.
    pub(crate) fn propose(&mut self, patch: &Patch<'_>, fan: FanKind, u: u16, v: u16) -> Option<f64> {
        self.proposal.faces.clear();
        self.proposal.vanished = 0.0;
        self.proposal.remnant = None;
        self.proposal.handed.clear();
        let flattened = self.lay_over(patch, fan, u, v)
            && self.overlay.bound(&self.displacements, &mut self.proposal.faces);
        (flattened || self.sweep(patch, fan, u, v)).then(|| self.proposal.norm())
    }

    /// Fills the overlay with the loop about u, from v on. False if the fan has no such loop.
    fn lay_over(&mut self, patch: &Patch<'_>, fan: FanKind, u: u16, v: u16) -> bool {
        self.overlay.begin();
        let first = match fan {
            FanKind::Closed => v,
            FanKind::Open(first, last) if v == first || v == last => first,
            FanKind::Open(..) | FanKind::Broken => return false,
        };
        if fan != FanKind::Closed && v != first {
            self.overlay.push(v, NO_FACE);
        }
        let mut vertex = first;
        for _ in 0..self.fan.wings.len() {
            let Some((face, next)) = self.fan.after(vertex) else { return false };
            self.overlay.push(vertex, face);
            vertex = next;
        }
        if fan != FanKind::Closed && v == first {
            self.overlay.push(vertex, NO_FACE);
        }
        self.overlay.place(u, |w| to_f64(patch.positions[usize::from(w)]));
        true
    }

    /// The map that takes every face of u along, linearly, is valid for any fan; nothing goes farther than u. False if a component
    /// would vanish that has to stay.
    fn sweep(&mut self, patch: &Patch<'_>, fan: FanKind, u: u16, v: u16) -> bool {
        let position = |w: u16| to_f64(patch.positions[usize::from(w)]);
        let go = |from: Point3<f64>, to: Point3<f64>| Sweep::to_segment(from, to, to);
        let (step, share) = match fan {
            // A lone face is folded onto its opposite edge.
            FanKind::Open(first, last) if self.fan.wings.len() == 1 => {
                let step = Sweep::to_segment(position(u), position(first), position(last));
                (step, if v == first { step.share } else { 1.0 - step.share })
            }
            _ => (go(position(u), position(v)), 0.0),
        };
        let moved = |d: &Displacement| d.moved(step.lo, step.hi);
        for (&(a, b), &face) in self.fan.wings.iter().zip(&self.fan.faces) {
            if a != v && b != v {
                self.proposal.faces.push((face, moved(&self.displacements[face as usize])));
            }
        }
        // A face that loses its area becomes an edge from v. Its points go on with a face at that edge; if there is none, they go to one
        // of its ends and on with any face there; if there is none either, to v and from there to another component, or nowhere.
        let mut left_over = Displacement::EMPTY;
        for i in 0..self.fan.wings.len() {
            let (a, b) = self.fan.wings[i];
            if a != v && b != v {
                continue;
            }
            let w = if a == v { b } else { a };
            let points = moved(&self.displacements[self.fan.faces[i] as usize]);
            let (to_v, to_w) = (go(position(w), position(v)), go(position(v), position(w)));
            let receiver = self.receiver(u, v, w, true).or_else(|| self.receiver(u, v, w, false));
            let (to, end) = match receiver {
                Some((face, Via::Edge)) => (Some(face), None),
                Some((face, Via::Target)) => (Some(face), Some(to_v)),
                Some((face, Via::Other)) => (Some(face), Some(to_w)),
                None => (None, Some(to_v)),
            };
            let points = end.map_or(points, |end| points.moved(end.lo, end.hi));
            match to {
                Some(face) => self.proposal.hand_over(face, &self.displacements[face as usize], &points),
                // Another cluster may draw more of what hangs on here.
                None if patch.locked[usize::from(w)] => return false,
                None => left_over.merge(&points),
            }
            let from = self.fan.faces[i];
            self.proposal.handed.push(Handed {
                from,
                to,
                other: w,
                share,
                to_end: end.is_some(),
                beyond: None,
            });
        }
        left_over == Displacement::EMPTY || self.leave(patch, u, v, &left_over)
    }

    /// Takes the points that are left at v without a face to another component, or lets them vanish where all others lie apart. False
    /// if there is no other, or if v is not this patch's alone: what hangs on there may go on elsewhere.
    fn leave(&mut self, patch: &Patch<'_>, u: u16, v: u16, points: &Displacement) -> bool {
        if patch.locked[usize::from(v)] || !self.sides.is_empty() {
            return false;
        }
        let other = self.nearest.find(patch.positions, &mut self.adjacency, u, v);
        let Some((face, nearest)) = other else { return false };
        let way = self.offset(patch, v, nearest);
        let (size, moved) = (points.norm(), points.moved(way, way));
        if moved.norm() > APART * size {
            self.proposal.remnant = Some(Remnant::new(to_f64(patch.positions[usize::from(v)]), points));
            self.proposal.vanished = APART * size;
            return true;
        }
        self.proposal.hand_over(face, &self.displacements[face as usize], &moved);
        for handed in self.proposal.handed.iter_mut().filter(|handed| handed.to.is_none()) {
            (handed.to, handed.beyond) = (Some(face), Some(nearest));
        }
        true
    }

    /// Carries the looks on over the collapse u -> v that was proposed last and is about to be carried out.
    pub(crate) fn carry_looks(&mut self, u: u16, v: u16) {
        let looks = &mut self.looks;
        if looks.faces.is_empty() {
            return;
        }
        if self.overlay.is_laid() {
            looks.carry_over(&self.overlay, u, v);
            return;
        }
        // u goes to a place on the edge from v to another vertex.
        let to = |other: u16, share: f64| Place { old: (u, 0.0), new: [(other, share), (v, 0.0)], loss: 0.0 };
        let moved = looks.differences(u, v, &to(v, 0.0));
        for (&(a, b), &face) in self.fan.wings.iter().zip(&self.fan.faces) {
            if a != v && b != v {
                looks.sweep(face, moved, [v, a, b]);
            }
        }
        for handed in &self.proposal.handed {
            let mut moved = looks.differences(u, v, &to(handed.other, handed.share));
            if handed.to_end {
                let end = Place { old: (handed.other, 0.0), new: [(v, 0.0); 2], loss: 0.0 };
                moved = sum(moved, looks.differences(handed.other, v, &end));
            }
            if let Some(beyond) = handed.beyond {
                let there = Place { old: (v, 0.0), new: [(beyond, 0.0); 2], loss: 0.0 };
                moved = sum(moved, looks.differences(v, beyond, &there));
            }
            let corners =
                |face: u32| self.adjacency.faces[face as usize].corners.map(|w| if w == u { v } else { w });
            looks.hand_over(handed.from, moved, handed.to, handed.to.map_or([v; 3], corners));
        }
    }

    /// The face that gets the points on the edge from v to `w` once u has gone to v: one at the edge, else one at v, else one at
    /// `w`. With `own` only a face of a member that has u: others do not know of the collapse, nor of its error.
    fn receiver(&mut self, u: u16, v: u16, w: u16, own: bool) -> Option<(u32, Via)> {
        if let Some(face) = self.face_at(u, v, own, |corners| corners.contains(&w)) {
            return Some((face, Via::Edge));
        }
        if let Some(face) = self.face_at(u, v, own, |_| true) {
            return Some((face, Via::Target));
        }
        let (ids, faces) = self.adjacency.living(w);
        let is_other = |id: u32| {
            let corners = faces[id as usize].corners;
            !corners.contains(&u) && (!own || has_member_of(&self.sides, u, corners))
        };
        ids.iter().copied().find(|id| is_other(*id)).map(|face| (face, Via::Other))
    }

    /// A face that v has after the collapse of u, chosen by its corners before that.
    fn face_at(&mut self, u: u16, v: u16, own: bool, accept: impl Fn([u16; 3]) -> bool) -> Option<u32> {
        // Those of u are of its members.
        let wings = self.fan.wings.iter().zip(&self.fan.faces);
        let mut surviving = wings.filter(|((a, b), _)| *a != v && *b != v);
        if let Some((_, face)) = surviving.find(|((a, b), _)| accept([u, *a, *b])) {
            return Some(*face);
        }
        let (ids, faces) = self.adjacency.living(v);
        let is_one = |id: u32| {
            let corners = faces[id as usize].corners;
            !corners.contains(&u) && accept(corners) && (!own || has_member_of(&self.sides, u, corners))
        };
        ids.iter().copied().find(|id| is_one(*id))
    }
}

/// Rounded up.
fn sum(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [0, 1].map(|i| round_up(f64::from(a[i]) + f64::from(b[i])))
}

/// What a face that gets points has of the edge that they are on.
enum Via {
    /// All of it.
    Edge,
    /// Its end at v.
    Target,
    /// Its other end.
    Other,
}

/// Whether a member that has u may have the face: one that has all of its corners. `sides` is empty where there is but one.
fn has_member_of(sides: &[u8], u: u16, corners: [u16; 3]) -> bool {
    let common = |all: u8, corner: u16| all & sides[usize::from(corner)];
    sides.is_empty() || corners.into_iter().fold(sides[usize::from(u)], common) != 0
}
