//! Errors of a progressive mesh found anew: at each collapse what it changes is held against a finer mesh of the same source, so that nothing adds up.
//!
//! Two things are kept true, each with an error `reached` that grows only. Every triangle of the reference is within it of the mesh: those that were held
//! against faces that a collapse takes away are held against those that are there afterwards ([`hold`]). And every face is within it of the reference ([`over`]). Both are
//! found in [`pieces`], for most faces in [`chain`]. A collapse's error is the smaller of this and of what was composed.

mod chain;
#[cfg(test)]
mod exact;
mod hold;
mod islands;
mod over;
mod pieces;
mod reference;
mod surfaces;
mod target;
mod tree;

use crate::adjacency::Adjacency;
use crate::dropped::DroppedComponent;
use crate::patch::Collapse;
use chain::Chain;
use chpm_mesh::geom::{round_up, to_f64};
use over::Luck;
use pieces::{Pieces, Served};
pub use reference::Reference;
use surfaces::Seen;
use target::Target;
use tree::{BoxTree, Search};

/// Share of the largest coordinate that rounding can hide, with much room.
const LOSS: f64 = 1.0 / (1u64 << 44) as f64;

/// Share of what is allowed at which nothing nearer is looked for.
const CLOSE: f64 = 0.7;

/// Share of the composed error that is allowed from the beginning: distances are seldom below a third of it.
const ALLOWED: f64 = 0.25;

/// Errors composed grow by this factor before what could not be shown is tried again.
const AGAIN: f32 = 1.2;

/// Nodes of a tree that take the time of a piece.
const SEEN: u64 = 128;

/// Faces that take the time of a piece.
const FACES: usize = 32;

/// A progressive mesh as it was decimated.
#[derive(Clone, Copy, Debug)]
pub struct Course<'a> {
    /// Vertices of the finest mesh, each at a vertex of the reference.
    pub positions: &'a [[f32; 3]],
    /// Triangles of the finest mesh.
    pub triangles: &'a [[u16; 3]],
    /// In the order in which they were carried out, with composed errors.
    pub collapses: &'a [Collapse],
    /// Balls that these leave behind, each with the place of the collapse, ascending.
    pub dropped: &'a [(usize, DroppedComponent)],
    /// Those that were left behind before, whatever the reference has of them.
    pub dropped_before: &'a [DroppedComponent],
}

/// How much time is taken.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Triangles of the reference for each of the first mesh that is held against it, at least: with few its own errors decide.
    pub ratio: usize,
    /// The same for the next reference, which serves from there on.
    pub next_ratio: usize,
    /// Pieces after which nothing more is found anew beside a reference, about a microsecond each.
    pub pieces: u64,
}

/// Errors of the meshes that the collapses leave, none larger than the one that was composed: bounds as those are, each by itself. They are found beside
/// the first of the references, the finest, until a mesh is coarse enough for the second.
pub fn tightened(course: &Course<'_>, references: &[Reference], limits: Limits) -> Vec<f32> {
    let composed = course.collapses.iter().map(|collapse| collapse.error);
    let [reference, coarser @ ..] = references else { return composed.collect() };
    let mut cover = Cover::new(course, reference, coarser, limits);
    let mut dropped = course.dropped.iter().peekable();
    let errors = course.collapses.iter().enumerate().map(|(place, collapse)| {
        if coarser.first().is_none_or(|next| limits.next_ratio * cover.alive > next.triangle_count()) {
            while let Some((_, ball)) = dropped.next_if(|(at, _)| *at == place) {
                // What is dropped is small beside what was composed, and has to be beside what is found.
                cover.floor = collapse.error;
                cover.balls.push(*ball);
            }
            cover.go_on(collapse);
            return cover.error().min(collapse.error);
        }
        collapse.error
    });
    errors.collect()
}

struct Cover<'a> {
    course: &'a Course<'a>,
    reference: &'a Reference,
    /// Those of fewer triangles, against which faces are held first.
    coarser: &'a [Reference],
    mesh: Adjacency,
    /// Per face, where it is.
    targets: Vec<Target>,
    /// Per face, triangles of the reference that are held against it, each with the turn in which it was; if it has had another since, it is no more.
    held: Vec<Vec<(u32, u32)>>,
    /// Per triangle of the reference, its turn, and one of the faces it is held against.
    turns: Vec<u32>,
    holders: Vec<u32>,
    /// Faces that are left.
    alive: usize,
    /// Whether triangles are held against the mesh yet.
    has_begun: bool,
    /// All that is held is within this; infinite once it is given up.
    reached: f64,
    /// Balls that were left behind, and the least that errors are for them.
    balls: Vec<DroppedComponent>,
    floor: f32,
    /// Triangles of the reference that could not be shown to be as near as was composed, and the error at which that was tried.
    pending: Vec<u32>,
    tried_at: f32,
    loss: f64,
    pieces: Pieces,
    chain: Chain,
    /// For each of the references.
    luck: Vec<Luck>,
    limits: Limits,
    seen_triangles: Seen,
    seen_faces: Seen,
    seen_points: Seen,
    /// Per point of the reference, the nearest face as last found.
    served: Vec<Served>,
    old: Vec<u32>,
    near: Vec<u32>,
    /// Triangles that may be over a face.
    over: Vec<u32>,
    about: Vec<u16>,
    again: Vec<u32>,
    /// The face that a triangle was held against last.
    holder: u32,
    /// A triangle of the reference near what was looked at last.
    hint: u32,
    search: Search,
}

