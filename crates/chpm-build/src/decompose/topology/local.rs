//! Counts of the topology of one leaf.

use super::sets::Sets;
use crate::report::Repairs;
use bytemuck::{Pod, Zeroable};
use chpm_mesh::geom;
use serde::{Deserialize, Serialize};

/// No shared id: the vertex belongs to this leaf alone.
pub(super) const LOOSE: u32 = u32::MAX;
/// Local vertices that there can be; a table of this length takes any `u16` without a check.
const TABLE: usize = 1 << 16;

/// Counts of one leaf, or of several, and edges and components that other leaves have to settle.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct TopologyCounts {
    /// Counts of all that is complete.
    pub(super) found: Repairs,
    /// Edges between shared vertices.
    pub(super) edges: Vec<EdgeUse>,
    /// Fans about shared vertices.
    pub(super) fans: Vec<Fan>,
    /// Pairs of shared ids that faces connect; a pair of equals makes a vertex known.
    pub(super) connected: Vec<[u32; 2]>,
    /// Pairs of shared ids that boundary edges connect; a pair of equals makes a vertex known.
    pub(super) bordering: Vec<[u32; 2]>,
    /// Shared ids of vertices that are known to be non-manifold.
    pub(super) non_manifold: Vec<u32>,
}

impl TopologyCounts {
    /// The same with other shared ids.
    pub(crate) fn renumbered(mut self, new: impl Fn(u32) -> u32) -> Self {
        for edge in &mut self.edges {
            let [a, b] = edge.ends.map(&new);
            if a > b {
                edge.faces = Faces { forward: edge.faces.backward, backward: edge.faces.forward };
            }
            edge.ends = [a.min(b), a.max(b)];
        }
        for fan in &mut self.fans {
            fan.vertex = new(fan.vertex);
            fan.ends = fan.ends.map(|end| if end == LOOSE { LOOSE } else { new(end) });
        }
        for pair in self.connected.iter_mut().chain(&mut self.bordering) {
            *pair = pair.map(&new);
        }
        self.non_manifold.iter_mut().for_each(|id| *id = new(*id));
        self
    }
}

/// The faces of one leaf on an edge between shared vertices.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub(super) struct EdgeUse {
    /// Shared ids of its ends, ascending.
    pub(super) ends: [u32; 2],
    pub(super) faces: Faces,
}

/// The faces on an edge by the direction in which they walk it. Counts saturate: beyond two they need not be exact.
#[derive(
    Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default, Pod, Zeroable, Serialize, Deserialize,
)]
#[repr(C)]
pub(super) struct Faces {
    pub(super) forward: u16,
    pub(super) backward: u16,
}

impl Faces {
    pub(super) fn add(&mut self, other: Faces) {
        self.forward = self.forward.saturating_add(other.forward);
        self.backward = self.backward.saturating_add(other.backward);
    }

    fn degree(self) -> u32 {
        u32::from(self.forward) + u32::from(self.backward)
    }

    /// Counts the edge that these are all faces of.
    pub(super) fn count(self, found: &mut Repairs) -> EdgeKind {
        match (self.degree(), self.forward) {
            (1, _) => {
                found.boundary_edges += 1;
                EdgeKind::Boundary
            }
            (2, 1) => EdgeKind::Regular,
            (2, _) => {
                found.mixed_winding_edges += 1;
                EdgeKind::Regular
            }
            _ => {
                found.non_manifold_edges += 1;
                EdgeKind::NonManifold
            }
        }
    }
}

/// Kind of an edge by the number of its faces.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum EdgeKind {
    Boundary,
    Regular,
    NonManifold,
}

/// One fan of a leaf's faces about a shared vertex: a run of faces, each of which shares an edge at the vertex with the next.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub(super) struct Fan {
    /// Shared id of the vertex.
    pub(super) vertex: u32,
    /// Shared ids of the first and last neighbour; [`LOOSE`] where no other leaf can continue the fan.
    pub(super) ends: [u32; 2],
}

