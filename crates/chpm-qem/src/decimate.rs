//! The driver: half-edge collapses in order until half the triangles are gone.
//!
//! One heap entry per vertex, re-evaluated when it comes up: costs only go stale towards the cheap side often enough that a
//! stale entry is simply pushed back with its true cost. A guess from quadrics and displacements says how soon a vertex comes up; whether
//! it then goes is up to the bound on the displacement that its collapse would leave, for if that is too large the vertex is put
//! back by it.

use crate::adjacency::Adjacency;
use crate::bound::Proposal;
use crate::displacement::Displacement;
use crate::fan::{Fan, FanKind, MAX_SPINE, MAX_VALENCE};
use crate::look::{Deviation, FaceLook, LookTracker};
use crate::nearest::Nearest;
use crate::overlay::Overlay;
use crate::patch::{Collapse, Outcome, Patch, Topology};
use crate::quadric::Quadric;
use crate::queue::{Entry, Queue};
use crate::refusal::{Refusal, Refusals};
use crate::remnant::Remnant;
use chpm_mesh::Aabb;
use chpm_mesh::geom::{area_vector, round_up, to_f64};
use nalgebra::Vector3;

/// Weight of the squared edge length in the order of collapses, for a vertex of mean area. It decides between collapses that cost
/// the same, as in planes and along lines, in favour of the shorter edge and the smaller area; it is no part of an error. It stands for a distance of
/// a millionth of the edge, about what single precision rounds a plane by: with 1e-5 here, halves of mechanical parts had ten to
/// a hundred times the deviation.
const LENGTH_TERM: f64 = 1e-12;

/// Weight of the squared bound in the order of collapses. The bound holds what all collapses so far have done; the quadric only
/// the last ones, but it averages. With 0.3, 0.6 and 1, the stored errors of the first level of a scan were 1.55, 1.28 and 1.10 times the
/// measured ones, and the build took 1.1 and 1.2 times as long.
const BOUND_TERM: f64 = 1.0;

/// What a vertex costs until its bound is known, as a multiple of its quadric's cost and the squared displacement about it together:
/// the bound is seldom less than they are. When this was chosen, a CT scan took 3.1 bounds for each collapse without a guess (by the quadric's
/// cost alone), and with 1, 1.25 and 1.5 here 2.6, 2.1 and 1.7; the measured RMS of a level was larger by up to 0, 2 and 4 %.
const GUESS: f32 = 1.0;
const HASTY_GUESS: f32 = 1.25;

/// Seams are halved so that the next level has less to lock, which is worth something but not any error: once half of what was
/// asked for is done, a collapse whose bound is so many times the error up to there is left to a level on which it is cheap.
const STEEP: f64 = 4.0;

/// Share of a forced collapse's cost below which the quadric's says that the vertex would go for nothing if it could.
const HELD_BACK: f32 = 1e-6;

/// What a vertex may do. Collapses that pass the link test keep it as it is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum VertexKind {
    Interior,
    Boundary,
    /// Of no single fan: goes only by force.
    Broken,
    /// Locked or of too high a valence: stays.
    Fixed,
    /// Has collapsed.
    Gone,
}

/// When a run has done enough.
#[derive(Clone, Copy, Debug)]
enum Goal {
    /// At most so many triangles are left.
    Triangles(usize),
    /// So many collapses were carried out.
    Collapses(usize),
}

/// How far a run has come.
#[derive(Clone, Copy, Debug)]
struct Progress {
    /// Triangles that are left.
    alive: usize,
    /// The largest error so far.
    error: f32,
    /// Collapses that were forced.
    forced: usize,
}

