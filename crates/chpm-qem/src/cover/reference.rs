//! A mesh of all of the source, finer than what is held against it.

/// "No edge": both ends of a triangle's side are one point.
pub(crate) const NO_EDGE: u32 = u32::MAX;

/// A mesh that is finer than a cluster, of all of the source that the cluster stands for: every point of that source is within a triangle's error of some
/// point of the triangle, and every point of the triangle within it of the source.
#[derive(Debug, Default)]
pub struct Reference {
    pub(crate) points: Vec<[f32; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) errors: Vec<f32>,
    /// Per point, the least error of its triangles.
    pub(crate) least: Vec<f32>,
    /// Per triangle, the edges from each corner to the next.
    pub(crate) edges: Vec<[u32; 3]>,
    pub(crate) edge_count: usize,
    /// Per point, a number of its component.
    pub(crate) components: Vec<u32>,
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

    /// Joins the parts where their vertices are at the same place, and numbers edges and components.
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

        self.least = vec![f32::INFINITY; self.points.len()];
        for (triangle, error) in self.triangles.iter().zip(&self.errors) {
            triangle.iter().for_each(|v| self.least[*v as usize] = self.least[*v as usize].min(*error));
        }
        self.number_edges();
        self.number_components();
    }

    fn number_edges(&mut self) {
        let mut sides: Vec<(u32, u32, u32)> = Vec::with_capacity(3 * self.triangles.len());
        for (index, [a, b, c]) in self.triangles.iter().enumerate() {
            for (side, (from, to)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
                if from != to {
                    sides.push((*from.min(to), *from.max(to), (3 * index + side) as u32));
                }
            }
        }
        sides.sort_unstable();

        self.edges = vec![[NO_EDGE; 3]; self.triangles.len()];
        self.edge_count = 0;
        let mut last = None;
        for (a, b, side) in sides {
            if last != Some((a, b)) {
                last = Some((a, b));
                self.edge_count += 1;
            }
            self.edges.as_flattened_mut()[side as usize] = self.edge_count as u32 - 1;
        }
    }

    fn number_components(&mut self) {
        self.components = (0..self.points.len() as u32).collect();
        for [a, b, c] in &self.triangles {
            for (a, b) in [(*a, *b), (*b, *c)] {
                let [a, b] = [a, b].map(|v| root(&mut self.components, v));
                self.components[a.max(b) as usize] = a.min(b);
            }
        }
        for v in 0..self.points.len() as u32 {
            self.components[v as usize] = root(&mut self.components, v);
        }
    }

    /// The point at a place, if there is one.
    pub(crate) fn point_at(&self, place: [f32; 3]) -> Option<u32> {
        let key = place.map(|x| (x + 0.0).to_bits());
        let found = self.points.binary_search_by_key(&key, |point| point.map(f32::to_bits));
        found.ok().map(|at| at as u32)
    }

    /// The largest coordinate.
    pub(crate) fn scale(&self) -> f64 {
        f64::from(self.points.as_flattened().iter().fold(0.0, |largest: f32, x| largest.max(x.abs())))
    }
}

fn root(of: &mut [u32], mut v: u32) -> u32 {
    while of[v as usize] != v {
        of[v as usize] = of[of[v as usize] as usize];
        v = of[v as usize];
    }
    v
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
        assert_eq!((reference.points.len(), reference.edge_count), (6, 6));
        let shared = |edge: &u32| reference.edges[1].contains(edge);
        assert_eq!(reference.edges[0].iter().filter(|e| shared(e)).count(), 1);
        assert_eq!(reference.edges[2][1], NO_EDGE);

        let at = |place| reference.components[reference.point_at(place).expect("a point") as usize];
        assert_eq!(at([0.0; 3]), at([1.0; 3]));
        assert_ne!(at([0.0; 3]), at([5.0; 3]));
        assert_eq!(reference.point_at([2.0; 3]), None);
        assert_eq!(reference.scale(), 6.0);
    }
}
