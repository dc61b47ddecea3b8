//! The driver: half-edge collapses in order until half the triangles are gone.
//!
//! One heap entry per vertex, re-evaluated when it comes up: costs only go stale towards the cheap side often enough that a
//! stale entry is simply pushed back with its true cost. A guess from quadrics and displacements says how soon a vertex comes up; whether
//! it then goes is up to the bound on the displacement that its collapse would leave, for if that is too large the vertex is put
//! back by it.

use crate::adjacency::Adjacency;
use crate::attribute_error::{AttributeErrorTracker, Deviation, FaceAttributeError};
use crate::bound::{Bounder, Scene};
use crate::displacement::Displacement;
use crate::dropped::{DroppedComponent, LastFace};
use crate::forced::{self, Neighbors};
use crate::kept::Kept;
use crate::legality;
use crate::one_ring::{MAX_SPINE, MAX_VALENCE, OneRing, OneRingKind};
use crate::patch::{Collapse, Given, Outcome, Patch, Topology};
use crate::price::Prices;
use crate::queue::{Entry, Queue};
use crate::refusal::{Refusal, Refusals};
use crate::vertex_flags::VertexFlags;
use chpm_mesh::geom::round_up;

/// Once half of the vertices that a group border is to lose are gone, a collapse whose bound is so many times the error up to there is left to a
/// level on which it is cheap.
const STEEP: f64 = 4.0;

/// Share of a forced collapse's cost below which the quadric's says that the vertex would go for nothing if it could.
const HELD_BACK: f32 = 1e-6;

/// When a run has done enough.
#[derive(Clone, Copy, Debug)]
enum Goal {
    /// At most so many triangles are left.
    Triangles(usize),
    /// The group borders are simplified.
    GroupBorders(BorderGoal),
}

/// How far group borders are simplified.
#[derive(Clone, Copy, Debug)]
pub enum BorderGoal {
    /// Until so many vertices have gone; fewer if the last of them cost too much.
    Vertices(usize),
    /// As long as errors are at most this.
    Error(f32),
}

/// The kernel's scratch: give each thread its own and use it for cluster after cluster.
///
/// ```
/// use chpm_qem::{Decimator, Patch};
///
/// // A flat grid of 8 x 8 squares: its corners are all that it takes, without any error.
/// let grid = chpm_synth::hand::grid(8, 8);
/// let triangles: Vec<[u16; 3]> = grid.triangles.iter().map(|t| t.map(|v| v as u16)).collect();
/// let locked = vec![false; grid.positions.len()];
/// let patch = Patch { positions: &grid.positions, triangles: &triangles, locked: &locked, ..Patch::default() };
/// let mut decimator = Decimator::default();
/// let outcome = decimator.decimate(&patch, 2, 0.0);
/// assert_eq!(outcome.triangle_count, 2);
/// assert!(outcome.collapses.iter().all(|collapse| collapse.error < 1e-5));
/// ```
#[derive(Debug, Default)]
pub struct Decimator {
    /// Whether collapses may be forced.
    pub topology: Topology,
    /// Whether fewer bounds are found for the price of a somewhat worse order.
    pub hasty: bool,
    mesh: Adjacency,
    one_ring: OneRing,
    prices: Prices,
    bounder: Bounder,
    kept: Kept,
    neighbors: Neighbors,
    states: Vec<VertexFlags>,
    queue: Queue,
    /// Half-edges of the vertex that came up, by what they cost.
    candidates: Vec<(f32, u16)>,
    /// Per face, how far it is from the source surface.
    displacements: Vec<Displacement>,
    attribute_errors: AttributeErrorTracker,
    collapses: Vec<Collapse>,
    /// Dropped components, and the error when the first of them was dropped.
    dropped: Vec<DroppedComponent>,
    last_faces: Vec<LastFace>,
    vanishing: f32,
}

