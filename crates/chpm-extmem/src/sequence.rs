//! Random numbers of one documented sequence, the same on every system.

/// The additive feedback generator x(n) = x(n - 3) + x(n - 31) in 32 bits, of which all but the lowest are the number: the
/// sequence of the GNU C library's `rand`, which POSIX leaves to each library. (Knuth, *The Art of Computer Programming* 2,
/// 3.2.2.)
///
/// The first 31 words are of the generator x(n) = 16807 x(n - 1) modulo 2^31 - 1 (Park and Miller, *Random number generators:
/// good ones are hard to find*, Comm. ACM 31, 1988), from the seed on, with 1 in the place of 0. The first sum goes to the fourth of
/// them, and 310 numbers are left out.
#[derive(Clone, Debug)]
pub(crate) struct Sequence {
    words: [u32; 31],
    /// The place of x(n - 31), where x(n) goes.
    oldest: usize,
}

impl Sequence {
    pub(crate) fn new(seed: u32) -> Self {
        // As in C, where a seed is a signed word, and a negative remainder comes back from below.
        let mut word = i64::from(seed.max(1) as i32);
        let words = std::array::from_fn(|place| {
            if place > 0 {
                word = (16807 * word) % i64::from(i32::MAX);
                word += if word < 0 { i64::from(i32::MAX) } else { 0 };
            }
            word as u32
        });
        let mut sequence = Sequence { words, oldest: 3 };
        for _ in 0..310 {
            sequence.next();
        }
        sequence
    }

    /// The next number, below 2^31.
    pub(crate) fn next(&mut self) -> u32 {
        let recent = (self.oldest + 28) % 31;
        let sum = self.words[self.oldest].wrapping_add(self.words[recent]);
        self.words[self.oldest] = sum;
        self.oldest = (self.oldest + 1) % 31;
        sum >> 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the GNU C library has them: the first three numbers and the thousandth.
    #[test]
    fn the_sequence_is_the_documented_one() {
        for (seed, numbers) in [
            (0, [1804289383, 846930886, 1681692777, 1143565421]),
            (1, [1804289383, 846930886, 1681692777, 1143565421]),
            (17, [1227918265, 3978157, 263514239, 281746090]),
            (4321, [1159144554, 1890380824, 476543177, 1395488675]),
            (i32::MAX as u32, [1065668062, 2142264300, 1066566375, 1698607095]),
            (1 << 31, [1336741213, 1210407648, 1447044896, 193932953]),
            (u32::MAX, [254925627, 1205188300, 366127624, 1892540048]),
        ] {
            let mut sequence = Sequence::new(seed);
            let first: Vec<u32> = (0..1000).map(|_| sequence.next()).collect();
            assert_eq!([first[0], first[1], first[2], first[999]], numbers, "{seed}");
        }
    }
}
