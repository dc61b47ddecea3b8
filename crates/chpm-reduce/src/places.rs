//! Vertices of the source, as places for vertices of a mesh.

use chpm_mesh::TriMesh;

/// Vertices of a source, looked through for the cheapest.
pub(crate) struct Places<'a> {
    source: &'a TriMesh,
    /// The search that came to a vertex last.
    seen: Vec<u32>,
    search: u32,
    best: Vec<(f64, u32)>,
}

impl<'a> Places<'a> {
    pub(crate) fn new(source: &'a TriMesh) -> Self {
        Places { source, seen: vec![0; source.positions.len()], search: 0, best: Vec::new() }
    }

    /// Finds the cheapest corners of some triangles, so many at most.
    pub(crate) fn find_cheapest(&mut self, triangles: &[u32], count: usize, cost: impl Fn([f32; 3]) -> f64) {
        self.search = self.search.wrapping_add(1);
        self.best.clear();
        for v in triangles.iter().flat_map(|t| self.source.triangles[*t as usize]) {
            if std::mem::replace(&mut self.seen[v as usize], self.search) == self.search {
                continue;
            }
            let entry = (cost(self.source.positions[v as usize]), v);
            let at = self.best.partition_point(|best| *best <= entry);
            if at < count {
                self.best.insert(at, entry);
                self.best.truncate(count);
            }
        }
    }

    /// Costs and vertices that were found last, the cheapest first.
    pub(crate) fn cheapest(&self) -> &[(f64, u32)] {
        &self.best
    }
}
