//! The borders inside a group: the members' union, in which the vertices that only members share may collapse.
//!
//! A collapse of a border is decided once, on the triangles of all members, and becomes one of the first collapses of each member that
//! has the vertex: so both sides of a group border always look the same, and the base meshes still fit together.

use super::working_set::WorkingSet;
use chpm_mesh::Vertices;
use chpm_qem::{
    AttributeErrors, BorderGoal, Collapse, Decimator, Deviation, Displacement, FaceAttributeError, Patch,
};

/// Scratch of the union.
#[derive(Debug, Default)]
pub(super) struct GroupBorder {
    vertices: Vertices,
    triangles: Vec<[u16; 3]>,
    locked: Vec<bool>,
    sides: Vec<u8>,
    /// Per member: the union's vertex of each local one, and the reverse.
    to_union: Vec<Vec<u16>>,
    to_local: Vec<Vec<u16>>,
    /// Shared id and vertex of the union, ascending.
    known: Vec<(u32, u16)>,
    /// Shared ids by vertex of the union.
    id_of: Vec<Option<u32>>,
    collapses: Vec<Collapse>,
    displacements: Vec<Displacement>,
    face_attribute_errors: Vec<FaceAttributeError>,
    /// The largest deviation that a collapse left.
    pub(super) deviation: Deviation,
    /// Per triangle of the union, the member's; the members' come one after another, and end at these places.
    triangle_of: Vec<u32>,
    ends: Vec<usize>,
    /// Vertices of one member that its triangles in the union use.
    used: Vec<bool>,
}

/// "The union does not have this vertex."
const NONE: u16 = u16::MAX;

/// Of so many vertices one at most is shared where borders are lines.
const MOSTLY_INNER: usize = 3;

impl GroupBorder {
    /// Simplifies the group borders of the members, up to the error that these come with: a group's error is never for its borders. What comes
    /// from the source has none; there a share of the vertices stays where `keep` of the triangles do. `inside` tells whether only members have a
    /// shared vertex. Answers false if the union is too large to be worked on.
    pub(super) fn simplify(
        &mut self,
        decimator: &mut Decimator,
        members: &[&WorkingSet],
        inside: impl Fn(u32) -> bool,
        keep: f64,
        min_error: f32,
    ) -> bool {
        self.collapses.clear();
        if !self.unite(members, inside) {
            return false;
        }
        let goal = match members.iter().all(|member| member.is_source) {
            true => {
                let sides = self.sides.iter().zip(&self.locked);
                let free = sides.filter(|(sides, locked)| sides.count_ones() > 1 && !**locked).count();
                BorderGoal::Vertices(free - (free as f64 * kept(members, keep)) as usize)
            }
            false => BorderGoal::Error(min_error),
        };

        let patch = Patch {
            positions: &self.vertices.positions,
            triangles: &self.triangles,
            displacements: &self.displacements,
            locked: &self.locked,
            attribute_errors: AttributeErrors::new(self.vertices.view(), &self.face_attribute_errors),
        };
        let outcome = decimator.decimate_group_border(&patch, &self.sides, goal, min_error);

        self.collapses.extend_from_slice(outcome.collapses);
        self.displacements.clear();
        self.displacements.extend_from_slice(decimator.displacements());
        self.face_attribute_errors.clear();
        self.face_attribute_errors.extend_from_slice(decimator.face_attribute_errors());
        self.deviation = decimator.deviation();
        true
    }

    /// Fills the union with the triangles that have a shared vertex: no others are about a vertex that may go, or that it may go
    /// to. Answers false if there are too many vertices.
    fn unite(&mut self, members: &[&WorkingSet], inside: impl Fn(u32) -> bool) -> bool {
        self.vertices.clear_vertices();
        self.triangles.clear();
        self.displacements.clear();
        self.face_attribute_errors.clear();
        self.triangle_of.clear();
        self.ends.clear();
        self.locked.clear();
        self.sides.clear();
        self.known.clear();
        self.id_of.clear();

        self.to_union.resize_with(members.len(), Vec::new);
        self.to_local.resize_with(members.len(), Vec::new);
        for (side, member) in members.iter().enumerate() {
            self.take_triangles(member);
            self.take_vertices(side, member, &inside);
            // The union takes 16-bit indices, too: where it does not fit, group borders stay as they are.
            if self.vertices.vertex_count() > usize::from(NONE) {
                return false;
            }

            let (start, to_union) = (self.ends.last().copied().unwrap_or(0), &self.to_union[side]);
            for triangle in &mut self.triangles[start..] {
                *triangle = triangle.map(|v| to_union[usize::from(v)]);
            }
            self.ends.push(self.triangles.len());
        }

        for (to_local, to_union) in self.to_local.iter_mut().zip(&self.to_union) {
            to_local.clear();
            to_local.resize(self.vertices.vertex_count(), NONE);
            for (local, union) in to_union.iter().enumerate().filter(|(_, union)| **union != NONE) {
                to_local[usize::from(*union)] = local as u16;
            }
        }
        true
    }

    /// Appends a member's triangles at shared vertices, with its own numbers of the vertices.
    fn take_triangles(&mut self, member: &WorkingSet) {
        self.used.clear();
        self.used.resize(member.vertices.vertex_count(), false);
        member.shared.iter().for_each(|(v, _)| self.used[usize::from(*v)] = true);
        let first = self.triangles.len();
        for (index, triangle) in member.triangles.iter().enumerate() {
            if triangle.iter().any(|v| self.used[usize::from(*v)]) {
                self.triangles.push(*triangle);
                self.triangle_of.push(index as u32);
                self.displacements.push(member.displacements.get(index).copied().unwrap_or_default());
                self.face_attribute_errors.extend(member.face_attribute_errors.get(index));
            }
        }
        for v in self.triangles[first..].as_flattened() {
            self.used[usize::from(*v)] = true;
        }
    }

