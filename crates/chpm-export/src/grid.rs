//! Positions as whole numbers on one lattice, normals and colours in bytes: `KHR_mesh_quantization`.

use chpm_mesh::{Aabb, geom};

/// The greatest whole number of an axis.
const MOST: f64 = 65535.0;

/// A lattice over the box of a model, the same for all meshes of a file, so that equal positions stay equal.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Grid {
    low: [f64; 3],
    /// From one point to the next, the same along all axes: what is turned by a node stays at right angles.
    step: f64,
    rounding: f64,
}

impl Grid {
    /// The finest lattice of 16 bits an axis over a box.
    pub fn over(bounds: &Aabb) -> Self {
        let size = |axis: usize| f64::from(bounds.max[axis]) - f64::from(bounds.min[axis]);
        let largest = (0..3).map(size).fold(0.0, f64::max);
        // A single, so that readers have just that; rounded up, so that all of the box has numbers.
        let step = f64::from(geom::round_up(largest / MOST));
        if step > 0.0 {
            // Half the diagonal of a cell, and the rounding of doubles.
            let rounding = 0.5 * 3.0_f64.sqrt() * step * (1.0 + 1e-9);
            Grid { low: bounds.min.map(f64::from), step, rounding }
        } else {
            // A point, or nothing.
            let low = if largest == 0.0 && bounds.min[0].is_finite() { bounds.min } else { [0.0; 3] };
            Grid { low: low.map(f64::from), step: 1.0, rounding: 0.0 }
        }
    }

    /// How far a position moves at most.
    pub fn rounding(&self) -> f64 {
        self.rounding
    }

    /// The place of the zero point, and the step.
    pub(crate) fn place(&self) -> ([f64; 3], f64) {
        (self.low, self.step)
    }

    /// The nearest point of the lattice.
    pub(crate) fn nearest(&self, position: [f32; 3]) -> [u16; 3] {
        std::array::from_fn(|axis| {
            let number = (f64::from(position[axis]) - self.low[axis]) / self.step;
            number.round().clamp(0.0, MOST) as u16
        })
    }
}

/// A unit normal in bytes.
pub(crate) fn small_normal(normal: [f32; 3]) -> [i8; 3] {
    normal.map(|x| (127.0 * f64::from(x)).round().clamp(-127.0, 127.0) as i8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_moves_by_half_a_cell_at_most_and_ends_have_numbers() {
        for (min, max) in [
            ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
            ([-3.7, 1e6, 0.1], [8.9, 1e6 + 5.0, 0.1]),
            ([-f32::MAX, 0.0, 0.0], [f32::MAX, 1.0, 1e30]),
            ([1e-40, 0.0, 0.0], [3e-40, 1e-41, 0.0]),
        ] {
            let grid = Grid::over(&Aabb { min, max });
            let (low, step) = grid.place();
            assert!(f64::from(step as f32) == step, "a reader in single precision has the same");
            assert_eq!(grid.nearest(min), [0; 3]);
            let mut state = 1_u64;
            for _ in 0..2000 {
                let position: [f32; 3] = std::array::from_fn(|axis| {
                    state =
                        state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    let share = (state >> 40) as f64 / (1 << 24) as f64;
                    let (min, max) = (f64::from(min[axis]), f64::from(max[axis]));
                    (min + share * (max - min)).clamp(min, max) as f32
                });
                let found = grid.nearest(position);
                let away: f64 = (0..3)
                    .map(|axis| {
                        let read = low[axis] + step * f64::from(found[axis]);
                        ((read - f64::from(position[axis])) / step).powi(2)
                    })
                    .sum();
                assert!(away.sqrt() * step <= grid.rounding(), "{position:?} {found:?}");
                // No number is beyond the end.
                assert!((0..3).all(|axis| found[axis] <= grid.nearest(max)[axis]));
            }
        }
    }

    #[test]
    fn a_point_stays_where_it_is() {
        let point = [2.5, -1.0, 7.0];
        let grid = Grid::over(&Aabb { min: point, max: point });
        assert_eq!(
            (grid.nearest(point), grid.place(), grid.rounding()),
            ([0; 3], ([2.5, -1.0, 7.0], 1.0), 0.0)
        );
        let nothing = Grid::over(&Aabb::EMPTY);
        assert!(nothing.rounding() == 0.0 && nothing.place() == ([0.0; 3], 1.0));
    }

    #[test]
    fn normals_in_bytes_keep_their_directions_within_half_a_degree() {
        let mut worst: f64 = 1.0;
        for i in 0..5000 {
            let (z, turn) = (f64::from(i) / 2500.0 - 1.0, 2.4 * f64::from(i));
            let flat = (1.0 - z * z).sqrt();
            let normal = [flat * turn.cos(), flat * turn.sin(), z];
            let small = small_normal(normal.map(|x| x as f32)).map(f64::from);
            let length = small.iter().map(|x| x * x).sum::<f64>().sqrt();
            worst = worst.min(small.iter().zip(normal).map(|(a, b)| a / length * b).sum());
        }
        assert!(worst.acos().to_degrees() < 0.5, "{}", worst.acos().to_degrees());
        assert_eq!(small_normal([-1.0, 0.0, 0.0]), [-127, 0, 0]);
    }
}
