//! A walk over triangles that serves a vertex cache: greedy, in whole numbers, in time linear in the triangles.
//!
//! As in Forsyth's "Linear-Speed Vertex Cache Optimisation" (2006) each vertex has a score, and the triangle with the highest sum comes
//! next. Here the cache is first in, first out, so that scores change only where something happens, and only the triangles at the
//! vertices that were used last are looked at; at one of very many, [`Hubs`] know the best.

use super::hubs::Hubs;

/// Vertices of the cache: somewhat fewer than hardware has, since an order also has to serve finer meshes than the one it is made for.
const SIZE: usize = 14;
/// Score of a vertex in the cache.
const CACHED: i32 = 60;
/// Score at each of these ages: the oldest vertices are best used before they are lost.
const OLDER: i32 = 5;
const AGES: [usize; 2] = [4, 8];
/// Score of a vertex for each triangle fewer than `FEW` that it has left: what is nearly done is finished.
const RARE: i32 = 20;
const FEW: u32 = 6;
/// Vertices whose triangles are looked at: those of the last triangle, and before.
const RECENT: usize = 5;

/// "No vertex": a mesh has fewer.
pub(super) const NONE: u16 = u16::MAX;

#[derive(Clone, Copy, Debug, Default)]
struct Vertex {
    /// Its triangles that are left, as a slice of `around`.
    start: u32,
    end: u32,
    /// When it came into the cache.
    came: u32,
}

/// A triangle at one of its vertices.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Around {
    others: [u16; 2],
    pub(super) index: u32,
}

/// Vertices that there can be; a table of this length takes any `u16` without a check.
const TABLE: usize = 1 << 16;

/// Scratch of the walk.
#[derive(Debug)]
pub(super) struct CacheWalk {
    vertices: Vec<Vertex>,
    scores: Box<[i32; TABLE]>,
    around: Vec<Around>,
    /// Vertices in the order in which they came into the cache, less those that were found to have nothing left.
    came: Vec<u16>,
    order: Vec<u32>,
    hubs: Hubs,
    /// Whether each triangle of a hub is looked at, too.
    #[cfg(test)]
    plain: bool,
    /// Triangles that were looked at.
    #[cfg(test)]
    looked: usize,
}

impl Default for CacheWalk {
    fn default() -> Self {
        CacheWalk {
            vertices: Vec::new(),
            scores: Box::new([0; TABLE]),
            around: Vec::new(),
            came: Vec::new(),
            order: Vec::new(),
            hubs: Hubs::default(),
            #[cfg(test)]
            plain: false,
            #[cfg(test)]
            looked: 0,
        }
    }
}

impl CacheWalk {
    /// An order of the triangles, which have vertices below `vertex_count`.
    pub(super) fn order(&mut self, triangles: &[[u16; 3]], vertex_count: usize) -> &[u32] {
        self.gather(triangles, vertex_count);
        // Without hubs, which surfaces do not have, nothing asks for them.
        match self.hubs.is_empty() {
            true => self.walk::<false>(triangles, vertex_count),
            false => self.walk::<true>(triangles, vertex_count),
        }
        &self.order
    }

    fn walk<const HUBS: bool>(&mut self, triangles: &[[u16; 3]], vertex_count: usize) {
        self.order.clear();
        self.came.clear();

        let mut cache = [NONE; SIZE];
        let mut recent = [NONE; RECENT];
        let mut time = SIZE + 1;
        let mut rest = 0..vertex_count as u16;

        while let Some(index) = self.best::<HUBS>(&recent, triangles).or_else(|| self.restart(&mut rest)) {
            self.order.push(index);
            if HUBS {
                self.hubs.take(index);
            }
            let corners = triangles[index as usize];
            for corner in corners {
                self.take::<HUBS>(corner, index, triangles);
                if time - self.vertices[usize::from(corner)].came as usize > SIZE {
                    self.load::<HUBS>(corner, &mut cache, time, triangles);
                    time += 1;
                }
            }
            recent = put_first(corners, recent);
        }
    }

