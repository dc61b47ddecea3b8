//! A progressive mesh that follows its position step by step.

use chpm_mesh::ProgressiveMesh;

/// The mesh of one cluster at a position that moves. Triangles are kept in the order of their [birth](ProgressiveMesh::birth), so
/// that those of a position are always the first ones; a triangle that is not there keeps the corners it had last. A step
/// writes the corners that it changes, the same ones up and down, and allocates nothing. What a position looks like
/// depends on the position alone (I3).
#[derive(Clone, Debug, Default)]
pub struct PmCursor {
    /// The position.
    n: usize,
    base_vertex_count: usize,
    targets: Vec<u16>,
    /// By birth, and in the order of the finest mesh among equals.
    triangles: Vec<[u16; 3]>,
    /// By place in the finest mesh: place in `triangles`.
    place: Vec<u32>,
    /// By position from the base mesh's: how many triangles it has.
    alive: Vec<u32>,
    /// By collapse: where its corners start in `corners`; one more entry for the end.
    first: Vec<u32>,
    /// Corners (three to a triangle) that a collapse moves without killing their triangle.
    corners: Vec<u32>,
}

impl PmCursor {
    /// A cursor at the finest mesh.
    ///
    /// # Panics
    /// As [`PmCursor::load`].
    pub fn new(mesh: &ProgressiveMesh<'_>) -> Self {
        let mut cursor = PmCursor::default();
        cursor.load(mesh);
        cursor
    }

    /// Starts again at the finest mesh of another cluster, in the memory of the last one.
    ///
    /// # Panics
    /// If an index of the mesh is out of range; those of a page that was parsed are not.
    pub fn load(&mut self, mesh: &ProgressiveMesh<'_>) {
        let collapses = mesh.vertex_count - mesh.base_vertex_count;
        self.n = mesh.vertex_count;
        self.base_vertex_count = mesh.base_vertex_count;
        self.targets.clear();
        self.targets.extend_from_slice(mesh.targets);
        self.sort_by_birth(mesh, collapses);
        self.list_corners(mesh, collapses);
    }

    /// Counting sort, which keeps the order among equals.
    fn sort_by_birth(&mut self, mesh: &ProgressiveMesh<'_>, collapses: usize) {
        self.alive.clear();
        self.alive.resize(collapses + 1, 0);
        self.place.clear();
        for corners in mesh.triangles {
            let birth = mesh.birth(*corners) - mesh.base_vertex_count;
            self.alive[birth] += 1;
            self.place.push(birth as u32);
        }
        // Starts of the births for now; placing the triangles makes ends of them, which are the counts of the positions.
        starts(&mut self.alive);
        self.triangles.clear();
        self.triangles.resize(mesh.triangles.len(), [0; 3]);
        for (corners, place) in mesh.triangles.iter().zip(&mut self.place) {
            let next = &mut self.alive[*place as usize];
            *place = *next;
            self.triangles[*next as usize] = *corners;
            *next += 1;
        }
    }

    /// Finds for every collapse the corners that it moves: counts them, then notes them.
    fn list_corners(&mut self, mesh: &ProgressiveMesh<'_>, collapses: usize) {
        self.first.clear();
        self.first.resize(collapses + 1, 0);
        let first = &mut self.first;
        self.triangles.iter().for_each(|corners| moves(mesh, *corners, |j, _| first[j] += 1));
        starts(first);
        let count = first[collapses] as usize;
        self.corners.clear();
        self.corners.resize(count, 0);
        for (place, corners) in (0..).zip(&self.triangles) {
            moves(mesh, *corners, |j, corner| {
                self.corners[first[j] as usize] = 3 * place + corner;
                first[j] += 1;
            });
        }
        // Starts have become ends: those of the collapse before are the starts again.
        first.rotate_right(1);
        first[0] = 0;
        debug_assert_eq!(first.last().copied(), Some(count as u32));
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

    /// Collapses or splits vertices until there are `n`, or as near as the mesh gets. O(corners that change).
    pub fn move_to(&mut self, n: usize) {
        let n = n.clamp(self.base_vertex_count, self.vertex_count());
        while self.n > n {
            self.n -= 1;
            self.write(self.n, self.targets[self.n - self.base_vertex_count]);
        }
        while self.n < n {
            self.write(self.n, self.n as u16);
            self.n += 1;
        }
    }

    /// Sets the corners that the collapse of `vertex` moves.
    fn write(&mut self, vertex: usize, to: u16) {
        let collapse = vertex - self.base_vertex_count;
        let range = self.first[collapse] as usize..self.first[collapse + 1] as usize;
        let all = self.triangles.as_flattened_mut();
        for corner in &self.corners[range] {
            all[*corner as usize] = to;
        }
    }

    /// The triangles of the position, by birth: the base mesh's first, then those that splits brought.
    pub fn triangles(&self) -> &[[u16; 3]] {
        let count = self.alive.get(self.n - self.base_vertex_count).copied().unwrap_or(0);
        &self.triangles[..count as usize]
    }

    /// The same triangles in the order of the finest mesh, as [`ProgressiveMesh::triangles_at`] has them. O(finest mesh).
    pub fn triangles_in_file_order(&self) -> impl Iterator<Item = [u16; 3]> + '_ {
        let alive = self.triangles();
        self.place.iter().filter_map(|place| alive.get(*place as usize).copied())
    }
}

/// Tells the collapses that move a corner of a triangle of the finest mesh and leave it alive, and which corner.
fn moves(mesh: &ProgressiveMesh<'_>, mut corners: [u16; 3], mut tell: impl FnMut(usize, u32)) {
    loop {
        let [a, b, c] = corners;
        let last = a.max(b).max(c);
        let Some(collapse) = usize::from(last).checked_sub(mesh.base_vertex_count) else { return };
        let target = mesh.targets[collapse];
        if corners.contains(&target) {
            return;
        }
        let corner = if last == a { 0 } else { 1 + u32::from(last != b) };
        corners[corner as usize] = target;
        tell(collapse, corner);
    }
}

/// Turns counts into the sums of those before.
fn starts(counts: &mut [u32]) {
    let mut sum = 0;
    for count in counts {
        sum += std::mem::replace(count, sum);
    }
}
