//! Cracks and topology, from sorted half edges; nothing here trusts an adjacency that a simplifier made.

use crate::box_tree::BoxTree;
use chpm_mesh::{Aabb, TriMesh, geom};

/// How the edges of a mesh are used.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct EdgeCounts {
    /// Undirected edges.
    pub edges: usize,
    /// Edges of one face.
    pub boundary: usize,
    /// Edges of more than two faces.
    pub non_manifold: usize,
    /// Edges of two faces that walk them in the same direction.
    pub inconsistent: usize,
}

/// Topology of a mesh. Vertices that no triangle uses are not counted.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Topology {
    /// Vertices that triangles use.
    pub vertices: usize,
    /// Undirected edges.
    pub edges: usize,
    /// Triangles.
    pub faces: usize,
    /// Sets of triangles that are connected through vertices.
    pub components: usize,
    /// Closed walks along boundary edges; a walk passes a vertex without changing from one fan of faces to another.
    pub boundary_loops: usize,
    /// Fans of faces beyond the first one of each vertex: 2 fans at the middle of a bow tie count 1.
    pub extra_fans: usize,
    /// Edges of more than two faces.
    pub non_manifold_edges: usize,
    /// Vertices less edges plus faces.
    pub euler: i64,
}

impl Topology {
    /// Whether there is no boundary edge.
    pub fn is_closed(&self) -> bool {
        self.boundary_loops == 0
    }

    /// Whether every edge has at most two faces and every vertex one fan.
    pub fn is_manifold(&self) -> bool {
        self.non_manifold_edges == 0 && self.extra_fans == 0
    }
}

/// A place where a level of detail may let the background through. Vertices are the level of detail's.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Crack {
    /// A boundary edge whose ends are not both on the boundary of the source.
    Opened {
        /// Ends, in the direction of its face.
        edge: [u32; 2],
    },
    /// A boundary vertex strictly inside a boundary edge that it is no end of.
    TJunction {
        /// The vertex.
        vertex: u32,
        /// Ends of the edge, in the direction of its face.
        edge: [u32; 2],
    },
}

/// A T-junction is this close to its edge, and this far from its ends, in lengths of the edge.
pub const T_JUNCTION_TOLERANCE: f64 = 1e-5;

/// A side of a triangle, seen from its smaller to its larger vertex.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    ends: [u32; 2],
    /// Whether the face walks from the larger to the smaller.
    backward: bool,
    /// Places of the two ends in the flattened corners.
    corners: [u32; 2],
}

impl HalfEdge {
    fn directed(self) -> [u32; 2] {
        let [a, b] = self.ends;
        if self.backward { [b, a] } else { [a, b] }
    }
}

fn half_edges(triangles: &[[u32; 3]]) -> Vec<HalfEdge> {
    let mut halves = Vec::with_capacity(3 * triangles.len());
    for (face, triangle) in triangles.iter().enumerate() {
        for i in 0..3 {
            let j = (i + 1) % 3;
            let [p, q] = [i, j].map(|k| (3 * face + k) as u32);
            let (u, v) = (triangle[i], triangle[j]);
            halves.push(if u <= v {
                HalfEdge { ends: [u, v], backward: false, corners: [p, q] }
            } else {
                HalfEdge { ends: [v, u], backward: true, corners: [q, p] }
            });
        }
    }
    halves.sort_unstable();
    halves
}

fn by_edge(halves: &[HalfEdge]) -> impl Iterator<Item = &[HalfEdge]> {
    halves.chunk_by(|a, b| a.ends == b.ends)
}

/// Boundary edges in the direction of their faces, in order of their ends.
fn boundary_edges(mesh: &TriMesh) -> Vec<[u32; 2]> {
    by_edge(&half_edges(&mesh.triangles)).filter(|e| e.len() == 1).map(|e| e[0].directed()).collect()
}

/// Counts edges by how many faces use them, and which way.
pub fn edge_counts(mesh: &TriMesh) -> EdgeCounts {
    let mut edges = EdgeCounts::default();
    for edge in by_edge(&half_edges(&mesh.triangles)) {
        edges.edges += 1;
        match edge {
            [_] => edges.boundary += 1,
            [a, b] => edges.inconsistent += usize::from(a.backward == b.backward),
            _ => edges.non_manifold += 1,
        }
    }
    edges
}

