//! A progressive mesh that follows its position: from scratch when it is new, step by step when it keeps moving.

use crate::lod::Lod;
use crate::steps::Steps;
use chpm_mesh::ProgressiveMesh;

/// The mesh of one cluster at a position that moves. Loading it copies the finest mesh and its collapses, nothing else. The first moves
/// are played from scratch, one pass over the triangles each; a mesh that still moves then prepares its steps, once, and from
/// there on a move costs what it changes. Which mesh a position is depends on the position alone (I3).
#[derive(Clone, Debug, Default)]
pub struct PmCursor {
    /// The position.
    n: usize,
    base_vertex_count: usize,
    targets: Vec<u16>,
    /// The finest mesh.
    finest: Vec<[u16; 3]>,
    /// The mesh of the position, but for the finest, unless steps are prepared.
    triangles: Vec<[u16; 3]>,
    lod: Lod,
    replays: u32,
    steps: Steps,
}

impl PmCursor {
    /// Moves that are played from scratch before steps are prepared, which costs about as much as all of these.
    pub const REPLAYS: u32 = 8;

    /// A cursor at the finest mesh.
    pub fn new(mesh: &ProgressiveMesh<'_>) -> Self {
        let mut cursor = PmCursor::default();
        cursor.load(mesh);
        cursor
    }

    /// Starts again at the finest mesh of another cluster, in the memory of the last one. It costs a copy of the arrays.
    pub fn load(&mut self, mesh: &ProgressiveMesh<'_>) {
        self.n = mesh.vertex_count;
        self.base_vertex_count = mesh.base_vertex_count;
        self.targets.clear();
        self.targets.extend_from_slice(mesh.targets);
        self.finest.clear();
        self.finest.extend_from_slice(mesh.triangles);
        self.replays = 0;
    }

    /// The position: the number of vertices.
    pub fn position(&self) -> usize {
        self.n
    }

    /// Vertices of the base mesh, the least position.
    pub fn base_vertex_count(&self) -> usize {
        self.base_vertex_count
    }

    /// Vertices of the finest mesh, the largest position.
    pub fn vertex_count(&self) -> usize {
        self.base_vertex_count + self.targets.len()
    }

    /// Collapses or splits vertices until there are `n`, or as near as the mesh gets. One of the first moves is O(finest mesh),
    /// a later one O(corners that change).
    ///
    /// # Panics
    /// If an index of the mesh is out of range; those of a page that was parsed are not.
    pub fn move_to(&mut self, n: usize) {
        let n = n.clamp(self.base_vertex_count, self.vertex_count());
        if n == self.n {
            return;
        }
        if !self.is_prepared() {
            self.replays += 1;
            if !self.is_prepared() {
                return self.replay(n);
            }
            self.prepare();
        }
        self.steps.walk(&self.targets, self.base_vertex_count, self.n..n);
        self.n = n;
    }

    /// Prepares the steps now, so that no later move is played from scratch: for a mesh that is known to move often.
    ///
    /// # Panics
    /// As [`PmCursor::move_to`].
    pub fn prepare_steps(&mut self) {
        if !self.is_prepared() {
            self.replays = Self::REPLAYS + 1;
            self.prepare();
        }
    }

    fn is_prepared(&self) -> bool {
        self.replays > Self::REPLAYS
    }

    fn prepare(&mut self) {
        let vertex_count = self.vertex_count();
        let mesh = ProgressiveMesh {
            vertex_count,
            base_vertex_count: self.base_vertex_count,
            triangles: &self.finest,
            targets: &self.targets,
        };
        self.steps.prepare(&mesh);
        self.steps.walk(&self.targets, self.base_vertex_count, self.base_vertex_count..self.n);
    }

    fn replay(&mut self, n: usize) {
        self.n = n;
        let vertex_count = self.vertex_count();
        if n < vertex_count {
            let mesh = ProgressiveMesh {
                vertex_count,
                base_vertex_count: self.base_vertex_count,
                triangles: &self.finest,
                targets: &self.targets,
            };
            self.lod.collect(&mesh, n, &mut self.triangles);
        }
    }

    /// The triangles of the position: in the order of the finest mesh at first; once steps are prepared by their
    /// [birth](ProgressiveMesh::birth), the base mesh's first, then those that splits brought, so that a step changes few of them.
    pub fn triangles(&self) -> &[[u16; 3]] {
        if self.is_prepared() {
            self.steps.triangles(self.n - self.base_vertex_count)
        } else if self.n < self.vertex_count() {
            &self.triangles
        } else {
            &self.finest
        }
    }

    /// The same triangles in the order of the finest mesh, as [`ProgressiveMesh::triangles_at`] has them. O(finest mesh).
    pub fn triangles_in_file_order(&self) -> impl Iterator<Item = [u16; 3]> + '_ {
        let all = self.triangles();
        let (places, plain) =
            if self.is_prepared() { (self.steps.places(), &[][..]) } else { (&[][..], all) };
        let stepped = places.iter().filter_map(|place| all.get(*place as usize));
        plain.iter().chain(stepped).copied()
    }
}
