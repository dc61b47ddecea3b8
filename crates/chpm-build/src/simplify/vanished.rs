//! Dropped components of a group's clusters, and how far they are from what is drawn.
//!
//! A vertex of a position is drawn at every finer one, too, if triangles use it at the first: so gaps are found at two positions only, one
//! before anything is dropped and the base mesh. Vertices that other clusters share do not count, since a group border's collapses may
//! pass over a cluster's own triangles.
//!
//! Where one triangle was left of a component, it is kept as a remnant, so that readers can draw it. Components without one count once more by themselves.

use super::lasting::Lasting;
use super::working_set::WorkingSet;
use chpm_mesh::ProgressiveMesh;
use chpm_qem::{DroppedComponent, LastFace, Outcome, Record, gap, thin_out};

/// Most dropped components that a cluster keeps apart: finding their gaps then takes a small part of the time that its collapses take.
const MOST: usize = 256;

/// Dropped components of a cluster, while it is simplified.
#[derive(Debug, Default)]
pub(super) struct Vanished {
    /// Components that its children dropped, and then its own.
    all: Vec<DroppedComponent>,
    below: usize,
    /// Those of them, likewise, that have no remnant.
    bare: Vec<DroppedComponent>,
    bare_below: usize,
    /// Its own, each with the place of the collapse by which it came about.
    own: Vec<(usize, DroppedComponent)>,
    /// Remnants of its own.
    lasting: Vec<Lasting>,
    /// The error with which the first of its own came about; infinite if there are none.
    from: f32,
    /// The largest gap of the groups below.
    gap_below: f32,
    /// The same of components without a remnant.
    rest_below: f32,
    triangles: Vec<[u16; 3]>,
    drawn: Vec<bool>,
}

impl Vanished {
    /// Starts with nothing, as a leaf does.
    pub(super) fn clear(&mut self) {
        self.all.clear();
        self.bare.clear();
        self.own.clear();
        self.lasting.clear();
        (self.below, self.bare_below, self.from) = (0, 0, f32::INFINITY);
        (self.gap_below, self.rest_below) = (0.0, 0.0);
    }

    /// Takes in what a child has left, the last `bare` of it without a remnant, whose group has the given gaps.
    pub(super) fn add_child(&mut self, dropped: &[u8], bare: u32, [gap, rest]: [f32; 2]) {
        let each = dropped.chunks_exact(size_of::<DroppedComponent>());
        let count = each.len() - bare as usize;
        let mut each = each.map(bytemuck::pod_read_unaligned::<DroppedComponent>);
        self.all.extend(each.by_ref().take(count));
        self.bare.extend(each);
        (self.below, self.bare_below) = (self.all.len(), self.bare.len());
        self.gap_below = self.gap_below.max(gap);
        self.rest_below = self.rest_below.max(rest);
    }

    /// Forgets what a decimation left.
    pub(super) fn forget_own(&mut self) {
        self.all.truncate(self.below);
        self.bare.truncate(self.bare_below);
        self.own.clear();
        self.lasting.clear();
        self.from = f32::INFINITY;
    }

    /// Takes in what a decimation left; `most` remnants of it.
    pub(super) fn add_own(&mut self, outcome: &Outcome<'_>, record: &Record, most: usize) {
        self.all.extend_from_slice(outcome.dropped);
        self.from = outcome.vanishing;
        for (ball, LastFace { vertex, bound }) in outcome.dropped.iter().zip(outcome.last_faces) {
            let vertex = u32::from(record.old_to_new[usize::from(*vertex)]);
            // The first collapse took the last vertex away.
            self.own.push((record.new_to_old.len() - 1 - vertex as usize, *ball));
            match bound.is_finite() {
                true => self.lasting.push(Lasting { ball: *ball, bound: *bound, vertex }),
                false => self.bare.push(*ball),
            }
        }
        // The largest are missed most.
        self.lasting.sort_unstable_by(|a, b| b.size().total_cmp(&a.size()).then(a.vertex.cmp(&b.vertex)));
        let beyond = self.lasting.drain(most.min(self.lasting.len())..);
        self.bare.extend(beyond.map(|lasting| lasting.ball));
    }