    /// Appends the vertices that these use.
    fn take_vertices(&mut self, side: usize, member: &WorkingSet, inside: impl Fn(u32) -> bool) {
        let to_union = &mut self.to_union[side];
        to_union.clear();

        // A shared vertex is known from a member before this one, if at all: none has it twice.
        let mut shared = member.shared.iter().peekable();
        let before = self.known.len();
        let vertices = member.vertices.view();
        for vertex in 0..vertices.positions.len() {
            let id = shared.next_if(|(v, _)| usize::from(*v) == vertex).map(|(_, id)| *id);
            if !self.used[vertex] {
                to_union.push(NONE);
                continue;
            }

            let found = id.and_then(|id| self.known[..before].binary_search_by_key(&id, |k| k.0).ok());
            let union = match found {
                Some(known) => self.known[known].1,
                None => {
                    let fresh = self.vertices.vertex_count() as u16;
                    self.vertices.gather(vertices, std::iter::once(vertex));
                    self.sides.push(0);
                    self.id_of.push(id);
                    self.locked.push(id.is_some_and(|id| !inside(id)));
                    self.known.extend(id.map(|id| (id, fresh)));
                    fresh
                }
            };
            self.sides[usize::from(union)] |= 1 << side;
            to_union.push(union);
        }
        self.known.sort_unstable();
    }

    /// The group border's collapses as the given member carries them out.
    pub(super) fn collapses_of(&self, side: usize, out: &mut Vec<Collapse>) {
        out.clear();
        let local = &self.to_local[side];
        let own = self.collapses.iter().filter(|c| self.sides[usize::from(c.from)] >> side & 1 == 1);
        out.extend(own.map(|c| Collapse {
            from: local[usize::from(c.from)],
            to: local[usize::from(c.to)],
            error: c.error,
        }));
    }

    /// Gives the given member's triangles, those that are left, the displacements and attribute errors that they have after the group border's
    /// collapses.
    pub(super) fn hand_to(&self, side: usize, member: &mut WorkingSet) {
        member.displacements.resize(member.triangles.len(), Displacement::default());
        let start = if side == 0 { 0 } else { self.ends[side - 1] };
        for union in start..self.ends[side] {
            let own = self.triangle_of[union] as usize;
            member.displacements[own] = self.displacements[union];
            if let Some(look) = self.face_attribute_errors.get(union) {
                member.face_attribute_errors[own] = *look;
            }
        }
    }

    /// Ids of the shared vertices that collapsed.
    pub(super) fn removed(&self) -> impl Iterator<Item = u32> + '_ {
        self.collapses.iter().filter_map(|c| self.id_of[usize::from(c.from)])
    }
}

/// Share of the border vertices that stays where `keep` of the triangles do: that of a line on a surface; but where much of what there is is border, it loses
/// as much as all else.
fn kept(members: &[&WorkingSet], keep: f64) -> f64 {
    let shared: usize = members.iter().map(|member| member.shared.len()).sum();
    let all: usize = members.iter().map(|member| member.vertices.vertex_count()).sum();
    if MOSTLY_INNER * shared < all { keep.sqrt() } else { keep }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of a strip, and where its group border is half way up: there is a spike of another colour.
    const ROWS: u16 = 7;
    const SPIKE: u16 = 3;

    /// A strip on one side of the group border, two quads across.
    fn half(side: f32) -> WorkingSet {
        let mut set = WorkingSet::default();
        for row in 0..ROWS {
            for column in 0..3_u16 {
                let is_spike = (row, column) == (SPIKE, 0);
                set.vertices.positions.push([
                    side * f32::from(column),
                    row.into(),
                    if is_spike { 0.25 } else { 0.0 },
                ]);
                set.vertices.colors.push([if is_spike { 220 } else { 20 }; 4]);
            }
        }

        for corner in (0..ROWS - 1).flat_map(|row| [3 * row, 3 * row + 1]) {
            let [a, b, c, d] = [corner, corner + 1, corner + 4, corner + 3];
            set.triangles.extend([[a, b, c], [a, c, d]]);
        }
        if side < 0.0 {
            set.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        }

        set.shared = (0..ROWS).map(|row| (3 * row, row.into())).collect();
        set.is_source = true;
        AttributeErrors::new(set.vertices.view(), &[])
            .of_source(&set.triangles, &mut set.face_attribute_errors);
        set
    }

    /// Displacements that a group border's collapses leave are in both members: their own collapses go on from there.
    #[test]
    fn both_sides_are_told_how_far_their_faces_are() {
        let mut members = [half(-1.0), half(1.0)];
        let (mut group_border, mut decimator) = (GroupBorder::default(), Decimator::default());
        let [a, b] = &members;
        assert!(group_border.simplify(&mut decimator, &[a, b], |_| true, 0.0, 0.0));
        assert!(group_border.removed().any(|id| id == u32::from(SPIKE)), "the spike is gone");
        assert!(group_border.deviation.color >= 200.0);
        for (side, member) in members.iter_mut().enumerate() {
            let mut collapses = Vec::new();
            group_border.collapses_of(side, &mut collapses);
            assert!(collapses.iter().any(|collapse| collapse.from == 3 * SPIKE));
            group_border.hand_to(side, member);
            let color =
                member.face_attribute_errors.iter().map(|look| look.deviation().color).fold(0.0, f32::max);
            let error = member.displacements.iter().map(Displacement::error).fold(0.0, f32::max);
            assert!(color >= 200.0 && error > 0.0, "side {side}: {color} {error}");
            assert_eq!(member.face_attribute_errors.len(), member.triangles.len());
        }
    }
}
