//! The mesh of one cluster at one position, from scratch: one pass over vertices and one over triangles.

use chpm_mesh::pm::is_alive;
use chpm_mesh::{Places, ProgressiveMesh};

/// Scratch that serves one cluster after the other.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lod {
    places: Places,
}

impl Lod {
    /// Counts the triangles of the mesh of `n` vertices.
    pub(crate) fn count(&mut self, mesh: &ProgressiveMesh<'_>, n: usize) -> usize {
        self.places.go_to(mesh, n);
        self.places.triangles(mesh.triangles).count()
    }

    /// Replaces `out` by the triangles of the mesh of `n` vertices, in the order of the finest mesh's.
    pub(crate) fn collect(&mut self, mesh: &ProgressiveMesh<'_>, n: usize, out: &mut Vec<[u16; 3]>) {
        self.places.go_to(mesh, n);
        // Half of them may be dead, in no order: each is written, and the next one overwrites what is. No branch to predict.
        out.resize(mesh.triangles.len(), [0; 3]);
        let mut alive = 0;
        for corners in mesh.triangles {
            let corners = corners.map(|v| self.places.of(v));
            out[alive] = corners;
            alive += usize::from(is_alive(&corners));
        }
        out.truncate(alive);
    }
}
