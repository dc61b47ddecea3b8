//! A triangle mesh that loses vertices by collapses of edges.

use chpm_mesh::geom::{area_vector, to_f64};
use nalgebra::{Point3, Vector3};

/// Least cosine between a face's normals before and after a change.
const TURN: f64 = 0.1;

/// Faces over vertices, and the faces about each vertex.
pub(crate) struct Surface {
    positions: Vec<[f32; 3]>,
    /// Corners of each face, also of those that are gone.
    faces: Vec<[u32; 3]>,
    stars: Vec<Vec<u32>>,
}

/// Change of a surface: faces that go, and others that get other corners or another place.
#[derive(Default)]
pub(crate) struct Change {
    /// The vertex that goes, if one does.
    pub(crate) from: Option<u32>,
    /// The vertex that gets its faces.
    pub(crate) to: u32,
    /// Where that is put.
    pub(crate) at: [f32; 3],
    /// Faces that go.
    pub(crate) gone: Vec<u32>,
    /// Faces that change, and their corners afterwards.
    pub(crate) changed: Vec<(u32, [u32; 3])>,
}

/// Neighbours of a vertex in ascending order, with the number of faces at each edge.
pub(crate) type Ring = Vec<(u32, u32)>;

impl Surface {
    pub(crate) fn new(positions: Vec<[f32; 3]>, faces: Vec<[u32; 3]>) -> Self {
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

    pub(crate) fn position(&self, vertex: u32) -> [f32; 3] {
        self.positions[vertex as usize]
    }

    pub(crate) fn point(&self, vertex: u32) -> Point3<f64> {
        to_f64(self.positions[vertex as usize])
    }

    pub(crate) fn corners(&self, corners: [u32; 3]) -> [[f32; 3]; 3] {
        corners.map(|v| self.positions[v as usize])
    }

    pub(crate) fn area_vector(&self, corners: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = self.corners(corners);
        area_vector(a, b, c)
    }

    /// Finds a vertex's neighbours.
    pub(crate) fn ring(&self, vertex: u32, ring: &mut Ring) {
        ring.clear();
        for face in self.star(vertex) {
            for v in self.face(*face).into_iter().filter(|v| *v != vertex) {
                match ring.iter_mut().find(|(known, _)| *known == v) {
                    Some((_, faces)) => *faces += 1,
                    None => ring.push((v, 1)),
                }
            }
        }
        ring.sort_unstable();
    }

    /// Whether the faces about a vertex are one fan, open or closed; given its neighbours.
    pub(crate) fn is_fan(&self, vertex: u32, ring: &Ring) -> bool {
        let open = ring.iter().filter(|(_, faces)| *faces == 1).count();
        if ring.iter().any(|(_, faces)| *faces > 2) || !matches!(open, 0 | 2) {
            return false;
        }
        // A walk from face to face reaches all of them.
        let star = self.star(vertex);
        let Some(first) = ring.iter().find(|(_, faces)| *faces == 1).or(ring.first()) else {
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

    /// Finds out what a collapse changes that puts two vertices at one place; false if the surface would not stay one of the same kind, or a face would
    /// turn over. The rings are those of both.
    pub(crate) fn collapse(
        &self,
        (from, ring): (u32, &Ring),
        (to, others): (u32, &Ring),
        at: [f32; 3],
        change: &mut Change,
    ) -> bool {
        let between = ring.iter().find(|(v, _)| *v == to).map_or(0, |(_, faces)| *faces);
        let is_open = |ring: &Ring| ring.iter().any(|(_, faces)| *faces == 1);
        let moves = at != self.position(to);
        // A boundary moves along itself.
        let fits = match between {
            1 => true,
            2 => !(is_open(ring) || moves && is_open(others)),
            _ => false,
        };
        if !fits || moves && !self.is_fan(to, others) {
            return false;
        }
        let common = others.iter().filter(|(v, _)| ring.iter().any(|(w, _)| w == v)).count();
        if common != between as usize {
            return false;
        }

        (change.from, change.to, change.at) = (Some(from), to, at);
        change.gone.clear();
        change.changed.clear();
        for face in self.star(from) {
            let corners = self.face(*face);
            if corners.contains(&to) {
                change.gone.push(*face);
                continue;
            }
            let after = corners.map(|v| if v == from { to } else { v });
            let is_there = self.star(to).iter().any(|other| {
                let other = self.face(*other);
                after.iter().all(|v| other.contains(v))
            });
            if is_there || self.turns(corners, after, to, at) {
                return false;
            }
            change.changed.push((*face, after));
        }
        if moves {
            for face in self.star(to) {
                let corners = self.face(*face);
                if change.gone.contains(face) {
                    continue;
                }
                if self.turns(corners, corners, to, at) {
                    return false;
                }
                change.changed.push((*face, corners));
            }
        }
        !change.changed.is_empty()
    }

    /// Whether a face turns over where it gets other corners, and one of these another place.
    fn turns(&self, before: [u32; 3], after: [u32; 3], to: u32, at: [f32; 3]) -> bool {
        let [a, b, c] = after.map(|v| if v == to { at } else { self.position(v) });
        let (old, new) = (self.area_vector(before), area_vector(a, b, c));
        let least = TURN * old.norm() * new.norm();
        new.norm() == 0.0 || (old.norm() > 0.0 && old.dot(&new) < least)
    }

    /// Puts a vertex elsewhere; answers where it was.
    pub(crate) fn put(&mut self, vertex: u32, at: [f32; 3]) -> [f32; 3] {
        std::mem::replace(&mut self.positions[vertex as usize], at)
    }

    /// Carries a change out.
    pub(crate) fn apply(&mut self, change: &Change) {
        for face in &change.gone {
            for v in self.faces[*face as usize] {
                self.stars[v as usize].retain(|other| other != face);
            }
        }
        for (face, after) in &change.changed {
            let before = std::mem::replace(&mut self.faces[*face as usize], *after);
            for v in before.into_iter().filter(|v| !after.contains(v)) {
                self.stars[v as usize].retain(|other| other != face);
            }
            for v in after.iter().filter(|v| !before.contains(v)) {
                self.stars[*v as usize].push(*face);
            }
        }
        self.put(change.to, change.at);
    }

    /// The faces that are left.
    pub(crate) fn left(&self) -> Vec<[u32; 3]> {
        let is_left = |(face, corners): (usize, &[u32; 3])| {
            self.star(corners[0]).contains(&(face as u32)).then_some(*corners)
        };
        self.faces.iter().enumerate().filter_map(is_left).collect()
    }
}
