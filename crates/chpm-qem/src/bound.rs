//! The displacements that a collapse would leave behind: what its error rests on. And, once it is carried out, the attribute errors.
//!
//! Where the last faces of a component go, their points go on with the nearest face of another, at the price of the way there; so pieces that
//! lie beside each other open no hole that the error does not tell. Only what lies apart, by many times its own size, vanishes at a
//! price by its size, and stays behind as a [`DroppedComponent`].

use crate::adjacency::{Adjacency, Wing};
use crate::attribute_error::AttributeErrorTracker;
use crate::displacement::{Displaced, Displacement};
use crate::dropped::{DroppedComponent, LastFace};
use crate::nearest::Nearest;
use crate::one_ring::{OneRing, OneRingKind};
use crate::overlay::{CellPoint, Overlay, Sweep};
use crate::patch::Given;
use chpm_mesh::geom::round_up;
use nalgebra::Point3;

/// A component lies apart if its points would have to go so many times as far as it is large to end on another. It is also what a
/// component that vanishes costs, as a multiple of its size.
const APART: f64 = 4.0;
/// A margin over a limit that no rounding explains.
const BEYOND: f64 = 1.000_001;

/// The effect of a collapse on the faces about it.
#[derive(Debug, Default)]
pub(crate) struct Proposal {
    /// Faces that would be displaced, and how far they would then be.
    pub(crate) faces: Vec<Displaced>,
    /// The price of what would vanish; 0 if nothing would.
    vanished: f64,
    /// The component that the collapse would drop, and what is left of it until then.
    pub(crate) dropped: Option<(DroppedComponent, LastFace)>,
    /// Where the faces that lose their area put their points; only where the one-rings do not lie over each other.
    handed: Vec<Handed>,
    /// Whether the map is that which is valid for any one-ring.
    swept: bool,
}

/// Points of a face that becomes the edge from v to `other`, or that is folded onto it.
#[derive(Clone, Copy, Debug)]
struct Handed {
    /// The face.
    from: u32,
    /// The face that has them after that; none if they vanish.
    to: Option<u32>,
    other: u16,
    /// u goes to the place of the edge that is so far from v.
    share: f64,
    /// Whether the points go on to an end of the edge.
    to_end: bool,
    /// The vertex of another component that they go on to from v.
    beyond: Option<u16>,
}

impl Proposal {
    fn clear(&mut self) {
        self.faces.clear();
        self.handed.clear();
        (self.vanished, self.dropped, self.swept) = (0.0, None, false);
    }

    /// Proposes again what one-rings that lie over each other gave.
    pub(crate) fn repeat(&mut self, faces: &[Displaced]) {
        self.clear();
        self.faces.extend_from_slice(faces);
    }

    /// Whether faces may be displaced that are not about u, or something would vanish.
    pub(crate) fn is_swept(&self) -> bool {
        self.swept
    }

    /// The longest displacement.
    fn norm(&self) -> f64 {
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

/// The inputs of a bound: a patch, its live faces with their displacements, and the one-ring of u.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) given: &'a Given<'a>,
    pub(crate) mesh: &'a Adjacency,
    pub(crate) displacements: &'a [Displacement],
    pub(crate) one_ring: &'a OneRing,
    /// Faces that are left.
    pub(crate) alive: usize,
}

/// Finds bounds, and keeps what the collapse that was looked at last would do.
#[derive(Debug, Default)]
pub(crate) struct Bounder {
    overlay: Overlay,
    pub(crate) proposal: Proposal,
    nearest: Nearest,
}

impl Bounder {
    /// Forgets the last patch.
    pub(crate) fn clear(&mut self) {
        self.nearest.clear();
    }

    /// Fills the proposal for u -> v; returns the bound on the displacements, or none if a component would vanish that has to stay.
    pub(crate) fn propose(&mut self, scene: &Scene<'_>, v: u16) -> Option<f64> {
        self.proposal.clear();
        let flattened = self.lay_over(scene, v);
        (flattened || self.sweep(scene, v)).then(|| self.proposal.norm())
    }

    /// Bounds the map between the one-rings that lie over each other. False if they do not.
    fn lay_over(&mut self, scene: &Scene<'_>, v: u16) -> bool {
        self.overlay.clear();
        match scene.one_ring.kind() {
            OneRingKind::Closed => {}
            OneRingKind::Open(first, last) if v == first || v == last => {}
            OneRingKind::Open(..) | OneRingKind::Broken => return false,
        }
        let Some(ring) = scene.one_ring.ring.seen_from(v) else { return false };
        self.overlay.bound(ring, scene.displacements, &mut self.proposal.faces)
    }

