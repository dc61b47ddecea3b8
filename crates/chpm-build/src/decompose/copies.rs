//! Copies of a triangle: faces that have the same three vertices in the same turn. The first one in the source stays.
//!
//! Two faces of opposite turn are the two sides of a sheet, and both stay.

/// The triangle as all its copies have it: the smallest vertex first, the turn as it is.
fn key([a, b, c]: [u32; 3]) -> [u32; 3] {
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
pub(super) struct Sieve {
    /// Triangles that were let through last, by hash.
    seen: Vec<[u32; 3]>,
    /// Copies that were dropped.
    pub(super) dropped: u64,
}

impl Sieve {
    /// log2 of the triangles that are remembered.
    const LOG: u32 = 15;

    pub(super) fn new() -> Self {
        Sieve { seen: vec![[0; 3]; 1 << Self::LOG], dropped: 0 }
    }

    /// Whether the triangle is new, as far as is remembered.
    #[inline]
    pub(super) fn passes(&mut self, triangle: [u32; 3]) -> bool {
        let passes = self.is_new(key(triangle));
        self.dropped += u64::from(!passes);
        passes
    }

    /// Whether a record is new, as far as is remembered: of the last that had its place.
    #[inline]
    pub(super) fn is_new(&mut self, record: [u32; 3]) -> bool {
        let [a, b, c] = record.map(u64::from);
        let hash = (a.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ b.rotate_left(32) ^ c)
            .wrapping_mul(0xd6e8_feb8_6659_fd93);
        let seen = &mut self.seen[(hash >> (64 - Self::LOG)) as usize];
        std::mem::replace(seen, record) != record
    }
}

/// Drops every copy but the first; answers how many.
pub(super) fn drop_all(triangles: &mut Vec<[u32; 3]>) -> u64 {
    let mut keyed: Vec<([u32; 3], u32)> = triangles.iter().map(|t| key(*t)).zip(0..).collect();
    keyed.sort_unstable();
    let mut copies: Vec<u32> =
        keyed.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1).collect();
    drop(keyed);
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

    #[test]
    fn copies_in_any_rotation_go_and_the_other_side_stays() {
        let mut triangles = vec![[7, 3, 5], [1, 2, 3], [5, 7, 3], [3, 7, 5], [3, 5, 7], [2, 3, 1], [7, 5, 3]];
        assert_eq!(drop_all(&mut triangles), 4);
        assert_eq!(triangles, [[7, 3, 5], [1, 2, 3], [3, 7, 5]]);
        assert_eq!(drop_all(&mut triangles), 0);
    }

    #[test]
    fn the_sieve_drops_copies_only() {
        let mut sieve = Sieve::new();
        let hash = |i: u32| i.wrapping_mul(0x9e37_79b9) >> 12;
        let all: Vec<[u32; 3]> =
            (0..200_000).map(|i| [hash(i % 90_000), hash(i % 90_000 + 1), i % 90_000]).collect();
        let mut passed: Vec<[u32; 3]> = all.iter().copied().filter(|t| sieve.passes(*t)).collect();
        let mut plain = all.clone();
        let copies = drop_all(&mut plain);
        assert_eq!(copies, 110_000);
        assert_eq!(sieve.dropped + drop_all(&mut passed), copies);
        assert_eq!(passed, plain);
        // Whatever is repeated soon is dropped at once.
        let mut sieve = Sieve::new();
        assert_eq!((0..1000).filter(|i| sieve.passes([[4, 5, 6], [5, 6, 4], [6, 4, 5]][i % 3])).count(), 1);
    }
}
