//! A mesh that grows by vertex splits: the triangles about each vertex, in the order that reader and writer both find them in.
//!
//! A corner is four times its triangle and its place there. The corners at a vertex are a list, which a split takes apart and puts together again.

use crate::packed::Damage;
use crate::packed::around::{ByVertex, by_vertex};

/// No corner, and no triangle.
pub(super) const NOWHERE: u32 = u32::MAX;
/// Larger rings are told triangle by triangle.
pub(super) const MOST_SPOKES: usize = 62;
/// Triangles of all rings together, for each of the page at most: so that a page's time has a bound.
const MOST_WALKED: u64 = 16;

/// A triangle of a ring: its corner at the middle, and the two behind that one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spoke {
    pub(super) corner: u32,
    pub(super) a: u16,
    pub(super) b: u16,
}

/// How the triangles about a vertex lie.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Ring {
    /// Each follows on another, all around.
    Closed,
    /// Each follows on another, but for the first; or there are none.
    Open,
    /// In any other way.
    Odd,
}

/// Room for a ring that is not too large, with places that any six bits are in.
const ROOM: usize = 64;
const NO_SPOKE: Spoke = Spoke { corner: NOWHERE, a: 0, b: 0 };

/// The mesh, and the ring that was looked at last.
pub(super) struct Rings {
    /// Four for a triangle, the last of them of no meaning.
    corners: Vec<u16>,
    /// By corner: the next at the same vertex.
    next: Vec<u32>,
    first: ByVertex<u32>,
    /// By triangle, the one behind it in the page.
    behind: Vec<u32>,
    head: u32,
    /// Triangles so far.
    count: usize,
    /// Where in the ring a vertex was last seen, as its second corner and as its third.
    seconds: ByVertex<u8>,
    thirds: ByVertex<u8>,
    found: [Spoke; ROOM],
    /// In their order around the middle where they have one; only the first `len` count.
    ring: Vec<Spoke>,
    len: usize,
    most_triangles: usize,
    left: u64,
    /// The vertices that each new one is guessed from, one after the other.
    pub(super) links: Vec<u16>,
}

impl Rings {
    pub(super) fn new() -> Self {
        Rings {
            corners: Vec::new(),
            next: Vec::new(),
            first: by_vertex(),
            behind: Vec::new(),
            head: NOWHERE,
            count: 0,
            seconds: by_vertex(),
            thirds: by_vertex(),
            found: [NO_SPOKE; ROOM],
            ring: vec![NO_SPOKE; ROOM],
            len: 0,
            most_triangles: 0,
            left: 0,
            links: Vec::new(),
        }
    }

    /// Begins a page of so many vertices and triangles.
    pub(super) fn clear(&mut self, vertex_count: usize, most_triangles: usize) {
        if self.behind.len() < most_triangles {
            self.behind.resize(most_triangles, NOWHERE);
            self.corners.resize(4 * most_triangles, 0);
            self.next.resize(4 * most_triangles, NOWHERE);
        }
        self.links.clear();
        self.first[..vertex_count].fill(NOWHERE);
        (self.head, self.count) = (NOWHERE, 0);
        self.most_triangles = most_triangles;
        self.left = MOST_WALKED * most_triangles as u64;
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.count
    }

    pub(super) fn ring(&self) -> &[Spoke] {
        &self.ring[..self.len]
    }

    /// Adds a triangle behind another one, or in front of all.
    #[inline]
    pub(super) fn add(&mut self, [a, b, c]: [u16; 3], behind: u32) -> Result<(), Damage> {
        if self.count >= self.most_triangles {
            return Err(Damage("no more triangles than it has"));
        }
        let triangle = self.count as u32;
        self.count += 1;
        let place = match behind {
            NOWHERE => &mut self.head,
            _ => &mut self.behind[behind as usize],
        };
        self.behind[triangle as usize] = std::mem::replace(place, triangle);
        let at = 4 * triangle as usize;
        self.corners[at..at + 4].copy_from_slice(&[a, b, c, 0]);
        let lists: &mut [u32] = &mut self.next[at..at + 3];
        for ((corner, list), vertex) in (at as u32..).zip(lists).zip([a, b, c]) {
            *list = std::mem::replace(&mut self.first[usize::from(vertex)], corner);
        }
        Ok(())
    }

