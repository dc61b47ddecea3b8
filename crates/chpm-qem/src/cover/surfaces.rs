//! Surfaces that points and pieces are held against.

use super::CLOSE;
use super::pieces::Surface;
use super::target::Target;
use super::tree::{BoxTree, Search};
use nalgebra::Point3;

/// The square of the distance at which nothing nearer is looked for, where so much is allowed and this comes on top.
pub(super) fn enough(allowed: f64, beyond: f64) -> f64 {
    (CLOSE * allowed - beyond).max(0.0).powi(2)
}

/// Faces that a point is held against: a few, one after the other.
pub(super) struct Few<'a> {
    pub(super) targets: &'a [Target],
    pub(super) of: &'a [u32],
    pub(super) beyond: f64,
}

impl Surface for Few<'_> {
    fn target(&self, index: u32) -> &Target {
        &self.targets[index as usize]
    }

    fn beyond(&self, _: u32) -> f64 {
        self.beyond
    }

    fn nearest(&mut self, point: &Point3<f64>, best: (u32, f64)) -> (u32, f64) {
        self.of.iter().fold(best, |best, index| self.targets[*index as usize].nearer(*index, point, best))
    }
}

/// Many faces, in a tree.
pub(super) struct Many<'a> {
    pub(super) targets: &'a [Target],
    pub(super) tree: &'a BoxTree,
    pub(super) search: &'a mut Search,
    pub(super) beyond: f64,
    /// The square of a distance at which a nearer one is not looked for.
    pub(super) enough: f64,
}

impl Surface for Many<'_> {
    fn target(&self, index: u32) -> &Target {
        &self.targets[index as usize]
    }

    fn beyond(&self, _: u32) -> f64 {
        self.beyond
    }

    fn nearest(&mut self, point: &Point3<f64>, best: (u32, f64)) -> (u32, f64) {
        self.tree.nearest(self.targets, self.search, point, best, self.enough)
    }
}

/// Triangles of the reference, each with its error.
pub(super) struct Own<'a> {
    pub(super) targets: &'a [Target],
    pub(super) tree: &'a BoxTree,
    pub(super) search: &'a mut Search,
    pub(super) errors: &'a [f32],
    /// Likewise.
    pub(super) enough: f64,
}

impl Surface for Own<'_> {
    fn target(&self, index: u32) -> &Target {
        &self.targets[index as usize]
    }

    fn beyond(&self, index: u32) -> f64 {
        self.errors[index as usize].into()
    }

    fn nearest(&mut self, point: &Point3<f64>, best: (u32, f64)) -> (u32, f64) {
        self.tree.nearest(self.targets, self.search, point, best, self.enough)
    }
}

/// Items that have been seen since the last turn.
#[derive(Default)]
pub(super) struct Seen {
    pub(super) at: Vec<u32>,
    pub(super) turn: u32,
}

impl Seen {
    pub(super) fn of(count: usize) -> Self {
        Seen { at: vec![0; count], turn: 0 }
    }

    pub(super) fn begin(&mut self) {
        self.turn += 1;
    }

    /// Whether this is the first time since then.
    pub(super) fn is_new(&mut self, index: u32) -> bool {
        let at = &mut self.at[index as usize];
        let is_new = *at != self.turn;
        *at = self.turn;
        is_new
    }
}
