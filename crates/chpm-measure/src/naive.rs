//! An oracle for tests: half-edge simplification that recomputes whatever it needs, clear and slow.
//!
//! Garland and Heckbert's quadrics ("Surface simplification using quadric error metrics", section 5) on half-edge
//! collapses: vertex `u` goes to its neighbour `v` at the cost that `u`'s quadric gives `v`'s position.

use chpm_mesh::{Aabb, TriMesh, Vertices, geom};
use nalgebra::{Matrix4, Point3, Vector3, Vector4};
use std::collections::{BTreeMap, BTreeSet};

/// A face may turn by no more than the angle of this cosine.
const LEAST_COSINE: f64 = 0.25;

/// Collapses half edges, cheapest first, until at most `target_triangles` are left or no collapse is allowed.
///
/// Vertices with `locked[v]` stay (an index past the end of `locked` is not locked), boundary vertices move along the
/// boundary only, non-manifold vertices stay, and the topology of manifold parts does not change. Surviving vertices
/// and triangles keep their order, and vertices their attributes. Triangles that name a vertex twice are dropped first.
///
/// # Panics
/// If a triangle names a vertex that is not there.
pub fn simplify(mesh: &TriMesh, target_triangles: usize, locked: &[bool]) -> TriMesh {
    let mut state = Simplifier::new(mesh, locked);
    for vertex in 0..state.points.len() as u32 {
        state.queue_around(vertex);
    }
    while state.live > target_triangles {
        let Some((_, u, v)) = state.queue.pop_first() else { break };
        state.costs.remove(&(u, v));
        if state.allows(u, v) {
            state.collapse(u, v);
        }
    }
    state.into_mesh(mesh)
}

struct Simplifier<'a> {
    points: Vec<Point3<f64>>,
    quadrics: Vec<Matrix4<f64>>,
    locked: &'a [bool],
    removed: Vec<bool>,
    faces: Vec<Option<[u32; 3]>>,
    /// Live faces of every vertex.
    stars: Vec<BTreeSet<usize>>,
    live: usize,
    /// Half edges by cost; a cost is never negative, so its bits sort as it does.
    queue: BTreeSet<(u64, u32, u32)>,
    costs: BTreeMap<(u32, u32), u64>,
}

/// Link of a vertex: the directed edges opposite it.
struct Link {
    /// First vertex of the open path, where there is one.
    start: Option<u32>,
    /// Last vertex of the open path.
    end: Option<u32>,
    /// Whether the link is one cycle or one path.
    manifold: bool,
}

impl<'a> Simplifier<'a> {
    fn new(mesh: &TriMesh, locked: &'a [bool]) -> Self {
        // Quadrics hold squares of coordinates: keep those small.
        let center = Aabb::of_points(&mesh.positions).center();
        let points: Vec<_> = mesh.positions.iter().map(|p| Point3::from(geom::to_f64(*p) - center)).collect();
        let faces: Vec<_> = mesh
            .triangles
            .iter()
            .copied()
            .filter(|&[a, b, c]| a != b && b != c && c != a)
            .map(Some)
            .collect();
        let mut stars = vec![BTreeSet::new(); points.len()];
        for (index, face) in faces.iter().enumerate() {
            for v in face.iter().flatten() {
                stars[*v as usize].insert(index);
            }
        }
        let mut state = Simplifier {
            quadrics: vec![Matrix4::zeros(); points.len()],
            removed: vec![false; points.len()],
            live: faces.len(),
            points,
            locked,
            faces,
            stars,
            queue: BTreeSet::new(),
            costs: BTreeMap::new(),
        };
        for index in 0..state.faces.len() {
            state.add_quadrics(index);
        }
        state
    }

    /// The plane of a face weighs its area; the plane that stands on a boundary edge weighs the edge's square.
    fn add_quadrics(&mut self, index: usize) {
        let Some(face) = self.faces[index] else { return };
        let normal = self.area_vector(face);
        fn plane(normal: Vector3<f64>, through: Point3<f64>, weight: f64) -> Matrix4<f64> {
            let Some(n) = normal.try_normalize(0.0) else { return Matrix4::zeros() };
            let p = Vector4::new(n.x, n.y, n.z, -n.dot(&through.coords));
            weight * p * p.transpose()
        }
        let own = plane(normal, self.points[face[0] as usize], 0.5 * normal.norm());
        for i in 0..3 {
            self.quadrics[face[i] as usize] += own;
            let (u, v) = (face[i], face[(i + 1) % 3]);
            if self.faces_of_edge(u, v).count() == 1 {
                let (p, q) = (self.points[u as usize], self.points[v as usize]);
                let wall = plane((q - p).cross(&normal), p, (q - p).norm_squared());
                self.quadrics[u as usize] += wall;
                self.quadrics[v as usize] += wall;
            }
        }
    }

