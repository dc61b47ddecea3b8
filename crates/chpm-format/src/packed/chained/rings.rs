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
    /// Where in the ring a vertex was last seen, as its second corner and as its third.
    seconds: ByVertex<u8>,
    thirds: ByVertex<u8>,
    found: Vec<Spoke>,
    /// In their order around the middle where they have one.
    pub(super) ring: Vec<Spoke>,
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
            seconds: by_vertex(),
            thirds: by_vertex(),
            found: Vec::new(),
            ring: Vec::new(),
            most_triangles: 0,
            left: 0,
            links: Vec::new(),
        }
    }

    /// Begins a page of so many vertices and triangles.
    pub(super) fn clear(&mut self, vertex_count: usize, most_triangles: usize) {
        self.corners.clear();
        self.next.clear();
        self.behind.clear();
        self.links.clear();
        self.first[..vertex_count].fill(NOWHERE);
        self.head = NOWHERE;
        self.most_triangles = most_triangles;
        self.left = MOST_WALKED * most_triangles as u64;
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.behind.len()
    }

    /// Adds a triangle behind another one, or in front of all.
    #[inline]
    pub(super) fn add(&mut self, corners: [u16; 3], behind: u32) -> Result<(), Damage> {
        let triangle = self.behind.len() as u32;
        if triangle as usize >= self.most_triangles {
            return Err(Damage("no more triangles than it has"));
        }
        let place = match self.behind.get_mut(behind as usize) {
            Some(place) => place,
            None => &mut self.head,
        };
        let after = std::mem::replace(place, triangle);
        self.behind.push(after);
        let [a, b, c] = corners;
        self.corners.extend_from_slice(&[a, b, c, 0]);
        let mut lists = [NOWHERE; 4];
        for ((corner, list), vertex) in (4 * triangle..).zip(&mut lists).zip(corners) {
            *list = std::mem::replace(&mut self.first[usize::from(vertex)], corner);
        }
        self.next.extend_from_slice(&lists);
        Ok(())
    }

    /// Looks at the triangles about a vertex.
    #[inline]
    pub(super) fn look(&mut self, vertex: u16) -> Result<Ring, Damage> {
        let Rings { corners, next, found, ring, seconds, thirds, .. } = self;
        let (corners, next) = (&corners[..], &next[..]);
        found.clear();
        ring.clear();
        let mut corner = self.first[usize::from(vertex)];
        while let Some(after) = next.get(corner as usize) {
            let (own, place) = (corner & !3, corner & 3);
            let (second, third) =
                (own + (0b01_00_10_01 >> (2 * place) & 3), own + (0b00_01_00_10 >> (2 * place) & 3));
            let (a, b) = (corners[second as usize], corners[third as usize]);
            seconds[usize::from(a)] = found.len() as u8;
            thirds[usize::from(b)] = found.len() as u8;
            found.push(Spoke { corner, a, b });
            corner = *after;
        }
        let count = found.len();
        self.left = self.left.checked_sub(count as u64).ok_or(Damage("rings that are not too many"))?;
        if count == 0 {
            return Ok(Ring::Open);
        }
        let is_once = |(at, spoke): (usize, &Spoke)| {
            usize::from(seconds[usize::from(spoke.a)]) == at
                && usize::from(thirds[usize::from(spoke.b)]) == at
        };
        if count > MOST_SPOKES || !found.iter().enumerate().all(is_once) {
            ring.extend_from_slice(found);
            return Ok(Ring::Odd);
        }
        let after = |spoke: Spoke| {
            let next = usize::from(seconds[usize::from(spoke.b)]);
            found.get(next).filter(|next| next.a == spoke.b).copied()
        };
        let mut is_closed = false;
        // Since each second corner and each third is there once, this comes back to the first or to an end.
        let mut at = Some(found[0]);
        while let Some(spoke) = at {
            ring.push(spoke);
            at = after(spoke);
            if at.is_some_and(|spoke| spoke.corner == found[0].corner) {
                is_closed = true;
                break;
            }
        }
        if !is_closed {
            let mut start = found[0];
            let before = |spoke: Spoke| {
                let last = usize::from(thirds[usize::from(spoke.a)]);
                found.get(last).filter(|last| last.b == spoke.a).copied()
            };
            while let Some(spoke) = before(start) {
                start = spoke;
            }
            ring.clear();
            let mut at = Some(start);
            while let Some(spoke) = at {
                ring.push(spoke);
                at = after(spoke);
            }
        }
        if ring.len() < count {
            ring.clear();
            ring.extend_from_slice(found);
            return Ok(Ring::Odd);
        }
        Ok(if is_closed { Ring::Closed } else { Ring::Open })
    }

    /// The vertex in front of a triangle of the ring, or behind the last.
    pub(super) fn link(&self, at: usize) -> Option<u16> {
        match self.ring.get(at) {
            Some(spoke) => Some(spoke.a),
            None => self.ring.get(at.checked_sub(1)?).map(|spoke| spoke.b),
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
        let len = self.ring.len();
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
        for (at, spoke) in self.ring.iter().enumerate() {
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
        let beside = self.ring.first().map_or(NOWHERE, |spoke| spoke.corner / 4);
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