/// The ends of boundary edges, each once, in order.
pub fn boundary_vertices(mesh: &TriMesh) -> Vec<u32> {
    let mut vertices = boundary_edges(mesh).concat();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// The mesh with vertices of the same position bits made one; triangles that so lose an edge go, attributes too.
///
/// Pieces that are drawn together share positions, not indices: weld before looking for cracks between them.
///
/// # Panics
/// If a triangle names a vertex that is not there.
///
/// # Examples
/// ```
/// let soup = chpm_measure::weld(&chpm_synth::hand::cube());
/// assert_eq!(soup.positions.len(), 8);
/// ```
pub fn weld(mesh: &TriMesh) -> TriMesh {
    fn key(v: u32, mesh: &TriMesh) -> [u32; 3] {
        mesh.positions[v as usize].map(f32::to_bits)
    }
    let mut order: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    order.sort_unstable_by_key(|&v| (key(v, mesh), v));
    let mut first = vec![0; order.len()];
    for same in order.chunk_by(|&a, &b| key(a, mesh) == key(b, mesh)) {
        same.iter().for_each(|&v| first[v as usize] = same[0]);
    }
    let welded = mesh.triangles.iter().map(|t| t.map(|v| first[v as usize]));
    let triangles = welded.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    TriMesh::new(mesh.positions.clone(), triangles)
}

/// Finds the cracks of a level of detail of `source`, in order.
///
/// Positions are compared by their bits: a level of detail keeps source vertices and moves none. Weld both meshes
/// first where they are made of pieces.
///
/// # Panics
/// If a triangle of either names a vertex that is not there.
///
/// # Examples
/// ```
/// let source = chpm_synth::hand::icosphere(1);
/// let mut broken = source.clone();
/// broken.triangles.pop();
/// assert!(chpm_measure::cracks(&source, &source).is_empty());
/// assert!(!chpm_measure::cracks(&broken, &source).is_empty());
/// ```
pub fn cracks(lod: &TriMesh, source: &TriMesh) -> Vec<Crack> {
    fn bits(mesh: &TriMesh, v: u32) -> [u32; 3] {
        mesh.positions[v as usize].map(f32::to_bits)
    }
    let mut allowed: Vec<[u32; 3]> = boundary_vertices(source).into_iter().map(|v| bits(source, v)).collect();
    allowed.sort_unstable();
    let edges = boundary_edges(lod);
    let opened = edges
        .iter()
        .filter(|e| !e.iter().all(|v| allowed.binary_search(&bits(lod, *v)).is_ok()))
        .map(|&edge| Crack::Opened { edge });
    let mut found: Vec<Crack> = opened.chain(t_junctions(lod, &edges)).collect();
    found.sort_unstable();
    found
}

fn t_junctions(mesh: &TriMesh, edges: &[[u32; 2]]) -> Vec<Crack> {
    fn position(v: u32, mesh: &TriMesh) -> nalgebra::Point3<f64> {
        geom::to_f64(mesh.positions[v as usize])
    }
    let length = |[a, b]: [u32; 2]| (position(b, mesh) - position(a, mesh)).norm();
    fn ends([a, b]: &[u32; 2], mesh: &TriMesh) -> [[f32; 3]; 2] {
        [*a, *b].map(|v| mesh.positions[v as usize])
    }
    let boxes: Vec<Aabb> = edges.iter().map(|edge| Aabb::of_points(&ends(edge, mesh))).collect();
    let tree = BoxTree::reaching(&boxes, |edge| T_JUNCTION_TOLERANCE * length(edges[edge]));

    let mut vertices = edges.concat();
    vertices.sort_unstable();
    vertices.dedup();

    let mut found = Vec::new();
    for vertex in vertices {
        let point = position(vertex, mesh);
        tree.for_each_reaching(point, |place| {
            let edge @ [a, b] = edges[tree.order()[place] as usize];
            let (along, to) = (position(b, mesh) - position(a, mesh), point - position(a, mesh));
            let length = length(edge);
            let t = along.dot(&to) / (length * length);
            let inside = t > T_JUNCTION_TOLERANCE && t < 1.0 - T_JUNCTION_TOLERANCE;
            let close = (to - along * t).norm() <= T_JUNCTION_TOLERANCE * length;
            if vertex != a && vertex != b && inside && close {
                found.push(Crack::TJunction { vertex, edge });
            }
        });
    }
    found
}

/// Counts components, boundary loops and the rest.
///
/// ```
/// let sphere = chpm_measure::topology(&chpm_synth::hand::icosphere(2));
/// assert!(sphere.is_closed() && sphere.is_manifold());
/// assert!(!chpm_measure::topology(&chpm_synth::hand::bow_tie()).is_manifold());
/// ```
pub fn topology(mesh: &TriMesh) -> Topology {
    let halves = half_edges(&mesh.triangles);
    let edges = edge_counts(mesh);
    let corners: Vec<u32> = mesh.triangles.concat();
    let mut used: Vec<(u32, u32)> = corners.iter().enumerate().map(|(c, &v)| (v, c as u32)).collect();
    used.sort_unstable();
    let at_vertices = || used.chunk_by(|a, b| a.0 == b.0);

    // Corners joined across edges of two faces are fans; fans joined along boundary edges are loops.
    let mut fans = Sets::new(corners.len());
    for edge in by_edge(&halves) {
        if let [a, b] = edge {
            fans.join(a.corners[0], b.corners[0]);
            fans.join(a.corners[1], b.corners[1]);
        }
    }
    let fan_count = fans.count(0..corners.len() as u32);
    let boundary: Vec<HalfEdge> = by_edge(&halves).filter(|e| e.len() == 1).map(|e| e[0]).collect();
    let mut loops = fans;
    boundary.iter().for_each(|half| loops.join(half.corners[0], half.corners[1]));

    let mut parts = Sets::new(mesh.triangles.len());
    for vertex in at_vertices() {
        vertex.iter().for_each(|(_, corner)| parts.join(vertex[0].1 / 3, corner / 3));
    }
    let vertices = at_vertices().count();
    Topology {
        vertices,
        edges: edges.edges,
        faces: mesh.triangles.len(),
        components: parts.count(0..mesh.triangles.len() as u32),
        boundary_loops: loops.count(boundary.iter().map(|half| half.corners[0])),
        extra_fans: fan_count - vertices,
        non_manifold_edges: edges.non_manifold,
        euler: vertices as i64 - edges.edges as i64 + mesh.triangles.len() as i64,
    }
}

/// Disjoint sets by union and path halving; the smallest member represents.
struct Sets(Vec<u32>);

impl Sets {
    fn new(len: usize) -> Self {
        Sets((0..len as u32).collect())
    }

    fn find(&mut self, mut x: u32) -> u32 {
        while self.0[x as usize] != x {
            let up = self.0[self.0[x as usize] as usize];
            self.0[x as usize] = up;
            x = up;
        }
        x
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// Sets that `members` are in.
    fn count(&mut self, members: impl Iterator<Item = u32>) -> usize {
        let mut roots: Vec<u32> = members.map(|m| self.find(m)).collect();
        roots.sort_unstable();
        roots.dedup();
        roots.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_synth::{Shape, Synth, hand};

    #[test]
    fn hand_meshes_are_what_they_say() {
        // vertices, edges, faces, components, loops, extra fans, edges of many faces, same-direction edges
        for (name, mesh, expected) in [
            ("tetrahedron", hand::tetrahedron(), [4, 6, 4, 1, 0, 0, 0, 0]),
            ("cube", hand::cube(), [8, 18, 12, 1, 0, 0, 0, 0]),
            ("grid", hand::grid(3, 2), [12, 23, 12, 1, 1, 0, 0, 0]),
            ("fan", hand::fan(7), [8, 14, 7, 1, 1, 0, 0, 0]),
            ("strip", hand::strip(5), [7, 11, 5, 1, 1, 0, 0, 0]),
            ("bow tie", hand::bow_tie(), [5, 6, 2, 1, 2, 1, 0, 0]),
            ("moebius", hand::moebius(6), [12, 24, 12, 1, 1, 0, 0, 1]),
            ("klein bottle", hand::klein_bottle(5), [25, 75, 50, 1, 0, 0, 0, 5]),
            ("two cubes", hand::two_cubes_sharing_an_edge(), [14, 35, 24, 1, 0, 2, 1, 0]),
            ("isolated vertex", hand::isolated_vertex(), [3, 3, 1, 1, 1, 0, 0, 0]),
            ("mixed winding", hand::mixed_winding(), [4, 5, 2, 1, 1, 0, 0, 1]),
            ("soup", hand::soup(3), [9, 9, 3, 3, 3, 0, 0, 0]),
            ("edge fan", hand::edge_fan(4), [6, 9, 4, 1, 4, 6, 1, 0]),
            ("icosphere", hand::icosphere(2), [162, 480, 320, 1, 0, 0, 0, 0]),
            ("nothing", TriMesh::default(), [0; 8]),
        ] {
            let t = topology(&mesh);
            let same = edge_counts(&mesh).inconsistent;
            let found = [
                t.vertices,
                t.edges,
                t.faces,
                t.components,
                t.boundary_loops,
                t.extra_fans,
                t.non_manifold_edges,
                same,
            ];
            assert_eq!(found, expected, "{name}");
            assert_eq!(t.euler, t.vertices as i64 - t.edges as i64 + t.faces as i64, "{name}");
        }
        let twice = edge_counts(&hand::duplicate_faces());
        assert_eq!(twice, EdgeCounts { edges: 5, boundary: 2, non_manifold: 1, inconsistent: 2 });
    }

    #[test]
    fn boundary_of_a_grid() {
        assert_eq!(boundary_vertices(&hand::grid(2, 2)), [0, 1, 2, 3, 5, 6, 7, 8]);
        assert!(boundary_vertices(&hand::cube()).is_empty());
    }

    #[test]
    fn a_missing_triangle_is_a_crack() {
        let source = Synth::new(Shape::Terrain, 200, 1).to_mesh();
        assert_eq!(cracks(&source, &source), []);
        let mut lod = source.clone();
        let [a, b, c] = lod.triangles.remove(95);
        let edges = cracks(&lod, &source).into_iter().map(|crack| match crack {
            Crack::Opened { edge } => edge,
            Crack::TJunction { .. } => panic!("{crack:?}"),
        });
        let mut expected = [[b, a], [c, b], [a, c]];
        expected.sort_by_key(|e| *e);
        assert_eq!(edges.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn a_simplified_mesh_has_no_cracks() {
        let source = Synth::new(Shape::Terrain, 600, 2).to_mesh();
        assert_eq!(cracks(&crate::naive::simplify(&source, 150, &[]), &source), []);
    }

    #[test]
    fn a_vertex_inside_an_edge_is_a_t_junction() {
        // Two triangles below the x axis meet one above it at (1, 0).
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0]];
        let mesh = TriMesh::new(positions, vec![[0, 3, 1], [1, 3, 2], [0, 2, 4]]);
        assert_eq!(cracks(&mesh, &mesh), [Crack::TJunction { vertex: 1, edge: [0, 2] }]);
        let mut apart = mesh.clone();
        apart.positions[1][1] = -1e-3;
        assert_eq!(cracks(&apart, &apart), []);
    }

    #[test]
    fn welding_joins_by_position() {
        let grid = hand::grid(3, 3);
        let corners = grid.triangles.iter().flat_map(|t| grid.corners(*t)).collect();
        let soup = TriMesh::new(corners, (0..18).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect());
        assert_eq!(topology(&soup).components, 18);
        assert_eq!(topology(&weld(&soup)), topology(&grid));
        assert_eq!(cracks(&weld(&soup), &grid), []);
        assert!(!cracks(&soup, &grid).is_empty());
        let degenerate = TriMesh::new(vec![[0.0; 3]; 3], vec![[0, 1, 2]]);
        assert!(weld(&degenerate).triangles.is_empty());
    }
}
