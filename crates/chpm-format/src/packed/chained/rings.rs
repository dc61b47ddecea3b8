//! A mesh that grows by vertex splits, and the triangles at each vertex, in an order that reader and writer both come to.

use crate::packed::Damage;
use crate::packed::around::{ByVertex, by_vertex};
use crate::packed::connect::NONE;

/// Triangles of a page at most, so that 16 bits hold the number of each.
pub(super) const MOST_TRIANGLES: usize = NONE as usize;
/// Triangles of all rings together, for each of the page at most: so that a page's time and memory have a bound.
const MOST_WALKED: usize = 8;
/// A ring: how many triangles it has, and these. Few have more than there is room for: those say so, and where theirs are.
type Ring = [u16; 16];
const ROOM: usize = 15;
const SPILLED: u16 = u16::MAX;
/// Triangles of a ring that are told at once where they go.
pub(super) const TOLD_AT_ONCE: usize = 31;

/// The triangles that went to the new vertex of a split, which are now its ring.
#[derive(Default)]
pub(super) struct Gone {
    /// How many.
    count: usize,
    /// Sums over them, with a and b the corners behind the middle: of a - b, and of the differences of their squares.
    sums: [i64; 2],
    /// The last of them; or else the first that stayed, if there is one.
    beside: u16,
}

impl Gone {
    /// Takes those of a ring that `bits` say, from the last on but for some, of which it had so many at first. The last that is left takes the place of each.
    /// What goes is put to those of the new vertex, with both corners behind the middle.
    #[inline(always)]
    fn take(
        &mut self,
        triangles: &mut [u64],
        [middle, new]: [u16; 2],
        ring: &mut [u16],
        (passed, count): (usize, usize),
        mut bits: u32,
        (fresh, links, seconds): (&mut [u16], &mut [u16], &mut [u16]),
    ) {
        while bits != 0 {
            let at = count - 1 - passed - bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let triangle = ring[at];
            ring[at] = ring[count - 1 - self.count];
            let corners = &mut triangles[usize::from(triangle)];
            let shift = shift_of(*corners, middle);
            let from_middle = *corners >> shift | *corners << (48 - shift);
            *corners ^= u64::from(middle ^ new) << shift;
            let (a, b) = ((from_middle >> 16) as u16, (from_middle >> 32) as u16);
            (fresh[self.count], links[self.count], seconds[self.count]) = (triangle, a, b);
            self.count += 1;
            let (a, b) = (i64::from(a), i64::from(b));
            self.sums[0] += a - b;
            self.sums[1] += (a - b) * (a + b);
        }
    }

    /// Whether they are all around the middle, or none.
    pub(super) fn is_whole(&self) -> bool {
        self.sums[0] == 0
    }

    /// The two ends of the triangles that went: the one a that is no b, and the one b that is no a.
    #[inline]
    fn ends(&self) -> Option<[u16; 2]> {
        let [apart, squares] = self.sums;
        // All others come in both sums with either sign. As floats, since a division of whole numbers takes longer.
        let sum = (squares as f64 / apart as f64) as i64;
        let first = (sum + apart) >> 1;
        let last = first - apart;
        (sum * apart == squares && first + last == sum).then_some([first as u16, last as u16])
    }
}

/// The mesh.
pub(super) struct Rings {
    /// Three corners each, sixteen bits for one, the first lowest.
    triangles: Vec<u64>,
    rings: ByVertex<Ring>,
    /// Rings that there is no room for.
    spilled: Vec<Vec<u16>>,
    /// By triangle, the one behind it in the page.
    behind: Vec<u16>,
    head: u16,
    /// Triangles so far.
    count: usize,
    most_triangles: usize,
    left: usize,
    /// The vertices that each new one is guessed from, one after the other, and how many they are: the first corners behind the middle of what went to it, and some more.
    links: Vec<u16>,
    link_count: usize,
    /// Of the triangles that went, the second corners.
    seconds: Vec<u16>,
}

impl Rings {
    pub(super) fn new() -> Self {
        Rings {
            triangles: Vec::new(),
            rings: by_vertex(),
            spilled: Vec::new(),
            behind: Vec::new(),
            head: NONE,
            count: 0,
            most_triangles: 0,
            left: 0,
            links: Vec::new(),
            link_count: 0,
            seconds: vec![0; ROOM],
        }
    }

    /// Begins a page of so many vertices and triangles.
    pub(super) fn clear(&mut self, vertex_count: usize, most_triangles: usize) -> Result<(), Damage> {
        if most_triangles > MOST_TRIANGLES {
            return Err(Damage("at most 65,535 triangles"));
        }
        if self.behind.len() < most_triangles {
            self.behind.resize(most_triangles, NONE);
            self.triangles.resize(most_triangles, 0);
        }
        self.rings[..vertex_count].iter_mut().for_each(|ring| ring[0] = 0);
        self.spilled.clear();
        self.link_count = 0;
        (self.head, self.count) = (NONE, 0);
        self.most_triangles = most_triangles;
        self.left = MOST_WALKED * most_triangles;
        Ok(())
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.count
    }

