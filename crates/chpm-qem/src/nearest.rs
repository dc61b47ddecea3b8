//! The nearest vertex of another component: where points go on whose own component vanishes.

use crate::adjacency::Adjacency;
use crate::kd_tree::KdTree;
use chpm_mesh::geom::to_f64;

/// Finds vertices that have faces, while a patch is decimated.
#[derive(Debug, Default)]
pub(crate) struct Nearest {
    /// The vertices that have faces when one is first asked for.
    tree: KdTree,
    /// By vertex: the nearest other one that has faces, as it was last found; the vertex itself before.
    known: Vec<u16>,
}

impl Nearest {
    /// Forgets the last patch.
    pub(crate) fn clear(&mut self) {
        self.known.clear();
    }

    /// The vertex nearest to v of those that have faces when u has gone there and v has none, and one of its faces.
    pub(crate) fn find(
        &mut self,
        positions: &[[f32; 3]],
        adjacency: &Adjacency,
        u: u16,
        v: u16,
    ) -> Option<(u32, u16)> {
        if self.known.is_empty() {
            self.known.extend(0..positions.len() as u16);
            let used = self.known.iter().copied().filter(|v| adjacency.count(*v) > 0);
            self.tree.fill(positions, used);
        }
        // Vertices lose faces and get none back: who was nearest still is, as long as it has one.
        let known = self.known[usize::from(v)];
        if known != v
            && let Some(face) = face_without(adjacency, known, u)
        {
            return Some((face, known));
        }
        let mut face = None;
        let has_face = |vertex| {
            // The two that lie nearest have no face without u.
            if vertex == u || vertex == v {
                return false;
            }
            let found = face_without(adjacency, vertex, u);
            face = found.or(face);
            found.is_some()
        };
        let nearest = self.tree.nearest(to_f64(positions[usize::from(v)]), has_face);
        self.known[usize::from(v)] = nearest.map_or(v, |(_, vertex)| vertex);
        face.zip(nearest.map(|(_, vertex)| vertex))
    }
}

/// A living face of a vertex that u is no corner of.
fn face_without(adjacency: &Adjacency, vertex: u16, u: u16) -> Option<u32> {
    adjacency.all_wings(vertex).find(|wing| vertex != u && !wing.has(u)).map(|wing| wing.face)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// What a look at every vertex finds, while faces die.
        #[test]
        fn it_is_the_nearest(
            positions in prop::collection::vec(prop::array::uniform3(-4i8..4), 3..90),
            steps in prop::collection::vec((any::<u16>(), any::<u16>(), any::<u16>()), 1..40),
        ) {
            let positions: Vec<[f32; 3]> = positions.iter().map(|p| p.map(f32::from)).collect();
            let count = positions.len() as u16 / 3 * 3;
            let triangles: Vec<_> = (0..count / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            let mut adjacency = Adjacency::default();
            adjacency.build(positions.len(), &triangles);
            let mut search = Nearest::default();
            for (pick, corner, other) in steps {
                // A triangle that is still there goes from one of its corners to another.
                let left: Vec<_> = triangles.iter().filter(|t| adjacency.count(t[0]) > 0).collect();
                let Some(triangle) = left.get(usize::from(pick) % left.len().max(1)) else { break };
                let u = usize::from(corner) % 3;
                let v = (u + 1 + usize::from(other) % 2) % 3;
                let (u, v) = (triangle[u], triangle[v]);
                let found = search.find(&positions, &adjacency, u, v);
                let squared = |w: u16| {
                    (to_f64(positions[usize::from(w)]) - to_f64(positions[usize::from(v)])).norm_squared()
                };
                let others = left.iter().filter(|t| t != &triangle).flat_map(|t| **t);
                let least = others.map(squared).fold(f64::INFINITY, f64::min);
                prop_assert_eq!(found.map_or(f64::INFINITY, |(_, w)| squared(w)), least);
                if let Some((face, w)) = found {
                    prop_assert!(adjacency.faces[face as usize].corners.contains(&w));
                }
                if pick % 2 == 0 {
                    adjacency.collapse(u, v, false);
                }
            }
        }
    }
}
