//! The nearest vertex of another component: where points go on whose own component vanishes.

use crate::adjacency::Adjacency;
use crate::kd_tree::KdTree;
use chpm_mesh::geom::to_f64;

/// Finds vertices that have faces, while a patch is decimated.
#[derive(Debug, Default)]
pub(crate) struct Nearest {
    /// The vertices that have faces when one is first asked for.
    tree: KdTree,
    /// By vertex.
    known: Vec<Known>,
}

/// Last known nearest vertex of a vertex.
#[derive(Clone, Copy, Debug)]
struct Known {
    /// The nearest other one that has faces; the vertex itself if there was none, or none was looked for.
    nearest: u16,
    /// The square of how far it is, or of how far there is none.
    squared: f64,
}

impl Nearest {
    /// Forgets the last patch.
    pub(crate) fn clear(&mut self) {
        self.known.clear();
    }

    /// The vertex nearest to v of those that have faces when u has gone there and v has none, and one of its faces. Only what is
    /// nearer than the root of `within` is looked for.
    pub(crate) fn find(
        &mut self,
        positions: &[[f32; 3]],
        adjacency: &Adjacency,
        [u, v]: [u16; 2],
        within: f64,
    ) -> Option<(u32, u16)> {
        if self.known.is_empty() {
            let all = 0..positions.len() as u16;
            self.known.extend(all.clone().map(|v| Known { nearest: v, squared: 0.0 }));
            self.tree.fill(positions, all.filter(|v| adjacency.count(*v) > 0));
        }
        // Vertices lose faces and get none back: who was nearest still is, as long as it has one, and where there was none there is none.
        let known = self.known[usize::from(v)];
        let face = if known.nearest == v { None } else { face_without(adjacency, known.nearest, u) };
        if within <= known.squared {
            return None;
        }
        if let Some(face) = face {
            return Some((face, known.nearest));
        }
        let mut face = None;
        let nearest = self.tree.nearest(to_f64(positions[usize::from(v)]), within, |vertex| {
            // The two that lie nearest have no face without u.
            if vertex == u || vertex == v {
                return false;
            }
            let found = face_without(adjacency, vertex, u);
            face = found.or(face);
            found.is_some()
        });
        let (squared, vertex) = nearest.unwrap_or((within, v));
        self.known[usize::from(v)] = Known { nearest: vertex, squared };
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
        /// Same answer as brute force, while faces die.
        #[test]
        fn it_is_the_nearest(
            positions in prop::collection::vec(prop::array::uniform3(-4i8..4), 3..90),
            steps in prop::collection::vec((any::<u16>(), any::<u16>(), any::<u16>(), 0u8..60), 1..40),
        ) {
            let positions: Vec<[f32; 3]> = positions.iter().map(|p| p.map(f32::from)).collect();
            let count = positions.len() as u16 / 3 * 3;
            let triangles: Vec<_> = (0..count / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            let mut adjacency = Adjacency::default();
            adjacency.build(positions.len(), &triangles);
            let mut search = Nearest::default();
            for (pick, corner, other, within) in steps {
                // A triangle that is still there goes from one of its corners to another.
                let left: Vec<_> = triangles.iter().filter(|t| adjacency.count(t[0]) > 0).collect();
                let Some(triangle) = left.get(usize::from(pick) % left.len().max(1)) else { break };
                let u = usize::from(corner) % 3;
                let v = (u + 1 + usize::from(other) % 2) % 3;
                let (u, v) = (triangle[u], triangle[v]);
                // Beyond all others, for some.
                let within = if within < 40 { f64::from(within) } else { f64::INFINITY };
                let found = search.find(&positions, &adjacency, [u, v], within);
                let squared = |w: u16| {
                    (to_f64(positions[usize::from(w)]) - to_f64(positions[usize::from(v)])).norm_squared()
                };
                let others = left.iter().filter(|t| t != &triangle).flat_map(|t| **t);
                let least = others.map(squared).fold(f64::INFINITY, f64::min);
                let least = if least < within { least } else { f64::INFINITY };
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