impl Decimator {
    /// Collapses until at most `target` triangles are left or nothing more can go. `min_error` is the error that the patch
    /// comes with; the errors of the collapses start from it.
    pub fn decimate(&mut self, patch: &Patch<'_>, target: usize, min_error: f32) -> Outcome<'_> {
        self.decimate_after(patch, &[], target, min_error)
    }

    /// The same after `group_border` collapses that were decided elsewhere, on the mesh of a whole group: they are carried out
    /// without a test and come first in the order. The vertices that they take away have to be locked.
    pub fn decimate_after(
        &mut self,
        patch: &Patch<'_>,
        group_border: &[Collapse],
        target: usize,
        min_error: f32,
    ) -> Outcome<'_> {
        let mut run = Run::begin(self, Given { patch, sides: &[] }, min_error);
        group_border.iter().for_each(|collapse| run.repeat(collapse));
        let stalled = run.until(Goal::Triangles(target));
        run.outcome(stalled)
    }

    /// Carries out again the first `collapses` of an earlier decimation of the same patch, of which the first `group_border` were decided elsewhere: what is left
    /// is what that decimation had then. That takes a small part of the time of finding them.
    pub fn decimate_again(
        &mut self,
        patch: &Patch<'_>,
        collapses: &[Collapse],
        group_border: usize,
        min_error: f32,
    ) -> Outcome<'_> {
        let mut run = Run::begin(self, Given { patch, sides: &[] }, min_error);
        let (group_border, own) = collapses.split_at(group_border);
        group_border.iter().for_each(|collapse| run.repeat(collapse));
        run.all.prices.set_displacements(&run.all.displacements);
        own.iter().for_each(|collapse| run.find_again(collapse));
        run.outcome(false)
    }

    /// Collapses vertices of the borders inside a group of clusters, whose union the patch is. `sides` has a bit for each member that has a
    /// vertex. A group border vertex has several and goes only to a vertex that all of its members have, so that each of them can carry out the
    /// same collapse.
    pub fn decimate_group_border(
        &mut self,
        patch: &Patch<'_>,
        sides: &[u8],
        goal: BorderGoal,
        min_error: f32,
    ) -> Outcome<'_> {
        let mut run = Run::begin(self, Given { patch, sides }, min_error);
        for (state, sides) in run.all.states.iter_mut().zip(sides) {
            if sides.count_ones() < 2 {
                state.set(VertexFlags::FIXED);
            }
        }
        let stalled = run.until(Goal::GroupBorders(goal));
        run.outcome(stalled)
    }

    /// Per face of the patch, how far it is from the source surface after the last decimation; of no meaning for faces that are gone.
    pub fn displacements(&self) -> &[Displacement] {
        &self.displacements
    }

    /// Per face of the patch, its attribute error after the last decimation; of no meaning for faces that are gone.
    /// Empty if the patch has no attributes.
    pub fn face_attribute_errors(&self) -> &[FaceAttributeError] {
        &self.attribute_errors.faces
    }

    /// The largest deviation of the attributes that a collapse of the last decimation left, at any step of it.
    pub fn deviation(&self) -> Deviation {
        self.attribute_errors.largest()
    }

    /// Whether a face of the patch is left after the last decimation.
    pub fn is_left(&self, face: usize) -> bool {
        !self.mesh.faces[face].is_dead()
    }

    /// The vertices of the patch that a face that is left has after the last decimation.
    pub fn corners(&self, face: usize) -> [u16; 3] {
        self.mesh.faces[face].corners
    }
}

/// One decimation.
struct Run<'a, 'd> {
    given: Given<'a>,
    all: &'d mut Decimator,
    /// Triangles that are left.
    alive: usize,
    /// The largest error so far.
    error: f32,
    /// Collapses that were forced.
    forced: usize,
    refusals: Refusals,
}

impl<'a, 'd> Run<'a, 'd> {
    fn begin(all: &'d mut Decimator, given: Given<'a>, min_error: f32) -> Self {
        let patch = given.patch;
        all.collapses.clear();
        all.dropped.clear();
        all.last_faces.clear();
        all.vanishing = f32::INFINITY;
        all.bounder.clear();
        all.kept.clear(patch.positions.len());
        all.mesh.build(patch.positions.len(), patch.triangles);
        all.one_ring.reset();
        all.prices.begin(patch, all.hasty);
        all.displacements.clear();
        all.displacements.extend_from_slice(patch.displacements);
        all.displacements.resize(patch.triangles.len(), Displacement::default());
        all.attribute_errors.begin(patch);
        let (alive, refusals) = (patch.triangles.len(), Refusals::default());
        let mut run = Run { given, all, alive, error: min_error, forced: 0, refusals };
        run.classify_vertices();
        run
    }

