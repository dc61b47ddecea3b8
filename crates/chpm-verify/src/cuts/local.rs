//! One cluster's mesh at a position: where its vertices are, and which edges are on a border.

use chpm_format::Page;
use chpm_mesh::Places;

/// Stand-in for the shared id of a vertex that no other cluster has.
pub(super) const UNSHARED: u32 = u32::MAX;

/// Plays one page after the other in the same memory.
#[derive(Default)]
pub(super) struct Local {
    /// By vertex of the finest mesh: where it is.
    places: Places,
    /// By vertex: its shared id.
    ids: Vec<u32>,
    odd: Vec<[u16; 2]>,
    edges: EdgeSort,
}

/// Sorts edges in time that follows their number.
#[derive(Default)]
struct EdgeSort {
    /// By lesser vertex: where its edges end.
    ends: Vec<u32>,
    /// Greater vertices, by lesser one.
    greater: Vec<u16>,
}

impl EdgeSort {
    /// Sorts edges between `count` vertices, and leaves one of each that there is an odd number of.
    fn keep_odd(&mut self, edges: &mut Vec<[u16; 2]>, count: usize) {
        let EdgeSort { ends, greater } = self;
        ends.clear();
        ends.resize(count + 1, 0);
        edges.iter().for_each(|[lesser, _]| ends[usize::from(*lesser) + 1] += 1);
        for vertex in 0..count {
            ends[vertex + 1] += ends[vertex];
        }
        greater.clear();
        greater.resize(edges.len(), 0);
        for [lesser, other] in edges.drain(..) {
            let end = &mut ends[usize::from(lesser)];
            greater[*end as usize] = other;
            *end += 1;
        }
        let mut start = 0;
        for (lesser, end) in ends[..count].iter().enumerate() {
            let others = &mut greater[start..*end as usize];
            others.sort_unstable();
            let odd = others.chunk_by(|a, b| a == b).filter(|same| same.len() % 2 == 1);
            edges.extend(odd.map(|same| [lesser as u16, same[0]]));
            start = *end as usize;
        }
    }
}

impl Local {
    /// Goes to the mesh of `n` vertices of a page that was checked before.
    pub(super) fn enter(&mut self, page: &Page<'_>, n: usize) {
        self.ids.clear();
        self.ids.resize(page.vertex_count(), UNSHARED);
        for (vertex, id) in page.shared() {
            self.ids[usize::from(vertex)] = id;
        }
        self.places.go_to(&page.progressive_mesh(), n);
    }

    /// Where a vertex of the finest mesh is.
    pub(super) fn at(&self, vertex: u16) -> u16 {
        self.places.of(vertex)
    }

    /// The shared id of a vertex.
    pub(super) fn id(&self, vertex: u16) -> u32 {
        self.ids[usize::from(vertex)]
    }

    /// An edge by shared ids, the lesser first.
    pub(super) fn by_id(&self, [a, b]: [u16; 2]) -> [u32; 2] {
        let (a, b) = (self.id(a), self.id(b));
        [a.min(b), a.max(b)]
    }

    fn triangles<'a>(&'a self, page: &'a Page<'_>) -> impl Iterator<Item = [u16; 3]> + 'a {
        page.triangles
            .iter()
            .map(|corners| corners.map(|v| self.at(v)))
            .filter(|[a, b, c]| (a != b) & (b != c) & (c != a))
    }

    /// Triangles of the mesh.
    pub(super) fn triangle_count(&self, page: &Page<'_>) -> u64 {
        self.triangles(page).count() as u64
    }

    /// The edges between shared vertices that an odd number of the mesh's triangles have, each by ascending vertices.
    pub(super) fn odd_edges(&mut self, page: &Page<'_>) -> &[[u16; 2]] {
        let mut odd = std::mem::take(&mut self.odd);
        odd.clear();
        for [a, b, c] in self.triangles(page) {
            let between = [[a, b], [b, c], [c, a]]
                .into_iter()
                .filter(|edge| edge.iter().all(|v| self.id(*v) != UNSHARED));
            odd.extend(between.map(|[u, v]| [u.min(v), u.max(v)]));
        }
        self.edges.keep_odd(&mut odd, self.ids.len());
        self.odd = odd;
        &self.odd
    }
}

/// Sorts by a key, and leaves one of each that there is an odd number of.
pub(super) fn keep_odd<T: Copy, K: Ord>(items: &mut Vec<T>, key: impl Fn(&T) -> K) {
    items.sort_unstable_by_key(&key);
    let (mut kept, mut start) = (0, 0);
    while start < items.len() {
        let item = items[start];
        let same = items[start..].iter().take_while(|other| key(other) == key(&item)).count();
        items[kept] = item;
        kept += same % 2;
        start += same;
    }
    items.truncate(kept);
}

/// A number for every edge of a cluster, in the same order, that is quickly compared.
pub(super) fn by_vertices(edge: &[u16; 2]) -> u32 {
    u32::from(edge[0]) << 16 | u32::from(edge[1])
}

/// The same for every edge by shared ids, in the same order, that is quickly compared.
pub(super) fn key(edge: &[u32; 2]) -> u64 {
    u64::from(edge[0]) << 32 | u64::from(edge[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_sorted_as_anything_is() {
        let mut sort = EdgeSort::default();
        for count in [1, 7, 90] {
            let ends = |i: u32| [i * 7919 % 89 % count, i * i % 83 % count].map(|v| v as u16);
            let mut edges: Vec<[u16; 2]> = (0..500).map(ends).collect();
            let mut expected = edges.clone();
            keep_odd(&mut expected, by_vertices);
            sort.keep_odd(&mut edges, count as usize);
            assert_eq!(edges, expected);
        }
    }

    #[test]
    fn odd_ones_are_left_once() {
        let mut items = vec![3, 1, 2, 3, 3, 1, 5, 5];
        keep_odd(&mut items, |item| *item);
        assert_eq!(items, [2, 3]);
        items.clear();
        keep_odd(&mut items, |item| *item);
        assert!(items.is_empty());
    }
}
