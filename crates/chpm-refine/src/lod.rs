//! The mesh of one cluster at one position, from scratch: one pass over vertices and one over triangles.

use chpm_mesh::ProgressiveMesh;

/// Where the vertices of a cluster are at a position; the buffer serves one cluster after the other.
#[derive(Default)]
pub(crate) struct Lod {
    resolved: Vec<u16>,
}

impl Lod {
    /// The triangles of the mesh of `n` vertices, in the order of the finest mesh's.
    pub(crate) fn triangles<'a>(
        &'a mut self,
        mesh: &ProgressiveMesh<'a>,
        n: usize,
    ) -> impl Iterator<Item = [u16; 3]> + use<'a> {
        // A target has a smaller index, so it is resolved before anything that goes there: no chain is followed twice.
        self.resolved.clear();
        self.resolved.extend((0..n).map(|v| v as u16));
        for target in &mesh.targets[n - mesh.base_vertex_count..] {
            self.resolved.push(self.resolved[usize::from(*target)]);
        }
        let resolved = &self.resolved;
        let corners = mesh.triangles.iter().map(|corners| corners.map(|v| resolved[usize::from(v)]));
        corners.filter(|[a, b, c]| a != b && b != c && c != a)
    }
}
