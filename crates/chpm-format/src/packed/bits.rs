//! Numbers as a symbol, which zstd makes short, and the bits that the symbol leaves open, which nothing makes shorter.

use super::Damage;

/// Distances below are symbols of their own.
pub(super) struct Near(pub(super) u32);

impl Near {
    /// The symbol of a distance, and how many bits, and which, it leaves open.
    pub(super) fn split(&self, distance: u32) -> (u32, u32, u32) {
        match distance.checked_sub(self.0) {
            None => (distance, 0, 0),
            Some(beyond) => {
                let len = (beyond + 1).ilog2();
                (self.0 + len, len, beyond + 1 - (1 << len))
            }
        }
    }

    /// The distance of a symbol.
    #[inline]
    pub(super) fn join(&self, symbol: u32, bits: &mut BitReader<'_>) -> Result<u32, Damage> {
        match symbol.checked_sub(self.0) {
            None => Ok(symbol),
            Some(len) if len < 31 => Ok(self.0 + bits.take(len) + ((1 << len) - 1)),
            Some(_) => Err(Damage("a distance of a legal length")),
        }
    }
}

/// A difference as a number that is small if the difference is, of either sign.
pub(super) fn fold(difference: u32) -> u32 {
    difference << 1 ^ ((difference as i32) >> 31) as u32
}

/// The difference that was folded.
#[inline]
pub(super) fn unfold(folded: u32) -> u32 {
    folded >> 1 ^ (folded & 1).wrapping_neg()
}

/// Appends the symbol of a difference and writes what it leaves open. The symbol is the length of the folded difference, so that its
/// highest bit is known.
pub(super) fn put_difference(difference: u32, symbols: &mut Vec<u8>, bits: &mut BitWriter) {
    let folded = fold(difference);
    let len = u32::BITS - folded.leading_zeros();
    symbols.push(len as u8);
    if len > 1 {
        bits.put(folded & !(1 << (len - 1)), len - 1);
    }
}

/// How many bits the symbol of a difference leaves open, and the bit above them. Of a symbol above 32, which no writer writes, some.
#[inline]
pub(super) fn difference_of(symbol: u8) -> (u32, u32) {
    let open = u32::from(symbol.saturating_sub(1)) & 31;
    (open, u32::from(symbol != 0) << open)
}

/// Bits, the lowest of a byte first.
#[derive(Default, Debug)]
pub(super) struct BitWriter {
    pub(super) bytes: Vec<u8>,
    kept: u64,
    len: u32,
}

impl BitWriter {
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        (self.kept, self.len) = (0, 0);
    }

    /// Writes the low `len` bits of a value that has no others.
    pub(super) fn put(&mut self, value: u32, len: u32) {
        self.kept |= u64::from(value) << self.len;
        self.len += len;
        while self.len >= 8 {
            self.bytes.push(self.kept as u8);
            self.kept >>= 8;
            self.len -= 8;
        }
    }

    /// Bits that were written.
    pub(super) fn count(&self) -> u64 {
        8 * self.bytes.len() as u64 + u64::from(self.len)
    }

    /// Fills the last byte with zeros.
    pub(super) fn finish(&mut self) {
        if self.len > 0 {
            self.bytes.push(self.kept as u8);
        }
        (self.kept, self.len) = (0, 0);
    }
}

/// Reads what a [`BitWriter`] wrote; behind the end there are zeros, which [`BitReader::finish`] finds out.
pub(super) struct BitReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> BitReader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        BitReader { bytes, at: 0 }
    }

    /// The next `len` bits, at most 31.
    #[inline]
    pub(super) fn take(&mut self, len: u32) -> u32 {
        let value = self.word() as u32 & ((1 << len) - 1);
        self.at += len as usize;
        value
    }

    #[inline(always)]
    fn word(&self) -> u64 {
        let first = self.at / 8;
        let word = match self.bytes.get(first..first + 8) {
            Some(eight) => u64::from_le_bytes(eight.try_into().unwrap_or_default()),
            None => self.last(first),
        };
        word >> (self.at % 8)
    }

    /// The difference of a symbol.
    #[inline]
    pub(super) fn difference(&mut self, symbol: u8) -> u32 {
        let (open, high) = difference_of(symbol);
        unfold(self.take(open) | high)
    }

    /// The differences of some symbols.
    #[inline(always)]
    pub(super) fn differences<const N: usize>(&mut self, symbols: &[u8; N]) -> [u32; N] {
        let mut differences = [0; N];
        let (mut word, mut left) = (self.word(), 57);
        for (symbol, difference) in symbols.iter().zip(&mut differences) {
            let (open, high) = difference_of(*symbol);
            if open > left {
                (word, left) = (self.word(), 57);
            }
            *difference = unfold(word as u32 & ((1 << open) - 1) | high);
            word >>= open;
            left -= open;
            self.at += open as usize;
        }
        differences
    }

    #[cold]
    fn last(&self, first: usize) -> u64 {
        let rest = self.bytes.get(first..).unwrap_or_default();
        rest.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte))
    }

    /// All was read, no more than there was, and what is left of the last byte is zero.
    pub(super) fn finish(self) -> Result<(), Damage> {
        if self.at.div_ceil(8) != self.bytes.len() {
            return Err(Damage("as many open bits as symbols need"));
        }
        let read = self.at % 8;
        if read == 0 || self.bytes.last().is_none_or(|last| last >> read == 0) {
            Ok(())
        } else {
            Err(Damage("zeros behind the last open bit"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_come_back(numbers in proptest::collection::vec((any::<u32>(), 0u32..32), 0..200)) {
            let numbers: Vec<u32> = numbers.into_iter().map(|(n, shift)| n >> shift).collect();
            let (mut symbols, mut bits, near) = (Vec::new(), BitWriter::default(), Near(16));
            for n in &numbers {
                put_difference(*n, &mut symbols, &mut bits);
                let (symbol, len, open) = near.split(n >> 2);
                prop_assert!(symbol < 16 + 32);
                symbols.push(symbol as u8);
                bits.put(open, len);
            }
            bits.finish();
            let mut reader = BitReader::new(&bits.bytes);
            for (pair, n) in symbols.chunks(2).zip(&numbers) {
                prop_assert_eq!(reader.difference(pair[0]), *n);
                prop_assert_eq!(near.join(pair[1].into(), &mut reader).ok(), Some(n >> 2));
            }
            let used = reader.at;
            prop_assert!(reader.finish().is_ok());
            // Any bit that is left of the last byte would be found.
            for bit in used..8 * bits.bytes.len() {
                let mut bytes = bits.bytes.clone();
                bytes[bit / 8] |= 1 << (bit % 8);
                prop_assert!(BitReader { bytes: &bytes, at: used }.finish().is_err(), "{bit} of {used}");
            }
            let mut short = BitReader::new(&bits.bytes);
            (0..bits.bytes.len() + 1).for_each(|_| { short.take(8); });
            prop_assert!(short.finish().is_err(), "more was read than there is");
        }
    }
}
