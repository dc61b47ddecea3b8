//! Order of the triangles in a page for vertex caches.
//!
//! A page is drawn at any position, but has one order: the one that is good for a cache at the middle position. A triangle that is gone
//! there comes as soon as its corners have come with others; for a corner that comes with none, the vertex that it went to counts.

mod cache_walk;
mod hubs;

use cache_walk::CacheWalk;
use chpm_mesh::pm::is_alive;
use chpm_mesh::{Places, ProgressiveMesh};

const NONE: u32 = u32::MAX;

/// Scratch of the ordering.
#[derive(Debug, Default)]
pub(crate) struct TriangleOrder {
    /// Where each vertex is at the middle position.
    places: Places,
    /// The triangles that are there, and their corners there; those that are gone.
    there: Vec<u32>,
    corners: Vec<[u16; 3]>,
    gone: Vec<u32>,
    walk: CacheWalk,
    /// By vertex, and by vertex of the middle position: the place of the first triangle that has it.
    first: Vec<u32>,
    first_there: Vec<u32>,
    /// The first of the gone that come behind each place, and what comes behind each of them.
    behind: Vec<u32>,
    next: Vec<u32>,
}

impl TriangleOrder {
    /// Makes `out` the triangles of `mesh` in the order that is good for its mesh of `middle` vertices. Answers with the order of those that are
    /// there.
    pub(crate) fn fill(
        &mut self,
        mesh: &ProgressiveMesh<'_>,
        middle: usize,
        out: &mut Vec<[u16; 3]>,
    ) -> &[u32] {
        self.play(mesh, middle);
        let order = self.walk.order(&self.corners, middle);

        // Where each vertex comes first, in the middle mesh and in the finest one.
        reset(&mut self.first, mesh.vertex_count);
        reset(&mut self.first_there, middle);
        for (place, at) in (0..).zip(order) {
            let at = *at as usize;
            note(&mut self.first, mesh.triangles[self.there[at] as usize], place);
            note(&mut self.first_there, self.corners[at], place);
        }
        for (first, survivor) in self.first.iter_mut().zip(self.places.as_slice()) {
            if *first == NONE {
                *first = self.first_there[usize::from(*survivor)];
            }
        }

        // Each triangle that is not in the middle mesh comes behind the last of its corners.
        let end = order.len();
        reset(&mut self.behind, end + 1);
        reset(&mut self.next, self.gone.len());
        for (number, index) in self.gone.iter().enumerate().rev() {
            let places = mesh.triangles[*index as usize].map(|corner| self.first[usize::from(corner)]);
            let last = places.into_iter().fold(0, u32::max) as usize;
            self.next[number] = std::mem::replace(&mut self.behind[last.min(end)], number as u32);
        }

        out.clear();
        for (place, behind) in self.behind.iter().enumerate() {
            out.extend(order.get(place).map(|at| mesh.triangles[self.there[*at as usize] as usize]));
            let mut number = *behind;
            while number != NONE {
                out.push(mesh.triangles[self.gone[number as usize] as usize]);
                number = self.next[number as usize];
            }
        }
        order
    }

    /// Finds the triangles of the middle position.
    fn play(&mut self, mesh: &ProgressiveMesh<'_>, middle: usize) {
        self.places.go_to(mesh, middle);
        self.there.clear();
        self.corners.clear();
        self.gone.clear();
        for (index, triangle) in (0..).zip(mesh.triangles) {
            let corners = triangle.map(|corner| self.places.of(corner));
            if is_alive(&corners) {
                self.there.push(index);
                self.corners.push(corners);
            } else {
                self.gone.push(index);
            }
        }
    }
}

fn reset(numbers: &mut Vec<u32>, count: usize) {
    numbers.clear();
    numbers.resize(count, NONE);
}