    /// Looks at the triangles about a vertex.
    #[inline]
    pub(super) fn look(&mut self, vertex: u16) -> Result<Ring, Damage> {
        let Rings { corners, next, found, ring, seconds, thirds, .. } = self;
        let (corners, next) = (&corners[..], &next[..]);
        let first = self.first[usize::from(vertex)];
        let (mut corner, mut count) = (first, 0);
        while corner != NOWHERE {
            let (a, b) = beside(corners, corner);
            seconds[usize::from(a)] = count as u8;
            found[count % ROOM] = Spoke { corner, a, b };
            count += 1;
            corner = next[corner as usize];
        }
        self.len = count;
        self.left = self.left.checked_sub(count as u64).ok_or(Damage("rings that are not too many"))?;
        if count == 0 {
            return Ok(Ring::Open);
        }
        if count > MOST_SPOKES {
            ring.clear();
            let mut corner = first;
            while corner != NOWHERE {
                let (a, b) = beside(corners, corner);
                ring.push(Spoke { corner, a, b });
                corner = next[corner as usize];
            }
            return Ok(Ring::Odd);
        }
        let all = &found[..count];
        let after = |at: usize| {
            let next = usize::from(seconds[usize::from(all[at].b)]);
            (next < count && all[next].a == all[at].b).then_some(next)
        };
        // Only the last with some second corner is found again: what comes back to the first after all has each once.
        let (mut at, mut len) = (0, 0);
        let is_closed = loop {
            ring[len] = all[at];
            len += 1;
            match after(at) {
                Some(0) => break len == count,
                Some(next) if len < count => at = next,
                _ => break false,
            }
        };
        if is_closed {
            return Ok(Ring::Closed);
        }
        for (at, spoke) in (0..).zip(all) {
            thirds[usize::from(spoke.b)] = at;
        }
        let is_once = |(at, spoke): (usize, &Spoke)| {
            usize::from(seconds[usize::from(spoke.a)]) == at
                && usize::from(thirds[usize::from(spoke.b)]) == at
        };
        if all.iter().enumerate().all(is_once) {
            let before = |at: usize| {
                let last = usize::from(thirds[usize::from(all[at].a)]);
                (last < count && all[last].b == all[at].a).then_some(last)
            };
            // Where the first is in a circle that is not all, going back does not end by itself.
            let mut start = 0;
            for _ in 0..count {
                match before(start) {
                    Some(last) => start = last,
                    None => break,
                }
            }
            let (mut at, mut len) = (Some(start), 0);
            while let Some(place) = at.filter(|_| len < count) {
                ring[len] = all[place];
                len += 1;
                at = after(place);
            }
            if len == count && at.is_none() {
                return Ok(Ring::Open);
            }
        }
        ring[..count].copy_from_slice(all);
        Ok(Ring::Odd)
    }

    /// The vertex in front of a triangle of the ring, or behind the last.
    pub(super) fn link(&self, at: usize) -> Option<u16> {
        match self.ring().get(at) {
            Some(spoke) => Some(spoke.a),
            None => self.ring().get(at.checked_sub(1)?).map(|spoke| spoke.b),
        }
    }

