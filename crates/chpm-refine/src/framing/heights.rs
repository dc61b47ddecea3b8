//! Terrain whose places are degrees and whose heights are metres: as it is, all of it is one upright line.

use super::outline::Outline;
use nalgebra::Vector3;

/// Metres of a degree along a meridian, on average.
const DEGREE: f64 = 111_320.0;
/// By how much heights exceed the longer side before anybody would take them for another unit.
const TALL: f64 = 10.0;
/// Of the ground, what a surface that is open above covers, at least: a rod or a wall has as much surface up as down.
const OPEN: f64 = 0.3;

/// Factor on heights for a terrain's picture; `origin` is what the outline's points are relative to.
pub(super) fn scale(outline: &Outline, origin: [f64; 3]) -> Option<f64> {
    let (low, size) = outline.bounds();
    // Longitude first, or latitude.
    let is_on_earth = is_within(0, 180.0, &low, &origin, &size) && is_within(1, 90.0, &low, &origin, &size)
        || is_within(0, 90.0, &low, &origin, &size) && is_within(1, 180.0, &low, &origin, &size);
    let ground = size.x * size.y;
    let is_tall = ground > 0.0 && size.z > TALL * size.x.max(size.y);
    if !(is_on_earth && is_tall) {
        return None;
    }
    let open: f64 = outline.triangles().map(upward).sum();
    (open.abs() > OPEN * ground).then_some(1.0 / DEGREE)
}

fn is_within(
    axis: usize,
    most: f64,
    low: &nalgebra::Point3<f64>,
    origin: &[f64; 3],
    size: &Vector3<f64>,
) -> bool {
    let least = low[axis] + origin[axis];
    least >= -most && least + size[axis] <= most
}

fn upward(corners: [nalgebra::Point3<f64>; 3]) -> f64 {
    let normal: Vector3<f64> = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    0.5 * normal.z
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hills over a square, at a place, with heights of a size.
    fn hills(at: [f32; 2], width: f32, height: f32) -> Outline {
        let side = 20_u32;
        let along = |n: u32| width * n as f32 / (side - 1) as f32;
        let point = |n: u32| {
            let (x, y) = (n % side, n / side);
            [
                at[0] + along(x),
                at[1] + along(y),
                height * ((0.7 * x as f32).sin() * (0.5 * y as f32).cos()).abs(),
            ]
        };
        let points: Vec<[f32; 3]> = (0..side * side).map(point).collect();
        let squares = (0..side * (side - 1)).filter(|n| n % side + 1 < side);
        let halves = |n: u32| [[n, n + 1, n + side], [n + 1, n + side + 1, n + side]];
        Outline::of_mesh(&points, &squares.flat_map(halves).collect::<Vec<_>>())
    }

    #[test]
    fn metres_over_degrees_are_told_from_all_else() {
        assert_eq!(scale(&hills([8.0, 46.0], 0.2, 900.0), [0.0; 3]), Some(1.0 / DEGREE));
        assert_eq!(scale(&hills([0.0, 0.0], 0.2, 900.0), [8.0, 46.0, 400.0]), Some(1.0 / DEGREE));
        // Metres all over, degrees that are none, heights of the same unit, and a rod.
        assert_eq!(scale(&hills([0.0, 0.0], 0.2, 900.0), [4e5, 5e6, 0.0]), None);
        assert_eq!(scale(&hills([100.0, 95.0], 0.2, 900.0), [0.0; 3]), None);
        assert_eq!(scale(&hills([8.0, 46.0], 0.2, 0.9), [0.0; 3]), None);
        let rod: Vec<[f32; 3]> =
            (0..8_u8).map(|n| [f32::from(n & 1), f32::from(n >> 1 & 1), 900.0 * f32::from(n >> 2)]).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        let rod = Outline::of_mesh(&rod, &quads.into_iter().flat_map(halves).collect::<Vec<_>>());
        assert_eq!(scale(&rod, [0.0; 3]), None);
        assert_eq!(scale(&Outline::default(), [0.0; 3]), None);
    }
}
