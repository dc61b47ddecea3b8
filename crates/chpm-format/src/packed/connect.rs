//! Triangles as a walk: each is told by an edge of one before it, and by whether its third corner is new.
//!
//! Vertices are numbered as the walk meets them: a vertex's *rank*. Reader and writer keep the same list of edges at which a triangle may
//! follow, each with the corner across it, and for each vertex where the border of what was met goes on.

use super::bits::{BitWriter, Near};

pub(super) const NONE: u16 = u16::MAX;
/// How far back an edge is, and a vertex.
pub(super) const EDGES: Near = Near(16);
pub(super) const VERTICES: Near = Near(32);
/// Third corners: a new vertex, the next along the border from the second corner, that before the first; another one that was met before.
pub(super) const NEW: u32 = 0;
pub(super) const AFTER: u32 = 1;
pub(super) const BEFORE: u32 = 2;
pub(super) const MET: u32 = 3;

/// Where a vertex is guessed to be: at `a + b - c`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Guess {
    pub(super) a: u16,
    pub(super) b: u16,
    pub(super) c: u16,
}

impl Guess {
    /// At another vertex.
    pub(super) fn at(rank: u16) -> Self {
        Guess { a: rank, b: rank, c: rank }
    }
}

/// State of the walk: vertices and faces that it has met.
#[derive(Default, Debug)]
pub(super) struct Walk {
    /// Edges, as the triangle across has their ends, and the corner on this side.
    edges: Vec<[u16; 3]>,
    /// Vertices as they were met, or met again after long.
    met: Vec<u16>,
    /// The vertex after and before each on the border.
    after: Vec<u16>,
    before: Vec<u16>,
    /// By rank.
    pub(super) guesses: Vec<Guess>,
}

impl Walk {
    pub(super) fn clear(&mut self, vertex_count: usize) {
        self.edges.clear();
        self.met.clear();
        self.guesses.clear();
        for border in [&mut self.after, &mut self.before] {
            border.clear();
            border.resize(vertex_count, NONE);
        }
    }

    /// Meets a vertex.
    #[inline]
    fn meet(&mut self, guess: Guess) -> u16 {
        let rank = self.guesses.len() as u16;
        self.guesses.push(guess);
        self.met.push(rank);
        rank
    }

    /// Guesses a vertex that no triangle has, or that nothing leads to.
    fn guess_next(&self) -> Guess {
        Guess::at((self.guesses.len() as u16).saturating_sub(1))
    }

    /// All that no triangle has come last.
    pub(super) fn meet_rest(&mut self, vertex_count: usize) {
        while self.guesses.len() < vertex_count {
            self.meet(self.guess_next());
        }
    }

    #[inline]
    fn push(&mut self, a: u16, b: u16, across: u16) {
        self.edges.push([a, b, across]);
        self.after[usize::from(a)] = b;
        self.before[usize::from(b)] = a;
    }

    /// Adds the open edges of a triangle that came across its first edge.
    #[inline]
    fn follow(&mut self, [a, b, c]: [u16; 3], third: u32) {
        if third != AFTER {
            self.push(c, b, a);
        }
        if third != BEFORE {
            self.push(a, c, b);
        }
    }

    fn start(&mut self, [a, b, c]: [u16; 3]) {
        self.push(b, a, c);
        self.push(c, b, a);
        self.push(a, c, b);
    }
}

/// The symbol of an edge and of what the third corner is: one, since the one foretells the other. 0 is that of a triangle without an edge.
pub(super) fn joined(edge: u32, third: u32) -> u8 {
    (1 + 4 * edge + third.min(MET)) as u8
}

/// How many corners are told of a triangle with this symbol.
#[inline]
pub(super) fn corners_told(symbol: u8) -> usize {
    let met = symbol.is_multiple_of(4) & (symbol != 0);
    usize::from(met) + 3 * usize::from(symbol == 0)
}

/// Symbols of the triangles, in three streams.
#[derive(Default, Debug)]
pub(super) struct Symbols {
    /// Of each triangle: [`joined`].
    pub(super) edges: Vec<u8>,
    /// Of each triangle with an edge, which corner it starts at; none where all start at the least.
    pub(super) turns: Vec<u8>,
    /// Of each vertex that was met before and is none of the border's, and of each corner of a triangle without an edge.
    pub(super) corners: Vec<u8>,
}

/// Finds edges by their ends, for the writer.
#[derive(Default, Debug)]
struct Finder {
    /// By rank of an edge's first end: the last of its edges, and from there those before.
    first: Vec<u32>,
    /// By edge, in the order of coming: its second end, the one before at the same first end, its place in [`Walk::edges`].
    all: Vec<(u16, u32, u32)>,
    /// By place.
    ids: Vec<u32>,
}

const NOWHERE: u32 = u32::MAX;

impl Finder {
    fn clear(&mut self, vertex_count: usize) {
        self.first.clear();
        self.first.resize(vertex_count, NOWHERE);
        self.all.clear();
        self.ids.clear();
    }

    /// Takes in what was pushed.
    fn see(&mut self, edges: &[[u16; 3]]) {
        for [a, b, _] in &edges[self.ids.len()..] {
            let (id, first) = (self.all.len() as u32, &mut self.first[usize::from(*a)]);
            self.all.push((*b, *first, self.ids.len() as u32));
            *first = id;
            self.ids.push(id);
        }
    }

