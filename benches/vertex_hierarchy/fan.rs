//! A manifold mesh as faces that know their neighbours; a vertex's faces are found by turning about it.

use chpm_mesh::TriMesh;

/// No face, no vertex, no split.
pub(crate) const NONE: u32 = u32::MAX;

/// Corners of every face, and the faces across its edges: edge `i` leads from corner `i` to the next one. A face that is not
/// there has [`NONE`] as its first corner.
#[derive(Clone, Debug, Default)]
pub(crate) struct Faces {
    pub(crate) corners: Vec<[u32; 3]>,
    pub(crate) across: Vec<[u32; 3]>,
}

impl Faces {
    /// Faces of a mesh in which every edge belongs to at most two faces, once in each direction.
    pub(crate) fn new(mesh: &TriMesh) -> anyhow::Result<Self> {
        let mut edges: Vec<([u32; 2], u32, bool)> = Vec::with_capacity(3 * mesh.triangles.len());
        for (face, corners) in (0..).zip(&mesh.triangles) {
            for i in 0..3 {
                let (a, b) = (corners[i], corners[(i + 1) % 3]);
                anyhow::ensure!(a != b, "triangle {face} names vertex {a} twice");
                edges.push(([a.min(b), a.max(b)], 3 * face + i as u32, a < b));
            }
        }
        edges.sort_unstable();
        let mut across = vec![[NONE; 3]; mesh.triangles.len()];
        for edge in edges.chunk_by(|one, other| one.0 == other.0) {
            match *edge {
                [_] => {}
                [(_, one, up), (_, other, along)] if up != along => {
                    across.as_flattened_mut()[one as usize] = other / 3;
                    across.as_flattened_mut()[other as usize] = one / 3;
                }
                _ => anyhow::bail!("the mesh is not manifold at the edge {:?}", edge[0].0),
            }
        }
        Ok(Faces { corners: mesh.triangles.clone(), across })
    }

    /// Whether the face is there.
    pub(crate) fn is_active(&self, face: u32) -> bool {
        self.corners[face as usize][0] != NONE
    }

    /// Which corner of a face a vertex is.
    pub(crate) fn corner(&self, face: u32, vertex: u32) -> usize {
        let corners = self.corners[face as usize];
        corners
            .iter()
            .position(|v| *v == vertex)
            .unwrap_or_else(|| panic!("{vertex} is no corner of {corners:?}"))
    }

    /// The next face about a vertex, against the clock seen from outside.
    pub(crate) fn ccw(&self, face: u32, vertex: u32) -> u32 {
        self.across[face as usize][(self.corner(face, vertex) + 2) % 3]
    }

    /// The face before.
    pub(crate) fn cw(&self, face: u32, vertex: u32) -> u32 {
        self.across[face as usize][self.corner(face, vertex)]
    }

    /// Replaces the neighbour of `face` across its edge `edge`; no face has none.
    pub(crate) fn join(&mut self, face: u32, edge: usize, other: u32) {
        if face != NONE {
            self.across[face as usize][edge] = other;
        }
    }

    /// The edge of `face` that leads to `other`.
    pub(crate) fn edge_to(&self, face: u32, other: u32) -> usize {
        let across = self.across[face as usize];
        across.iter().position(|f| *f == other).unwrap_or_else(|| panic!("{face} has no neighbour {other}"))
    }
}

/// The faces about a vertex, in turn, and the vertices around it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fan {
    pub(crate) faces: Vec<u32>,
    /// `ring[i]` and the next one are the other corners of `faces[i]`; an open fan has one vertex more than faces.
    pub(crate) ring: Vec<u32>,
    pub(crate) closed: bool,
}

impl Fan {
    /// Collects the fan of a vertex from one of its faces on.
    pub(crate) fn collect(&mut self, faces: &Faces, vertex: u32, one: u32) {
        self.faces.clear();
        self.ring.clear();
        let mut first = one;
        loop {
            let before = faces.cw(first, vertex);
            self.closed = before == one;
            if before == NONE || self.closed {
                break;
            }
            first = before;
        }
        first = if self.closed { one } else { first };
        let mut face = first;
        loop {
            let corners = faces.corners[face as usize];
            let corner = faces.corner(face, vertex);
            self.faces.push(face);
            self.ring.push(corners[(corner + 1) % 3]);
            let next = faces.ccw(face, vertex);
            if next == NONE {
                self.ring.push(corners[(corner + 2) % 3]);
            }
            if next == NONE || next == first {
                return;
            }
            face = next;
        }
    }

    /// The face that the half edge from the middle to `ring[at]` belongs to, and the one on its other side.
    pub(crate) fn beside(&self, at: usize) -> [u32; 2] {
        let left = self.faces.get(at).copied().unwrap_or(NONE);
        let before = if at > 0 { at - 1 } else { self.faces.len() - 1 };
        [left, if at > 0 || self.closed { self.faces[before] } else { NONE }]
    }
}