/// The kernel's scratch: give each thread its own and use it for cluster after cluster.
#[derive(Debug, Default)]
pub struct Decimator {
    /// Whether collapses may be forced.
    pub topology: Topology,
    /// Whether fewer bounds are found for the price of a somewhat worse order.
    pub hasty: bool,
    pub(crate) adjacency: Adjacency,
    pub(crate) fan: Fan,
    pub(crate) quadrics: Vec<Quadric>,
    kinds: Vec<VertexKind>,
    /// Vertices that nothing legal could be done with when they came up.
    waiting: Vec<bool>,
    /// Vertices that are in the queue at the price of a forced collapse.
    offered: Vec<bool>,
    /// Vertices about which something has changed since their bound was found.
    stale: Vec<bool>,
    queue: Queue,
    /// Per face, how far it is from the source surface.
    pub(crate) displacements: Vec<Displacement>,
    pub(crate) overlay: Overlay,
    /// What the collapse that was looked at last would do.
    pub(crate) proposal: Proposal,
    pub(crate) looks: LookTracker,
    candidates: Vec<(f32, u16)>,
    /// Vertices about the one that may be forced, each with its number of faces.
    pub(crate) ring: Vec<(u16, u32)>,
    collapses: Vec<Collapse>,
    /// What has vanished, and the error when the first of it did.
    remnants: Vec<Remnant>,
    vanishing: f32,
    pub(crate) nearest: Nearest,
    /// Members that have a vertex, a bit each, while seams are decimated; else empty.
    pub(crate) sides: Vec<u8>,
    /// What costs are multiplied by so that they fit an f32 for a model of any size.
    pub(crate) cost_scale: f64,
    /// One over the area of the patch that falls to a vertex.
    per_mean_area: f64,
}

impl Decimator {
    /// Collapses until at most `target` triangles are left or nothing more can go. `min_error` is the error that the patch
    /// comes with; the errors of the collapses start from it.
    pub fn decimate(&mut self, patch: &Patch<'_>, target: usize, min_error: f32) -> Outcome<'_> {
        self.decimate_after(patch, &[], target, min_error)
    }

    /// The same after `seam` collapses that were decided elsewhere, on the mesh of a whole group: they are carried out
    /// without a test and come first in the order. The vertices that they take away have to be locked.
    pub fn decimate_after(
        &mut self,
        patch: &Patch<'_>,
        seam: &[Collapse],
        target: usize,
        min_error: f32,
    ) -> Outcome<'_> {
        self.sides.clear();
        let mut refusals = self.prepare(patch);
        let mut progress = Progress { alive: patch.triangles.len(), error: min_error, forced: 0 };
        for collapse in seam {
            let offset = self.offset(patch, collapse.from, collapse.to);
            let quadric = self.quadrics[usize::from(collapse.from)];
            self.quadrics[usize::from(collapse.to)].add_moved(&quadric, offset);
            progress.alive -= self.adjacency.collapse(collapse.from, collapse.to);
            progress.error = collapse.error;
            self.collapses.push(*collapse);
        }
        self.fill_queue(patch);
        let stalled = self.run(patch, Goal::Triangles(target), &mut progress, &mut refusals);
        self.outcome(progress, stalled, refusals)
    }

