//! Order of vertices and triangles in a page (Yoon 6.3 and 6.4.1).
//!
//! One cache-oblivious order of the finest mesh's vertices decides both: the base mesh's vertices take it as it is, and the
//! triangles are induced from it, each coming with its first vertex. The vertices that collapse stay where the collapse order
//! puts them.

use super::multilevel::{Graph, Multilevel};
use chpm_format::{FormatError, Page, PageParts};
use chpm_mesh::{Places, Vertices};

/// Scratch of the reordering.
#[derive(Debug, Default)]
pub(super) struct LocalOrder {
    graph: Graph,
    seen: Vec<u32>,
    multilevel: Multilevel,
    places: Places,
    base_triangles: Vec<[u16; 3]>,
    rank: Vec<u16>,
    position: Vec<u16>,
    at_position: Vec<u16>,
    old_to_new: Vec<u16>,
    new_to_old: Vec<u16>,
    starts: Vec<u32>,
    vertices: Vertices,
    triangles: Vec<[u16; 3]>,
    targets: Vec<u16>,
    errors: Vec<f32>,
    shared: Vec<(u16, u32)>,
}

impl LocalOrder {
    /// Appends the page in its new order to `out`; it is as long as before.
    pub(super) fn reorder(&mut self, page: &Page<'_>, out: &mut Vec<u8>) -> Result<(), FormatError> {
        self.order_vertices(page);
        self.number_base(page);
        self.induce_triangles(page);

        self.vertices.clear_vertices();
        self.vertices.gather(page.vertices, self.new_to_old.iter().map(|v| usize::from(*v)));

        fn new(v: u16, old_to_new: &[u16]) -> u16 {
            old_to_new[usize::from(v)]
        }
        self.targets.clear();
        self.targets.extend(page.targets.iter().map(|t| new(*t, &self.old_to_new)));
        self.shared.clear();
        self.shared.extend(page.shared().map(|(v, id)| (new(v, &self.old_to_new), id)));
        self.shared.sort_unstable();
        self.errors.clear();
        self.errors.extend((page.base_vertex_count..page.vertex_count()).map(|n| page.error_at(n)));
        PageParts {
            vertices: self.vertices.view(),
            triangles: &self.triangles,
            targets: &self.targets,
            errors: &self.errors,
            shared: &self.shared,
            min_error: page.min_error,
            scale_error: page.error_scale,
        }
        .encode(out)?;
        Ok(())
    }

    /// Position of every vertex of the finest mesh in its cache-oblivious order. The progressive mesh itself is the first
    /// coarsening (Yoon 6.3.1 names edge collapse as one): the base mesh is ordered, and each vertex that collapsed comes with
    /// the one that it ended in.
    fn order_vertices(&mut self, page: &Page<'_>) {
        let base = page.base_vertex_count;
        self.places.go_to(&page.progressive_mesh(), base);
        self.base_triangles.clear();
        self.base_triangles.extend(self.places.triangles(page.triangles));

        let pairs = self.base_triangles.iter().flat_map(|t| {
            let [a, b, c] = t.map(u32::from);
            [(a, b), (b, c), (c, a)]
        });
        self.graph.fill(base, pairs, &mut self.seen);

        // A counting sort of all vertices by the rank of the base vertex that they end in.
        self.starts.clear();
        self.starts.resize(base + 1, 0);
        self.rank.clear();
        self.rank.resize(base, 0);
        for (at, vertex) in self.multilevel.order(&mut self.graph).iter().enumerate() {
            self.rank[*vertex as usize] = at as u16;
        }
        for survivor in self.places.as_slice() {
            self.starts[usize::from(self.rank[usize::from(*survivor)]) + 1] += 1;
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        self.position.clear();
        for survivor in self.places.as_slice() {
            let start = &mut self.starts[usize::from(self.rank[usize::from(*survivor)])];
            self.position.push(*start as u16);
            *start += 1;
        }
    }

    fn number_base(&mut self, page: &Page<'_>) {
        // In the order of their positions, of which each vertex has another.
        const NONE: u16 = u16::MAX;
        self.at_position.clear();
        self.at_position.resize(page.vertex_count(), NONE);
        for (vertex, position) in (0..page.base_vertex_count as u16).zip(&self.position) {
            self.at_position[usize::from(*position)] = vertex;
        }
        self.new_to_old.clear();
        self.new_to_old.extend(self.at_position.iter().filter(|vertex| **vertex != NONE));
        self.new_to_old.extend(page.base_vertex_count as u16..page.vertex_count() as u16);
        self.old_to_new.clear();
        self.old_to_new.resize(page.vertex_count(), 0);
        for (new, old) in self.new_to_old.iter().enumerate() {
            self.old_to_new[usize::from(*old)] = new as u16;
        }
    }

    /// Triangles by the position of their first vertex: a counting sort.
    fn induce_triangles(&mut self, page: &Page<'_>) {
        fn key(t: &[u16; 3], position: &[u16]) -> usize {
            t.map(|v| position[usize::from(v)]).into_iter().min().map_or(0, usize::from)
        }
        self.starts.clear();
        self.starts.resize(page.vertex_count() + 1, 0);
        for triangle in page.triangles {
            self.starts[key(triangle, &self.position) + 1] += 1;
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        self.triangles.clear();
        self.triangles.resize(page.triangles.len(), [0; 3]);
        for triangle in page.triangles {
            let slot = &mut self.starts[key(triangle, &self.position)];
            self.triangles[*slot as usize] = triangle.map(|v| self.old_to_new[usize::from(v)]);
            *slot += 1;
        }
    }
}
