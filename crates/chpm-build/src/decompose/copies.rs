//! Copies of a triangle: faces that have the same three vertices in the same turn. The first one in the source stays.
//!
//! Two faces of opposite turn are the two sides of a sheet, and both stay.

use crate::ids::Id;
use crate::trace::Phase;
use chpm_extmem::{Column, ExtmemError};
use rayon::prelude::*;

/// The triangle as all its copies have it: the smallest vertex first, the turn as it is.
fn key<I: Id>([a, b, c]: [I; 3]) -> [I; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// Drops copies that come soon after one another, so that a million of them take no room. Those that it lets through are for
/// [`drop_all`].
pub(super) struct Sieve<I> {
    /// Triangles that were let through last, by hash.
    seen: Vec<[I; 3]>,
    /// Copies that were dropped.
    pub(super) dropped: u64,
}

impl<I: Id> Default for Sieve<I> {
    fn default() -> Self {
        Sieve { seen: vec![[I::zeroed(); 3]; 1 << LOG], dropped: 0 }
    }
}

/// log2 of the triangles that are remembered.
const LOG: u32 = 15;
/// Places that one thread joins.
const PART: usize = 1 << 11;

impl<I: Id> Sieve<I> {
    /// A sieve that all `triangles` before one of them came through: it remembers the last of each place, which a few hundred thousand have filled.
    pub(super) fn behind(triangles: &Column<[I; 3]>, start: usize) -> Result<Self, ExtmemError> {
        let (mut sieve, mut scratch) = (Sieve::default(), Vec::new());
        let (mut open, mut end) = (sieve.seen.len(), start);
        while open > 0 && end > 0 {
            let begin = end.saturating_sub(1 << LOG);
            for triangle in triangles.read(begin..end, &mut scratch)?.iter().rev() {
                let key = key(*triangle);
                let seen = &mut sieve.seen[place(key)];
                // No triangle has three equal corners.
                if *seen == [I::zeroed(); 3] {
                    *seen = key;
                    open -= 1;
                }
            }
            end = begin;
        }
        Ok(sieve)
    }

    /// Whether a record is new, as far as is remembered: of the last that had its place.
    #[inline]
    pub(super) fn is_new(&mut self, record: [I; 3]) -> bool {
        std::mem::replace(&mut self.seen[place(record)], record) != record
    }

    /// Goes on with triangles that were sifted by themselves, as if they had come here one by one. Answers those that are not let through after
    /// all: which pieces they are of, and their places there.
    pub(super) fn join(&mut self, pieces: &[(&[[I; 3]], &Sifted<I>)], phase: Phase<'_>) -> Vec<(usize, u32)> {
        // Places do not ask for each other.
        let parts = self.seen.par_chunks_mut(PART).enumerate().map(|(part, seen)| {
            let _traced = phase.task("join");
            let mut copies = Vec::new();
            for (piece, (triangles, sifted)) in pieces.iter().enumerate() {
                let range = part * PART..part * PART + seen.len();
                let first_and_last = sifted.firsts[range.clone()].iter().zip(&sifted.sieve.seen[range]);
                for (seen, (first, last)) in
                    seen.iter_mut().zip(first_and_last).filter(|(_, (first, _))| **first != NONE)
                {
                    if *seen == key(triangles[*first as usize]) {
                        copies.push((piece, *first));
                    }
                    *seen = *last;
                }
            }
            copies
        });
        let copies: Vec<(usize, u32)> = parts.collect::<Vec<_>>().concat();
        self.dropped +=
            copies.len() as u64 + pieces.iter().map(|(_, sifted)| sifted.sieve.dropped).sum::<u64>();
        copies
    }
}

/// No triangle.
const NONE: u32 = u32::MAX;

/// Where a sieve remembers a record.
#[inline]
fn place<I: Id>(record: [I; 3]) -> usize {
    let [a, b, c] = record.map(I::bits);
    let hash =
        (a.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ b.rotate_left(32) ^ c).wrapping_mul(0xd6e8_feb8_6659_fd93);
    (hash >> (64 - LOG)) as usize
}

/// Triangles in a row that were sifted by themselves, on whichever thread.
pub(super) struct Sifted<I> {
    /// By triangle, whether it is let through.
    passes: Vec<bool>,
    /// By place, the triangle that came there first: what came before all of these decides. [`NONE`] where none came.
    firsts: Vec<u32>,
    sieve: Sieve<I>,
}

impl<I: Id> Default for Sifted<I> {
    fn default() -> Self {
        Sifted { passes: Vec::new(), firsts: Vec::new(), sieve: Sieve::default() }
    }
}

impl<I: Id> Sifted<I> {
    pub(super) fn sift(&mut self, triangles: &[[I; 3]]) {
        self.passes.clear();
        self.firsts.clear();
        self.firsts.resize(1 << LOG, NONE);
        self.sieve.seen.fill([I::zeroed(); 3]);
        self.sieve.dropped = 0;
        for (index, triangle) in (0..).zip(triangles) {
            let key = key(*triangle);
            let place = place(key);
            let before = std::mem::replace(&mut self.sieve.seen[place], key);
            // No triangle has three equal corners.
            if before == [I::zeroed(); 3] {
                self.firsts[place] = index;
            }
            self.passes.push(before != key);
            self.sieve.dropped += u64::from(before == key);
        }
    }

    /// Leaves out a triangle that was let through.
    pub(super) fn leave_out(&mut self, triangle: u32) {
        self.passes[triangle as usize] = false;
    }

    /// Those of the triangles that were let through.
    pub(super) fn passing<'a>(&self, triangles: &'a [[I; 3]]) -> impl Iterator<Item = &'a [I; 3]> {
        triangles.iter().zip(&self.passes).filter(|(_, passes)| **passes).map(|(triangle, _)| triangle)
    }
}

