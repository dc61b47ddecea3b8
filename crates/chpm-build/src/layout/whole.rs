//! A whole mesh in the cache-oblivious order (Yoon 6.3 and 6.4.1), for who reads it after us.

use super::multilevel::{Graph, Multilevel};

/// Bytes that ordering takes for each vertex and each triangle, beside the mesh: mostly the graph of all edges, at every level of coarsening.
pub const ORDER_BYTES: [u64; 2] = [32, 96];

/// Triangles of a mesh that can be ordered: their edges are counted by 32 bits, each from both ends of every triangle that has it.
pub const MOST_ORDERED: u64 = u32::MAX as u64 / 6;

/// Orders the vertices of a mesh by the cache-oblivious metric and its triangles by the first of their vertices. Answers the new index of each
/// vertex; the triangles are numbered by it when it returns. What is the first corner of a triangle stays it. `go_on` is asked all the time whether
/// to; if not, the answer is `None`, and the triangles are as they were.
///
/// # Panics
/// If a corner is not below `vertex_count`, or there are more triangles than [`MOST_ORDERED`].
pub fn order_mesh(
    vertex_count: usize,
    triangles: &mut Vec<[u32; 3]>,
    mut go_on: impl FnMut() -> bool,
) -> Option<Vec<u32>> {
    assert!(triangles.len() as u64 <= MOST_ORDERED, "no more triangles than can be ordered");
    let mut graph = Graph::default();
    let pairs = triangles.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]);
    graph.fill(vertex_count, pairs, &mut Vec::new());
    let mut multilevel = Multilevel::default();
    let mut places = vec![0; vertex_count];
    for (place, vertex) in (0..).zip(multilevel.order_while(&mut graph, &mut go_on)?) {
        places[*vertex as usize] = place;
    }
    drop((graph, multilevel));
    for triangle in &mut *triangles {
        *triangle = triangle.map(|vertex| places[vertex as usize]);
    }
    // Equal ones stay as they are.
    triangles.sort_by_key(|[a, b, c]| *a.min(b).min(c));
    Some(places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    /// A grid whose vertices and triangles are anywhere.
    fn shuffled_grid(side: u32) -> Vec<[u32; 3]> {
        let id = |x: u32, y: u32| (y * side + x) * 137 % (side * side);
        let cells = (0..side - 1).flat_map(|y| (0..side - 1).map(move |x| (x, y)));
        let both = |(x, y)| {
            let [a, b, c, d] = [id(x, y), id(x + 1, y), id(x, y + 1), id(x + 1, y + 1)];
            [[a, b, d], [a, d, c]]
        };
        let mut all: Vec<[u32; 3]> = cells.flat_map(both).collect();
        all.sort_by_key(|[a, b, c]| a.wrapping_mul(b ^ c) % 1009);
        all
    }

    #[test]
    fn an_order_is_a_permutation_with_short_spans() {
        let side = 60;
        let before = shuffled_grid(side);
        let mut after = before.clone();
        let places = order_mesh((side * side) as usize, &mut after, || true).unwrap();
        assert_eq!(places.iter().collect::<HashSet<_>>().len(), places.len());
        let renumbered: HashSet<_> = before.iter().map(|t| t.map(|v| places[v as usize])).collect();
        assert_eq!(renumbered, after.iter().copied().collect());
        let spans = |triangles: &[[u32; 3]]| {
            let bits = triangles.iter().map(|[a, b, _]| f64::from(a.abs_diff(*b)).log2());
            bits.sum::<f64>() / triangles.len() as f64
        };
        assert!(spans(&after) < 3.0, "{}", spans(&after));
        assert!(spans(&before) > 8.0);
    }

    #[test]
    fn what_has_no_triangle_has_a_place() {
        let mut triangles = vec![[3, 1, 1], [3, 3, 3]];
        let mut places = order_mesh(5, &mut triangles, || true).unwrap();
        places.sort_unstable();
        assert_eq!(places, [0, 1, 2, 3, 4]);
        assert!(order_mesh(0, &mut Vec::new(), || true).unwrap().is_empty());
    }

    #[test]
    fn ordering_can_be_stopped_anywhere() {
        let before = shuffled_grid(20);
        let mut asked = 0_usize;
        let mut count = || {
            asked += 1;
            true
        };
        order_mesh(400, &mut before.clone(), &mut count).unwrap();
        assert!(asked > 100, "{asked}");
        for last in [0, 1, 2, asked / 2, asked - 1] {
            let (mut left, mut after) = (0..last, before.clone());
            assert!(
                order_mesh(400, &mut after, || left.next().is_some()).is_none() && after == before,
                "{last} of {asked}"
            );
        }
    }
}