    /// The map that takes every face of u along, linearly, is valid for any one-ring; nothing goes farther than u. False if a component
    /// would vanish that has to stay.
    fn sweep(&mut self, scene: &Scene<'_>, v: u16) -> bool {
        let Scene { given, displacements, one_ring, .. } = *scene;
        self.proposal.swept = true;
        fn go(from: Point3<f64>, to: Point3<f64>) -> Sweep {
            Sweep::to_segment(from, to, to)
        }
        let u = one_ring.vertex();
        let (step, share) = match one_ring.kind() {
            // A lone face is folded onto its opposite edge.
            OneRingKind::Open(first, last) if one_ring.wings.len() == 1 => {
                let step = Sweep::to_segment(given.position(u), given.position(first), given.position(last));
                (step, if v == first { step.share } else { 1.0 - step.share })
            }
            _ => (go(given.position(u), given.position(v)), 0.0),
        };
        let moved = |face: u32| displacements[face as usize].moved(step.lo, step.hi);
        let surviving = one_ring.wings.iter().filter(|wing| !wing.has(v));
        self.proposal.faces.extend(surviving.map(|wing| (wing.face, moved(wing.face))));
        // A face that loses its area becomes an edge from v. Its points go on with a face at that edge; if there is none, they go to one
        // of its ends and on with any face there; if there is none either, to v and from there to another component, or nowhere.
        let mut left_over = Displacement::EMPTY;
        for wing in one_ring.wings.iter().filter(|wing| wing.has(v)) {
            let w = wing.a ^ wing.b ^ v;
            let points = moved(wing.face);
            let (to, end) = match receiver(scene, v, w) {
                Some((face, Via::Edge)) => (Some(face), None),
                Some((face, Via::Target)) => (Some(face), Some(go(given.position(w), given.position(v)))),
                Some((face, Via::Other)) => (Some(face), Some(go(given.position(v), given.position(w)))),
                None => (None, Some(go(given.position(w), given.position(v)))),
            };
            let points = end.map_or(points, |end| points.moved(end.lo, end.hi));
            match to {
                Some(face) => self.proposal.hand_over(face, &displacements[face as usize], &points),
                // Another cluster may draw more of what hangs on here.
                None if given.is_locked(w) => return false,
                None => left_over.merge(&points),
            }
            self.proposal.handed.push(Handed {
                from: wing.face,
                to,
                other: w,
                share,
                to_end: end.is_some(),
                beyond: None,
            });
        }
        left_over == Displacement::EMPTY || self.leave(scene, v, &left_over)
    }

    /// Takes the points that are left at v without a face to another component, or lets them vanish where all others lie apart. False
    /// if there is no other, or if v is not this patch's alone: what hangs on there may go on elsewhere.
    fn leave(&mut self, scene: &Scene<'_>, v: u16, points: &Displacement) -> bool {
        let Scene { given, mesh, displacements, one_ring, alive } = *scene;
        let is_last = alive <= one_ring.wings.len();
        if given.is_locked(v) || !given.sides.is_empty() || is_last {
            return false;
        }
        let size = points.norm();
        // Whatever is farther away than this lies apart: points go no less far than the way less their size.
        let reach = (APART + 1.0) * size * BEYOND;
        let within = (reach * reach).max(f64::MIN_POSITIVE);
        let beside = self.nearest.find(given.patch.positions, mesh, [one_ring.vertex(), v], within);
        let moved = beside.map(|(face, nearest)| {
            let way = given.offset(v, nearest);
            (face, nearest, points.moved(way, way))
        });
        let Some((face, nearest, moved)) = moved.filter(|(.., moved)| moved.norm() <= APART * size) else {
            let ball = DroppedComponent::new(given.position(v), points);
            self.proposal.dropped = Some((ball, self.last_face(scene)));
            self.proposal.vanished = APART * size;
            return true;
        };
        self.proposal.hand_over(face, &displacements[face as usize], &moved);
        for handed in self.proposal.handed.iter_mut().filter(|handed| handed.to.is_none()) {
            (handed.to, handed.beyond) = (Some(face), Some(nearest));
        }
        true
    }