/// Drops every copy but the first, of triangles over vertices below `vertex_count`; answers how many.
pub(super) fn drop_all(triangles: &mut Vec<[u32; 3]>, vertex_count: usize) -> u64 {
    // Behind each vertex, the triangles of which it is the smallest: few, so that nothing large is sorted.
    let mut ends = vec![0u32; vertex_count];
    for triangle in &*triangles {
        ends[key(*triangle)[0] as usize] += 1;
    }
    let mut end = 0;
    for place in &mut ends {
        (*place, end) = (end, end + *place);
    }
    let mut rest = vec![([0; 2], 0); triangles.len()];
    for (index, triangle) in (0..).zip(&*triangles) {
        let [least, b, c] = key(*triangle);
        let place = &mut ends[least as usize];
        rest[*place as usize] = ([b, c], index);
        *place += 1;
    }

    let (mut copies, mut start) = (Vec::new(), 0);
    for end in ends {
        let about = &mut rest[start as usize..end as usize];
        about.sort_unstable();
        copies.extend(about.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1));
        start = end;
    }
    if copies.is_empty() {
        return 0;
    }

    copies.sort_unstable();
    let (mut rest, mut at) = (copies.iter().peekable(), 0);
    triangles.retain(|_| {
        let is_copy = rest.next_if(|copy| **copy == at).is_some();
        at += 1;
        !is_copy
    });
    copies.len() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Trace;
    use chpm_extmem::{BufferWriter, Store};

    #[test]
    fn copies_in_any_rotation_go_and_the_other_side_stays() {
        let mut triangles = vec![[7, 3, 5], [1, 2, 3], [5, 7, 3], [3, 7, 5], [3, 5, 7], [2, 3, 1], [7, 5, 3]];
        assert_eq!(drop_all(&mut triangles, 8), 4);
        assert_eq!(triangles, [[7, 3, 5], [1, 2, 3], [3, 7, 5]]);
        assert_eq!(drop_all(&mut triangles, 8), 0);
    }

    #[test]
    fn the_sieve_drops_copies_only() {
        let mut sieve = Sieve::default();
        let hash = |i: u32| i.wrapping_mul(0x9e37_79b9) >> 12;
        let all: Vec<[u32; 3]> =
            (0..200_000).map(|i| [hash(i % 90_000), hash(i % 90_000 + 1), i % 90_000]).collect();
        let mut passed: Vec<[u32; 3]> = all.iter().copied().filter(|t| sieve.is_new(key(*t))).collect();
        let dropped = (all.len() - passed.len()) as u64;
        // The same in pieces that know nothing of each other.
        let (mut pieces, mut sifted, mut kept) =
            (Sieve::default(), Sifted::default(), Vec::<[u32; 3]>::new());
        for piece in all.chunks(7001) {
            sifted.sift(piece);
            let copies = pieces.join(&[(piece, &sifted)], Trace::default().phase());
            copies.into_iter().for_each(|(_, triangle)| sifted.leave_out(triangle));
            kept.extend(sifted.passing(piece));
        }
        assert!(kept == passed && pieces.dropped == dropped && dropped > 0);
        // And in parts, each of which looks at what comes before it.
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), 0).unwrap();
        let mut writer = BufferWriter::new(&store, "triangles", 0).unwrap();
        writer.extend_from_slice(&all).unwrap();
        let column = writer.finish_column().unwrap();
        let mut of_parts = Vec::<[u32; 3]>::new();
        for (start, end) in [(0, 1), (1, 60_000), (60_000, 60_000), (60_000, 131_072), (131_072, 200_000)] {
            let mut sieve = Sieve::behind(&column, start).unwrap();
            of_parts.extend(all[start..end].iter().copied().filter(|t| sieve.is_new(key(*t))));
        }
        assert!(of_parts == passed);
        let mut plain = all.clone();
        let copies = drop_all(&mut plain, 1 << 20);
        assert_eq!(copies, 110_000);
        assert_eq!(dropped + drop_all(&mut passed, 1 << 20), copies);
        assert_eq!(passed, plain);
        // Whatever is repeated soon is dropped at once.
        let mut sieve = Sieve::<u32>::default();
        assert_eq!(
            (0..1000).filter(|i| sieve.is_new(key([[4, 5, 6], [5, 6, 4], [6, 4, 5]][i % 3]))).count(),
            1
        );
    }
}