impl Fan {
    fn closed(vertex: u32) -> Self {
        Fan { vertex, ends: [LOOSE; 2] }
    }
}

/// Counts leaves, one after the other; holds the tables for that.
#[derive(Debug)]
pub(crate) struct Surveyor {
    points: Vec<[f32; 3]>,
    /// Shared id by local vertex, or [`LOOSE`].
    ids: Vec<u32>,
    /// Faces about each vertex, as the two corners that follow it: `wings[starts[v]..starts[v + 1]]`.
    starts: Vec<u32>,
    wings: Vec<(u16, u16)>,
    /// By neighbour: the vertex that was looked at when this was written, and a value.
    next: Box<[(u16, u16); TABLE]>,
    /// Vertices that are not known to have one closed fan, ascending.
    open: Vec<u16>,
    link: Link,
    border: Sets,
    surface: Sets,
    /// By root of a set: the first shared id in it.
    first: Vec<u32>,
    /// Whether two faces about a vertex might be copies of one another.
    doubtful: Vec<bool>,
    copies: Vec<[u16; 3]>,
}

impl Default for Surveyor {
    fn default() -> Self {
        Surveyor {
            points: Vec::new(),
            ids: Vec::new(),
            starts: Vec::new(),
            wings: Vec::new(),
            next: Box::new([(u16::MAX, 0); TABLE]),
            open: Vec::new(),
            link: Link::default(),
            border: Sets::default(),
            surface: Sets::default(),
            first: Vec::new(),
            doubtful: Vec::new(),
            copies: Vec::new(),
        }
    }
}

impl Surveyor {
    /// Counts one leaf: `triangles` over local vertices (three different ones each), whose global numbers are `vertices`
    /// (each in some triangle), `shared` of which other leaves may use too, given as (local, shared id).
    pub(crate) fn survey(
        &mut self,
        triangles: &[[u16; 3]],
        vertices: &[u32],
        shared: &[(u16, u32)],
        positions: &[[f32; 3]],
    ) -> TopologyCounts {
        let mut leaf = TopologyCounts::default();
        self.ids.clear();
        self.ids.resize(vertices.len(), LOOSE);
        for &(local, id) in shared {
            self.ids[usize::from(local)] = id;
        }

        self.count_zero_areas(triangles, vertices, positions, &mut leaf);
        self.count_components(triangles, vertices.len(), shared, &mut leaf);
        self.gather_wings(triangles, vertices.len());
        self.find_open();
        self.border.absent(if self.open.is_empty() { 0 } else { vertices.len() });
        self.doubtful.clear();
        self.next[..vertices.len()].fill((u16::MAX, 0));

        for index in 0..self.open.len() {
            self.look_at(self.open[index], &mut leaf);
        }

        if self.border.count > 0 {
            leaf.found.boundary_loops =
                hand_over(&mut self.border, marked(shared), &mut self.first, &mut leaf.bordering);
        }
        if !self.doubtful.is_empty() {
            leaf.found.two_sided_faces = self.count_copies(triangles);
        }
        leaf
    }

    fn count_zero_areas(
        &mut self,
        triangles: &[[u16; 3]],
        vertices: &[u32],
        positions: &[[f32; 3]],
        leaf: &mut TopologyCounts,
    ) {
        self.points.clear();
        self.points.extend(vertices.iter().map(|v| positions[*v as usize]));
        leaf.found.zero_area_faces = triangles
            .iter()
            .filter(|t| {
                let [a, b, c] = t.map(|v| self.points[usize::from(v)]);
                geom::area_vector(a, b, c).iter().all(|x| *x == 0.0)
            })
            .count() as u64;
    }

    fn count_components(
        &mut self,
        triangles: &[[u16; 3]],
        vertex_count: usize,
        shared: &[(u16, u32)],
        leaf: &mut TopologyCounts,
    ) {
        self.surface.singletons(vertex_count);
        for &[a, b, c] in triangles {
            self.surface.join_present(u32::from(a), u32::from(b));
            self.surface.join_present(u32::from(a), u32::from(c));
        }
        leaf.found.components =
            hand_over(&mut self.surface, marked(shared), &mut self.first, &mut leaf.connected);
    }

