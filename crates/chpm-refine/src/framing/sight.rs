//! Silhouette of an outline from afar, along one direction: a small picture of depths.

use super::outline::Outline;
use nalgebra::{Point3, Vector3};

/// Areas of a silhouette.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub(super) struct Seen {
    /// Area of the silhouette.
    pub(super) silhouette: f64,
    /// Area of the surface that shows: folds and details count by what there is of them.
    pub(super) surface: f64,
    /// Area that shows its outer side.
    pub(super) outside: f64,
}

/// Pixels of the longer side.
const PIXELS: f64 = 160.0;
/// Pixels that all triangles together may take, with what is in their boxes: a soup of large ones is seen with fewer.
const MOST: f64 = (1 << 22) as f64;
/// How much surface lies behind one unit of the picture, at most: what is seen edge-on is not seen.
const STEEPEST: f64 = 4.0;

/// Looks along a direction, in whatever turn about it.
pub(super) fn look(outline: &Outline, sight: Vector3<f64>) -> Seen {
    let aside = sight.cross(&Vector3::ith(sight.iamin(), 1.0)).normalize();
    let axes = [aside, aside.cross(&sight)];
    fn flat(p: &Point3<f64>, axes: &[Vector3<f64>; 2]) -> [f64; 2] {
        axes.map(|axis| p.coords.dot(&axis))
    }

    // The rectangle that it takes.
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for at in outline.corners().map(|point| flat(&point, &axes)) {
        low = [low[0].min(at[0]), low[1].min(at[1])];
        high = [high[0].max(at[0]), high[1].max(at[1])];
    }
    let size = [high[0] - low[0], high[1] - low[1]];
    let pixel = size[0].max(size[1]) / PIXELS;
    if !(pixel > 0.0 && pixel.is_finite()) {
        return Seen::default();
    }
    let boxes = outline.triangles().map(|corners| {
        let at = corners.map(|corner| flat(&corner, &axes));
        let sides = [0, 1].map(|axis| {
            let [a, b, c] = at.map(|p| p[axis]);
            a.max(b).max(c) - a.min(b).min(c)
        });
        sides[0] * sides[1]
    });
    let taken = boxes.sum::<f64>() / (pixel * pixel);
    let pixel = pixel * (taken / MOST).max(1.0).sqrt();
    let [width, height] = size.map(|side| (side / pixel).ceil().max(1.0) as usize);

    // For each pixel the nearest depth, and the surface behind a unit of it.
    let mut nearest = vec![(f64::INFINITY, 0.0, false); width * height];
    for corners in outline.triangles() {
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let facing = -normal.dot(&sight);
        if facing == 0.0 {
            continue;
        }
        let steep = (normal.norm() / facing.abs()).min(STEEPEST);
        let at = corners.map(|corner| {
            let [x, y] = flat(&corner, &axes);
            [(x - low[0]) / pixel, (y - low[1]) / pixel, corner.coords.dot(&sight)]
        });
        cover(at, [width, height], |place, depth| {
            if depth < nearest[place].0 {
                nearest[place] = (depth, steep, facing > 0.0);
            }
        });
    }
    let mut seen = Seen::default();
    for (_, steep, is_outer) in nearest.into_iter().filter(|(depth, ..)| depth.is_finite()) {
        seen.silhouette += pixel * pixel;
        seen.surface += steep * pixel * pixel;
        seen.outside += if is_outer { steep * pixel * pixel } else { 0.0 };
    }
    seen
}

/// Tells the places of pixels whose middle a triangle covers, and its depth there.
fn cover(at: [[f64; 3]; 3], [width, height]: [usize; 2], mut tell: impl FnMut(usize, f64)) {
    fn edge(a: [f64; 3], b: [f64; 3], x: f64, y: f64) -> f64 {
        (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
    }
    let area = edge(at[0], at[1], at[2][0], at[2][1]);

    if area == 0.0 {
        return;
    }

    for row in range(1, height, &at) {
        for column in range(0, width, &at) {
            let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
            let shares = [edge(at[1], at[2], x, y), edge(at[2], at[0], x, y), edge(at[0], at[1], x, y)];
            let shares = shares.map(|share| share / area);
            if shares.iter().all(|share| *share >= 0.0) {
                let depth = (0..3).map(|corner| shares[corner] * at[corner][2]).sum();
                tell(row * width + column, depth);
            }
        }
    }
}

fn range(axis: usize, count: usize, at: &[[f64; 3]; 3]) -> std::ops::Range<usize> {
    let low = at.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
    let high = at.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
    (low - 0.5).ceil().max(0.0) as usize..((high - 0.5).floor() + 1.0).clamp(0.0, count as f64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_seen_of_a_box() {
        // 1 by 2 by 3.
        let corner = |n: u8| [f32::from(n & 1), 2.0 * f32::from(n >> 1 & 1), 3.0 * f32::from(n >> 2)];
        let points: Vec<[f32; 3]> = (0..8).map(corner).collect();
        let quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        let outline = Outline::of_mesh(&points, &triangles);
        for (sight, area) in [(Vector3::x(), 6.0), (Vector3::y(), 3.0), (-Vector3::z(), 2.0)] {
            let seen = look(&outline, sight);
            assert!((seen.silhouette - area).abs() < 0.1 && (seen.surface - area).abs() < 0.1, "{seen:?}");
        }
        // From a corner all three sides show, each at its own angle.
        let seen = look(&outline, Vector3::from([1.0, 1.0, 1.0]).normalize());
        assert!(
            (seen.silhouette - 11.0 / 3.0_f64.sqrt()).abs() < 0.2 && (seen.surface - 11.0).abs() < 0.4,
            "{seen:?}"
        );
        assert_eq!(look(&Outline::default(), Vector3::x()), Seen::default());
    }

    #[test]
    fn a_soup_of_large_triangles_is_seen_with_fewer_pixels() {
        // Each over half of a square, one behind the other.
        let points: Vec<[f32; 3]> = (0..6000_u16)
            .flat_map(|n| [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| [x, y, f32::from(n)]))
            .collect();
        let triangles: Vec<[u32; 3]> = (0..6000).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
        let seen = look(&Outline::of_mesh(&points, &triangles), Vector3::z());
        assert!((seen.silhouette - 0.5).abs() < 0.05, "{seen:?}");
    }
}
