//! Which vertices hang together through triangles: sets that are joined, in memory that the budget bounds, whatever the order of the triangles.
//!
//! Every vertex has a link to an earlier one of its component, or to itself. Vertices are taken in slices, the last slice first, and only
//! the links of one slice are in memory. There the least vertex of a set is its root. An edge from a set to a vertex of an earlier slice
//! becomes the root's link; a second such edge says that two earlier vertices hang together, and goes on to the slice of the later one as an
//! edge between these. No edge ever becomes two, and none goes back, so that a slice is done when its edges are.

use super::local::each;
use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use chpm_extmem::{Buckets, Column};

/// Vertices of a slice at least, where there are so many.
const LEAST: usize = 1 << 18;
/// Bytes that the edges of a slice gather.
const BLOCK: usize = 1 << 13;

/// By vertex an earlier one of its component, or itself if it is the first.
pub(super) fn links<I: Id>(
    triangles: &Column<[I; 3]>,
    vertices: usize,
    context: &Context<'_>,
) -> Result<Column<I>, BuildError> {
    // As much for the links that are done.
    let len = vertices.min(LEAST.max(context.store.budget.available() as usize / (2 * size_of::<I>())));
    links_by(len.max(1), triangles, vertices, context)
}

/// With slices of `len` vertices.
fn links_by<I: Id>(
    len: usize,
    triangles: &Column<[I; 3]>,
    vertices: usize,
    context: &Context<'_>,
) -> Result<Column<I>, BuildError> {
    let store = &context.store;
    let _share = store.budget.reserve_work("components", (size_of::<I>() * len) as u64)?;
    let last = vertices.saturating_sub(1) / len;
    fn of<I: Id>(vertex: I, len: usize) -> usize {
        vertex.index() / len
    }

    // Edges within the last slice are joined as triangles come; those of others wait for their slice.
    let mut edges = Buckets::<[I; 2]>::new(store, "edges of components", last, BLOCK);
    let mut slice = Slice::new(last * len..vertices);
    each(triangles, context, |_, triangles| {
        for triangle in triangles {
            let mut corners = *triangle;
            corners.sort_unstable();
            // Two edges join three corners.
            let [low, middle, high] = corners;
            for edge in [[high, low], [middle, low]] {
                let left = if of(edge[0], len) == last { slice.join(edge) } else { Some(edge) };
                left.map_or(Ok(()), |edge| edges.push(of(edge[0], len), edge))?;
            }
        }
        Ok(())
    })?;

    // From the last slice to the first: what an edge leaves to be joined has its higher end in an earlier one.
    let mut links = Column::zeroed(store, "links of vertices", vertices)?;
    slice.finish(&mut links)?;
    let mut block = Vec::new();
    for index in (0..last).rev() {
        slice.begin(index * len..(index + 1) * len);
        for number in 0..edges.block_count(index) {
            context.check()?;
            edges.read_block(index, number, &mut block)?;
            for left in block.iter().filter_map(|edge| slice.join(*edge)) {
                edges.push(of(left[0], len), left)?;
            }
        }
        edges.clear(index);
        slice.finish(&mut links)?;
    }
    Ok(links)
}

/// The links of vertices in a row. Within the slice they make trees; a root's leads to itself or out of the slice.
struct Slice<I> {
    first: I,
    links: Vec<I>,
}

impl<I: Id> Slice<I> {
    fn new(range: std::ops::Range<usize>) -> Self {
        let mut slice = Slice { first: I::NONE, links: Vec::with_capacity(range.len()) };
        slice.begin(range);
        slice
    }

    fn begin(&mut self, range: std::ops::Range<usize>) {
        self.first = I::of(range.start);
        self.links.clear();
        self.links.extend(range.map(I::of));
    }

    fn link(&mut self, vertex: I) -> &mut I {
        &mut self.links[vertex.index() - self.first.index()]
    }

    /// Where a link leads if that is in the slice, else the vertex itself.
    fn above(&mut self, vertex: I) -> I {
        let link = *self.link(vertex);
        if link < self.first { vertex } else { link }
    }

    /// The least vertex of the set; the way there becomes half as long.
    fn root(&mut self, mut vertex: I) -> I {
        loop {
            let above = self.above(vertex);
            if above == vertex {
                return vertex;
            }
            let next = self.above(above);
            *self.link(vertex) = next;
            vertex = next;
        }
    }

    /// Takes an edge from a vertex of the slice to an earlier one; may leave another edge like it, whose vertices both lie before the slice.
    fn join(&mut self, [later, earlier]: [I; 2]) -> Option<[I; 2]> {
        let (mut root, mut out) = (self.root(later), earlier);
        if out >= self.first {
            let other = self.root(earlier);
            if other == root {
                return None;
            }
            let higher = root.max(other);
            root = root.min(other);
            out = std::mem::replace(self.link(higher), root);
            if out == higher {
                return None;
            }
        }

        let link = self.link(root);
        if *link == root {
            *link = out;
        } else if *link != out {
            let pair = [out.max(*link), out.min(*link)];
            *link = pair[1];
            return Some(pair);
        }
        None
    }