impl<'a> Cover<'a> {
    fn new(
        course: &'a Course<'a>,
        reference: &'a Reference,
        coarser: &'a [Reference],
        limits: Limits,
    ) -> Self {
        let mut mesh = Adjacency::default();
        mesh.build(course.positions.len(), course.triangles);
        let (faces, triangles) = (course.triangles.len(), reference.triangle_count());
        Cover {
            course,
            reference,
            coarser,
            mesh,
            targets: Vec::new(),
            held: vec![Vec::new(); faces],
            turns: vec![0; triangles],
            holders: vec![u32::MAX; triangles],
            alive: faces,
            has_begun: false,
            reached: f64::INFINITY,
            balls: course.dropped_before.to_vec(),
            floor: 0.0,
            pending: Vec::new(),
            tried_at: 0.0,
            loss: LOSS * reference.scale(),
            pieces: Pieces::default(),
            chain: Chain::default(),
            luck: vec![Luck::default(); 1 + coarser.len()],
            limits,
            seen_triangles: Seen::of(triangles),
            seen_faces: Seen::of(faces),
            seen_points: Seen::of(reference.points.len()),
            served: vec![(0, 0.0); reference.points.len()],
            old: Vec::new(),
            near: Vec::new(),
            over: Vec::new(),
            about: Vec::new(),
            again: Vec::new(),
            holder: 0,
            hint: 0,
            search: Search::default(),
        }
    }

    /// Whether the mesh's vertices are the reference's.
    fn is_complete(&self) -> bool {
        self.course.positions.iter().all(|place| self.reference.point_at(*place).is_some())
    }

    /// Bound on the error of the mesh; infinite where there is none.
    fn error(&self) -> f32 {
        if self.has_begun && self.pending.is_empty() {
            round_up(self.reached + self.loss).max(self.floor)
        } else {
            f32::INFINITY
        }
    }

    /// Follows a collapse.
    fn go_on(&mut self, collapse: &Collapse) {
        let Collapse { from, to, error } = *collapse;
        if self.has_begun && self.reached == f64::INFINITY {
            return;
        }
        self.old.clear();
        self.about.clear();
        for wing in self.mesh.all_wings(from) {
            self.old.push(wing.face);
            self.about.extend([wing.a, wing.b]);
        }
        self.mesh.collapse(from, to, false);
        self.alive -= self.old.iter().filter(|face| !self.is_left(**face)).count();

        if self.has_begun {
            self.change(error);
            if error > AGAIN * self.tried_at && !self.pending.is_empty() {
                self.try_again(error);
            }
        } else if self.limits.ratio * self.alive <= self.reference.triangle_count() {
            self.begin(error);
        }
        if self.is_spent() {
            self.reached = f64::INFINITY;
        }
    }

    /// Whether so much was done that nothing more is.
    fn is_spent(&self) -> bool {
        self.pieces.count + self.search.seen / SEEN > self.limits.pieces
    }

    fn target(&self, face: u32) -> Target {
        let corners = self.mesh.faces[face as usize].corners;
        Target::new(corners.map(|v| to_f64(self.course.positions[usize::from(v)])))
    }

    fn is_left(&self, face: u32) -> bool {
        !self.mesh.faces[face as usize].is_dead()
    }

    /// Holds all of the reference against the mesh, and the mesh against it.
    fn begin(&mut self, error: f32) {
        self.has_begun = true;
        self.tried_at = error;
        self.targets = (0..self.mesh.faces.len() as u32).map(|face| self.target(face)).collect();
        let alive: Vec<u32> = (0..self.targets.len() as u32).filter(|face| self.is_left(*face)).collect();
        let Some(first) = alive.first().filter(|_| self.is_complete()) else { return };
        self.reached = ALLOWED * f64::from(error);
        self.holder = *first;

        let tree = BoxTree::new(&self.targets, alive.clone());
        self.seen_points.begin();
        for triangle in 0..self.reference.triangle_count() as u32 {
            if self.is_spent() {
                return;
            }
            self.hold_first(triangle, &tree, error);
        }
        for face in alive {
            if self.is_spent() {
                return;
            }
            self.cover(face, error);
        }
    }

    /// Holds what a collapse has changed.
    fn change(&mut self, error: f32) {
        // The faces about the vertex that went, as they are now, and those around them.
        self.seen_faces.begin();
        self.near.clear();
        for i in 0..self.old.len() {
            let face = self.old[i];
            self.targets[face as usize] = self.target(face);
            if self.is_left(face) && self.seen_faces.is_new(face) {
                self.near.push(face);
            }
        }
        let changed = self.near.len();
        let mut seen = 0;
        for vertex in &self.about {
            for wing in self.mesh.all_wings(*vertex) {
                seen += 1;
                if self.seen_faces.is_new(wing.face) {
                    self.near.push(wing.face);
                }
            }
        }

        self.pieces.count += seen / FACES as u64;
        self.seen_triangles.begin();
        self.again.clear();
        for face in &self.old {
            for (triangle, turn) in self.held[*face as usize].drain(..) {
                if turn == self.turns[triangle as usize] && self.seen_triangles.is_new(triangle) {
                    self.again.push(triangle);
                }
            }
        }
        if !self.pending.is_empty() {
            let (pending, seen) = (&mut self.pending, &self.seen_triangles);
            pending.retain(|triangle| seen.at[*triangle as usize] != seen.turn);
        }
        let near = std::mem::take(&mut self.near);
        let again = std::mem::take(&mut self.again);
        self.seen_points.begin();
        for triangle in &again {
            // It is given up, then.
            if self.is_spent() {
                break;
            }
            self.hold(*triangle, &near, error);
        }
        (self.near, self.again) = (near, again);

        for i in 0..changed {
            self.cover(self.near[i], error);
        }
    }

    fn try_again(&mut self, error: f32) {
        self.tried_at = error;
        let pending = std::mem::take(&mut self.pending);
        for triangle in pending {
            let far = self.hold_anywhere(triangle);
            self.take(triangle, far, error);
        }
    }
}