    fn area_vector(&self, face: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = face.map(|v| self.points[v as usize]);
        (b - a).cross(&(c - a))
    }

    fn star(&self, v: u32) -> impl Iterator<Item = [u32; 3]> {
        self.stars[v as usize].iter().filter_map(|&f| self.faces[f])
    }

    fn faces_of_edge(&self, u: u32, v: u32) -> impl Iterator<Item = [u32; 3]> {
        self.star(u).filter(move |face| face.contains(&v))
    }

    fn neighbours(&self, v: u32) -> BTreeSet<u32> {
        self.star(v).flatten().filter(|&w| w != v).collect()
    }

    fn link(&self, u: u32) -> Link {
        let mut next = BTreeMap::new();
        let mut entered = BTreeSet::new();
        let mut simple = true;
        for face in self.star(u) {
            let i = face.iter().position(|&w| w == u).unwrap_or(0);
            let (from, to) = (face[(i + 1) % 3], face[(i + 2) % 3]);
            simple &= next.insert(from, to).is_none() && entered.insert(to);
        }
        let start = next.keys().copied().find(|v| !entered.contains(v));
        let mut at = start.or_else(|| next.keys().next().copied());
        let first = at;
        let (mut steps, mut end) = (0, None);
        while let Some(to) = at.and_then(|v| next.get(&v).copied()) {
            steps += 1;
            end = start.map(|_| to);
            at = Some(to).filter(|_| steps < next.len() && Some(to) != first);
        }
        Link { manifold: simple && steps > 0 && steps == next.len(), start, end }
    }

    fn allows(&self, u: u32, v: u32) -> bool {
        let link = self.link(u);
        let is_boundary = link.start.is_some();
        let along_boundary = link.start == Some(v) || link.end == Some(v);
        let apexes: BTreeSet<u32> =
            self.faces_of_edge(u, v).flatten().filter(|&w| w != u && w != v).collect();
        let common: BTreeSet<u32> = self.neighbours(u).intersection(&self.neighbours(v)).copied().collect();
        link.manifold
            && !self.locked.get(u as usize).is_some_and(|l| *l)
            && (!is_boundary || along_boundary)
            && !apexes.is_empty()
            && common == apexes
            && apexes.iter().all(|&w| self.leaves_an_edge(u, v, w))
            && self.moved_faces(u, v).all(|(_, new)| !self.has_face(new))
            && self.moved_faces(u, v).all(|(old, new)| !self.flips(old, new))
    }

    /// Whether the two outer edges of a face that goes become one edge of one or two faces: it loses this face twice.
    fn leaves_an_edge(&self, u: u32, v: u32, apex: u32) -> bool {
        let faces = self.faces_of_edge(u, apex).count() + self.faces_of_edge(v, apex).count();
        matches!(faces, 3 | 4)
    }

    /// Faces that the collapse keeps, before and after.
    fn moved_faces(&self, u: u32, v: u32) -> impl Iterator<Item = ([u32; 3], [u32; 3])> {
        self.star(u)
            .filter(move |face| !face.contains(&v))
            .map(move |face| (face, face.map(|w| if w == u { v } else { w })))
    }

    fn has_face(&self, face: [u32; 3]) -> bool {
        self.star(face[0]).any(|other| face.iter().all(|v| other.contains(v)))
    }

    /// A face without area has no side to flip to.
    fn flips(&self, old: [u32; 3], new: [u32; 3]) -> bool {
        let (old, new) = (self.area_vector(old), self.area_vector(new));
        old.norm() > 0.0 && new.dot(&old) <= LEAST_COSINE * old.norm() * new.norm()
    }

    fn collapse(&mut self, u: u32, v: u32) {
        let around = self.neighbours(u);
        for index in std::mem::take(&mut self.stars[u as usize]) {
            let Some(face) = self.faces[index] else { continue };
            if face.contains(&v) {
                self.faces[index] = None;
                self.live -= 1;
                for w in face.into_iter().filter(|&w| w != u) {
                    self.stars[w as usize].remove(&index);
                }
            } else {
                self.faces[index] = Some(face.map(|w| if w == u { v } else { w }));
                self.stars[v as usize].insert(index);
            }
        }

        let merged = self.quadrics[u as usize];
        self.quadrics[v as usize] += merged;
        self.removed[u as usize] = true;

        for half in around.into_iter().flat_map(|w| [(u, w), (w, u)]) {
            if let Some(cost) = self.costs.remove(&half) {
                self.queue.remove(&(cost, half.0, half.1));
            }
        }

        self.queue_around(v);
        for w in self.neighbours(v) {
            self.queue_around(w);
        }
    }