    /// Stores where each vertex's root leads.
    fn finish(&mut self, links: &mut Column<I>) -> Result<(), BuildError> {
        let first = self.first.index();
        for vertex in (first..first + self.links.len()).map(I::of) {
            let root = self.root(vertex);
            let link = *self.link(root);
            *self.link(vertex) = link;
        }
        Ok(links.write(first, &self.links)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::Wide;
    use chpm_extmem::{BufferWriter, Store};
    use chpm_extmem::{Cancel, Silent};
    use proptest::prelude::*;

    /// By vertex the first one of its component: the least number goes from corner to corner until none changes.
    fn naive(triangles: &[[u32; 3]], vertices: usize) -> Vec<u32> {
        let mut firsts: Vec<u32> = (0..vertices as u32).collect();
        loop {
            let before = firsts.clone();
            for triangle in triangles {
                let least = triangle.map(|v| firsts[v as usize]).into_iter().min().unwrap();
                triangle.iter().for_each(|v| firsts[*v as usize] = least);
            }
            if firsts == before {
                return firsts;
            }
        }
    }

    /// The first vertex of each one's component, where links lead.
    fn found<I: Id>(len: usize, triangles: &[[u32; 3]], vertices: usize, memory: u64) -> Vec<u32> {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), memory).unwrap();
        let mut writer = BufferWriter::new(&store, "triangles", 0).unwrap();
        let ids: Vec<_> = triangles.iter().map(|triangle| triangle.map(|v| I::of(v as usize))).collect();
        writer.extend_from_slice(&ids).unwrap();
        let triangles = writer.finish_column().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let context = Context::new(store, pool, &Silent, Cancel::default());
        let links = links_by(len, &triangles, vertices, &context).unwrap();
        assert_eq!(links.is_on_disk(), memory == 0 && vertices > 0);
        context.cancel.cancel();
        let stopped = links_by(len, &triangles, vertices, &context);
        assert!(triangles.is_empty() || matches!(stopped, Err(BuildError::Cancelled)), "nobody looks");
        let mut scratch = Vec::new();
        let links = links.read(0..vertices, &mut scratch).unwrap();
        let mut firsts: Vec<u32> = links.iter().map(|link| link.index() as u32).collect();
        for vertex in 0..vertices {
            assert!(firsts[vertex] <= vertex as u32, "a link leads back");
            firsts[vertex] = firsts[firsts[vertex] as usize];
        }
        firsts
    }

    proptest! {
        #[test]
        fn components_are_those_of_a_naive_search(
            vertices in 3usize..60,
            corners in prop::collection::vec(any::<[u32; 3]>(), 0..60),
            len in 1usize..70,
            spread in 1u32..60,
        ) {
            // Corners that lie close together make many components.
            let near = |[a, b, c]: [u32; 3]| {
                let first = a % vertices as u32;
                [first, first + b % spread, first + c % spread].map(|v| v % vertices as u32)
            };
            let triangles: Vec<[u32; 3]> = corners.into_iter().map(near).collect();
            let expected = naive(&triangles, vertices);
            prop_assert_eq!(found::<u32>(len, &triangles, vertices, 0), &expected[..]);
            prop_assert_eq!(found::<Wide>(len, &triangles, vertices, 0), &expected[..]);
            prop_assert_eq!(found::<u32>(len, &triangles, vertices, 1 << 24), expected);
        }
    }

    /// Rings of triangles whose vertices and order are shuffled: in no slice do many hang together.
    #[test]
    fn any_order_and_any_slices_give_the_same() {
        const VERTICES: u32 = 30_000;
        let shuffled = |i: u32| i * 7_919 % VERTICES;
        let ring = |i: u32, step: u32| i / 1000 * 1000 + (i + step) % 1000;
        let triangles: Vec<[u32; 3]> = (0..VERTICES)
            .map(|i| i * 10_007 % VERTICES)
            .map(|i| [0, 1, 2].map(|step| shuffled(ring(i, step))))
            .collect();
        let mut expected = vec![u32::MAX; VERTICES as usize];
        for ring in 0..VERTICES / 1000 {
            let members = || (ring * 1000..(ring + 1) * 1000).map(shuffled);
            let first = members().min().unwrap();
            members().for_each(|v| expected[v as usize] = first);
        }
        for len in [VERTICES as usize, 10_000, 999, 64] {
            assert!(found::<u32>(len, &triangles, VERTICES as usize, 0) == expected, "slices of {len}");
        }
    }
}
