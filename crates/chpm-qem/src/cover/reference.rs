//! A mesh of all of the source, finer than what is held against it.

use super::islands::Islands;
use super::target::Target;
use super::tree::BoxTree;
use chpm_mesh::geom::to_f64;

/// A mesh that is finer than a cluster, of all of the source that the cluster stands for: every point of that source is within a triangle's error of some
/// point of the triangle, and every point of the triangle within it of the source.
#[derive(Debug, Default)]
pub struct Reference {
    pub(crate) points: Vec<[f32; 3]>,
    /// The points by the bits of their places.
    by_place: Vec<u32>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) errors: Vec<f32>,
    /// Per triangle the numbers of its edges, from each corner to the next; the same for all that have the edge.
    pub(crate) edges: Vec<[u32; 3]>,
    pub(crate) edge_count: usize,
    /// The triangles, to find them.
    pub(crate) targets: Vec<Target>,
    pub(crate) tree: BoxTree,
    /// The error of most of them, at most.
    pub(crate) usual_error: f64,
    pub(crate) islands: Islands,
}

impl Reference {
    /// Adds part of it.
    pub fn add(&mut self, positions: &[[f32; 3]], triangles: impl Iterator<Item = ([u16; 3], f32)>) {
        let first = self.points.len() as u32;
        // Both zeros are one place.
        self.points.extend(positions.iter().map(|p| p.map(|x| x + 0.0)));
        for (triangle, error) in triangles {
            self.triangles.push(triangle.map(|v| first + u32::from(v)));
            self.errors.push(error);
        }
    }

    /// Triangles so far.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// Joins the parts where their vertices are at the same place, once all are there.
    pub fn join(&mut self) {
        let points = std::mem::take(&mut self.points);
        let key = |v: u32| points[v as usize].map(f32::to_bits);
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_unstable_by_key(|v| (key(*v), *v));

        let mut joined = vec![0; points.len()];
        for v in order {
            let point = points[v as usize];
            if self.points.last().map(|last: &[f32; 3]| last.map(f32::to_bits)) != Some(key(v)) {
                self.points.push(point);
            }
            joined[v as usize] = self.points.len() as u32 - 1;
        }
        self.triangles.iter_mut().for_each(|t| *t = t.map(|v| joined[v as usize]));
        self.arrange();
        self.number_edges();
        self.islands = Islands::new(self.points.len(), &self.triangles);

        let mut errors = self.errors.clone();
        errors.sort_unstable_by(f32::total_cmp);
        self.usual_error = errors.get(errors.len() / 4 * 3).map_or(0.0, |error| f64::from(*error));
    }

    /// Puts triangles that are near each other side by side, and their points.
    fn arrange(&mut self) {
        let all = 0..self.triangles.len() as u32;
        let targets: Vec<Target> =
            all.clone().map(|index| Target::new(self.corners(index).map(to_f64))).collect();
        self.tree = BoxTree::new(&targets, all.collect());
        let order = self.tree.take_order();
        self.targets = order.iter().map(|index| targets[*index as usize]).collect();
        self.errors = order.iter().map(|index| self.errors[*index as usize]).collect();
        self.triangles = order.iter().map(|index| self.triangles[*index as usize]).collect();

        // Points of no triangle come last.
        let mut numbers = vec![u32::MAX; self.points.len()];
        let used = self.triangles.as_flattened().iter().copied();
        let mut count = 0;
        for point in used.chain(0..self.points.len() as u32) {
            let number = &mut numbers[point as usize];
            if *number == u32::MAX {
                (*number, count) = (count, count + 1);
            }
        }
        let points = self.points.clone();
        points.iter().zip(&numbers).for_each(|(point, number)| self.points[*number as usize] = *point);
        self.triangles.iter_mut().for_each(|t| *t = t.map(|v| numbers[v as usize]));
        self.by_place = numbers;
    }

    fn number_edges(&mut self) {
        let mut having: Vec<(u64, u32)> = Vec::with_capacity(3 * self.triangles.len());
        for (triangle, vertices) in self.triangles.iter().enumerate() {
            for corner in 0..3 {
                let (v, w) = (vertices[corner], vertices[(corner + 1) % 3]);
                let key = u64::from(v.min(w)) << 32 | u64::from(v.max(w));
                having.push((key, (3 * triangle + corner) as u32));
            }
        }
        having.sort_unstable();
        self.edges = vec![[0; 3]; self.triangles.len()];
        self.edge_count = 0;
        for same in having.chunk_by(|a, b| a.0 == b.0) {
            for (_, at) in same {
                self.edges.as_flattened_mut()[*at as usize] = self.edge_count as u32;
            }
            self.edge_count += 1;
        }
    }

    /// The point at a place, if there is one.
    pub(crate) fn point_at(&self, place: [f32; 3]) -> Option<u32> {
        let key = place.map(|x| (x + 0.0).to_bits());
        let at = |point: &u32| self.points[*point as usize].map(f32::to_bits);
        self.by_place.binary_search_by_key(&key, at).ok().map(|at| self.by_place[at])
    }

    pub(crate) fn corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        self.triangles[triangle as usize].map(|v| self.points[v as usize])
    }

    /// The largest coordinate.
    pub(crate) fn scale(&self) -> f64 {
        f64::from(self.points.as_flattened().iter().fold(0.0, |largest: f32, x| largest.max(x.abs())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_joined_at_equal_places() {
        let mut reference = Reference::default();
        reference.add(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [([0, 1, 2], 0.5)].into_iter());
        reference.add(&[[1.0, -0.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]], [([0, 2, 1], 0.25)].into_iter());
        reference.add(&[[5.0; 3], [6.0, 5.0, 5.0]], [([0, 1, 1], 0.0)].into_iter());
        reference.join();
        assert_eq!((reference.points.len(), reference.triangle_count()), (6, 3));
        let common = |v: &&u32| reference.triangles[1].contains(v);
        assert_eq!(reference.triangles[0].iter().filter(common).count(), 2);
        assert_eq!(reference.errors, [0.5, 0.25, 0.0]);
        assert_eq!(reference.point_at([2.0; 3]), None);
        assert_eq!(reference.scale(), 6.0);
    }
}