    pub(super) fn links(&self) -> &[u16] {
        &self.links[..self.link_count]
    }

    /// The triangles at a vertex.
    fn ring(&self, vertex: u16) -> &[u16] {
        match &self.rings[usize::from(vertex)] {
            [SPILLED, place, ..] => &self.spilled[usize::from(*place)],
            [len, triangles @ ..] => &triangles[..usize::from(*len)],
        }
    }

    /// The triangles at a vertex from the last on, each with the place of its corner there.
    pub(super) fn corners(&self, vertex: u16) -> impl Iterator<Item = (u16, u8)> {
        let place = move |triangle: u16| (shift_of(self.triangles[usize::from(triangle)], vertex) / 16) as u8;
        self.ring(vertex).iter().rev().map(move |triangle| (*triangle, place(*triangle)))
    }

    #[inline]
    fn push(&mut self, vertex: u16, triangle: u16) {
        let ring = &mut self.rings[usize::from(vertex)];
        let len = usize::from(ring[0]);
        if len < ROOM {
            ring[len + 1] = triangle;
            ring[0] += 1;
        } else {
            self.spill(vertex, triangle);
        }
    }

    #[cold]
    fn spill(&mut self, vertex: u16, triangle: u16) {
        let ring = &mut self.rings[usize::from(vertex)];
        if ring[0] != SPILLED {
            self.spilled.push(ring[1..].to_vec());
            // No more than there are vertices.
            (ring[0], ring[1]) = (SPILLED, (self.spilled.len() - 1) as u16);
        }
        self.spilled[usize::from(ring[1])].push(triangle);
    }

    /// Adds the next triangle of the base mesh.
    #[inline]
    pub(super) fn add_base(&mut self, corners: [u16; 3]) -> Result<(), Damage> {
        let triangle = self.count;
        self.put(corners)?;
        self.behind[triangle] = self.count as u16;
        Ok(())
    }

    /// The base mesh is whole.
    pub(super) fn end_base(&mut self) {
        if let Some(last) = self.count.checked_sub(1) {
            (self.head, self.behind[last]) = (0, NONE);
        }
    }

    #[inline(always)]
    fn put(&mut self, corners: [u16; 3]) -> Result<(), Damage> {
        if self.count >= self.most_triangles {
            return Err(Damage("no more triangles than it has"));
        }
        let [a, b, c] = corners.map(u64::from);
        self.triangles[self.count] = a | b << 16 | c << 32;
        corners.into_iter().for_each(|vertex| self.push(vertex, self.count as u16));
        self.count += 1;
        Ok(())
    }

    /// Adds a triangle behind another one of the page, or in front of all, and behind those at its vertices.
    #[inline]
    pub(super) fn add(&mut self, corners: [u16; 3], behind: u16) -> Result<(), Damage> {
        let triangle = self.count;
        self.put(corners)?;
        let place = match behind {
            NONE => &mut self.head,
            _ => &mut self.behind[usize::from(behind)],
        };
        self.behind[triangle] = std::mem::replace(place, triangle as u16);
        Ok(())
    }

    /// Hands triangles at the middle over to the new vertex. From the last on, `told` answers for so many of them, [`TOLD_AT_ONCE`] at most, which go,
    /// by a bit each. The last that is left takes the place of each that goes.
    #[inline]
    pub(super) fn split(
        &mut self,
        [middle, new]: [u16; 2],
        mut told: impl FnMut(u32) -> u32,
    ) -> Result<Gone, Damage> {
        self.reserve_links(ROOM);
        let Ok([ring, fresh]) = self.rings.get_disjoint_mut([usize::from(middle), usize::from(new)]) else {
            return Err(Damage("a vertex that is there"));
        };
        let ([len, ring @ ..], [of_new, fresh @ ..]) = (ring, fresh);
        let count = usize::from(*len);
        if count > ROOM {
            return self.split_spilled([middle, new], told);
        }
        self.left = self.left.checked_sub(count).ok_or(Damage("rings that are not too many"))?;
        let mut gone = Gone::default();
        let links = &mut self.links[self.link_count..][..ROOM];
        let to = (&mut fresh[..], links, &mut self.seconds[..ROOM]);
        gone.take(&mut self.triangles, [middle, new], ring, (0, count), told(count as u32), to);
        *len -= gone.count as u16;
        *of_new = gone.count as u16;
        gone.beside = match gone.count {
            0 if count == 0 => NONE,
            0 => ring[0],
            goes => fresh[goes - 1],
        };
        self.link_count += gone.count;
        Ok(gone)
    }