    /// Prices every half edge at `v` anew: those refused before get another chance where the surface changed.
    fn queue_around(&mut self, v: u32) {
        for w in self.neighbours(v) {
            for (from, to) in [(v, w), (w, v)] {
                let p = self.points[to as usize].to_homogeneous();
                // Adding zero turns -0, whose bits are the largest, into 0.
                let cost = ((p.transpose() * self.quadrics[from as usize] * p)[0].max(0.0) + 0.0).to_bits();
                if let Some(old) = self.costs.insert((from, to), cost) {
                    self.queue.remove(&(old, from, to));
                }
                self.queue.insert((cost, from, to));
            }
        }
    }

    fn into_mesh(self, mesh: &TriMesh) -> TriMesh {
        let mut vertices = Vertices::default();
        vertices.gather(mesh.view(), (0..self.removed.len()).filter(|v| !self.removed[*v]));
        let mut count = 0;
        let numbers: Vec<u32> = self
            .removed
            .iter()
            .map(|gone| {
                count += u32::from(!gone);
                count.saturating_sub(1)
            })
            .collect();
        TriMesh {
            vertices,
            triangles: self.faces.iter().flatten().map(|f| f.map(|v| numbers[v as usize])).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{crack::topology, hausdorff::deviation};
    use chpm_synth::{Shape, Synth, hand};

    #[test]
    fn a_sphere_halves_and_stays_a_sphere() {
        let mesh = Synth::new(Shape::Sphere, 2000, 0).to_mesh();
        let half = simplify(&mesh, mesh.triangles.len() / 2, &[]);
        assert_eq!(half.triangles.len(), mesh.triangles.len() / 2);
        let shape = topology(&half);
        assert!(shape.is_closed() && shape.is_manifold() && shape.euler == 2);
        // An edge of 0.12 leaves a chord 0.002 deep; half the vertices make it twice that.
        let error = deviation(&mesh, &half, 8);
        assert!(error.max() > 1e-4 && error.max() < 0.02, "{error:?}");
    }

    #[test]
    fn a_plane_collapses_to_two_triangles_without_error() {
        let mesh = hand::grid(8, 6);
        let least = simplify(&mesh, 2, &[]);
        assert_eq!(least.triangles.len(), 2);
        assert_eq!(deviation(&mesh, &least, 8).max(), 0.0);
        assert_eq!(topology(&least).boundary_loops, 1);
    }

    #[test]
    fn locked_vertices_stay() {
        let mesh = Synth::new(Shape::Terrain, 400, 3).to_mesh();
        let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v % 3 == 0).collect();
        let least = simplify(&mesh, 0, &locked);
        let kept = mesh.positions.iter().zip(&locked).filter(|(_, l)| **l).map(|(p, _)| p);
        assert!(kept.clone().all(|p| least.positions.contains(p)));
        assert!(least.positions.len() < mesh.positions.len() / 2 && least.positions.len() >= kept.count());
        assert_eq!(simplify(&mesh, 0, &vec![true; mesh.positions.len()]), mesh);
    }

    #[test]
    fn topology_stays_as_it_is() {
        for shape in Shape::ALL {
            let mesh = Synth::new(shape, 1500, 5).to_mesh();
            let (before, after) = (topology(&mesh), topology(&simplify(&mesh, 0, &[])));
            assert!(after.is_manifold(), "{shape}");
            assert!(after.faces < before.faces, "{shape}");
            assert_eq!(
                (before.components, before.boundary_loops, before.euler),
                (after.components, after.boundary_loops, after.euler),
                "{shape}"
            );
        }
    }

    #[test]
    fn what_cannot_collapse_is_returned_as_it_is() {
        for mesh in [
            TriMesh::default(),
            hand::tetrahedron(),
            hand::strip(1),
            hand::bow_tie(),
            hand::edge_fan(5),
            hand::soup(4),
            hand::isolated_vertex(),
        ] {
            assert_eq!(simplify(&mesh, 0, &[]), mesh);
        }
    }

    #[test]
    fn attributes_follow_their_vertices() {
        let mut mesh = hand::grid(4, 4);
        mesh.normals = mesh.positions.clone();
        mesh.colors = (0..25).map(|i| [i, 0, 0, 255]).collect();
        let least = simplify(&mesh, 0, &[]);
        assert_eq!(least.normals, least.positions);
        for (p, c) in least.positions.iter().zip(&least.colors) {
            assert_eq!(mesh.positions[usize::from(c[0])], *p);
        }
    }
}