    /// Collapses at most `count` vertices of the seams of a group of clusters, whose union the patch is. `sides` has a bit for
    /// each member that has a vertex. A seam vertex has several and goes only to a vertex that all of its members have, so that
    /// each of them can carry out the same collapse.
    pub fn decimate_seams(
        &mut self,
        patch: &Patch<'_>,
        sides: &[u8],
        count: usize,
        min_error: f32,
    ) -> Outcome<'_> {
        self.sides.clear();
        self.sides.extend_from_slice(sides);
        let mut refusals = self.prepare(patch);
        for (kind, sides) in self.kinds.iter_mut().zip(sides) {
            if sides.count_ones() < 2 {
                *kind = VertexKind::Fixed;
            }
        }
        self.fill_queue(patch);
        let mut progress = Progress { alive: patch.triangles.len(), error: min_error, forced: 0 };
        let stalled = self.run(patch, Goal::Collapses(count), &mut progress, &mut refusals);
        self.outcome(progress, stalled, refusals)
    }

    fn outcome(&self, progress: Progress, stalled: bool, refusals: Refusals) -> Outcome<'_> {
        Outcome {
            collapses: &self.collapses,
            triangle_count: progress.alive,
            stalled,
            forced: progress.forced,
            remnants: &self.remnants,
            vanishing: self.vanishing,
            refusals,
        }
    }

    /// Per face of the patch, how far it is from the source surface after the last decimation; of no meaning for faces that are gone.
    pub fn displacements(&self) -> &[Displacement] {
        &self.displacements
    }

    /// Per face of the patch, how it looks beside the source after the last decimation; of no meaning for faces that are gone.
    /// Empty if the patch has no looks.
    pub fn face_looks(&self) -> &[FaceLook] {
        &self.looks.faces
    }

    /// The largest deviation of the attributes that a collapse of the last decimation left, at any step of it.
    pub fn deviation(&self) -> Deviation {
        self.looks.largest()
    }

    /// Whether a face of the patch is left after the last decimation.
    pub fn is_left(&self, face: usize) -> bool {
        !self.adjacency.faces[face].is_dead()
    }

    fn prepare(&mut self, patch: &Patch<'_>) -> Refusals {
        let mut refusals = Refusals::default();
        self.collapses.clear();
        self.remnants.clear();
        self.vanishing = f32::INFINITY;
        self.nearest.clear();
        self.cost_scale = cost_scale(patch.positions);
        self.adjacency.build(patch.positions.len(), patch.triangles);
        self.fan.reset(patch.positions.len());
        self.accumulate_quadrics(patch);
        let area: f64 = self.quadrics.iter().map(|q| q.area).sum();
        self.per_mean_area = if area > 0.0 { patch.positions.len() as f64 / area } else { 0.0 };
        self.displacements.clear();
        self.displacements.extend_from_slice(patch.displacements);
        self.displacements.resize(patch.triangles.len(), Displacement::default());
        self.looks.begin(patch);
        self.classify_vertices(patch, &mut refusals);
        refusals
    }

    fn accumulate_quadrics(&mut self, patch: &Patch<'_>) {
        self.quadrics.clear();
        self.quadrics.resize(patch.positions.len(), Quadric::default());
        for corners in patch.triangles {
            let [a, b, c] = corners.map(|v| patch.positions[usize::from(v)]);
            let normal = area_vector(a, b, c);
            for v in corners {
                self.quadrics[usize::from(*v)].add_face(normal);
            }
        }
    }

    /// Sorts out who may collapse, and gives boundary edges their planes.
    fn classify_vertices(&mut self, patch: &Patch<'_>, refusals: &mut Refusals) {
        self.kinds.clear();
        for vertex in 0..patch.positions.len() {
            let vertex = vertex as u16;
            let count = self.adjacency.count(vertex);
            if count > MAX_SPINE {
                if !patch.locked[usize::from(vertex)] {
                    refusals.add(Refusal::Valence);
                }
                self.kinds.push(VertexKind::Fixed);
                continue;
            }
            self.fan.gather(&mut self.adjacency, vertex);
            let fan = self.fan.classify();
            if let FanKind::Open(first, last) = fan {
                self.add_boundary_planes(patch, vertex, first, last);
            }
            self.kinds.push(match fan {
                _ if patch.locked[usize::from(vertex)] => VertexKind::Fixed,
                FanKind::Closed | FanKind::Open(..) if count > MAX_VALENCE => {
                    refusals.add(Refusal::Valence);
                    VertexKind::Fixed
                }
                FanKind::Closed => VertexKind::Interior,
                FanKind::Open(..) => VertexKind::Boundary,
                FanKind::Broken => {
                    refusals.add(Refusal::NonManifold);
                    if self.topology == Topology::Change { VertexKind::Broken } else { VertexKind::Fixed }
                }
            });
        }
    }

    fn add_boundary_planes(&mut self, patch: &Patch<'_>, vertex: u16, first: u16, last: u16) {
        let position = |v: u16| patch.positions[usize::from(v)];
        for &(a, b) in &self.fan.wings {
            let normal = area_vector(position(vertex), position(a), position(b));
            for end in [(a == first).then_some(a), (b == last).then_some(b)].into_iter().flatten() {
                let edge = to_f64(position(end)) - to_f64(position(vertex));
                self.quadrics[usize::from(vertex)].add_boundary(edge, normal);
            }
        }
    }

    fn fill_queue(&mut self, patch: &Patch<'_>) {
        self.waiting.clear();
        self.waiting.resize(patch.positions.len(), false);
        self.offered.clear();
        self.offered.resize(patch.positions.len(), false);
        self.stale.clear();
        self.stale.resize(patch.positions.len(), true);
        let mut queue = std::mem::take(&mut self.queue);
        queue.refill(|entries| {
            for vertex in 0..patch.positions.len() {
                if self.kinds[vertex] != VertexKind::Fixed {
                    let least = self.evaluate(patch, vertex as u16);
                    entries.push(Entry::new(self.guess(least), vertex as u16));
                }
            }
        });
        self.queue = queue;
    }

    /// Gathers the fan of `u` and its half-edges with their costs; answers the least cost. For a boundary vertex the inner
    /// edges are among them, so that the answer is a lower bound; the legality test sorts them out.
    fn evaluate(&mut self, patch: &Patch<'_>, u: u16) -> f32 {
        self.fan.gather(&mut self.adjacency, u);
        self.candidates.clear();
        let quadric = &self.quadrics[usize::from(u)];
        let length_term = LENGTH_TERM * quadric.area * self.per_mean_area;
        // Without area there is nothing to be far from.
        let per_area = if quadric.area > 0.0 { 1.0 / quadric.area } else { 0.0 };
        let origin = to_f64(patch.positions[usize::from(u)]);
        let scale = self.cost_scale;
        let candidate = |v: u16| {
            let d = to_f64(patch.positions[usize::from(v)]) - origin;
            let cost = quadric.at(d) * per_area + length_term * d.norm_squared();
            ((cost * scale) as f32, v)
        };
        let wings = &self.fan.wings;
        self.candidates.extend(wings.iter().map(|(a, _)| candidate(*a)));
        if self.kinds[usize::from(u)] == VertexKind::Boundary {
            // The fan is open: its last vertex follows in a wing but leads none.
            let last = wings.iter().find(|(_, b)| wings.iter().all(|(a, _)| a != b));
            self.candidates.extend(last.map(|(_, last)| candidate(*last)));
        }
        if let Some(own) = self.sides.get(usize::from(u)) {
            self.candidates.retain(|(_, v)| own & !self.sides[usize::from(*v)] == 0);
        }
        let costs = self.candidates.iter().map(|(cost, _)| *cost);
        costs.fold(f32::INFINITY, |least, cost| if cost < least { cost } else { least })
    }

    /// Answers whether it stalled.
    fn run(
        &mut self,
        patch: &Patch<'_>,
        goal: Goal,
        progress: &mut Progress,
        refusals: &mut Refusals,
    ) -> bool {
        let reached = |progress: &Progress, collapses: usize| match goal {
            Goal::Triangles(target) => progress.alive <= target,
            Goal::Collapses(count) => collapses >= count,
        };
        while !reached(progress, self.collapses.len()) {
            let Some(entry) = self.queue.pop() else { return true };
            let u = entry.vertex();
            if entry.is_offer() {
                self.offered[usize::from(u)] = false;
            }
            if self.kinds[usize::from(u)] == VertexKind::Gone {
                continue;
            }
            let least = self.evaluate(patch, u);
            let next = self.queue.next_cost();
            // A price that a bound gave is right as long as nothing changes; any other is only as good as the guess.
            let guessed = !entry.is_offer() && (entry.is_guess() || self.stale[usize::from(u)]);
            if guessed {
                let due = self.guess(least);
                if due > next {
                    self.queue.push(Entry::new(due, u));
                    continue;
                }
            }
            let fan = self.fan.classify();
            let locked = refusals.of(Refusal::LockedEdge);
            if let Some((cost, v)) = self.cheapest_legal(patch, fan, u, refusals) {
                let due = self.guess(cost);
                if guessed && due > next {
                    self.queue.push(Entry::new(due, u));
                    continue;
                }
                let Some(bound) = self.propose(patch, fan, u, v) else {
                    self.refuse(u, refusals);
                    continue;
                };
                let cost = cost.max(self.bound_cost(bound));
                if cost <= next && self.is_steep(goal, bound) {
                    return true;
                }
                if cost > next {
                    self.stale[usize::from(u)] = false;
                    self.queue.push(Entry::bounded(cost, u));
                } else {
                    self.carry_out(patch, u, v, bound, cost, progress);
                }
                continue;
            }
            self.waiting[usize::from(u)] = true;
            // An offer that is in the queue already is looked at again when it comes up.
            if self.offered[usize::from(u)] {
                continue;
            }
            let held = refusals.of(Refusal::LockedEdge) > locked
                || (!self.sides.is_empty() && fan != FanKind::Broken);
            if let Some(v) = self.nearest_forced(patch, u) {
                let Some(bound) = self.propose(patch, fan, u, v) else {
                    self.refuse(u, refusals);
                    continue;
                };
                let cost = self.bound_cost(bound);
                // What is flat and only held back by locks or a seam needs no force: on a higher level it will be free.
                if held && least < HELD_BACK * cost {
                    continue;
                }
                if cost <= next && self.is_steep(goal, bound) {
                    return true;
                }
                if cost <= next {
                    progress.forced += 1;
                    self.carry_out(patch, u, v, bound, cost, progress);
                } else {
                    self.offered[usize::from(u)] = true;
                    self.queue.push(Entry::offer(cost, u));
                }
            }
        }
        false
    }

    /// A component would vanish that has to stay.
    fn refuse(&mut self, u: u16, refusals: &mut Refusals) {
        refusals.add(Refusal::Component);
        self.waiting[usize::from(u)] = true;
    }

    /// Whether a collapse of a seam costs too much.
    fn is_steep(&self, goal: Goal, bound: f64) -> bool {
        let Goal::Collapses(count) = goal else { return false };
        let half = self.collapses.get(count / 2).map_or(0.0, |half| f64::from(half.error));
        half > 0.0 && bound > STEEP * half
    }

    /// What the gathered vertex will cost, whose least half-edge cost is given: its faces keep the displacement that they have.
    fn guess(&self, least: f32) -> f32 {
        let norms = self.fan.faces.iter().map(|face| self.displacements[*face as usize].norm_squared());
        let displaced = norms.fold(0.0, |most: f64, norm| if norm > most { norm } else { most });
        let factor = if self.hasty { HASTY_GUESS } else { GUESS };
        factor * (least + (BOUND_TERM * displaced * self.cost_scale) as f32)
    }

    fn bound_cost(&self, bound: f64) -> f32 {
        (BOUND_TERM * bound * bound * self.cost_scale) as f32
    }

    /// Carries out what was proposed last.
    fn carry_out(
        &mut self,
        patch: &Patch<'_>,
        u: u16,
        v: u16,
        bound: f64,
        cost: f32,
        progress: &mut Progress,
    ) {
        let (quadric, offset) = (self.quadrics[usize::from(u)], self.offset(patch, u, v));
        progress.error = progress.error.max(round_up(bound));
        for (face, displacement) in &self.proposal.faces {
            self.displacements[*face as usize] = *displacement;
        }
        self.carry_looks(u, v);
        if let Some(remnant) = self.proposal.remnant {
            self.remnants.push(remnant);
            self.vanishing = self.vanishing.min(progress.error);
        }
        self.quadrics[usize::from(v)].add_moved(&quadric, offset);
        progress.alive -= self.adjacency.collapse(u, v);
        self.kinds[usize::from(u)] = VertexKind::Gone;
        self.collapses.push(Collapse { from: u, to: v, error: progress.error });
        self.wake_ring(cost);
    }

    pub(crate) fn offset(&self, patch: &Patch<'_>, u: u16, v: u16) -> Vector3<f64> {
        to_f64(patch.positions[usize::from(v)]) - to_f64(patch.positions[usize::from(u)])
    }

    /// Puts ring vertices that had no legal collapse back into the queue: the ring has changed.
    fn wake_ring(&mut self, cost: f32) {
        for i in 0..self.fan.wings.len() {
            let (a, b) = self.fan.wings[i];
            for w in [a, b] {
                self.stale[usize::from(w)] = true;
                let waited = std::mem::take(&mut self.waiting[usize::from(w)]);
                if waited && self.kinds[usize::from(w)] != VertexKind::Gone {
                    self.queue.push(Entry::new(cost, w));
                }
            }
        }
    }

    /// The cheapest of the evaluated half-edges that may collapse.
    fn cheapest_legal(
        &mut self,
        patch: &Patch<'_>,
        fan: FanKind,
        u: u16,
        refusals: &mut Refusals,
    ) -> Option<(f32, u16)> {
        if fan == FanKind::Broken {
            self.candidates.drain(..).for_each(|_| refusals.add(Refusal::NonManifold));
        }
        while let Some(best) = (0..self.candidates.len()).min_by(|&i, &j| {
            self.candidates[i]
                .0
                .total_cmp(&self.candidates[j].0)
                .then(self.candidates[i].1.cmp(&self.candidates[j].1))
        }) {
            let (cost, v) = self.candidates.swap_remove(best);
            match self.check(patch, fan, u, v) {
                Ok(()) => return Some((cost, v)),
                Err(refusal) => refusals.add(refusal),
            }
        }
        None
    }
}

/// A power of two, so that scaling loses nothing: costs grow with the square of a length.
fn cost_scale(positions: &[[f32; 3]]) -> f64 {
    let size = Aabb::of_points(positions).diagonal().clamp(f64::exp2(-150.0), f64::exp2(130.0));
    f64::exp2(-2.0 * size.log2().floor())
}
