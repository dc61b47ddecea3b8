//! Surfaces that points and pieces are held against.

use super::pieces::Surface;
use super::target::Target;
use super::tree::BoxTree;
use nalgebra::Point3;

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

    fn nearest(&mut self, point: &Point3<f64>, mut best: (u32, f64)) -> (u32, f64) {
        for index in self.of {
            let target = &self.targets[*index as usize];
            if target.box_squared(point) < best.1 {
                let squared = target.squared(point);
                if squared < best.1 {
                    best = (*index, squared);
                }
            }
        }
        best
    }
}

/// Many faces, in a tree.
pub(super) struct Many<'a> {
    pub(super) targets: &'a [Target],
    pub(super) tree: &'a mut BoxTree,
    pub(super) beyond: f64,
}

impl Surface for Many<'_> {
    fn target(&self, index: u32) -> &Target {
        &self.targets[index as usize]
    }

    fn beyond(&self, _: u32) -> f64 {
        self.beyond
    }

    fn nearest(&mut self, point: &Point3<f64>, best: (u32, f64)) -> (u32, f64) {
        self.tree.nearest(self.targets, point, best)
    }
}

/// Triangles of the reference, each with its error.
pub(super) struct Own<'a> {
    pub(super) targets: &'a [Target],
    pub(super) tree: &'a mut BoxTree,
    pub(super) errors: &'a [f32],
}

impl Surface for Own<'_> {
    fn target(&self, index: u32) -> &Target {
        &self.targets[index as usize]
    }

    fn beyond(&self, index: u32) -> f64 {
        self.errors[index as usize].into()
    }

    fn nearest(&mut self, point: &Point3<f64>, best: (u32, f64)) -> (u32, f64) {
        self.tree.nearest(self.targets, point, best)
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