    fn gather_wings(&mut self, triangles: &[[u16; 3]], vertex_count: usize) {
        self.starts.clear();
        self.starts.resize(vertex_count + 1, 0);
        for corner in triangles.as_flattened() {
            self.starts[usize::from(*corner)] += 1;
        }
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.wings.resize(3 * triangles.len(), (0, 0));
        for &[a, b, c] in triangles {
            for (v, wing) in [(a, (b, c)), (b, (c, a)), (c, (a, b))] {
                let start = &mut self.starts[usize::from(v)];
                *start -= 1;
                self.wings[*start as usize] = wing;
            }
        }
    }

    /// Finds the vertices that are shared or do not have one closed fan of three or more faces, wound the same way. All
    /// edges at any other vertex have two faces in opposite directions, and no two of its faces are copies.
    fn find_open(&mut self) {
        let vertex_count = self.ids.len();
        self.next[..vertex_count].fill((u16::MAX, 0));
        self.open.clear();
        for vertex in 0..vertex_count {
            let wings = &self.wings[self.starts[vertex] as usize..self.starts[vertex + 1] as usize];
            let vertex = vertex as u16;
            for &(a, b) in wings {
                self.next[usize::from(a)] = (vertex, b);
            }
            let Some(&(first, _)) = wings.first() else { continue };
            // A walk of as many steps as there are wings that comes home with the last step and not before has met as
            // many different neighbours, each with a wing of its own.
            let (mut at, mut homes, mut lost) = (first, 0, false);
            for _ in 0..wings.len() {
                let (owner, to) = self.next[usize::from(at)];
                lost |= owner != vertex;
                at = to;
                homes += u32::from(at == first);
            }
            let closed = !lost && at == first && homes == 1 && wings.len() >= 3;
            if !closed || self.ids[usize::from(vertex)] != LOOSE {
                self.open.push(vertex);
            }
        }
    }

    /// Counts or hands over the fans of an open vertex, and its edges to later ones. (Edges to vertices that are not open
    /// have nothing to count.)
    fn look_at(&mut self, vertex: u16, leaf: &mut TopologyCounts) {
        let wings = &self.wings
            [self.starts[usize::from(vertex)] as usize..self.starts[usize::from(vertex) + 1] as usize];
        self.link.gather(vertex, wings, &mut self.next);
        let id = self.ids[usize::from(vertex)];
        for &(neighbor, faces) in &self.link.neighbors {
            let neighbor_id = self.ids[usize::from(neighbor)];
            if neighbor < vertex {
                continue;
            }
            if id == LOOSE || neighbor_id == LOOSE {
                if faces.count(&mut leaf.found) == EdgeKind::Boundary {
                    self.border.join(u32::from(vertex), u32::from(neighbor));
                }
            } else if id < neighbor_id {
                leaf.edges.push(EdgeUse { ends: [id, neighbor_id], faces });
            } else {
                let faces = Faces { forward: faces.backward, backward: faces.forward };
                leaf.edges.push(EdgeUse { ends: [neighbor_id, id], faces });
            }
        }
        let knotted = self.link.is_knotted();
        if knotted || self.link.closed_fans() > 0 {
            self.doubtful.resize(self.ids.len(), false);
            self.doubtful[usize::from(vertex)] = true;
        }
        if id == LOOSE {
            leaf.found.non_manifold_vertices += u64::from(knotted || self.link.fans.count != 1);
        } else if knotted {
            // Other leaves have faces about it too, and nothing joins those to a closed fan: it is no manifold vertex.
            leaf.fans.push(Fan::closed(id));
        } else {
            self.link.hand_over(id, &self.ids, &mut leaf.fans);
        }
    }