    /// As [`Rings::split`], of a ring that there is no room for.
    #[cold]
    fn split_spilled(
        &mut self,
        [middle, new]: [u16; 2],
        mut told: impl FnMut(u32) -> u32,
    ) -> Result<Gone, Damage> {
        let place = usize::from(self.rings[usize::from(middle)][1]);
        let mut ring = std::mem::take(&mut self.spilled[place]);
        let count = ring.len();
        self.left = self.left.checked_sub(count).ok_or(Damage("rings that are not too many"))?;
        let mut fresh = vec![0; count];
        self.reserve_links(count);
        self.seconds.resize(self.seconds.len().max(count), 0);
        let mut gone = Gone::default();
        for first in (0..count).step_by(TOLD_AT_ONCE) {
            let bits = told((count - first).min(TOLD_AT_ONCE) as u32);
            let to = (&mut fresh[..], &mut self.links[self.link_count..], &mut self.seconds[..]);
            gone.take(&mut self.triangles, [middle, new], &mut ring, (first, count), bits, to);
        }
        fresh.truncate(gone.count);
        ring.truncate(count - gone.count);
        gone.beside = fresh.last().or(ring.first()).copied().unwrap_or(NONE);
        self.spilled[place] = ring;
        fresh.iter().for_each(|triangle| self.push(new, *triangle));
        self.link_count += gone.count;
        Ok(gone)
    }

    /// Room for so many links, and one more.
    #[inline]
    fn reserve_links(&mut self, count: usize) {
        if self.links.len() <= self.link_count + count {
            self.links.resize(2 * (self.link_count + count) + 1, 0);
        }
    }

    /// One more vertex to guess the new one from.
    #[inline]
    pub(super) fn link(&mut self, vertex: u16) {
        self.reserve_links(0);
        self.links[self.link_count] = vertex;
        self.link_count += 1;
    }

    /// The ends of the triangles that went, each with the triangle that has it; none where there are none, or those that went are not one after the other.
    #[inline]
    pub(super) fn ends(&self, gone: &Gone, new: u16) -> Option<[(u16, u16); 2]> {
        let [first, last] = gone.ends().filter(|_| !gone.is_whole())?;
        let (mut of_first, mut of_last) = (usize::MAX, usize::MAX);
        let links = &self.links[self.link_count - gone.count..self.link_count];
        for (at, (a, b)) in links.iter().zip(&self.seconds).enumerate() {
            of_first = if *a == first { at } else { of_first };
            of_last = if *b == last { at } else { of_last };
        }
        let ring = self.ring(new);
        Some([(first, *ring.get(of_first)?), (last, *ring.get(of_last)?)])
    }

    /// Adds the triangles of a split between those that went and those that stayed, where they are told to be.
    #[inline]
    pub(super) fn fill(
        &mut self,
        [middle, new]: [u16; 2],
        gone: &Gone,
        [in_front, behind]: [bool; 2],
    ) -> Result<(), Damage> {
        let Some([first, last]) = self.ends(gone, new) else {
            let is_whole = gone.is_whole() && !(in_front | behind);
            return if is_whole { Ok(()) } else { Err(Damage("triangles side by side")) };
        };
        self.link(last.0);
        if in_front {
            self.add([middle, first.0, new], first.1)?;
        }
        if behind {
            self.add([middle, new, last.0], last.1)?;
        }
        Ok(())
    }

    /// Adds one of the triangles that are told by themselves, each behind the one before.
    pub(super) fn add_odd(&mut self, corners: [u16; 3], gone: &Gone, is_first: bool) -> Result<(), Damage> {
        let before = (self.count as u16).wrapping_sub(1);
        self.add(corners, if is_first { gone.beside } else { before })
    }

    /// The triangles in the page's order, each from its least corner on.
    pub(super) fn put_triangles(&self, out: &mut [[u8; 6]]) {
        let mut at = self.head;
        for out in out {
            let Some(told) = self.triangles.get(usize::from(at)) else { return };
            let [a, b, c] = [0, 16, 32].map(|shift| (told >> shift) as u16);
            let shift = 16 * if b < a.min(c) { 1 } else { 2 * u32::from(c < a) };
            let turned = (told >> shift | told << (48 - shift)).to_le_bytes();
            *out = [turned[0], turned[1], turned[2], turned[3], turned[4], turned[5]];
            at = self.behind[usize::from(at)];
        }
    }
}

/// By how many bits a triangle is to be shifted so that one of its corners comes first.
#[inline(always)]
fn shift_of(triangle: u64, corner: u16) -> u32 {
    16 * u32::from((triangle >> 16) as u16 == corner) + 32 * u32::from((triangle >> 32) as u16 == corner)
}
