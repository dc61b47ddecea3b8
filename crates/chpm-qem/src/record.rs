//! A collapse order as the file wants it: vertices renumbered so that every prefix of collapses leaves a prefix of vertices.

use crate::patch::{Collapse, Outcome, Patch};

/// The renumbering and the collapse order of one decimated patch; see `chpm_mesh::pm` for what the numbers mean.
#[derive(Debug, Default)]
pub struct Record {
    /// New to old vertex index: the survivors in their old order, then the collapsed ones, the first to go last.
    pub new_to_old: Vec<u16>,
    /// Old to new vertex index.
    pub old_to_new: Vec<u16>,
    /// New index of the vertex that `base_vertex_count + j` collapses to.
    pub targets: Vec<u16>,
    /// Error of the mesh of `base_vertex_count + j` vertices, object units.
    pub errors: Vec<f32>,
}

impl Record {
    /// Refills from what a decimation did.
    pub fn renumber(&mut self, patch: &Patch<'_>, outcome: &Outcome<'_>) {
        const GONE: u16 = u16::MAX;
        let vertex_count = patch.positions.len();
        self.old_to_new.clear();
        self.old_to_new.resize(vertex_count, 0);
        for collapse in outcome.collapses {
            self.old_to_new[usize::from(collapse.from)] = GONE;
        }
        self.new_to_old.clear();
        self.new_to_old.extend(
            (0..vertex_count as u32).map(|v| v as u16).filter(|&v| self.old_to_new[usize::from(v)] != GONE),
        );
        self.new_to_old.extend(outcome.collapses.iter().rev().map(|c| c.from));
        for (new, &old) in self.new_to_old.iter().enumerate() {
            self.old_to_new[usize::from(old)] = new as u16;
        }
        self.targets.clear();
        self.targets.extend(outcome.collapses.iter().rev().map(|c| self.old_to_new[usize::from(c.to)]));
        self.errors.clear();
        self.errors.extend(outcome.collapses.iter().rev().map(|c| c.error));
    }

    /// The collapses in the order in which they were carried out, of the patch's vertices.
    pub fn collapses(&self) -> impl Iterator<Item = Collapse> {
        let of_base = &self.new_to_old[..self.base_vertex_count()];
        let gone = self.new_to_old[of_base.len()..].iter();
        gone.zip(&self.targets).zip(&self.errors).rev().map(|((from, to), error)| Collapse {
            from: *from,
            to: self.new_to_old[usize::from(*to)],
            error: *error,
        })
    }

    /// Vertices that are left in the base mesh.
    pub fn base_vertex_count(&self) -> usize {
        self.new_to_old.len() - self.targets.len()
    }
}
