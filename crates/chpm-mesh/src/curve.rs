//! Curves that fill space: numbers of cells, by which those that are near in order are near in space.
//!
//! ```
//! use chpm_mesh::curve::{hilbert, morton};
//!
//! // Binary digits of the axes in turn, those of x the lowest.
//! assert_eq!(morton([0b11, 0b01, 0b10]), 0b101_011);
//! assert_eq!(hilbert([0, 0, 0]), 0);
//! ```

/// Place of a cell along Morton's curve.
pub fn morton(cell: [u16; 3]) -> u64 {
    let [x, y, z] = cell.map(spread);
    x | y << 1 | z << 2
}

/// [`morton`] for cells of 32 digits an axis.
pub fn morton_wide(cell: [u32; 3]) -> u128 {
    let [high, low] = [16, 0].map(|shift| u128::from(morton(cell.map(|digits| (digits >> shift) as u16))));
    high << 48 | low
}

/// The cell of a place that [`morton_wide`] gave.
pub fn morton_wide_cell(place: u128) -> [u32; 3] {
    // Every third digit.
    let gather = |digits: u128| (0..32).fold(0, |all, i| all | ((digits >> (3 * i)) as u32 & 1) << i);
    [place, place >> 1, place >> 2].map(gather)
}

/// Puts two zeros in front of each digit.
fn spread(digits: u16) -> u64 {
    let mut x = u64::from(digits);
    x = (x | x << 16) & 0xff00_00ff;
    x = (x | x << 8) & 0x00f0_0f00_f00f;
    x = (x | x << 4) & 0x0c30_c30c_30c3;
    (x | x << 2) & 0x2492_4924_9249
}

/// Digits of a cell along an axis that [`hilbert`] looks at.
pub const HILBERT_BITS: u32 = 21;

/// Place of a cell along Hilbert's curve (Skilling, "Programming the Hilbert curve", 2004): cells that follow one another share a side.
pub fn hilbert(mut cell: [u32; 3]) -> u64 {
    let top = 1 << (HILBERT_BITS - 1);
    let mut bit = top;
    while bit > 1 {
        let below = bit - 1;
        for axis in 0..3 {
            if cell[axis] & bit != 0 {
                cell[0] ^= below;
            } else {
                let swapped = (cell[0] ^ cell[axis]) & below;
                cell[0] ^= swapped;
                cell[axis] ^= swapped;
            }
        }
        bit >>= 1;
    }

    // What follows is Gray's code of the place, its bits dealt to the axes in turn.
    cell[1] ^= cell[0];
    cell[2] ^= cell[1];
    let mut flip = 0;
    let mut bit = top;
    while bit > 1 {
        if cell[2] & bit != 0 {
            flip ^= bit - 1;
        }
        bit >>= 1;
    }
    (0..HILBERT_BITS).rev().fold(0, |place: u64, bit: u32| {
        cell.iter().fold(place, |place, c| place << 1 | u64::from((c ^ flip) >> bit & 1))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_dealt_in_turn() {
        for [x, y, z] in [[0, 0, 0], [0b10_1101_0011, 7, 1023], [u32::MAX, 0x8000_0001, 0x1234_5678]] {
            let dealt = (0..32).map(|bit| {
                let digits = [z, y, x].map(|digits| u128::from(digits >> bit & 1));
                (digits[0] << 2 | digits[1] << 1 | digits[2]) << (3 * bit)
            });
            let place = morton_wide([x, y, z]);
            assert_eq!(place, dealt.sum::<u128>());
            assert_eq!(morton_wide_cell(place), [x, y, z]);
            assert_eq!(u128::from(morton([x, y, z].map(|digits| digits as u16))), place & ((1 << 48) - 1));
        }
    }

    #[test]
    fn the_curve_goes_from_cell_to_cell_beside_it() {
        let coarse = |x: u32| x << (HILBERT_BITS - 3);
        let mut cells: Vec<[u32; 3]> = (0..512).map(|i| [i & 7, i >> 3 & 7, i >> 6]).collect();
        cells.sort_by_key(|cell| hilbert(cell.map(coarse)));
        for pair in cells.windows(2) {
            let steps: u32 = (0..3).map(|axis| pair[0][axis].abs_diff(pair[1][axis])).sum();
            assert_eq!(steps, 1, "{pair:?}");
        }
    }
}
