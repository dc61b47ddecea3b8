//! The mesh of one cluster at one position, from scratch: one pass over vertices and one over triangles.

use chpm_mesh::ProgressiveMesh;

/// Where the vertices of a cluster are at a position; the buffer serves one cluster after the other.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lod {
    resolved: Vec<u16>,
}

impl Lod {
    /// Counts the triangles of the mesh of `n` vertices.
    pub(crate) fn count(&mut self, mesh: &ProgressiveMesh<'_>, n: usize) -> usize {
        self.resolve(mesh, n);
        let corners = |corners: &[u16; 3]| corners.map(|v| self.resolved[usize::from(v)]);
        mesh.triangles.iter().map(corners).filter(is_alive).count()
    }

    /// Replaces `out` by the triangles of the mesh of `n` vertices, in the order of the finest mesh's.
    pub(crate) fn collect(&mut self, mesh: &ProgressiveMesh<'_>, n: usize, out: &mut Vec<[u16; 3]>) {
        self.resolve(mesh, n);
        // Half of them may be dead, in no order: each is written, and the next one overwrites what is. No branch to predict.
        out.resize(mesh.triangles.len(), [0; 3]);
        let mut alive = 0;
        for corners in mesh.triangles {
            let corners = corners.map(|v| self.resolved[usize::from(v)]);
            out[alive] = corners;
            alive += usize::from(is_alive(&corners));
        }
        out.truncate(alive);
    }

    /// A target has a smaller index, so it is resolved before anything that goes there: no chain is followed twice.
    fn resolve(&mut self, mesh: &ProgressiveMesh<'_>, n: usize) {
        self.resolved.clear();
        self.resolved.extend((0..n).map(|v| v as u16));
        for target in &mesh.targets[n - mesh.base_vertex_count..] {
            self.resolved.push(self.resolved[usize::from(*target)]);
        }
    }
}

fn is_alive([a, b, c]: &[u16; 3]) -> bool {
    // All three are compared: no branch.
    (a != b) & (b != c) & (c != a)
}
