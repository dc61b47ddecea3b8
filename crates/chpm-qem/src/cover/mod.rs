//! Errors of a progressive mesh found anew: at each collapse what it changes is held against a finer mesh of the same source, so that nothing adds up.
//!
//! Two things are kept true, each with an error `reached` that grows only. Every triangle of the reference is within it of the mesh: those that were held
//! against faces that a collapse takes away are held against those that are there afterwards. And every face is within it of the reference. Both are
//! found in [`pieces`], for most faces in [`chain`]. A collapse's error is the smaller of this and of what was composed.

mod chain;
#[cfg(test)]
mod exact;
mod pieces;
mod reference;
mod surfaces;
mod target;
mod tree;

use crate::adjacency::Adjacency;
use crate::patch::Collapse;
use chain::Chain;
use chpm_mesh::Aabb;
use chpm_mesh::geom::{round_up, to_f64};
use nalgebra::Point3;
use pieces::{Pieces, Served, Surface};
pub use reference::Reference;
use surfaces::{Few, Many, Own, Seen};
use target::{Target, meet};
use tree::BoxTree;

/// Share of the largest coordinate that rounding can hide, with much room.
const LOSS: f64 = 1.0 / (1u64 << 44) as f64;

/// Triangles over a face that take the time of a piece, and those that are only looked at.
const TRIANGLES: usize = 8;
const LOOKED_AT: usize = 128;

/// Faces that take the time of a piece.
const FACES: u64 = 16;

/// Errors composed grow by this factor before what could not be shown is tried again.
const AGAIN: f32 = 1.2;

/// A progressive mesh as it was decimated.
#[derive(Clone, Copy, Debug)]
pub struct Course<'a> {
    /// Vertices of the finest mesh, each at a vertex of the reference.
    pub positions: &'a [[f32; 3]],
    /// Triangles of the finest mesh.
    pub triangles: &'a [[u16; 3]],
    /// In the order in which they were carried out, with composed errors.
    pub collapses: &'a [Collapse],
}

/// How much time is taken.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Triangles of the reference for each of the first mesh that is held against it, at least: with few its own errors decide.
    pub ratio: usize,
    /// Pieces after which nothing more is found anew, about a microsecond each.
    pub pieces: u64,
}

/// Errors of the meshes that the collapses leave, none larger than the one that was composed: bounds as those are.
pub fn tightened(course: &Course<'_>, reference: &Reference, limits: Limits) -> Vec<f32> {
    let mut errors: Vec<f32> = course.collapses.iter().map(|collapse| collapse.error).collect();
    let mut cover = Cover::new(course, reference, limits);
    if !cover.is_complete() {
        return errors;
    }
    let mut last = 0.0_f32;
    for (collapse, error) in course.collapses.iter().zip(&mut errors) {
        cover.go_on(collapse);
        *error = cover.error().min(*error).max(last);
        last = *error;
    }
    errors
}

fn corners_of(reference: &Reference, triangle: u32) -> [Point3<f64>; 3] {
    reference.corners(triangle).map(to_f64)
}

struct Cover<'a> {
    course: &'a Course<'a>,
    reference: &'a Reference,
    mesh: Adjacency,
    /// Per face, where it is.
    targets: Vec<Target>,
    /// Per face, triangles of the reference that may be held against it.
    held: Vec<Vec<u32>>,
    /// Faces that are left.
    alive: usize,
    /// Whether triangles are held against the mesh yet.
    has_begun: bool,
    /// All that is held is within this; infinite once it is given up.
    reached: f64,
    /// Triangles of the reference that could not be shown to be as near as was composed, and the error at which that was tried.
    pending: Vec<u32>,
    tried_at: f32,
    loss: f64,
    pieces: Pieces,
    chain: Chain,
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
    /// A triangle of the reference near what was looked at last.
    hint: u32,
    reference_targets: Vec<Target>,
    /// The boxes around these.
    reference_boxes: Vec<Aabb>,
    reference_tree: BoxTree,
}

impl<'a> Cover<'a> {
    fn new(course: &'a Course<'a>, reference: &'a Reference, limits: Limits) -> Self {
        let mut mesh = Adjacency::default();
        mesh.build(course.positions.len(), course.triangles);
        let (faces, triangles) = (course.triangles.len(), reference.triangles.len());
        Cover {
            course,
            reference,
            mesh,
            targets: Vec::new(),
            held: vec![Vec::new(); faces],
            alive: faces,
            has_begun: false,
            reached: f64::INFINITY,
            pending: Vec::new(),
            tried_at: 0.0,
            loss: LOSS * reference.scale(),
            pieces: Pieces::default(),
            chain: Chain::default(),
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
            hint: 0,
            reference_targets: Vec::new(),
            reference_boxes: Vec::new(),
            reference_tree: BoxTree::default(),
        }
    }

