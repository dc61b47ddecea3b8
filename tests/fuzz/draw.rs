//! A case is a string of bytes, and everything that is generated is drawn from it: what a seed gives is always the same, and a
//! shorter string is a simpler case.

use arbitrary::Unstructured;
use xxhash_rust::xxh3::xxh3_64_with_seed;

/// Bytes of a case.
const LEN: usize = 4096;

/// The bytes of a case.
pub(crate) fn bytes_of(seed: u64, case: u64) -> Vec<u8> {
    let word = |i: u64| xxh3_64_with_seed(&[case, i].map(u64::to_le_bytes).concat(), seed);
    (0..LEN as u64 / 8).flat_map(|i| word(i).to_le_bytes()).collect()
}

/// Draws from the bytes of a case. Where they are at an end, the first and smallest of everything is drawn.
pub(crate) struct Draw<'a>(Unstructured<'a>);

impl<'a> Draw<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Draw(Unstructured::new(bytes))
    }

    /// A number below `bound`, which must not be 0.
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        self.0.int_in_range(0..=bound - 1).unwrap_or(0)
    }

    /// Between two numbers, both of which occur.
    pub(crate) fn between(&mut self, least: usize, most: usize) -> usize {
        least + self.below(most - least + 1)
    }

    /// True once in so many times.
    pub(crate) fn once_in(&mut self, times: usize) -> bool {
        self.below(times) == times - 1
    }

    /// One of several; the simplest should come first.
    pub(crate) fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    pub(crate) fn word(&mut self) -> u64 {
        self.0.arbitrary().unwrap_or(0)
    }

    /// A whole number that has been trouble somewhere.
    pub(crate) fn odd_integer(&mut self) -> u64 {
        let near =
            self.pick(&[0, 1, 2, 1 << 8, 1 << 15, 1 << 16, 1 << 31, 1 << 32, 1 << 63, 4096, 0x7f80_0000]);
        let near: u64 = if self.once_in(4) { self.word() } else { near };
        near.wrapping_add(self.below(5) as u64).wrapping_sub(2)
    }

    /// A number that has been trouble somewhere.
    pub(crate) fn odd_float(&mut self) -> f64 {
        let odd =
            [0.0, -0.0, 1.0, 1e-45, 1e-38, 1.7e38, 3.4e38, 4e38, 1e-320, 1e300, f64::NAN, f64::INFINITY];
        let value = if self.once_in(3) { f64::from_bits(self.word()) } else { self.pick(&odd) };
        if self.once_in(3) { -value } else { value }
    }
}

/// A fraction between 0 and 1 for a number, so that large meshes need few drawn bytes.
pub(crate) fn noise(seed: u64, index: usize) -> f64 {
    (xxh3_64_with_seed(&index.to_le_bytes(), seed) >> 11) as f64 / (1u64 << 53) as f64
}