/// Notes the place for the corners that came at no earlier one.
fn note(first: &mut [u32], corners: [u16; 3], place: u32) {
    for corner in corners {
        let first = &mut first[usize::from(corner)];
        *first = place.min(*first);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_measure::cache::acmr;

    /// A grid of `side` by `side` quads in rows, shuffled; every second vertex of a row goes to the one before it, the last ones first.
    fn grid(side: u16) -> (usize, usize, Vec<[u16; 3]>, Vec<u16>) {
        let row = side + 1;
        let is_base = |v: u16| (v % row).is_multiple_of(2);
        let mut old: Vec<u16> = (0..row * row).filter(|v| is_base(*v)).collect();
        let base = old.len();
        old.extend((0..row * row).filter(|v| !is_base(*v)));
        let mut new = vec![0; old.len()];
        (0..).zip(&old).for_each(|(n, v)| new[usize::from(*v)] = n);
        let targets = old[base..].iter().map(|v| new[usize::from(*v) - 1]).collect();
        let mut triangles = Vec::new();
        for at in (0..side).flat_map(|y| (0..side).map(move |x| y * row + x)) {
            triangles.push([at, at + 1, at + row]);
            triangles.push([at + 1, at + row + 1, at + row]);
        }
        let count = triangles.len();
        let shuffled = (0..count).map(|i| triangles[i * 1013 % count].map(|v| new[usize::from(v)])).collect();
        (base, old.len(), shuffled, targets)
    }

    #[test]
    fn every_triangle_comes_once_and_caches_are_served_at_every_position() {
        let (base_vertex_count, vertex_count, triangles, targets) = grid(40);
        let mesh =
            ProgressiveMesh { vertex_count, base_vertex_count, triangles: &triangles, targets: &targets };
        let mut ordered = Vec::new();
        let mut order = TriangleOrder::default();
        order.fill(&mesh, mesh.base_vertex_count.midpoint(mesh.vertex_count), &mut ordered);

        let first = ordered.clone();
        order.fill(&mesh, mesh.base_vertex_count.midpoint(mesh.vertex_count), &mut ordered);
        assert_eq!(first, ordered, "the scratch shows");

        let sorted = |mut triangles: Vec<[u16; 3]>| {
            triangles.sort_unstable();
            triangles
        };
        assert_eq!(sorted(ordered.clone()), sorted(triangles.clone()));

        let new = ProgressiveMesh { triangles: &ordered, ..mesh };
        for n in [base_vertex_count, base_vertex_count.midpoint(vertex_count), vertex_count] {
            let acmr = |mesh: &ProgressiveMesh<'_>| {
                let mut played = Vec::new();
                mesh.triangles_at(n, &mut played);
                acmr(played.into_iter().map(|t| t.map(u32::from)), 16)
            };
            assert!(acmr(&mesh) > 1.5, "the given order is a bad one");
            assert!(acmr(&new) < 0.85, "{} at {n} of {base_vertex_count} to {vertex_count}", acmr(&new));
        }
    }

    #[test]
    fn what_is_gone_waits_for_its_corners() {
        // A fan about vertex 4, which collapses to 0; then 3 collapses to 0. At the middle 4 is gone, and with it the first and the last.
        let triangles = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let fan = ProgressiveMesh {
            vertex_count: 5,
            base_vertex_count: 3,
            triangles: &triangles,
            targets: &[0, 0],
        };
        let mut out = Vec::new();
        TriangleOrder::default().fill(&fan, 4, &mut out);
        assert_eq!(out, [[1, 2, 4], [0, 1, 4], [2, 3, 4], [3, 0, 4]]);
    }

    #[test]
    fn odd_meshes_are_ordered_too() {
        let mut order = TriangleOrder::default();
        let mut out = vec![[1, 2, 3]];
        let empty = ProgressiveMesh { vertex_count: 1, base_vertex_count: 1, triangles: &[], targets: &[] };
        order.fill(&empty, 1, &mut out);
        assert!(out.is_empty());
        // All is gone at the middle, and three are one triangle.
        let triangles = [[0, 1, 2], [2, 1, 0], [0, 1, 2], [1, 2, 0]];
        let gone = ProgressiveMesh {
            vertex_count: 3,
            base_vertex_count: 1,
            triangles: &triangles,
            targets: &[0, 0],
        };
        order.fill(&gone, 2, &mut out);
        assert_eq!(out, triangles);
        let whole = ProgressiveMesh { base_vertex_count: 3, targets: &[], ..gone };
        order.fill(&whole, 3, &mut out);
        out.sort_unstable();
        assert_eq!(out, [[0, 1, 2], [0, 1, 2], [1, 2, 0], [2, 1, 0]]);
    }
}
