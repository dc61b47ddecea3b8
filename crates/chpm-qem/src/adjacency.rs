//! Faces of a cluster and the faces about each vertex, in flat arrays that a collapse updates by appending.

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

    /// The two corners that follow `vertex`, which is one of them, in the face's winding. Without a branch: which corner it is
    /// cannot be foreseen.
    #[inline]
    pub(crate) fn others(&self, vertex: u16) -> (u16, u16) {
        let [a, b, c] = self.corners;
        let (a, b, c) = (u64::from(a), u64::from(b), u64::from(c));
        let at = 16 * (u32::from(self.corners[1] == vertex) + 2 * u32::from(self.corners[2] == vertex));
        let (next, before) = (b | c << 16 | a << 32, c | a << 16 | b << 32);
        ((next >> at) as u16, (before >> at) as u16)
    }
}

/// Faces, and per vertex a slice of an arena of face ids. A collapse appends the merged slice of its target and frees
/// nothing: the arena grows by a handful of ids per collapse and is reused by the next cluster.
#[derive(Debug, Default)]
pub(crate) struct Adjacency {
    pub(crate) faces: Vec<Face>,
    slices: Vec<(u32, u32)>,
    arena: Vec<u32>,
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
        self.arena.resize(offset as usize, 0);
        for (id, triangle) in triangles.iter().enumerate() {
            for corner in triangle {
                let slice = &mut self.slices[usize::from(*corner)];
                self.arena[(slice.0 + slice.1) as usize] = id as u32;
                slice.1 += 1;
            }
        }
    }

    /// An upper bound of the living faces about `vertex`.
    #[inline]
    pub(crate) fn count(&self, vertex: u16) -> usize {
        self.slices[usize::from(vertex)].1 as usize
    }

    /// Drops dead faces from the slice of `vertex` and returns the living ones' ids, with all faces to look them up in.
    #[inline]
    pub(crate) fn living(&mut self, vertex: u16) -> (&[u32], &[Face]) {
        let (offset, count) = &mut self.slices[usize::from(vertex)];
        let slice = &mut self.arena[*offset as usize..(*offset + *count) as usize];
        let mut kept = 0;
        for i in 0..slice.len() {
            let id = slice[i];
            slice[kept] = id;
            kept += usize::from(!self.faces[id as usize].is_dead());
        }
        *count = kept as u32;
        (&slice[..kept], &self.faces)
    }

    /// Moves the faces of `u` to `v`; those that hold both die. Returns how many died.
    pub(crate) fn collapse(&mut self, u: u16, v: u16) -> usize {
        let merged = self.arena.len();
        let (v_offset, v_count) = self.slices[usize::from(v)];
        let (u_offset, u_count) = self.slices[usize::from(u)];
        let mut died = 0;
        for i in u_offset..u_offset + u_count {
            let id = self.arena[i as usize];
            let face = &mut self.faces[id as usize];
            if face.is_dead() {
                continue;
            }
            if face.corners.contains(&v) {
                face.dead = 1;
                died += 1;
            } else {
                face.corners = face.corners.map(|c| if c == u { v } else { c });
                self.arena.push(id);
            }
        }
        for i in v_offset..v_offset + v_count {
            let id = self.arena[i as usize];
            if !self.faces[id as usize].is_dead() {
                self.arena.push(id);
            }
        }
        self.slices[usize::from(v)] = (merged as u32, (self.arena.len() - merged) as u32);
        self.slices[usize::from(u)].1 = 0;
        died
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collapse_kills_the_shared_faces_and_hands_over_the_rest() {
        let mut adjacency = Adjacency::default();
        adjacency.build(5, &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
        assert_eq!(adjacency.living(4).0, [0, 1, 2, 3]);
        assert_eq!(adjacency.collapse(4, 0), 2);
        assert_eq!(adjacency.living(0).0, [1, 2]);
        assert_eq!(adjacency.living(4).0, []);
        assert_eq!(adjacency.living(3).0, [2]);
        assert_eq!(adjacency.faces[1].corners, [1, 2, 0]);
        assert_eq!([2, 3, 0].map(|v| adjacency.faces[2].others(v)), [(3, 0), (0, 2), (2, 3)]);
    }
}
