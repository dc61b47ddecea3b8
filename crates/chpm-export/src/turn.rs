//! A turn by right angles: a matrix of 0, 1 and -1, which changes signs and no other bit.

use std::ops::Neg;

/// Which axis becomes x, which y and which z, and whether it changes its sign.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Turn([(usize, bool); 3]);

impl Turn {
    /// Nothing is turned.
    pub const NONE: Turn = Turn([(0, false), (1, false), (2, false)]);

    /// The turn that makes an axis (0 to 2), or its negative end, point along y.
    pub const fn to_y(axis: usize, is_negative: bool) -> Turn {
        let sign = is_negative;
        match axis {
            0 => Turn([(1, !sign), (0, sign), (2, false)]),
            1 => Turn([(0, false), (1, sign), (2, sign)]),
            _ => Turn([(0, false), (2, sign), (1, !sign)]),
        }
    }

    /// The same along z: what points along y is then turned on.
    pub fn to_z(axis: usize, is_negative: bool) -> Turn {
        let Turn(first) = Turn::to_y(axis, is_negative);
        Turn([first[0], (first[2].0, !first[2].1), first[1]])
    }

    /// A place or a direction, turned.
    pub fn apply<T: Copy + Neg<Output = T>>(&self, v: [T; 3]) -> [T; 3] {
        self.0.map(|(axis, sign)| if sign { -v[axis] } else { v[axis] })
    }

    /// Columns: what x, y and z become.
    pub(crate) fn columns(&self) -> [[i8; 3]; 3] {
        [0, 1, 2]
            .map(|column| self.0.map(|(axis, sign)| i8::from(axis == column) * if sign { -1 } else { 1 }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_axis_comes_to_point_up_and_nothing_is_mirrored() {
        let cross = |[a, b, c]: [i32; 3], [x, y, z]: [i32; 3]| [b * z - c * y, c * x - a * z, a * y - b * x];
        for (axis, sign) in [(0, false), (1, false), (2, false), (0, true), (1, true), (2, true)] {
            let mut up = [0, 0, 0];
            up[axis] = if sign { -1 } else { 1 };
            for (turn, expected) in [(Turn::to_y(axis, sign), [0, 1, 0]), (Turn::to_z(axis, sign), [0, 0, 1])]
            {
                assert_eq!(turn.apply(up), expected, "{axis} {sign}");
                let [x, y, z] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(|way| turn.apply(way));
                assert_eq!(cross(x, y), z, "{axis} {sign}");
                assert_eq!(turn.columns().map(|column| column.map(i32::from)), [x, y, z]);
            }
        }
        assert_eq!((Turn::to_y(1, false), Turn::to_z(2, false)), (Turn::NONE, Turn::NONE));
        assert_eq!(Turn::to_y(2, false).apply([1, 2, 3]), [1, 3, -2]);
    }
}