    /// Finds the triangles at each vertex.
    fn gather(&mut self, triangles: &[[u16; 3]], vertex_count: usize) {
        self.vertices.clear();
        self.vertices.resize(vertex_count, Vertex::default());
        for corner in triangles.as_flattened() {
            self.vertices[usize::from(*corner)].end += 1;
        }

        self.hubs.find(self.vertices.iter().map(|vertex| vertex.end));
        #[cfg(test)]
        if self.plain {
            self.hubs = Hubs::default();
        }

        let mut start = 0;
        for (vertex, score) in self.vertices.iter_mut().zip(&mut self.scores[..]) {
            let count = vertex.end;
            *score = rarity(count);
            *vertex = Vertex { start, end: start, came: 0 };
            start += count;
        }

        self.around.clear();
        self.around.resize(start as usize, Around::default());
        self.hubs.gather(triangles, &self.scores[..]);

        for (index, [a, b, c]) in (0..).zip(triangles) {
            for (corner, others) in [(*a, [*b, *c]), (*b, [*c, *a]), (*c, [*a, *b])] {
                let vertex = &mut self.vertices[usize::from(corner)];
                self.around[vertex.end as usize] = Around { others, index };
                if self.hubs.has(corner) {
                    self.hubs.put(index, [*a, *b, *c], corner, vertex.end - vertex.start);
                }
                vertex.end += 1;
            }
        }
    }

    /// The triangle with the highest score at some vertices.
    fn best<const HUBS: bool>(&mut self, recent: &[u16], triangles: &[[u16; 3]]) -> Option<u32> {
        // Score and index in one number, so that the larger of two is found without a branch.
        let mut best = 0;
        for corner in recent {
            let Some(vertex) = self.vertices.get(usize::from(*corner)) else { break };
            if HUBS && self.hubs.has(*corner) {
                let (score, index) = self.hubs.best(*corner, triangles, &self.scores[..]).unwrap_or_default();
                best = best.max((score as u64) << 32 | u64::from(index));
                continue;
            }
            #[cfg(test)]
            {
                self.looked += (vertex.end - vertex.start) as usize;
            }
            let own = self.scores[usize::from(*corner)];
            for Around { others: [a, b], index } in &self.around[vertex.start as usize..vertex.end as usize] {
                let score = own + self.scores[usize::from(*a)] + self.scores[usize::from(*b)];
                best = best.max((score as u64) << 32 | u64::from(*index));
            }
        }
        (best > 0).then_some(best as u32)
    }

    /// A triangle to go on with where there is none: at the vertex that came last, or at any.
    fn restart(&mut self, rest: &mut std::ops::Range<u16>) -> Option<u32> {
        let first = |vertex: u16, all: &Self| {
            let Vertex { start, end, .. } = all.vertices[usize::from(vertex)];
            (start < end).then(|| all.around[start as usize].index)
        };
        while let Some(vertex) = self.came.last() {
            if let Some(index) = first(*vertex, self) {
                return Some(index);
            }
            self.came.pop();
        }
        rest.find_map(|vertex| first(vertex, self))
    }

    /// Takes a triangle from those that one of its corners has left.
    fn take<const HUBS: bool>(&mut self, corner: u16, index: u32, triangles: &[[u16; 3]]) {
        let vertex = &mut self.vertices[usize::from(corner)];
        let left = &mut self.around[vertex.start as usize..vertex.end as usize];
        let Some(last) = left.len().checked_sub(1) else { return };
        let at = if HUBS && self.hubs.has(corner) {
            let at = self.hubs.place(index, triangles[index as usize], corner);
            let moved = left[last].index;
            self.hubs.put(moved, triangles[moved as usize], corner, at);
            at as usize
        } else {
            // To the end and without a branch: where it is cannot be foretold, and there are few.
            left.iter().enumerate().fold(last, |at, (i, a)| if a.index == index { i } else { at })
        };
        left.swap(at, last);
        vertex.end -= 1;
        self.raise::<HUBS>(corner, rarity(last as u32) - rarity(last as u32 + 1), triangles);
    }

    /// Adds to the score of a vertex.
    #[inline]
    fn raise<const HUBS: bool>(&mut self, vertex: u16, by: i32, triangles: &[[u16; 3]]) {
        self.scores[usize::from(vertex)] += by;
        if HUBS && by > 0 {
            let Vertex { start, end, .. } = self.vertices[usize::from(vertex)];
            let left = &self.around[start as usize..end as usize];
            self.hubs.rise(vertex, left, triangles, &self.scores[..]);
        }
    }

    /// Puts a vertex into the cache, in the place of the oldest, and lets others grow older.
    fn load<const HUBS: bool>(
        &mut self,
        vertex: u16,
        cache: &mut [u16; SIZE],
        time: usize,
        triangles: &[[u16; 3]],
    ) {
        // That of no vertex is in the table, too, and nothing looks at it.
        let oldest = std::mem::replace(&mut cache[time % SIZE], vertex);
        self.scores[usize::from(oldest)] -= CACHED + OLDER * AGES.len() as i32;
        for older in AGES.map(|age| cache[(time - age) % SIZE]) {
            if older != NONE {
                self.raise::<HUBS>(older, OLDER, triangles);
            }
        }
        self.raise::<HUBS>(vertex, CACHED, triangles);
        self.vertices[usize::from(vertex)].came = time as u32;
        self.came.push(vertex);
    }
}

