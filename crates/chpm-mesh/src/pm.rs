//! The progressive mesh of one cluster, as the file stores it, and the plain way to play it.
//!
//! Half-edge collapses keep input vertices, so a progressive mesh is its finest mesh plus a collapse order
//! (Quick-VDR 3.2.2). Vertices are numbered so that the survivors of every prefix of collapses are a prefix of the
//! vertices: vertex `i >= base_vertex_count` is the one that collapses when the mesh goes from `i + 1` vertices to `i`, and it
//! goes to `targets[i - base_vertex_count] < i`. A PM position is therefore a vertex count `n`: `base_vertex_count` is the
//! base mesh M^0, `vertex_count` the finest mesh M^k.

/// A view of one cluster's finest triangles and its collapse order.
///
/// ```
/// use chpm_mesh::ProgressiveMesh;
///
/// // A square of two triangles; its last vertex collapses to the first one.
/// let mesh = ProgressiveMesh {
///     vertex_count: 4,
///     base_vertex_count: 3,
///     triangles: &[[0, 1, 2], [0, 2, 3]],
///     targets: &[0],
/// };
/// let mut coarse = Vec::new();
/// mesh.triangles_at(3, &mut coarse);
/// assert_eq!(coarse, [[0, 1, 2]]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ProgressiveMesh<'a> {
    /// Vertices of the finest mesh.
    pub vertex_count: usize,
    /// Vertices of the base mesh; the rest collapse, the last vertex first.
    pub base_vertex_count: usize,
    /// Corners of the finest mesh's triangles.
    pub triangles: &'a [[u16; 3]],
    /// Where vertex `base_vertex_count + j` collapses to; always a smaller index than its own.
    pub targets: &'a [u16],
}

impl ProgressiveMesh<'_> {
    /// Where `vertex` is in the mesh of `n` vertices.
    pub fn resolve(&self, mut vertex: u16, n: usize) -> u16 {
        debug_assert!(n >= self.base_vertex_count && n <= self.vertex_count);
        while usize::from(vertex) >= n {
            vertex = self.targets[usize::from(vertex) - self.base_vertex_count];
        }
        vertex
    }

    /// Appends the triangles of the mesh of `n` vertices, in the order of the finest mesh's.
    pub fn triangles_at(&self, n: usize, out: &mut Vec<[u16; 3]>) {
        for corners in self.triangles {
            let [a, b, c] = corners.map(|v| self.resolve(v, n));
            if a != b && b != c && c != a {
                out.push([a, b, c]);
            }
        }
    }

    /// The corners that a triangle of the finest mesh has at one position or another, the finest first, while it is there.
    pub fn states(&self, corners: [u16; 3]) -> impl Iterator<Item = [u16; 3]> {
        let next = move |corners: &[u16; 3]| {
            let last = corners.iter().copied().max().unwrap_or(0);
            let target = *self.targets.get(usize::from(last).checked_sub(self.base_vertex_count)?)?;
            Some(corners.map(|v| if v == last { target } else { v })).filter(is_alive)
        };
        std::iter::successors(Some(corners), next)
    }

    /// The least vertex count at which a triangle is still there: it dies when the mesh goes from this count to one less.
    /// A triangle of the base mesh answers `base_vertex_count`.
    pub fn birth(&self, mut corners: [u16; 3]) -> usize {
        loop {
            let [a, b, c] = corners;
            let last = a.max(b).max(c);
            if usize::from(last) < self.base_vertex_count {
                return self.base_vertex_count;
            }
            let target = self.targets[usize::from(last) - self.base_vertex_count];
            corners = corners.map(|v| if v == last { target } else { v });
            let [a, b, c] = corners;
            if a == b || b == c || c == a {
                return usize::from(last) + 1;
            }
        }
    }
}

/// Where the vertices of a progressive mesh are at one position, found in one pass; the buffer serves one mesh after the other.
#[derive(Clone, Debug, Default)]
pub struct Places(Vec<u16>);

impl Places {
    /// Goes to the mesh of `n` vertices.
    pub fn go_to(&mut self, mesh: &ProgressiveMesh<'_>, n: usize) {
        self.0.clear();
        self.0.extend((0..n).map(|v| v as u16));
        // A target has a smaller index, so it is resolved before anything that goes there: no chain is followed twice.
        for target in &mesh.targets[n - mesh.base_vertex_count..] {
            self.0.push(self.0[usize::from(*target)]);
        }
    }

    /// Where a vertex of the finest mesh is.
    #[inline]
    pub fn of(&self, vertex: u16) -> u16 {
        self.0[usize::from(vertex)]
    }

    /// The same of every vertex.
    pub fn as_slice(&self) -> &[u16] {
        &self.0
    }

    /// The triangles that are left of those of the finest mesh, in their order.
    pub fn triangles<'a>(&'a self, finest: &'a [[u16; 3]]) -> impl Iterator<Item = [u16; 3]> + 'a {
        finest.iter().map(|corners| corners.map(|v| self.of(v))).filter(is_alive)
    }
}

/// Whether a triangle has three different corners.
#[inline]
pub fn is_alive([a, b, c]: &[u16; 3]) -> bool {
    // All three are compared: no branch.
    (a != b) & (b != c) & (c != a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square fan about vertex 4, which collapses to 0; then 3 collapses to 0.
    const FAN: ProgressiveMesh<'static> = ProgressiveMesh {
        vertex_count: 5,
        base_vertex_count: 3,
        triangles: &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
        targets: &[0, 0],
    };

    #[test]
    fn positions_play_from_finest_to_base() {
        let at = |n| {
            let mut out = Vec::new();
            FAN.triangles_at(n, &mut out);
            out
        };
        assert_eq!(at(5).len(), 4);
        assert_eq!(at(4), [[1, 2, 0], [2, 3, 0]]);
        assert_eq!(at(3), [[1, 2, 0]]);
    }

    #[test]
    fn places_agree_with_playing() {
        let mut places = Places::default();
        for n in 3..=5 {
            places.go_to(&FAN, n);
            assert!((0..5).all(|v| places.of(v) == FAN.resolve(v, n)), "at {n} vertices");
            let mut out = Vec::new();
            FAN.triangles_at(n, &mut out);
            assert!(places.triangles(FAN.triangles).eq(out), "at {n} vertices");
        }
    }

    #[test]
    fn states_are_those_of_all_positions() {
        for corners in FAN.triangles {
            let mut played: Vec<[u16; 3]> = Vec::new();
            for n in (3..=5).rev() {
                let state = corners.map(|v| FAN.resolve(v, n));
                if is_alive(&state) && played.last() != Some(&state) {
                    played.push(state);
                }
            }
            assert!(FAN.states(*corners).eq(played), "{corners:?}");
        }
    }

    #[test]
    fn birth_agrees_with_playing() {
        for n in 3..=5 {
            let mut out = Vec::new();
            FAN.triangles_at(n, &mut out);
            let born = FAN.triangles.iter().filter(|t| FAN.birth(**t) <= n).count();
            assert_eq!(out.len(), born, "at {n} vertices");
        }
    }
}