    /// The latest place of an edge.
    fn find(&self, a: u16, b: u16) -> Option<u32> {
        let mut id = *self.first.get(usize::from(a))?;
        while let Some((end, before, place)) = self.all.get(id as usize) {
            if *end == b {
                return Some(*place);
            }
            id = *before;
        }
        None
    }

    /// Follows [`Vec::swap_remove`] of the edges.
    fn remove(&mut self, edges: &[[u16; 3]], place: u32) {
        let id = self.ids.swap_remove(place as usize);
        if let Some(moved) = self.ids.get(place as usize) {
            self.all[*moved as usize].2 = place;
        }
        let before = self.all[id as usize].1;
        let first = &mut self.first[usize::from(edges[place as usize][0])];
        if *first == id {
            *first = before;
            return;
        }
        let mut later = *first;
        while self.all[later as usize].1 != id {
            later = self.all[later as usize].1;
        }
        self.all[later as usize].1 = before;
    }
}

/// Writes triangles.
#[derive(Default, Debug)]
pub(super) struct Writer {
    /// Whether it tells at which corner each triangle starts.
    pub(super) turns: bool,
    pub(super) walk: Walk,
    pub(super) symbols: Symbols,
    finder: Finder,
    /// Rank of each vertex, and vertex of each rank.
    pub(super) ranks: Vec<u16>,
    pub(super) order: Vec<u16>,
    /// By rank: where it last came among those met.
    last: Vec<u32>,
}

impl Writer {
    pub(super) fn write(&mut self, triangles: &[[u16; 3]], vertex_count: usize, bits: &mut BitWriter) {
        self.walk.clear(vertex_count);
        self.finder.clear(vertex_count);
        self.ranks.clear();
        self.ranks.resize(vertex_count, NONE);
        self.order.clear();
        self.last.clear();
        let Symbols { edges, turns, corners } = &mut self.symbols;
        [edges, turns, corners].into_iter().for_each(Vec::clear);
        self.turns = !triangles.iter().all(|[a, b, c]| a < b && a < c);
        for corners in triangles {
            self.triangle(*corners, bits);
        }
        for vertex in 0..vertex_count as u16 {
            if self.ranks[usize::from(vertex)] == NONE {
                self.ranks[usize::from(vertex)] = self.order.len() as u16;
                self.order.push(vertex);
            }
        }
        self.walk.meet_rest(vertex_count);
    }

    fn triangle(&mut self, corners: [u16; 3], bits: &mut BitWriter) {
        let ranks = corners.map(|vertex| self.ranks[usize::from(vertex)]);
        let found = (0..3).filter_map(|turn| {
            let (a, b) = (ranks[turn], ranks[(turn + 1) % 3]);
            let place = if a == NONE || b == NONE { None } else { self.finder.find(a, b) };
            place.map(|place| (place, turn))
        });
        let Some((place, turn)) = found.max_by_key(|(place, _)| *place) else {
            return self.apart(corners, bits);
        };
        let back = self.walk.edges.len() as u32 - 1 - place;
        let (symbol, len, open) = EDGES.split(back);
        if self.turns {
            self.symbols.turns.push(turn as u8);
        }
        bits.put(open, len);
        self.finder.remove(&self.walk.edges, place);
        let [a, b, across] = self.walk.edges.swap_remove(place as usize);

        let vertex = corners[(turn + 2) % 3];
        let rank = ranks[(turn + 2) % 3];
        let third = if rank == NONE {
            self.meet(vertex, Guess { a, b, c: across });
            NEW
        } else if self.walk.after[usize::from(b)] == rank {
            AFTER
        } else if self.walk.before[usize::from(a)] == rank {
            BEFORE
        } else {
            let known = self.known(rank, bits);
            self.symbols.corners.push(known as u8);
            MET
        };
        self.symbols.edges.push(joined(symbol, third));
        self.walk.follow([a, b, self.ranks[usize::from(vertex)]], third);
        self.finder.see(&self.walk.edges);
    }

    fn apart(&mut self, corners: [u16; 3], bits: &mut BitWriter) {
        self.symbols.edges.push(0);
        let mut before = None;
        for vertex in corners {
            let rank = self.ranks[usize::from(vertex)];
            let symbol = if rank == NONE {
                self.meet(vertex, before.map_or_else(|| self.walk.guess_next(), Guess::at));
                0
            } else {
                1 + self.known(rank, bits)
            };
            self.symbols.corners.push(symbol as u8);
            before = Some(self.ranks[usize::from(vertex)]);
        }
        self.walk.start(corners.map(|vertex| self.ranks[usize::from(vertex)]));
        self.finder.see(&self.walk.edges);
    }

    fn meet(&mut self, vertex: u16, guess: Guess) {
        self.last.push(self.walk.met.len() as u32);
        self.ranks[usize::from(vertex)] = self.walk.meet(guess);
        self.order.push(vertex);
    }

    /// The symbol of a vertex that was met.
    fn known(&mut self, rank: u16, bits: &mut BitWriter) -> u32 {
        let met = &mut self.walk.met;
        let last = &mut self.last[usize::from(rank)];
        let (symbol, len, open) = VERTICES.split(met.len() as u32 - 1 - *last);
        bits.put(open, len);
        if symbol >= VERTICES.0 {
            *last = met.len() as u32;
            met.push(rank);
        }
        symbol
    }
}