fn rarity(left: u32) -> i32 {
    RARE * FEW.saturating_sub(left) as i32
}

/// The corners, and then the first of the others that are not among them.
fn put_first(corners: [u16; 3], others: [u16; RECENT]) -> [u16; RECENT] {
    let mut all = [NONE; RECENT + 3];
    all[..3].copy_from_slice(&corners);
    let mut end = 3;
    for vertex in others {
        all[end] = vertex;
        let [a, b, c] = corners;
        end += usize::from((vertex != a) & (vertex != b) & (vertex != c));
    }
    std::array::from_fn(|i| all[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_measure::cache::acmr;
    use chpm_synth::{Shape, Synth, hand};

    fn ordered(triangles: &[[u32; 3]], vertex_count: usize) -> Vec<[u32; 3]> {
        let small: Vec<[u16; 3]> = triangles.iter().map(|t| t.map(|v| v as u16)).collect();
        let mut walk = CacheWalk::default();
        let order = walk.order(&small, vertex_count).to_vec();
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..triangles.len() as u32), "every triangle comes once");
        order.iter().map(|index| triangles[*index as usize]).collect()
    }

    #[test]
    fn a_cache_is_served_about_as_well_as_by_the_peer() {
        for shape in [Shape::Isosurface, Shape::Terrain, Shape::Sphere, Shape::Torus] {
            let mesh = Synth::new(shape, 4_000, 1).to_mesh();
            let count = mesh.positions.len();
            let ours = acmr(ordered(&mesh.triangles, count), 16);
            let peer = meshopt::optimize_vertex_cache(mesh.triangles.as_flattened(), count);
            let peer = acmr(peer.as_chunks().0.iter().copied(), 16);
            assert!(ours < 1.05 * peer && ours < 0.75, "{shape}: {ours}, the peer {peer}");
        }
    }

    #[test]
    fn a_strip_is_walked_from_end_to_end() {
        let strip = hand::strip(50);
        assert_eq!(acmr(ordered(&strip.triangles, strip.positions.len()), 3), 52.0 / 50.0);
    }

    /// Same order by looking at each triangle of a vertex, however many there are.
    fn plain(triangles: &[[u16; 3]], vertex_count: usize) -> Vec<u32> {
        let mut walk = CacheWalk { plain: true, ..CacheWalk::default() };
        walk.order(triangles, vertex_count).to_vec()
    }

    #[test]
    fn hubs_change_nothing_about_the_order() {
        let mut state = 1u32;
        let mut chance = |below: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % below
        };
        // Few hubs, and vertices that are joined to them and to each other at random; a hub and its fan; all about one edge.
        let random: Vec<[u16; 3]> = (0..3000)
            .map(|i| {
                [chance(5), 5 + chance(400), if i % 3 == 0 { 405 + chance(5) } else { 410 + chance(300) }]
            })
            .map(|t| t.map(|v| v as u16))
            .collect();
        let fan: Vec<[u16; 3]> = (1..900).map(|i| [0, i, i + 1]).collect();
        let edge: Vec<[u16; 3]> = (2..900).map(|i| [0, 1, i]).collect();
        for triangles in [random, fan, edge] {
            let count = 1 + usize::from(*triangles.as_flattened().iter().max().unwrap());
            let mut walk = CacheWalk::default();
            assert_eq!(walk.order(&triangles, count), plain(&triangles, count));
            assert!(!walk.hubs.is_empty());
        }
    }

    #[test]
    fn triangles_about_one_edge_are_not_looked_at_each_time() {
        let edge: Vec<[u16; 3]> = (2..20_000).map(|i| [0, 1, i]).collect();
        let mut walk = CacheWalk::default();
        walk.order(&edge, 20_000);
        assert!(walk.looked < 10 * edge.len(), "{} of {}", walk.looked, edge.len());
    }

    #[test]
    fn odd_triangles_come_once_too() {
        assert!(ordered(&[], 0).is_empty());
        assert!(ordered(&[], 3).is_empty());
        // Copies, islands, vertices that nothing uses, and more triangles at one vertex than any table has.
        ordered(&[[7, 8, 9], [7, 8, 9], [9, 8, 7], [1, 2, 3]], 12);
        let fan: Vec<[u32; 3]> = (1..30_000).map(|i| [0, i, i + 1]).collect();
        ordered(&fan, 30_001);
        let last = u32::from(NONE) - 1;
        ordered(&[[last, 0, 1], [last, 1, 2]], last as usize + 1);
    }
}
