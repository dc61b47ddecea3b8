//! Faces of a cluster and the faces about each vertex, in flat arrays that a collapse keeps up to date.

use crate::one_ring::MAX_SPINE;

/// A face: three local vertices and a flag.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Face {
    pub(crate) corners: [u16; 3],
    dead: u16,
}

impl Face {
    pub(crate) fn is_dead(&self) -> bool {
        self.dead != 0
    }

    /// A live face as seen from one of its corners; `None` where it is dead or has no such corner.
    fn wing(&self, face: u32, vertex: u16) -> Option<Wing> {
        let [x, y, z] = self.corners;
        let (a, b) = if x == vertex {
            (y, z)
        } else if y == vertex {
            (z, x)
        } else {
            (x, y)
        };
        (!self.is_dead()).then_some(Wing { face, a, b })
    }
}

/// A vertex of more faces is not kept up to date: it stays, and is seldom looked at.
pub(crate) const MANY: usize = 2 * MAX_SPINE;

/// A face of a vertex, and its two corners that follow the vertex in the face's winding.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Wing {
    pub(crate) face: u32,
    pub(crate) a: u16,
    pub(crate) b: u16,
}

impl Wing {
    #[inline]
    pub(crate) fn has(self, vertex: u16) -> bool {
        (self.a == vertex) | (self.b == vertex)
    }
}

/// Faces, and per vertex a slice of an arena of wings: those of its faces that are left. A collapse appends the merged slice of its
/// target and frees nothing: the arena grows by a handful of wings per collapse and is reused by the next cluster.
#[derive(Debug, Default)]
pub(crate) struct Adjacency {
    pub(crate) faces: Vec<Face>,
    slices: Vec<(u32, u32)>,
    arena: Vec<Wing>,
}

impl Adjacency {
    pub(crate) fn build(&mut self, vertex_count: usize, triangles: &[[u16; 3]]) {
        self.faces.clear();
        self.faces.extend(triangles.iter().map(|&corners| Face { corners, dead: 0 }));
        self.slices.clear();
        self.slices.resize(vertex_count, (0, 0));
        for corner in triangles.as_flattened() {
            self.slices[usize::from(*corner)].1 += 1;
        }

        let mut offset = 0;
        for slice in &mut self.slices {
            slice.0 = offset;
            offset += std::mem::take(&mut slice.1);
        }

        self.arena.clear();
        self.arena.resize(offset as usize, Wing::default());

        for (face, &[x, y, z]) in (0..).zip(triangles) {
            for (vertex, a, b) in [(x, y, z), (y, z, x), (z, x, y)] {
                let slice = &mut self.slices[usize::from(vertex)];
                self.arena[(slice.0 + slice.1) as usize] = Wing { face, a, b };
                slice.1 += 1;
            }
        }
    }

    /// How many faces there are about `vertex`; of very many, at most.
    #[inline]
    pub(crate) fn count(&self, vertex: u16) -> usize {
        self.slices[usize::from(vertex)].1 as usize
    }

    /// The faces about `vertex`, if they are not very many.
    #[inline]
    pub(crate) fn wings(&self, vertex: u16) -> &[Wing] {
        let (offset, count) = self.slices[usize::from(vertex)];
        &self.arena[offset as usize..(offset + count) as usize]
    }

    /// The faces about `vertex`, however many.
    pub(crate) fn all_wings(&self, vertex: u16) -> impl Iterator<Item = Wing> {
        self.wings(vertex)
            .iter()
            .filter_map(move |wing| self.faces[wing.face as usize].wing(wing.face, vertex))
    }

    /// Brings the faces of a vertex of very many up to date.
    fn refresh(&mut self, vertex: u16) {
        let (offset, count) = self.slices[usize::from(vertex)];
        if count as usize > MANY {
            let mut kept = offset;
            for i in offset..offset + count {
                let face = self.arena[i as usize].face;
                if let Some(wing) = self.faces[face as usize].wing(face, vertex) {
                    self.arena[kept as usize] = wing;
                    kept += 1;
                }
            }
            self.slices[usize::from(vertex)].1 = kept - offset;
        }
    }