    /// The last face of a component whose points all stay behind.
    fn last_face(&self, Scene { displacements, one_ring, .. }: &Scene<'_>) -> LastFace {
        let handed = &self.proposal.handed;
        let is_one = handed.len() == one_ring.wings.len()
            && handed.iter().all(|one| one.to.is_none() && one.other == handed[0].other);
        let bounds = handed.iter().map(|one| displacements[one.from as usize].error());
        let bound = if is_one { bounds.fold(0.0, f32::max) } else { f32::INFINITY };
        LastFace { vertex: one_ring.vertex(), bound }
    }

    /// Carries the attribute errors on over the collapse u -> v that was proposed last and is about to be carried out.
    pub(crate) fn carry_attribute_errors(
        &self,
        mesh: &Adjacency,
        one_ring: &OneRing,
        v: u16,
        attribute_errors: &mut AttributeErrorTracker,
    ) {
        let u = one_ring.vertex();
        if let Some(ring) = one_ring.ring.seen_from(v).filter(|_| self.overlay.is_laid()) {
            attribute_errors.carry_over(&self.overlay, ring, u, v);
            return;
        }
        // u goes to a place on the edge from v to another vertex.
        fn to(other: u16, share: f64, u: u16, v: u16) -> CellPoint {
            CellPoint { old: (u, 0.0), new: [(other, share), (v, 0.0)], loss: 0.0 }
        }
        let moved = attribute_errors.differences(u, v, &to(v, 0.0, u, v));
        for wing in one_ring.wings.iter().filter(|wing| !wing.has(v)) {
            attribute_errors.sweep(wing.face, moved, [v, wing.a, wing.b]);
        }
        for handed in &self.proposal.handed {
            let mut moved = attribute_errors.differences(u, v, &to(handed.other, handed.share, u, v));
            if handed.to_end {
                let end = CellPoint { old: (handed.other, 0.0), new: [(v, 0.0); 2], loss: 0.0 };
                moved = sum(moved, attribute_errors.differences(handed.other, v, &end));
            }
            if let Some(beyond) = handed.beyond {
                let there = CellPoint { old: (v, 0.0), new: [(beyond, 0.0); 2], loss: 0.0 };
                moved = sum(moved, attribute_errors.differences(v, beyond, &there));
            }
            let corners = |face: u32| mesh.faces[face as usize].corners.map(|w| if w == u { v } else { w });
            attribute_errors.hand_over(handed.from, moved, handed.to, handed.to.map_or([v; 3], corners));
        }
    }
}

/// Rounded up.
fn sum(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [0, 1].map(|i| round_up(f64::from(a[i]) + f64::from(b[i])))
}

/// The edge that hands points to a face, as that face has it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Via {
    /// All of it.
    Edge,
    /// Its end at v.
    Target,
    /// Its other end.
    Other,
}

/// The face that gets the points on the edge from v to `w` once u has gone to v: one at the edge, else one at v, else one at
/// `w`. One of a member that has u if there is any: others do not know of the collapse, nor of its error.
fn receiver(scene: &Scene<'_>, v: u16, w: u16) -> Option<(u32, Via)> {
    let Scene { given, mesh, one_ring, .. } = *scene;
    let u = one_ring.vertex();
    fn at_v(wing: &Wing, w: u16) -> Via {
        if wing.has(w) { Via::Edge } else { Via::Target }
    }
    let is_foreign = |corner: u16, wing: &Wing| !given.has_member_of(u, [corner, wing.a, wing.b]);
    let own = one_ring.wings.iter().filter(|wing| !wing.has(v)).map(|wing| (false, at_v(wing, w), wing.face));
    let beside = |corner: u16| mesh.all_wings(corner).filter(move |wing| !wing.has(u));
    let of_v = beside(v).map(|wing| (is_foreign(v, &wing), at_v(&wing, w), wing.face));
    let of_w = beside(w).map(|wing| (is_foreign(w, &wing), Via::Other, wing.face));
    let mut best: Option<(bool, Via, u32)> = None;
    for one in own.chain(of_v).chain(of_w) {
        let better = best.filter(|best| (best.0, best.1) <= (one.0, one.1)).unwrap_or(one);
        best = Some(better);
        // Nothing is better than an own face at the edge, and nothing at w is better than any other own face.
        if !better.0 && (better.1 == Via::Edge || one.1 == Via::Other) {
            break;
        }
    }
    best.map(|(_, via, face)| (face, via))
}
