//! A triangle mesh that loses vertices by half-edge collapses.

use chpm_mesh::geom::{area_vector, to_f64};
use nalgebra::Vector3;

/// Least cosine between a face's normals before and after a collapse.
const TURN: f64 = 0.1;

/// Faces over fixed vertices, and the faces about each vertex.
pub(crate) struct Surface<'a> {
    positions: &'a [[f32; 3]],
    /// Corners of each face, also of those that are gone.
    faces: Vec<[u32; 3]>,
    stars: Vec<Vec<u32>>,
}

/// Effect of a collapse: the faces about its vertex, those that go and those that change.
#[derive(Default)]
pub(crate) struct Collapse {
    /// The vertex that goes.
    pub(crate) from: u32,
    /// Its neighbour, where it goes.
    pub(crate) to: u32,
    /// Faces that go.
    pub(crate) gone: Vec<u32>,
    /// Faces that change, and their corners afterwards.
    pub(crate) changed: Vec<(u32, [u32; 3])>,
}

impl<'a> Surface<'a> {
    pub(crate) fn new(positions: &'a [[f32; 3]], faces: Vec<[u32; 3]>) -> Self {
        let mut stars = vec![Vec::new(); positions.len()];
        for (face, corners) in faces.iter().enumerate() {
            corners.iter().for_each(|v| stars[*v as usize].push(face as u32));
        }
        Surface { positions, faces, stars }
    }

    pub(crate) fn vertex_count(&self) -> usize {
        self.stars.len()
    }

    pub(crate) fn star(&self, vertex: u32) -> &[u32] {
        &self.stars[vertex as usize]
    }

    pub(crate) fn face(&self, face: u32) -> [u32; 3] {
        self.faces[face as usize]
    }

    pub(crate) fn corners(&self, corners: [u32; 3]) -> [[f32; 3]; 3] {
        corners.map(|v| self.positions[v as usize])
    }

    pub(crate) fn area_vector(&self, corners: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = self.corners(corners);
        area_vector(a, b, c)
    }

    /// From one vertex to another.
    pub(crate) fn edge(&self, from: u32, to: u32) -> Vector3<f64> {
        to_f64(self.positions[to as usize]) - to_f64(self.positions[from as usize])
    }

    /// Neighbours of a vertex in ascending order, with the number of faces at each edge.
    pub(crate) fn neighbours(&self, vertex: u32, found: &mut Vec<(u32, u32)>) {
        found.clear();
        for face in self.star(vertex) {
            for v in self.face(*face).into_iter().filter(|v| *v != vertex) {
                match found.iter_mut().find(|(known, _)| *known == v) {
                    Some((_, faces)) => *faces += 1,
                    None => found.push((v, 1)),
                }
            }
        }
        found.sort_unstable();
    }

    /// Whether the faces about a vertex are one fan, open or closed; given its neighbours.
    pub(crate) fn is_fan(&self, vertex: u32, neighbours: &[(u32, u32)]) -> bool {
        let open = neighbours.iter().filter(|(_, faces)| *faces == 1).count();
        if neighbours.iter().any(|(_, faces)| *faces > 2) || !matches!(open, 0 | 2) {
            return false;
        }
        // A walk from face to face reaches all of them.
        let star = self.star(vertex);
        let Some(first) = neighbours.iter().find(|(_, faces)| *faces == 1).or(neighbours.first()) else {
            return false;
        };
        let (mut at, mut last) = (first.0, None);
        let mut steps = 0;
        while let Some(face) =
            star.iter().copied().find(|face| Some(*face) != last && self.face(*face).contains(&at))
        {
            let next = self.face(face).into_iter().find(|v| *v != at && *v != vertex);
            let Some(next) = next else { return false };
            (at, last) = (next, Some(face));
            steps += 1;
            if at == first.0 || steps > star.len() {
                break;
            }
        }
        steps == star.len()
    }

    /// Finds out the effect of a collapse; false if the surface would not stay one of the same kind, or a face would turn over.
    pub(crate) fn collapse(
        &self,
        from: u32,
        to: u32,
        neighbours: &[(u32, u32)],
        others: &mut Vec<(u32, u32)>,
        collapse: &mut Collapse,
    ) -> bool {
        let between = neighbours.iter().find(|(v, _)| *v == to).map_or(0, |(_, faces)| *faces);
        // A boundary moves along itself.
        if between != 2 && !(between == 1 && neighbours.iter().any(|(_, faces)| *faces == 1)) {
            return false;
        }
        if between == 2 && neighbours.iter().any(|(_, faces)| *faces == 1) {
            return false;
        }
        self.neighbours(to, others);
        let common = others.iter().filter(|(v, _)| neighbours.iter().any(|(w, _)| w == v)).count();
        if common != between as usize {
            return false;
        }

        (collapse.from, collapse.to) = (from, to);
        collapse.gone.clear();
        collapse.changed.clear();
        for face in self.star(from) {
            let corners = self.face(*face);
            if corners.contains(&to) {
                collapse.gone.push(*face);
                continue;
            }
            let after = corners.map(|v| if v == from { to } else { v });
            let (old, new) = (self.area_vector(corners), self.area_vector(after));
            let least = TURN * old.norm() * new.norm();
            let turned = new.norm() == 0.0 || (old.norm() > 0.0 && old.dot(&new) < least);
            let is_there = self.star(to).iter().any(|other| {
                let other = self.face(*other);
                after.iter().all(|v| other.contains(v))
            });
            if turned || is_there {
                return false;
            }
            collapse.changed.push((*face, after));
        }
        !collapse.changed.is_empty()
    }

    /// Carries a collapse out.
    pub(crate) fn apply(&mut self, collapse: &Collapse) {
        for face in &collapse.gone {
            for v in self.faces[*face as usize] {
                self.stars[v as usize].retain(|other| other != face);
            }
        }
        for (face, after) in &collapse.changed {
            self.faces[*face as usize] = *after;
            self.stars[collapse.to as usize].push(*face);
        }
        self.stars[collapse.from as usize].clear();
    }

    /// The faces that are left.
    pub(crate) fn left(&self) -> Vec<[u32; 3]> {
        let is_left = |(face, corners): (usize, &[u32; 3])| {
            self.star(corners[0]).contains(&(face as u32)).then_some(*corners)
        };
        self.faces.iter().enumerate().filter_map(is_left).collect()
    }
}
