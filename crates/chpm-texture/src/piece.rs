//! Pieces of footprints, sorted by where in which image their rows are.

use crate::Wrap;
use crate::footprint::{Footprint, inside};
use bytemuck::{Pod, Zeroable};

/// Pixels of a strip: its height follows from the image's width alone.
const STRIP: u32 = 1 << 19;

/// The part of a triangle's footprint whose rows are in one strip of an image.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Piece {
    pub(crate) image: u32,
    pub(crate) strip: u32,
    pub(crate) corners: [[i32; 2]; 3],
    pub(crate) rows: [i32; 2],
    pub(crate) vertices: [u32; 3],
    pub(crate) material: u32,
}

/// Rows of a strip of an image that is so wide.
pub(crate) fn strip_height(width: u32) -> u32 {
    (STRIP / width.max(1)).clamp(1, 64)
}

impl Piece {
    pub(crate) fn footprint(&self) -> Footprint {
        Footprint { corners: self.corners }
    }

    /// Cuts all of a footprint, which `self` has in its rows, where the image has another strip.
    pub(crate) fn cut<E>(
        self,
        size: [u32; 2],
        wrap: Wrap,
        mut push: impl FnMut(Piece) -> Result<(), E>,
    ) -> Result<(), E> {
        let height = i64::from(strip_height(size[0]));
        let side = i64::from(size[1]);
        let (mut at, end) = (i64::from(self.rows[0]), i64::from(self.rows[1]));
        while at < end {
            let row = inside(at, side, wrap);
            let strip = row / height;
            let is_turned = wrap == Wrap::Mirror && at.div_euclid(side) % 2 != 0;
            let left =
                if is_turned { row - strip * height + 1 } else { side.min((strip + 1) * height) - row };
            let stop = end.min(at + left);
            push(Piece { strip: strip as u32, rows: [at as i32, stop as i32], ..self })?;
            at = stop;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_a_piece_are_in_its_strip() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for size in [[1 << 16, 50], [20_000, 77], [3, 5]] {
                let side = i64::from(size[1]);
                let (first, last) =
                    if wrap == Wrap::Clamp { (0, side + 1) } else { (-3 * side - 2, 2 * side + 9) };
                let whole = Piece { rows: [first as i32, last as i32], ..Piece::zeroed() };
                let mut next = whole.rows[0];
                let height = i64::from(strip_height(size[0]));
                let check = |piece: Piece| {
                    assert_eq!(piece.rows[0], next);
                    assert!(piece.rows[0] < piece.rows[1]);
                    for row in piece.rows[0]..piece.rows[1] {
                        assert_eq!(inside(row.into(), side, wrap) / height, piece.strip.into());
                    }
                    next = piece.rows[1];
                    Ok::<(), ()>(())
                };
                whole.cut(size, wrap, check).unwrap();
                assert_eq!(next, whole.rows[1]);
            }
        }
    }
}