    /// Moves the faces of `u` to `v`; those that hold both die. Returns how many died. In a closed fan each neighbour of u leads a
    /// wing.
    pub(crate) fn collapse(&mut self, u: u16, v: u16, closed: bool) -> usize {
        self.refresh(u);
        self.refresh(v);
        let merged = self.arena.len();
        let (v_offset, v_count) = self.slices[usize::from(v)];
        let (u_offset, u_count) = self.slices[usize::from(u)];

        // Which faces die cannot be foretold: all are written, and the next one takes the place of one that died.
        self.arena.resize(merged + (u_count + v_count) as usize, Wing::default());
        let (mut end, mut died) = (merged, 0);
        for i in u_offset..u_offset + u_count {
            let wing = self.arena[i as usize];
            let dies = wing.has(v);
            let face = &mut self.faces[wing.face as usize];
            face.dead |= u16::from(dies);
            face.corners = face.corners.map(|c| if c == u { v } else { c });
            died += usize::from(dies);
            self.arena[end] = wing;
            end += usize::from(!dies);
            self.rename(wing.a, u, v);
            if !closed {
                self.rename(wing.b, u, v);
            }
        }
        for i in u_offset..u_offset + u_count {
            let wing = self.arena[i as usize];
            if wing.has(v) {
                self.remove(wing.a ^ wing.b ^ v, wing.face);
            }
        }

        for i in v_offset..v_offset + v_count {
            let wing = self.arena[i as usize];
            self.arena[end] = wing;
            end += usize::from(!wing.has(u));
        }

        self.arena.truncate(end);
        self.slices[usize::from(v)] = (merged as u32, (end - merged) as u32);
        self.slices[usize::from(u)].1 = 0;
        died
    }

    /// Puts v in the place of u about another vertex.
    #[inline]
    fn rename(&mut self, vertex: u16, u: u16, v: u16) {
        let (offset, count) = self.slices[usize::from(vertex)];
        if vertex == v || count as usize > MANY {
            return;
        }
        for wing in &mut self.arena[offset as usize..(offset + count) as usize] {
            let renamed = |w: u16| if w == u { v } else { w };
            (wing.a, wing.b) = (renamed(wing.a), renamed(wing.b));
        }
    }

    /// Takes a face from those about another vertex; the others stay in their order.
    fn remove(&mut self, vertex: u16, face: u32) {
        let (offset, count) = &mut self.slices[usize::from(vertex)];
        if *count as usize > MANY {
            return;
        }
        let wings = &mut self.arena[*offset as usize..(*offset + *count) as usize];
        if let Some(at) = wings.iter().position(|wing| wing.face == face) {
            wings.copy_within(at + 1.., at);
            *count -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collapse_kills_the_shared_faces_and_hands_over_the_rest() {
        let mut adjacency = Adjacency::default();
        adjacency.build(5, &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
        let wing = |(face, a, b)| Wing { face, a, b };
        assert_eq!(adjacency.wings(4), [(0, 0, 1), (1, 1, 2), (2, 2, 3), (3, 3, 0)].map(wing));
        assert_eq!(adjacency.collapse(4, 0, true), 2);
        assert_eq!(adjacency.wings(0), [(1, 1, 2), (2, 2, 3)].map(wing));
        assert_eq!(adjacency.wings(4), []);
        assert_eq!(adjacency.wings(3), [wing((2, 0, 2))]);
        assert_eq!(adjacency.wings(2), [(1, 0, 1), (2, 3, 0)].map(wing));
        assert_eq!(adjacency.faces[1].corners, [1, 2, 0]);
        assert!(adjacency.faces[0].is_dead() && !adjacency.faces[2].is_dead());
    }

    /// Very many faces about one vertex are told as they are, though they are not kept up to date.
    #[test]
    fn a_vertex_of_very_many_faces_is_known_when_it_is_asked_for() {
        let count = MANY as u16 + 10;
        let triangles: Vec<_> = (1..=count).map(|i| [0, i, i % count + 1]).collect();
        let mut adjacency = Adjacency::default();
        adjacency.build(usize::from(count) + 1, &triangles);
        for u in (2..count).step_by(2) {
            assert_eq!(adjacency.collapse(u, u + 1, false), 1);
        }
        let wings: Vec<Wing> = adjacency.all_wings(0).collect();
        assert_eq!(wings.len(), usize::from(count / 2 + 1));
        assert!(wings.iter().all(|wing| wing.a % 2 == 1 || wing.a == count), "{wings:?}");
        assert_eq!(adjacency.collapse(0, 1, false), 2);
        assert_eq!(adjacency.count(1), usize::from(count / 2 - 1));
    }

    #[test]
    fn a_face_may_die_at_a_vertex_that_loses_all() {
        let mut adjacency = Adjacency::default();
        adjacency.build(4, &[[0, 1, 2], [0, 2, 3]]);
        assert_eq!(adjacency.collapse(1, 2, false), 1);
        assert_eq!(adjacency.collapse(3, 0, false), 1);
        assert_eq!([0, 1, 2, 3].map(|v| adjacency.count(v)), [0; 4]);
    }
}
