//! What has vanished from the clusters of a group, and how far that is from what they draw.
//!
//! A vertex of a position is drawn at every finer one, too, if triangles use it at the first: so gaps are found at two positions only, one
//! before anything vanishes and the base mesh. Vertices that other clusters share do not count, since a seam's collapses may
//! pass over a cluster's own triangles.

use super::working_set::WorkingSet;
use chpm_mesh::ProgressiveMesh;
use chpm_qem::{Outcome, Record, Remnant, gap, thin_out};

/// Most remnants that a cluster keeps apart: finding their gaps then takes a small part of the time that its collapses take.
const MOST: usize = 256;

/// The remnants of a cluster, while it is simplified.
#[derive(Debug, Default)]
pub(super) struct Vanished {
    /// What its children left, and then its own.
    all: Vec<Remnant>,
    below: usize,
    /// The error with which the first of its own came about; infinite if there are none.
    from: f32,
    /// The largest gap of the groups below.
    gap_below: f32,
    triangles: Vec<[u16; 3]>,
    drawn: Vec<bool>,
}

impl Vanished {
    /// Starts with nothing, as a leaf does.
    pub(super) fn clear(&mut self) {
        self.all.clear();
        (self.below, self.from, self.gap_below) = (0, f32::INFINITY, 0.0);
    }

    /// Takes in what a child has left, whose group has the given gap.
    pub(super) fn add_child(&mut self, remnants: &[u8], gap: f32) {
        let each = remnants.chunks_exact(size_of::<Remnant>());
        self.all.extend(each.map(bytemuck::pod_read_unaligned::<Remnant>));
        self.below = self.all.len();
        self.gap_below = self.gap_below.max(gap);
    }

    /// Takes in what a decimation left.
    pub(super) fn add_own(&mut self, outcome: &Outcome<'_>) {
        self.all.extend_from_slice(outcome.remnants);
        self.from = outcome.vanishing;
    }

    /// Follows the errors where they are lowered.
    pub(super) fn limit(&mut self, limited: impl Fn(f32) -> f32) {
        if self.from < f32::INFINITY {
            self.from = limited(self.from);
        }
    }

    /// The error with which something vanished first; infinite if nothing did.
    pub(super) fn from(&self) -> f32 {
        self.from
    }

    /// The gap of all remnants at the base mesh.
    pub(super) fn base_gap(&mut self, set: &WorkingSet, record: &Record) -> f32 {
        let base = record.base_vertex_count();
        self.gap(self.all.len(), set, record, base).max(self.gap_below)
    }

    /// The gap of what the children left, at all positions of an error below `from`.
    pub(super) fn fine_gap(&mut self, set: &WorkingSet, record: &Record, from: f32) -> f32 {
        let far = record.errors.iter().take_while(|error| **error >= from).count();
        self.gap(self.below, set, record, record.base_vertex_count() + far).max(self.gap_below)
    }

    /// The gap of the first `count` remnants at the position `n`.
    fn gap(&mut self, count: usize, set: &WorkingSet, record: &Record, n: usize) -> f32 {
        if count == 0 {
            return 0.0;
        }
        let mesh = ProgressiveMesh {
            vertex_count: set.vertices.positions.len(),
            base_vertex_count: record.base_vertex_count(),
            triangles: &set.triangles,
            targets: &record.targets,
        };
        self.triangles.clear();
        mesh.triangles_at(n, &mut self.triangles);
        self.drawn.clear();
        self.drawn.resize(n, false);
        self.triangles.as_flattened().iter().for_each(|v| self.drawn[usize::from(*v)] = true);
        let shared = set.shared.iter().map(|(vertex, _)| usize::from(*vertex));
        shared.take_while(|vertex| *vertex < n).for_each(|vertex| self.drawn[vertex] = false);
        let drawn = (0..n as u16).filter(|vertex| self.drawn[usize::from(*vertex)]);
        // It is infinite where other clusters have all that is left.
        gap(&self.all[..count], &set.vertices.positions, drawn).min(f32::MAX)
    }

    /// The remnants, as a parent reads them.
    pub(super) fn bytes(&mut self) -> &[u8] {
        thin_out(&mut self.all, MOST);
        bytemuck::cast_slice(&self.all)
    }
}
