//! A strip of an image's rows in linear light, and sums over parts of a row.

use crate::srgb::linear;

/// Texels of a block; the sums of all that lie before it are kept.
const BLOCK: usize = 32;

/// Red, green and blue in linear light, each times alpha and one of 256, and 255 times that factor. So what is not seen hardly counts,
/// and where nothing is seen, colours are averaged all the same.
pub type Texel = [u16; 4];

/// The last part of [`Texel`], for a weight of one.
pub(crate) const WEIGHT: u64 = 255;

/// A pixel in linear light, times its alpha: see [`Pixels`](crate::sheet::Pixels).
#[inline]
pub fn texel(&[r, g, b, a]: &[u8; 4]) -> Texel {
    let light = linear();
    if a == 255 {
        return [light[r as usize], light[g as usize], light[b as usize], 256 * 255];
    }
    let shown = u32::from(a) + 1;
    let part = |value: u8| ((u32::from(light[value as usize]) * shown + 128) >> 8) as u16;
    [part(r), part(g), part(b), (shown * 255) as u16]
}

/// Sums over a part of a row: of texels, and of texels times their distance from the part's begin.
#[derive(Clone, Copy, Default, PartialEq, Debug)]
pub(crate) struct Sums {
    pub(crate) plain: [u64; 4],
    pub(crate) moment: [u64; 4],
}

/// Rows of an image.
pub(crate) struct Texels {
    width: usize,
    rows: Vec<Texel>,
    /// Sums before each block of a row, from the row's begin, and those of the whole row.
    before: Vec<Sums>,
}

impl Texels {
    /// Bytes of a strip with its pixels.
    pub(crate) fn bytes(width: usize, rows: usize) -> u64 {
        let row = width * (size_of::<[u8; 4]>() + size_of::<Texel>());
        (rows * (row + Self::blocks(width) * size_of::<Sums>())) as u64
    }

    fn blocks(width: usize) -> usize {
        width / BLOCK + 1
    }

    pub(crate) fn new(width: usize) -> Self {
        Texels { width, rows: Vec::new(), before: Vec::new() }
    }

    /// Replaces the rows.
    pub(crate) fn fill(&mut self, pixels: &[[u8; 4]]) {
        self.rows.clear();
        self.rows.extend(pixels.iter().map(texel));

        self.before.clear();
        for row in self.rows.chunks_exact(self.width.max(1)) {
            let mut sums = Sums::default();
            self.before.push(sums);
            for (index, block) in row.as_chunks::<BLOCK>().0.iter().enumerate() {
                sums.append(&direct(block), index * BLOCK);
                self.before.push(sums);
            }
        }
    }

    /// One texel.
    pub(crate) fn at(&self, row: usize, column: usize) -> Sums {
        Sums { plain: self.rows[row * self.width + column].map(u64::from), moment: [0; 4] }
    }

    /// Sums over columns from `begin` to `end`.
    pub(crate) fn sums(&self, row: usize, begin: usize, end: usize) -> Sums {
        let texels = &self.rows[row * self.width..][..self.width];
        if end - begin <= 2 * BLOCK {
            return direct(&texels[begin..end]);
        }
        let before = &self.before[row * Self::blocks(self.width)..];
        let until = |column: usize| {
            let block = column / BLOCK;
            let mut sums = before[block];
            sums.append(&direct(&texels[block * BLOCK..column]), block * BLOCK);
            sums
        };
        let (first, all) = (until(begin), until(end));
        let mut sums = Sums::default();
        for part in 0..4 {
            sums.plain[part] = all.plain[part] - first.plain[part];
            sums.moment[part] = all.moment[part] - first.moment[part] - begin as u64 * sums.plain[part];
        }
        sums
    }
}

impl Sums {
    /// Adds those of a part that begins `distance` farther on.
    pub(crate) fn append(&mut self, part: &Sums, distance: usize) {
        for i in 0..4 {
            self.plain[i] += part.plain[i];
            self.moment[i] += part.moment[i] + distance as u64 * part.plain[i];
        }
    }

    /// The same part of `len` texels from its other end.
    pub(crate) fn reversed(&self, len: usize) -> Sums {
        let last = len as u64 - 1;
        Sums { plain: self.plain, moment: std::array::from_fn(|i| last * self.plain[i] - self.moment[i]) }
    }
}

/// Sums over a few texels: from the last to the first, what was gathered is added once a step.
fn direct(texels: &[Texel]) -> Sums {
    let (mut plain, mut moment) = ([0u32; 4], [0u32; 4]);
    for texel in texels.iter().rev() {
        for i in 0..4 {
            moment[i] += plain[i];
            plain[i] += u32::from(texel[i]);
        }
    }
    Sums { plain: plain.map(u64::from), moment: moment.map(u64::from) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_parts_are_sums_of_texels() {
        let (width, height) = (333, 3);
        let pixels: Vec<[u8; 4]> =
            (0..width * height).map(|i| (i as u32).wrapping_mul(0x9e37_79b9).to_le_bytes()).collect();
        let mut texels = Texels::new(width);
        texels.fill(&pixels);
        for row in 0..height {
            for begin in (0..width).step_by(7) {
                for end in (begin + 1..=width).step_by(5) {
                    let mut expected = Sums::default();
                    for column in begin..end {
                        expected.append(&texels.at(row, column), column - begin);
                    }
                    assert_eq!(texels.sums(row, begin, end), expected, "{row} {begin} {end}");
                }
            }
        }
    }

    #[test]
    fn the_longest_row_does_not_overflow() {
        let width = 65_535;
        let mut texels = Texels::new(width);
        texels.fill(&vec![[255; 4]; width]);
        let sums = texels.sums(0, 0, width);
        assert_eq!(sums.plain[0], 65_535 * 65_535);
        assert_eq!(sums.reversed(width), sums);
    }
}