    /// Counts faces that have the vertices of an earlier one; all three of them are then doubtful.
    fn count_copies(&mut self, triangles: &[[u16; 3]]) -> u64 {
        self.copies.clear();
        for &triangle in triangles {
            if triangle.iter().all(|v| self.doubtful[usize::from(*v)]) {
                let mut sorted = triangle;
                sorted.sort_unstable();
                self.copies.push(sorted);
            }
        }
        let all = self.copies.len();
        self.copies.sort_unstable();
        self.copies.dedup();
        (all - self.copies.len()) as u64
    }
}

/// The link of a vertex: its neighbours with the faces on the edges to them, and which of them hang together.
#[derive(Debug, Default)]
struct Link {
    neighbors: Vec<(u16, Faces)>,
    /// Fans, as sets of indices into `neighbors`.
    fans: Sets,
    /// Per set, at its root: the neighbour at its first end.
    first_ends: Vec<u32>,
}

impl Link {
    fn gather(&mut self, vertex: u16, wings: &[(u16, u16)], slots: &mut [(u16, u16); TABLE]) {
        self.neighbors.clear();
        self.fans.absent(2 * wings.len());
        for &(a, b) in wings {
            let [a, b] = [a, b].map(|neighbor| {
                let (owner, slot) = &mut slots[usize::from(neighbor)];
                if *owner != vertex {
                    (*owner, *slot) = (vertex, self.neighbors.len() as u16);
                    self.neighbors.push((neighbor, Faces::default()));
                }
                *slot
            });
            self.neighbors[usize::from(a)].1.add(Faces { forward: 1, backward: 0 });
            self.neighbors[usize::from(b)].1.add(Faces { forward: 0, backward: 1 });
            self.fans.join(u32::from(a), u32::from(b));
        }
    }

    /// Whether some edge at the vertex has more than two faces.
    fn is_knotted(&self) -> bool {
        self.neighbors.iter().any(|(_, faces)| faces.degree() > 2)
    }

    /// How many fans close up; there must be no knot.
    fn closed_fans(&self) -> u32 {
        let ends = self.neighbors.iter().filter(|(_, faces)| faces.degree() == 1).count();
        self.fans.count - ends as u32 / 2
    }

    /// Records the fans about the shared vertex `id`; there must be no knot.
    fn hand_over(&mut self, id: u32, ids: &[u32], fans: &mut Vec<Fan>) {
        const NONE: u32 = u32::MAX;
        self.first_ends.clear();
        self.first_ends.resize(self.neighbors.len(), NONE);
        for (slot, (neighbor, faces)) in self.neighbors.iter().enumerate() {
            if faces.degree() == 1 {
                let first = &mut self.first_ends[self.fans.find(slot as u32) as usize];
                if *first == NONE {
                    *first = u32::from(*neighbor);
                } else {
                    fans.push(Fan { vertex: id, ends: [ids[*first as usize], ids[usize::from(*neighbor)]] });
                }
            }
        }
        fans.extend((0..self.closed_fans()).map(|_| Fan::closed(id)));
    }
}

fn marked(shared: &[(u16, u32)]) -> impl Iterator<Item = (u32, u32)> {
    shared.iter().map(|(local, id)| (u32::from(*local), *id))
}

/// Writes down which shared vertices, given by number in the sets and id, hang together, as pairs; returns how many sets hold
/// none.
pub(super) fn hand_over(
    sets: &mut Sets,
    shared: impl Iterator<Item = (u32, u32)>,
    first: &mut Vec<u32>,
    pairs: &mut Vec<[u32; 2]>,
) -> u64 {
    let mut whole = sets.count;
    first.clear();
    first.resize(sets.len(), LOOSE);
    for (local, id) in shared {
        if sets.contains(local) {
            let first = &mut first[sets.find(local) as usize];
            if *first == LOOSE {
                *first = id;
                whole -= 1;
            }
            pairs.push([*first, id]);
        }
    }
    u64::from(whole)
}