    /// Remnants of its own components.
    pub(super) fn lasting(&self) -> &[Lasting] {
        &self.lasting
    }

    /// Follows the errors where they are lowered.
    pub(super) fn limit(&mut self, limited: impl Fn(f32) -> f32) {
        if self.from < f32::INFINITY {
            self.from = limited(self.from);
        }
    }

    /// Leaves those without a remnant that may be farther from theirs than the mesh in which they are missing is allowed to be, once errors were lowered.
    pub(super) fn keep_within(&mut self, record: &Record) {
        let base = record.base_vertex_count();
        let beyond = |lasting: &mut Lasting| lasting.bound > record.errors[lasting.vertex as usize - base];
        self.bare.extend(self.lasting.extract_if(.., beyond).map(|lasting| lasting.ball));
    }

    /// Its own components, by the places of the collapses that dropped them, and those that its children did.
    pub(super) fn balls(&self) -> (&[(usize, DroppedComponent)], &[DroppedComponent]) {
        (&self.own, &self.all[..self.below])
    }

    /// The error with which something vanished first; infinite if nothing did.
    pub(super) fn from(&self) -> f32 {
        self.from
    }

    /// The gap of all dropped components at the base mesh.
    pub(super) fn base_gap(&mut self, set: &WorkingSet, record: &Record) -> f32 {
        let base = record.base_vertex_count();
        self.gap(Of::First(self.all.len()), set, record, base).max(self.gap_below)
    }

    /// The same of components without a remnant.
    pub(super) fn rest(&mut self, set: &WorkingSet, record: &Record) -> f32 {
        let base = record.base_vertex_count();
        self.gap(Of::Bare, set, record, base).max(self.rest_below)
    }

    /// The gap of what the children left, at all positions of an error below `from`.
    pub(super) fn fine_gap(&mut self, set: &WorkingSet, record: &Record, from: f32) -> f32 {
        let far = record.errors.iter().take_while(|error| **error >= from).count();
        self.gap(Of::First(self.below), set, record, record.base_vertex_count() + far).max(self.gap_below)
    }

    /// The gap of some of them at the position `n`.
    fn gap(&mut self, of: Of, set: &WorkingSet, record: &Record, n: usize) -> f32 {
        let missing = match of {
            Of::First(count) => &self.all[..count],
            Of::Bare => &self.bare,
        };
        if missing.is_empty() {
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
        gap(missing, &set.vertices.positions, drawn).min(f32::MAX)
    }

    /// The dropped components as a parent reads them, first all and then those without a remnant, and how many these are.
    pub(super) fn bytes(&mut self) -> (&[u8], u32) {
        thin_out(&mut self.all, MOST);
        thin_out(&mut self.bare, MOST);
        self.all.extend_from_slice(&self.bare);
        (bytemuck::cast_slice(&self.all), self.bare.len() as u32)
    }
}

/// Some of a cluster's dropped components.
#[derive(Clone, Copy)]
enum Of {
    /// The first ones.
    First(usize),
    /// Those without a remnant.
    Bare,
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_qem::Refusals;

    /// A ball as a child's page has it.
    fn ball(center: [f32; 3], radius: f32) -> Vec<u8> {
        let [x, y, z] = center;
        bytemuck::cast_slice(&[x, y, z, radius]).to_vec()
    }

    fn outcome(dropped: &[DroppedComponent], vanishing: f32) -> Outcome<'_> {
        Outcome {
            collapses: &[],
            triangle_count: 1,
            stalled: false,
            forced: 0,
            dropped,
            last_faces: &[],
            vanishing,
            refusals: Refusals::default(),
        }
    }