    fn outcome(self, stalled: bool) -> Outcome<'d> {
        Outcome {
            collapses: &self.all.collapses,
            triangle_count: self.alive,
            stalled,
            forced: self.forced,
            dropped: &self.all.dropped,
            last_faces: &self.all.last_faces,
            vanishing: self.all.vanishing,
            refusals: self.refusals,
        }
    }

    /// Sorts out who may collapse, and gives boundary edges their planes.
    fn classify_vertices(&mut self) {
        let Decimator { topology, mesh, one_ring, prices, states, .. } = &mut *self.all;
        states.clear();
        for vertex in 0..self.given.patch.positions.len() as u32 {
            let vertex = vertex as u16;
            let (count, locked) = (mesh.count(vertex), self.given.is_locked(vertex));
            let mut state = VertexFlags::default();
            if locked {
                state.set(VertexFlags::FIXED);
            }

            let mut stays = |refusal| {
                if !locked {
                    self.refusals.add(refusal);
                    state.set(VertexFlags::FIXED);
                }
            };

            if count > MAX_SPINE {
                stays(Refusal::Valence);
            } else if count > MAX_VALENCE
                || *topology == Topology::Keep
                || OneRing::may_be_open(mesh.wings(vertex))
            {
                let kind = one_ring.gather(mesh, vertex);
                prices.add_boundary(&self.given, one_ring);
                match kind {
                    OneRingKind::Closed | OneRingKind::Open(..) if count > MAX_VALENCE => {
                        stays(Refusal::Valence)
                    }
                    OneRingKind::Open(..) => state.set(VertexFlags::BOUNDARY),
                    OneRingKind::Broken if *topology == Topology::Keep => stays(Refusal::NonManifold),
                    OneRingKind::Closed | OneRingKind::Broken => {}
                }
            }

            states.push(state);
        }
    }

    /// Carries out a collapse that was decided elsewhere.
    fn repeat(&mut self, collapse: &Collapse) {
        let Collapse { from, to, error } = *collapse;
        self.all.prices.hand_on(from, to, self.given.offset(from, to));
        self.alive -= self.all.mesh.collapse(from, to, false);
        self.error = error;
        self.all.collapses.push(*collapse);
    }

    /// Carries out a collapse of an earlier run, which found it on the same mesh.
    fn find_again(&mut self, collapse: &Collapse) {
        let Collapse { from, to, error } = *collapse;
        let Decimator { mesh, one_ring, .. } = &mut *self.all;
        one_ring.gather(mesh, from);
        let is_legal = legality::check(&self.given, mesh, one_ring, to).is_ok();
        one_ring.turn_to(&self.given, to);
        self.forced += usize::from(!is_legal);
        let Some(bound) = self.propose(to) else { unreachable!("it was carried out") };
        self.carry_out(to, bound, 0.0);
        debug_assert_eq!(self.error, error, "it is the same mesh");
    }

    /// Begins anew with the quadrics of what is left.
    fn renew(&mut self) {
        let Decimator { mesh, one_ring, prices, states, kept, .. } = &mut *self.all;
        let left = mesh.faces.iter().filter(|face| !face.is_dead()).map(|face| face.corners);
        prices.renew(self.given.patch, left);
        kept.clear(self.given.patch.positions.len());
        for (vertex, state) in states.iter_mut().enumerate() {
            if state.is(VertexFlags::GONE) || mesh.count(vertex as u16) == 0 {
                continue;
            }
            state.drop(VertexFlags::OFFERED);
            state.drop(VertexFlags::WAITING);
            if state.is(VertexFlags::BOUNDARY) {
                one_ring.gather(mesh, vertex as u16);
                prices.add_boundary(&self.given, one_ring);
            }
        }
        self.fill_queue();
    }

    fn fill_queue(&mut self) {
        let Decimator { mesh, prices, states, queue, candidates, displacements, .. } = &mut *self.all;
        prices.set_displacements(displacements);
        queue.refill(|entries| {
            for (vertex, state) in states.iter_mut().enumerate() {
                if !state.is(VertexFlags::FIXED) && !state.is(VertexFlags::GONE) {
                    state.set(VertexFlags::STALE);
                    let (vertex, on_boundary) = (vertex as u16, state.is(VertexFlags::BOUNDARY));
                    let wings = mesh.wings(vertex);
                    let least = prices.half_edges(&self.given, vertex, wings, on_boundary, candidates);
                    entries.push(Entry::new(prices.guess(prices.displaced(wings), least), vertex));
                }
            }
        });
    }

    fn is_reached(&self, goal: Goal) -> bool {
        match goal {
            Goal::Triangles(target) => self.alive <= target,
            Goal::GroupBorders(BorderGoal::Vertices(count)) => self.all.collapses.len() >= count,
            Goal::GroupBorders(BorderGoal::Error(_)) => false,
        }
    }

    /// Collapses until the goal is reached; answers whether it stalled before.
    fn until(&mut self, goal: Goal) -> bool {
        self.fill_queue();
        let mut renewed = self.alive;
        while !self.is_reached(goal) {
            if !self.all.hasty && matches!(goal, Goal::Triangles(_)) && 7 * self.alive < 5 * renewed {
                renewed = self.alive;
                self.renew();
            }
            let Some(entry) = self.all.queue.pop() else { break };
            let u = entry.vertex();
            if entry.is_offer() {
                self.state(u).drop(VertexFlags::OFFERED);
            }
            let state = *self.state(u);
            if state.is(VertexFlags::GONE) || self.all.mesh.count(u) == 0 {
                continue;
            }

            // A vertex of a face that is all that is left of its component.
            if self.all.topology == Topology::Change
                && let Some(v) = forced::alone(&self.given, &self.all.mesh, u)
            {
                // Along neither of its two edges may it go: its component would vanish.
                (0..2).for_each(|_| self.refusals.add(Refusal::Component));
                self.state(u).set(VertexFlags::WAITING);
                self.all.one_ring.gather(&self.all.mesh, u);
                if !self.state(u).is(VertexFlags::OFFERED) && self.force(goal, v, None) {
                    break;
                }
                continue;
            }
            // It costs what it did when it was put back, and so the least of all.
            if entry.is_bound()
                && !state.is(VertexFlags::STALE)
                && let Some((v, bound)) = self.recall(u, entry.cost())
            {
                debug_assert!(self.all.prices.of_bound(bound) <= entry.cost(), "it costs what it did");
                if self.is_steep(goal, bound) {
                    break;
                }
                self.carry_out(v, bound, entry.cost());
                continue;
            }

            // What its half-edges would cost by the quadric alone. If that says that others come first, nothing more is looked
            // at.
            let all = &mut *self.all;
            let wings = all.mesh.wings(u);
            let on_boundary = state.is(VertexFlags::BOUNDARY);
            let least = all.prices.half_edges(&self.given, u, wings, on_boundary, &mut all.candidates);
            let next = all.queue.next_cost();
            // A price that a bound gave is right as long as nothing changes; any other is only as good as the guess.
            let guessed = !entry.is_offer() && (entry.is_guess() || state.is(VertexFlags::STALE));
            let displaced = if guessed { all.prices.displaced(wings) } else { 0.0 };
            if guessed {
                let due = all.prices.guess(displaced, least);
                if due > next {
                    all.queue.push(Entry::new(due, u));
                    continue;
                }
            }

            // The cheapest collapse that the legality tests leave, at the price of its bound, is carried out, or comes up again
            // at that price.
            let kind = all.one_ring.gather(&all.mesh, u);
            let locked = self.refusals.of(Refusal::LockedEdge);
            if let Some((cost, v)) = self.cheapest_legal() {
                let all = &mut *self.all;
                let due = all.prices.guess(displaced, cost);
                if guessed && due > next {
                    all.queue.push(Entry::new(due, u));
                    continue;
                }
                let Some(bound) = self.propose(v) else {
                    self.refuse(u);
                    continue;
                };
                let cost = cost.max(self.all.prices.of_bound(bound));
                if cost <= next && self.is_steep(goal, bound) {
                    break;
                }
                if cost > next {
                    self.state(u).drop(VertexFlags::STALE);
                    self.keep(u, v, bound, cost);
                    self.all.queue.push(Entry::bounded(cost, u));
                } else {
                    self.carry_out(v, bound, cost);
                }
                continue;
            }

            // Nothing is legal: it waits for a change nearby, or is offered at the price of force.
            self.state(u).set(VertexFlags::WAITING);
            // An offer that is in the queue already is looked at again when it comes up.
            if self.all.topology == Topology::Keep || self.state(u).is(VertexFlags::OFFERED) {
                continue;
            }
            let held = self.refusals.of(Refusal::LockedEdge) > locked
                || (!self.given.sides.is_empty() && kind != OneRingKind::Broken);
            let Decimator { neighbors, mesh, one_ring, .. } = &mut *self.all;
            let Some(v) = neighbors.nearest(&self.given, mesh, one_ring) else { continue };
            // What is flat and only held back by locks or a group border needs no force: on a higher level it will be free.
            if self.force(goal, v, held.then_some(least)) {
                break;
            }
        }
        !self.is_reached(goal)
    }

    /// Forces the gathered vertex to v if that costs least, or offers to do so at its price; answers whether it is too steep. If it is
    /// `held` back at a cost by its quadric that is next to nothing, neither is done.
    fn force(&mut self, goal: Goal, v: u16, held: Option<f32>) -> bool {
        let (u, next) = (self.all.one_ring.vertex(), self.all.queue.next_cost());
        self.all.one_ring.turn_to(&self.given, v);
        let Some(bound) = self.propose(v) else {
            self.refuse(u);
            return false;
        };

        let cost = self.all.prices.of_bound(bound);
        if held.is_some_and(|least| least < HELD_BACK * cost) {
            return false;
        }

        // It comes up again at its price.
        if cost > next {
            self.state(u).set(VertexFlags::OFFERED);
            self.all.queue.push(Entry::offer(cost, u));
            return false;
        }
        if self.is_steep(goal, bound) {
            return true;
        }

        self.forced += 1;
        self.carry_out(v, bound, cost);
        false
    }

    fn state(&mut self, vertex: u16) -> &mut VertexFlags {
        &mut self.all.states[usize::from(vertex)]
    }

    /// The bound of the collapse of the gathered vertex.
    fn propose(&mut self, v: u16) -> Option<f64> {
        let Decimator { mesh, one_ring, displacements, bounder, .. } = &mut *self.all;
        let alive = self.alive;
        bounder.propose(&Scene { given: &self.given, mesh, displacements, one_ring, alive }, v)
    }

    /// Keeps what was proposed last for when u comes up again, if that is all that there is to it.
    fn keep(&mut self, u: u16, v: u16, bound: f64, price: f32) {
        let Decimator { kept, bounder, attribute_errors, .. } = &mut *self.all;
        if !bounder.proposal.is_swept() && attribute_errors.is_empty() {
            kept.keep(u, v, bound, price, &bounder.proposal.faces);
        } else {
            kept.forget(u);
        }
    }

    /// Proposes what was kept of u at a price, about which nothing has changed, and answers with the bound. None if there is nothing,
    /// or if more has come to v than it may have.
    fn recall(&mut self, u: u16, price: f32) -> Option<(u16, f64)> {
        let Decimator { kept, mesh, one_ring, bounder, displacements: current, .. } = &mut *self.all;
        let (v, bound, displacements) = kept.at_price(u, price)?;
        one_ring.gather(mesh, u);
        legality::check_topology(&self.given, mesh, one_ring, v).ok()?;
        if cfg!(debug_assertions) {
            one_ring.turn_to(&self.given, v);
            let alive = self.alive;
            let scene = Scene { given: &self.given, mesh, displacements: current, one_ring, alive };
            // By another, so that what this one holds is the same without the test.
            let mut again = Bounder::default();
            assert_eq!(again.propose(&scene, v), Some(bound), "nothing has changed");
            assert_eq!(again.proposal.faces, displacements, "nothing has changed");
        }
        bounder.proposal.repeat(displacements);
        Some((v, bound))
    }

    /// A component would vanish that has to stay.
    fn refuse(&mut self, u: u16) {
        self.refusals.add(Refusal::Component);
        self.state(u).set(VertexFlags::WAITING);
    }

    /// Whether a collapse of a group border costs too much.
    fn is_steep(&self, goal: Goal, bound: f64) -> bool {
        match goal {
            Goal::Triangles(_) => false,
            Goal::GroupBorders(BorderGoal::Vertices(count)) => {
                let half = self.all.collapses.get(count / 2).map_or(0.0, |half| f64::from(half.error));
                half > 0.0 && bound > STEEP * half
            }
            Goal::GroupBorders(BorderGoal::Error(most)) => bound > most.into(),
        }
    }

    /// Carries out what was proposed last.
    fn carry_out(&mut self, v: u16, bound: f64, cost: f32) {
        let all = &mut *self.all;
        let u = all.one_ring.vertex();
        self.error = self.error.max(round_up(bound));
        for (face, displacement) in &all.bounder.proposal.faces {
            all.displacements[*face as usize] = *displacement;
            all.prices.set_displacement(*face, displacement);
        }
        if !all.attribute_errors.is_empty() {
            all.bounder.carry_attribute_errors(&all.mesh, &all.one_ring, v, &mut all.attribute_errors);
        }
        if let Some((dropped, last_face)) = all.bounder.proposal.dropped {
            all.dropped.push(dropped);
            all.last_faces.push(last_face);
            all.vanishing = all.vanishing.min(self.error);
        }
        if all.bounder.proposal.is_swept() {
            // Points may have gone on to a face that is not about u.
            for corner in
                all.bounder.proposal.faces.iter().flat_map(|(face, _)| all.mesh.faces[*face as usize].corners)
            {
                all.states[usize::from(corner)].set(VertexFlags::STALE);
            }
        }
        all.prices.hand_on(u, v, self.given.offset(u, v));
        let closed = all.one_ring.kind() == OneRingKind::Closed;
        self.alive -= all.mesh.collapse(u, v, closed);
        all.states[usize::from(u)].set(VertexFlags::GONE);
        all.collapses.push(Collapse { from: u, to: v, error: self.error });
        // Ring vertices that had no legal collapse are put back into the queue: the ring has changed.
        let wings = &all.one_ring.wings[..];
        let followers = if closed { &[] } else { wings };
        for w in wings.iter().map(|wing| wing.a).chain(followers.iter().map(|wing| wing.b)) {
            let state = &mut all.states[usize::from(w)];
            state.set(VertexFlags::STALE);
            if state.is(VertexFlags::WAITING) {
                state.drop(VertexFlags::WAITING);
                all.queue.push(Entry::new(cost, w));
            }
        }
    }

    /// The cheapest of the half-edges that may collapse.
    fn cheapest_legal(&mut self) -> Option<(f32, u16)> {
        let Decimator { mesh, one_ring, candidates, .. } = &mut *self.all;
        if one_ring.kind() == OneRingKind::Broken {
            candidates.drain(..).for_each(|_| self.refusals.add(Refusal::NonManifold));
        }
        fn rank(&(cost, v): &(f32, u16)) -> (u32, u16) {
            (cost.to_bits(), v)
        }
        while let Some(best) = (0..candidates.len()).min_by_key(|i| rank(&candidates[*i])) {
            let (cost, v) = candidates.swap_remove(best);
            match legality::check(&self.given, mesh, one_ring, v) {
                Ok(()) => return Some((cost, v)),
                Err(refusal) => self.refusals.add(refusal),
            }
        }
        None
    }
}
