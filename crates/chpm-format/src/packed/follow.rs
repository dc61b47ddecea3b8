//! Reading the walk over triangles that [`super::connect`] writes.
//!
//! What comes next can hardly be foretold, least of all by a processor: so all that may be written is written, and counts say what stays.

use super::Damage;
use super::around::{Around, ByVertex, by_vertex};
use super::bits::BitReader;
use super::connect::{AFTER, BEFORE, EDGES, MET, NEW, NONE, VERTICES};

/// State of the walk: as in [`super::connect::Walk`], but with vertices for ranks.
pub(super) struct Follower {
    edges: Vec<[u16; 4]>,
    met: Vec<u16>,
    after: ByVertex<u16>,
    before: ByVertex<u16>,
    /// By rank: a vertex, and three that it is guessed from.
    guesses: ByVertex<[u16; 4]>,
    pub(super) around: Around,
}

/// How much of these is in use.
#[derive(Clone, Copy)]
struct Counts {
    edges: usize,
    met: usize,
    vertices: usize,
}

impl Follower {
    pub(super) fn new() -> Self {
        Follower {
            edges: Vec::new(),
            met: Vec::new(),
            after: by_vertex(),
            before: by_vertex(),
            guesses: by_vertex(),
            around: Around::new(),
        }
    }

    /// The first vertices of the walk, each with those that it is guessed from, which came before it; the first with itself.
    pub(super) fn guesses(&self, vertex_count: usize) -> &[[u16; 4]] {
        &self.guesses[..vertex_count]
    }

    fn clear(&mut self, vertex_count: usize, triangle_count: usize, apart: usize) {
        // A triangle leaves two edges at most and takes one; or it leaves three. One more is written than stays.
        let edges = triangle_count + 2 * apart + 2;
        if self.edges.len() < edges {
            self.edges.resize(edges, [0; 4]);
        }
        // Each vertex once, and again with each corner that is told.
        let met = vertex_count + triangle_count + 2 * apart + 2;
        if self.met.len() < met {
            self.met.resize(met, 0);
        }
        self.after[..vertex_count].fill(NONE);
        self.before[..vertex_count].fill(NONE);
        self.around.clear(vertex_count);
    }

    /// Reads as many triangles as there is room for in `out`. `order` are the vertices by rank; `edges` has a symbol for each triangle, `turns`
    /// one for each that an edge leads to, or none at all, and `corners` those that [`super::connect::told`] counts.
    pub(super) fn read<const TURNS: bool>(
        &mut self,
        order: &[u16],
        (edges, turns, mut corners): (&[u8], &[u8], &[u8]),
        bits: &mut BitReader<'_>,
        out: &mut [[u8; 6]],
    ) -> Result<(), Damage> {
        let apart = edges.iter().filter(|symbol| **symbol == 0).count();
        self.clear(order.len(), edges.len(), apart);
        let mut turns = turns.iter();
        let mut counts = Counts { edges: 0, met: 0, vertices: 0 };
        let mut legal = true;
        for (symbol, out) in edges.iter().zip(out) {
            let Some(symbol) = symbol.checked_sub(1) else {
                let (symbols, rest) = corners.split_first_chunk().ok_or(Damage("three corners"))?;
                corners = rest;
                let corners = self.start(*symbols, order, &mut counts, bits)?;
                *out = bytes_of(corners, 0);
                continue;
            };
            // Each by itself, so that the processor need not look for one where another was written.
            let Follower { edges, met, after, before, guesses, around } = self;
            let (edges, met) = (&mut edges[..], &mut met[..]);
            let (edge, third) = (symbol / 4, u32::from(symbol % 4));
            let back = EDGES.join(edge.into(), bits)? as usize;
            let last = counts.edges.wrapping_sub(1);
            let place = last.wrapping_sub(back);
            if place >= counts.edges || counts.edges + 1 >= edges.len() {
                return Err(Damage("an edge that was met"));
            }
            let [a, b, across, _] = edges[place];
            edges[place] = edges[last];

            let new = order.get(counts.vertices).copied().unwrap_or(NONE);
            let vertex = if third == MET {
                let (symbol, rest) = corners.split_first().ok_or(Damage("a third corner"))?;
                corners = rest;
                again(met, (*symbol).into(), &mut counts, bits)?
            } else {
                let (after, before) = (after[usize::from(b)], before[usize::from(a)]);
                let border = if third == AFTER { after } else { before };
                if third == NEW { new } else { border }
            };
            legal &= vertex != NONE;
            guesses[counts.vertices & 0xffff] = [new, a, b, across];
            met[counts.met] = new;
            let is_met = usize::from((third == NEW) & (new != NONE));
            counts.met += is_met;
            counts.vertices += is_met;

            let (one, two) = (third != AFTER, third != BEFORE);
            edges[last] = [vertex, b, a, 0];
            after[usize::from(if one { vertex } else { NONE })] = b;
            before[usize::from(if one { b } else { NONE })] = vertex;
            edges[last + usize::from(one)] = [a, vertex, b, 0];
            after[usize::from(if two { a } else { NONE })] = vertex;
            before[usize::from(if two { vertex } else { NONE })] = a;
            counts.edges = last + usize::from(one) + usize::from(two);
            around.add([a, b, vertex]);
            // Where nothing is told, the least corner comes first.
            let least = if vertex < a.min(b) { 1 } else { 2 * u8::from(b < a) };
            let turn = if TURNS { *turns.next().ok_or(Damage("the turn of a triangle"))? % 3 } else { least };
            *out = bytes_of([a, b, vertex], turn);
        }
        if !legal {
            return Err(Damage("a border at the corner"));
        }
        for rank in counts.vertices..order.len() {
            let before = order[rank.saturating_sub(1)];
            self.guesses[rank] = [order[rank], before, before, before];
        }
        Ok(())
    }

