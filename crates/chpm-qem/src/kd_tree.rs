//! Vertices that are near to a place: a k-d tree (Bentley 1975).

use chpm_mesh::geom::to_f64;
use nalgebra::Point3;

/// Some vertices of a patch. In every part the middle one lies between the two halves, by one coordinate after the other.
#[derive(Debug, Default)]
pub(crate) struct KdTree(Vec<u16>);

impl KdTree {
    /// Refills it.
    pub(crate) fn fill(&mut self, positions: &[[f32; 3]], vertices: impl Iterator<Item = u16>) {
        self.0.clear();
        self.0.extend(vertices);
        divide(positions, &mut self.0, 0);
    }

    /// The vertex nearest to a place of those that are accepted, and the square of its distance. Only what is nearer than all accepted
    /// so far is asked about.
    pub(crate) fn nearest(
        &self,
        positions: &[[f32; 3]],
        at: Point3<f64>,
        accept: impl FnMut(u16) -> bool,
    ) -> Option<(f64, u16)> {
        let mut search = Search { positions, at, accept, least: f64::INFINITY, nearest: None };
        search.visit(&self.0, 0);
        search.nearest.map(|vertex| (search.least, vertex))
    }
}

/// Puts the middle vertex by a coordinate between the two halves, and so on with the next coordinate in both.
fn divide(positions: &[[f32; 3]], part: &mut [u16], axis: usize) {
    if part.len() > 1 {
        let middle = part.len() / 2;
        let place = |v: u16| positions[usize::from(v)][axis];
        part.select_nth_unstable_by(middle, |a, b| place(*a).total_cmp(&place(*b)).then(a.cmp(b)));
        let (before, rest) = part.split_at_mut(middle);
        divide(positions, before, (axis + 1) % 3);
        divide(positions, &mut rest[1..], (axis + 1) % 3);
    }
}

struct Search<'a, F> {
    positions: &'a [[f32; 3]],
    at: Point3<f64>,
    accept: F,
    /// The square of the distance to the nearest so far.
    least: f64,
    nearest: Option<u16>,
}

impl<F: FnMut(u16) -> bool> Search<'_, F> {
    fn visit(&mut self, part: &[u16], axis: usize) {
        let middle = part.len() / 2;
        let Some(&vertex) = part.get(middle) else { return };
        let place = to_f64(self.positions[usize::from(vertex)]);
        let squared = (place - self.at).norm_squared();
        if squared < self.least && (self.accept)(vertex) {
            (self.least, self.nearest) = (squared, Some(vertex));
        }
        let beyond = self.at[axis] - place[axis];
        let (before, after) = (&part[..middle], &part[middle + 1..]);
        let (near, far) = if beyond < 0.0 { (before, after) } else { (after, before) };
        self.visit(near, (axis + 1) % 3);
        if beyond * beyond < self.least {
            self.visit(far, (axis + 1) % 3);
        }
    }
}