    /// A row of triangles between the vertices 0, 1, 2, 3 ... at these places, of which other clusters have some.
    fn row(places: &[f32], shared: &[u16]) -> WorkingSet {
        let mut set = WorkingSet::default();
        set.vertices.positions = places.iter().map(|x| [*x, 0.0, 0.0]).collect();
        set.triangles = (2..places.len() as u16).map(|v| [v - 2, v - 1, v]).collect();
        set.shared = shared.iter().map(|v| (*v, u32::from(*v))).collect();
        set
    }

    /// The last vertices go one after the other, each to the one before, with these errors from the finest on.
    fn record(count: u16, errors: &[f32]) -> Record {
        let base = count - errors.len() as u16;
        let all: Vec<u16> = (0..count).collect();
        let mut errors = errors.to_vec();
        errors.reverse();
        let targets = (base..count).map(|v| v - 1).collect();
        Record { new_to_old: all.clone(), old_to_new: all, targets, errors }
    }

    fn near(gap: f32, expected: f32) -> bool {
        (expected..expected * 1.0001).contains(&gap)
    }

    #[test]
    fn vertices_that_others_share_are_not_surely_drawn() {
        let mut vanished = Vanished::default();
        vanished.clear();
        vanished.add_child(&ball([0.0, 1.0, 0.0], 0.25), 0, [0.5, 0.0]);
        let gap = |vanished: &mut Vanished, shared: &[u16]| {
            vanished.base_gap(&row(&[0.0, 3.0, 7.0, 20.0], shared), &record(4, &[]))
        };
        assert!(near(gap(&mut vanished, &[]), 1.25));
        // The next that is this cluster's own.
        assert!(near(gap(&mut vanished, &[0]), 10.0_f32.sqrt() + 0.25));
        assert!(near(gap(&mut vanished, &[0, 1]), 50.0_f32.sqrt() + 0.25));
        assert_eq!(gap(&mut vanished, &[0, 1, 2, 3]), f32::MAX);
        // Nor is what no triangle uses.
        let mut set = row(&[0.0, 3.0, 7.0, 20.0], &[]);
        set.triangles.remove(0);
        assert!(near(vanished.base_gap(&set, &record(4, &[])), 10.0_f32.sqrt() + 0.25));
    }

    #[test]
    fn gaps_are_of_the_coarsest_mesh_that_they_are_told_for() {
        let mut vanished = Vanished::default();
        vanished.clear();
        vanished.add_child(&ball([9.0, 1.0, 0.0], 0.0), 0, [0.5, 0.0]);
        let own = bytemuck::pod_read_unaligned(&ball([40.0, 0.0, 0.0], 0.0));
        vanished.add_own(&outcome(&[own], 3.0), &Record::default(), 9);
        assert_eq!(vanished.from(), 3.0);
        // 9 goes with an error of 1, 5 with 3.
        let (set, record) = (row(&[0.0, 1.0, 2.0, 5.0, 9.0], &[]), record(5, &[1.0, 3.0]));
        assert!(near(vanished.base_gap(&set, &record), 38.0));
        // Below an error of 3 what the cluster itself has left is there, and 5 is drawn; below 1 all are.
        assert!(near(vanished.fine_gap(&set, &record, 3.0), 17.0_f32.sqrt()));
        assert!(near(vanished.fine_gap(&set, &record, 1.0), 1.0));
        // At least what is known from below.
        assert_eq!(Vanished { gap_below: 60.0, ..Vanished::default() }.base_gap(&set, &record), 60.0);
    }

    #[test]
    fn the_error_from_which_something_is_missing_follows_the_others() {
        let mut vanished = Vanished::default();
        vanished.clear();
        vanished.limit(|error| error.min(2.0));
        assert_eq!(vanished.from(), f32::INFINITY, "nothing is missing");
        vanished.add_own(&outcome(&[DroppedComponent::default()], 5.0), &Record::default(), 9);
        vanished.limit(|error| error.min(2.0));
        assert_eq!(vanished.from(), 2.0);
    }
}