    /// A triangle that no edge leads to.
    fn start(
        &mut self,
        symbols: [u8; 3],
        order: &[u16],
        counts: &mut Counts,
        bits: &mut BitReader<'_>,
    ) -> Result<[u16; 3], Damage> {
        let mut corners = [0; 3];
        let mut before = order.get(counts.vertices.saturating_sub(1)).copied().unwrap_or_default();

        for (symbol, corner) in symbols.into_iter().zip(&mut corners) {
            *corner = match symbol.checked_sub(1) {
                Some(symbol) => again(&mut self.met, symbol.into(), counts, bits)?,
                None => {
                    let new = *order.get(counts.vertices).ok_or(Damage("no more vertices than there are"))?;
                    self.guesses[counts.vertices] = [new, before, before, before];
                    self.met[counts.met] = new;
                    counts.met += 1;
                    counts.vertices += 1;
                    new
                }
            };
            before = *corner;
        }

        self.around.add(corners);
        let [a, b, c] = corners;
        for (from, to, across) in [(b, a, c), (c, b, a), (a, c, b)] {
            self.edges[counts.edges] = [from, to, across, 0];
            counts.edges += 1;
            self.after[usize::from(from)] = to;
            self.before[usize::from(to)] = from;
        }
        Ok(corners)
    }
}

/// A vertex that was met before.
#[inline]
fn again(met: &mut [u16], symbol: u32, counts: &mut Counts, bits: &mut BitReader<'_>) -> Result<u16, Damage> {
    let back = VERTICES.join(symbol, bits)? as usize;
    let place = counts.met.checked_sub(back + 1).ok_or(Damage("a vertex that was met"))?;
    let vertex = met[place];
    met[counts.met] = vertex;
    counts.met += usize::from(symbol >= VERTICES.0);
    Ok(vertex)
}

/// Three corners as bytes, turned so that the first comes at that place.
#[inline]
fn bytes_of(corners: [u16; 3], turn: u8) -> [u8; 6] {
    let [a, b, c] = corners.map(u64::from);
    let told = a | b << 16 | c << 32;
    let shift = 16 * u32::from(turn);
    let turned = (told << shift | told >> (48 - shift)).to_le_bytes();
    [turned[0], turned[1], turned[2], turned[3], turned[4], turned[5]]
}