    /// Splits the middle of the ring that is not odd: `count` triangles from `start` on go to the new vertex, and where asked, triangles come in front of them
    /// and behind.
    #[inline]
    pub(super) fn split_arc(
        &mut self,
        kind: Ring,
        [middle, new]: [u16; 2],
        [start, count]: [usize; 2],
        [in_front, behind]: [bool; 2],
    ) -> Result<(), Damage> {
        let len = self.len;
        let is_closed = kind == Ring::Closed;
        let is_there = if is_closed { start < len && count <= len } else { start + count <= len };
        if !is_there || ((in_front | behind) && len == 0) {
            return Err(Damage("a part of the ring"));
        }
        let (mut of_new, mut of_middle) = (NOWHERE, NOWHERE);
        let mut at = start;
        for turn in 0..len {
            if at >= len {
                at = 0;
            }
            let corner = self.ring[at].corner as usize;
            if turn < count {
                self.links.push(self.ring[at].a);
                self.corners[corner] = new;
                self.next[corner] = std::mem::replace(&mut of_new, corner as u32);
            } else {
                self.next[corner] = std::mem::replace(&mut of_middle, corner as u32);
            }
            at += 1;
        }
        self.first[usize::from(middle)] = of_middle;
        self.first[usize::from(new)] = of_new;
        let end = start + count;
        let end = if is_closed && end >= len { end - len } else { end };
        let Some(last) = self.link(end) else { return Ok(()) };
        if count > 0 || in_front | behind {
            self.links.push(last);
        }
        if in_front {
            let first = self.link(start).unwrap_or_default();
            self.add([middle, first, new], self.ring[start.min(len - 1)].corner / 4)?;
        }
        if behind {
            let before = if end == 0 { len - 1 } else { end - 1 };
            self.add([middle, new, last], self.ring[before].corner / 4)?;
        }
        Ok(())
    }

    /// Splits the middle of any ring: `goes` answers by the place of a triangle whether the new vertex gets it. Triangles are to be added.
    pub(super) fn split_odd(&mut self, [middle, new]: [u16; 2], mut goes: impl FnMut(usize) -> bool) {
        let mut lists = [NOWHERE; 2];
        for at in 0..self.len {
            let spoke = self.ring[at];
            let corner = spoke.corner as usize;
            let is_new = goes(at);
            if is_new {
                self.links.push(spoke.a);
                self.corners[corner] = new;
            }
            self.next[corner] = std::mem::replace(&mut lists[usize::from(is_new)], corner as u32);
        }
        [self.first[usize::from(middle)], self.first[usize::from(new)]] = lists;
    }

    /// Adds triangles of such a split behind one of the ring, each behind the one before.
    pub(super) fn add_odd(&mut self, corners: [u16; 3], is_first: bool) -> Result<(), Damage> {
        let beside = self.ring().first().map_or(NOWHERE, |spoke| spoke.corner / 4);
        let last = (self.triangle_count() as u32).wrapping_sub(1);
        self.add(corners, if is_first { beside } else { last })
    }

    /// The triangles in the page's order, each from its least corner on.
    pub(super) fn put_triangles(&self, out: &mut [[u8; 6]]) {
        let mut at = self.head;
        for out in out {
            let first = 4 * at as usize;
            let Some([a, b, c, _]) = self.corners.get(first..first + 4).and_then(|four| four.first_chunk())
            else {
                return;
            };
            let told = u64::from(*a) | u64::from(*b) << 16 | u64::from(*c) << 32;
            let shift = 16 * if *b < *a.min(c) { 1 } else { 2 * u32::from(c < a) };
            let turned = (told >> shift | told << (48 - shift)).to_le_bytes();
            *out = [turned[0], turned[1], turned[2], turned[3], turned[4], turned[5]];
            at = self.behind[at as usize];
        }
    }
}

/// The two corners behind one of a triangle.
#[inline(always)]
fn beside(corners: &[u16], corner: u32) -> (u16, u16) {
    let (own, place) = (corner & !3, corner & 3);
    let (second, third) = (0b01_00_10_01 >> (2 * place) & 3, 0b00_01_00_10 >> (2 * place) & 3);
    (corners[(own + second) as usize], corners[(own + third) as usize])
}
