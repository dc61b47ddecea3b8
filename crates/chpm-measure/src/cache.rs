//! How well an order of triangles is served by a vertex cache.

use std::collections::VecDeque;
use std::ops::AddAssign;

/// Counts of a simulated vertex cache.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct VertexCache {
    /// Triangles drawn.
    pub triangles: u64,
    /// Different vertices that they use.
    pub vertices: u64,
    /// Vertices that were not in the cache when drawn.
    pub misses: u64,
}

impl VertexCache {
    /// Average cache misses per triangle: 3 is the worst, about 0.5 the best that a large mesh allows; 0 for nothing.
    pub fn acmr(&self) -> f64 {
        ratio(self.misses, self.triangles)
    }

    /// Average transforms per vertex: 1 is the best; 0 for nothing.
    pub fn atvr(&self) -> f64 {
        ratio(self.misses, self.vertices)
    }
}

impl AddAssign for VertexCache {
    /// As if the cache had been emptied in between and no vertex were in both.
    fn add_assign(&mut self, more: VertexCache) {
        self.triangles += more.triangles;
        self.vertices += more.vertices;
        self.misses += more.misses;
    }
}

/// Draws triangles through a first-in first-out cache of `size` vertices. A hit does not move a vertex.
///
/// ```
/// let strip = chpm_synth::hand::strip(100).triangles;
/// let cached = chpm_measure::cache::vertex_cache(strip.iter().copied(), 16);
/// assert_eq!((cached.triangles, cached.misses), (100, 102));
/// ```
pub fn vertex_cache(triangles: impl IntoIterator<Item = [u32; 3]>, size: usize) -> VertexCache {
    let mut counts = VertexCache::default();
    let mut fifo = VecDeque::with_capacity(size.min(1 << 16));
    let mut missed = Vec::new();

    for triangle in triangles {
        counts.triangles += 1;
        for vertex in triangle {
            if fifo.contains(&vertex) {
                continue;
            }
            missed.push(vertex);
            if fifo.len() >= size {
                fifo.pop_front();
            }
            if size > 0 {
                fifo.push_back(vertex);
            }
        }
    }

    // Each vertex has to be loaded once, whatever the order.
    counts.misses = missed.len() as u64;
    missed.sort_unstable();
    missed.dedup();
    counts.vertices = missed.len() as u64;
    counts
}

/// [`VertexCache::acmr`] of a sequence of triangles.
pub fn acmr(triangles: impl IntoIterator<Item = [u32; 3]>, fifo_size: usize) -> f64 {
    vertex_cache(triangles, fifo_size).acmr()
}

/// [`VertexCache::atvr`] of a sequence of triangles.
pub fn atvr(triangles: impl IntoIterator<Item = [u32; 3]>, fifo_size: usize) -> f64 {
    vertex_cache(triangles, fifo_size).atvr()
}

fn ratio(a: u64, b: u64) -> f64 {
    if b == 0 { 0.0 } else { a as f64 / b as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_synth::hand;

    #[test]
    fn a_strip_misses_once_per_vertex() {
        let counts = vertex_cache(hand::strip(10).triangles, 3);
        assert_eq!(counts, VertexCache { triangles: 10, vertices: 12, misses: 12 });
        assert_eq!((counts.acmr(), counts.atvr()), (1.2, 1.0));
    }

    #[test]
    fn no_cache_misses_always_and_a_large_one_once() {
        let triangles = hand::grid(4, 4).triangles;
        assert_eq!(acmr(triangles.iter().copied(), 0), 3.0);
        assert_eq!(acmr(triangles.iter().copied(), 1000), 25.0 / 32.0);
        assert_eq!(atvr(triangles, 1000), 1.0);
        assert_eq!((acmr([], 16), atvr([], 16)), (0.0, 0.0));
    }

    #[test]
    fn first_in_is_first_out_even_when_used() {
        // With room for three, 0 is hit in the second triangle and is still the first to go.
        let counts = vertex_cache([[0, 1, 2], [0, 2, 3], [0, 3, 2]], 3);
        assert_eq!(counts, VertexCache { triangles: 3, vertices: 4, misses: 5 });
    }
}