    /// Whether the mesh's vertices are the reference's.
    fn is_complete(&self) -> bool {
        self.course.positions.iter().all(|place| self.reference.point_at(*place).is_some())
    }

    /// Bound on the error of the mesh; infinite where there is none.
    fn error(&self) -> f32 {
        if self.has_begun && self.pending.is_empty() {
            round_up(self.reached + self.loss)
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
        for face in &self.old {
            if self.mesh.faces[*face as usize].is_dead() {
                self.alive -= 1;
            }
        }

        if !self.has_begun {
            if self.limits.ratio * self.alive <= self.reference.triangles.len() {
                self.begin(error);
            }
            return;
        }
        self.change(error);
        if error > AGAIN * self.tried_at && !self.pending.is_empty() {
            self.try_again(error);
        }
        if self.pieces.count > self.limits.pieces {
            self.reached = f64::INFINITY;
        }
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
        self.reached = 0.0;
        self.tried_at = error;
        self.targets = (0..self.mesh.faces.len() as u32).map(|face| self.target(face)).collect();
        let alive: Vec<u32> = (0..self.targets.len() as u32).filter(|face| self.is_left(*face)).collect();
        let all = 0..self.reference.triangles.len() as u32;
        self.reference_targets =
            all.clone().map(|triangle| Target::new(corners_of(self.reference, triangle))).collect();
        self.reference_boxes =
            all.clone().map(|triangle| Aabb::of_points(&self.reference.corners(triangle))).collect();
        self.reference_tree = BoxTree::new(&self.reference_targets, all.collect());
        let Some(mut hint) = alive.first().copied() else {
            self.reached = f64::INFINITY;
            return;
        };
        let mut tree = BoxTree::new(&self.targets, alive.clone());

        for triangle in 0..self.reference.triangles.len() as u32 {
            let mut served = [(0, 0.0); 3];
            for (served, v) in served.iter_mut().zip(self.reference.triangles[triangle as usize]) {
                let known = &mut self.served[v as usize];
                if self.seen_points.at[v as usize] == 0 {
                    self.seen_points.at[v as usize] = 1;
                    let point = to_f64(self.reference.points[v as usize]);
                    let first = (hint, self.targets[hint as usize].squared(&point));
                    let (face, squared) = tree.nearest(&self.targets, &point, first);
                    *known = (face, squared.sqrt());
                }
                *served = *known;
                hint = known.0;
            }

            let beyond = f64::from(self.reference.errors[triangle as usize]);
            let mut many = Many { targets: &self.targets, tree: &mut tree, beyond };
            let corners = corners_of(self.reference, triangle);
            let far = self.pieces.reach(corners, served, self.reached, &mut many);
            self.take(triangle, far, error);
        }
        self.seen_points.turn = 1;
        alive.into_iter().for_each(|face| self.cover(face, error));
    }

    /// Notes how far a triangle is from the mesh, and which faces it was held against.
    fn take(&mut self, triangle: u32, far: f64, error: f32) {
        for face in &self.pieces.used {
            let held = &mut self.held[*face as usize];
            if held.last() != Some(&triangle) {
                held.push(triangle);
            }
        }
        if far > f64::from(error) {
            self.pending.push(triangle);
        } else {
            self.reached = self.reached.max(far);
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
        for vertex in &self.about {
            for wing in self.mesh.all_wings(*vertex) {
                if self.seen_faces.is_new(wing.face) {
                    self.near.push(wing.face);
                }
            }
        }

        self.seen_triangles.begin();
        self.again.clear();
        for face in &self.old {
            for triangle in self.held[*face as usize].drain(..) {
                if self.seen_triangles.is_new(triangle) {
                    self.again.push(triangle);
                }
            }
        }
        if !self.pending.is_empty() {
            let (pending, seen) = (&mut self.pending, &self.seen_triangles);
            pending.retain(|triangle| seen.at[*triangle as usize] != seen.turn);
        }
        for face in &self.near[changed..] {
            let seen = &self.seen_triangles;
            self.held[*face as usize].retain(|triangle| seen.at[*triangle as usize] != seen.turn);
        }
        let near = std::mem::take(&mut self.near);
        let again = std::mem::take(&mut self.again);
        self.seen_points.begin();
        for triangle in &again {
            self.hold(*triangle, &near, error);
        }
        (self.near, self.again) = (near, again);

        for i in 0..changed {
            self.cover(self.near[i], error);
        }
    }

    /// Holds a triangle of the reference against faces.
    fn hold(&mut self, triangle: u32, near: &[u32], error: f32) {
        let beyond = f64::from(self.reference.errors[triangle as usize]);
        let mut far = f64::INFINITY;
        if let Some(&first) = near.first() {
            let mut few = Few { targets: &self.targets, of: near, beyond };
            let mut served = [(0, 0.0); 3];
            for (served, v) in served.iter_mut().zip(self.reference.triangles[triangle as usize]) {
                let known = &mut self.served[v as usize];
                if self.seen_points.is_new(v) {
                    let point = to_f64(self.reference.points[v as usize]);
                    let (face, squared) =
                        few.nearest(&point, (first, self.targets[first as usize].squared(&point)));
                    *known = (face, squared.sqrt());
                }
                *served = *known;
            }
            let corners = corners_of(self.reference, triangle);
            far = self.pieces.reach(corners, served, self.reached, &mut few);
        }
        if far > f64::from(error) {
            far = self.hold_anywhere(triangle);
        }
        self.take(triangle, far, error);
    }

    /// Holds a triangle against the whole mesh.
    fn hold_anywhere(&mut self, triangle: u32) -> f64 {
        let beyond = f64::from(self.reference.errors[triangle as usize]);
        let all: Vec<u32> = (0..self.targets.len() as u32).filter(|face| self.is_left(*face)).collect();
        let Some(&first) = all.first() else {
            self.pieces.used.clear();
            return f64::INFINITY;
        };
        let corners = corners_of(self.reference, triangle);
        let mut few = Few { targets: &self.targets, of: &all, beyond };
        let served = corners.map(|point| {
            let (face, squared) = few.nearest(&point, (first, self.targets[first as usize].squared(&point)));
            (face, squared.sqrt())
        });
        let before = self.pieces.count;
        let far = self.pieces.reach(corners, served, self.reached, &mut few);
        // It is dear, and counts as what it takes.
        self.pieces.count += (3 + self.pieces.count - before) * all.len() as u64 / (4 * FACES);
        far
    }

    /// Holds a face against the reference: against what is over it, and the nearest where that is too high or is not shown to be over all of it.
    fn cover(&mut self, face: u32, error: f32) {
        self.gather(face);
        let corners = self.targets[face as usize].corners;
        let over =
            self.over.iter().map(|triangle| (*triangle, self.reference_targets[*triangle as usize].corners));
        self.pieces.count += (self.over.len() / TRIANGLES) as u64;
        let held = self.chain.hold(&corners, self.reference, over, self.reached, self.loss);
        let far = match held {
            Some(beyond) => {
                let parts = std::mem::take(&mut self.chain.steep);
                let far =
                    parts.iter().map(|part| self.hold_against_nearest(*part, self.reached - beyond) + beyond);
                let far = far.fold(0.0, f64::max);
                self.chain.steep = parts;
                far
            }
            None => self.hold_against_nearest(corners, self.reached),
        };
        // What was composed is a bound on it for as long as it is there.
        self.reached = self.reached.max(far.min(f64::from(error)));
    }

    /// Collects what may be over a face: triangles that are held against it and those around it.
    fn gather(&mut self, face: u32) {
        let around = self.targets[face as usize].aabb(self.reached);
        self.seen_triangles.begin();
        self.seen_faces.begin();
        self.over.clear();
        let mut visited = 0;
        for vertex in self.mesh.faces[face as usize].corners {
            for wing in self.mesh.all_wings(vertex) {
                visited += 1;
                if !self.seen_faces.is_new(wing.face) {
                    continue;
                }
                visited += self.held[wing.face as usize].len();
                let held = self.held[wing.face as usize].iter();
                for triangle in
                    held.filter(|triangle| meet(&self.reference_boxes[**triangle as usize], &around))
                {
                    if self.seen_triangles.is_new(*triangle) {
                        self.over.push(*triangle);
                    }
                }
            }
        }
        self.pieces.count += (visited / LOOKED_AT) as u64;
    }

    /// How far a face, or part of one, is from the nearest of the reference, at most; what is within `allowed` is not looked at more closely.
    fn hold_against_nearest(&mut self, corners: [Point3<f64>; 3], allowed: f64) -> f64 {
        let mut own = Own {
            targets: &self.reference_targets,
            tree: &mut self.reference_tree,
            errors: &self.reference.errors,
        };
        let served = corners.map(|point| {
            let near = own.targets[self.hint as usize].squared(&point);
            let (triangle, squared) = own.nearest(&point, (self.hint, near));
            self.hint = triangle;
            (triangle, squared.sqrt())
        });
        self.pieces.reach(corners, served, allowed, &mut own)
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
