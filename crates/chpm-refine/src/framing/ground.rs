//! How a model stands with one of its directions up: what it rests on.

use super::direction::Up;
use super::outline::Outline;
use super::sight::look;
use nalgebra::{Point3, Vector3};

/// Footprint of a model. Areas are shares of its silhouette from above.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub(super) struct Ground {
    /// Area that its lowest points span, where its centre of mass is above that; else zero.
    pub(super) support: f64,
    /// Flat surface at the bottom that faces down.
    pub(super) base: f64,
    /// By how much more surface faces up than down: 1 for a landscape, 0 for what is closed.
    pub(super) open: f64,
    /// Height by the longest side of the box.
    pub(super) height: f64,
    /// How far it has to be tilted before it falls: the way of its centre of mass to the border of what it stands on, by the height of that centre.
    pub(super) steady: f64,
    /// The part of the surface that the mirror image of top and bottom has not: few things look the same upside down, most do in a mirror.
    pub(super) lopsided: f64,
}

/// A part of the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    at: Point3<f64>,
    /// Of the length of its area.
    normal: Vector3<f64>,
}

/// Patches of a surface, about.
const PATCHES: f64 = 20_000.0;
/// Of the height, from the lowest point on: what touches the ground.
const TOUCHES: f64 = 0.03;
/// Cells of the longest side in which a surface and its mirror image are compared.
const CELLS: f64 = 32.0;
/// How far, relative to the size of the silhouette, a centre of mass may be outside of what it is supported by: outlines are coarse.
const TOLERANCE: f64 = 0.02;

/// Even patches of all triangles, those of large ones many.
pub(super) fn patches(outline: &Outline) -> Vec<Patch> {
    fn normal(corners: &[Point3<f64>; 3]) -> Vector3<f64> {
        0.5 * (corners[1] - corners[0]).cross(&(corners[2] - corners[0]))
    }
    let total: f64 = outline.triangles().map(|corners| normal(&corners).norm()).sum();
    let mut patches = Vec::new();
    for corners in outline.triangles() {
        let whole = normal(&corners);
        let share = whole.norm() / total;
        if !(share > 0.0 && share.is_finite()) {
            continue;
        }
        // A grid over the parallelogram of twice the triangle, its far half turned onto the near one.
        let count = (share * PATCHES).sqrt().ceil().max(1.0) as u32;
        fn along(n: u32, count: u32) -> f64 {
            (f64::from(n) + 0.5) / f64::from(count)
        }
        for (u, v) in (0..count).flat_map(|i| (0..count).map(move |j| (i, j))) {
            let (u, v) = (along(u, count), along(v, count));
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let at = corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v;
            patches.push(Patch { at, normal: whole / f64::from(count * count) });
        }
    }
    patches
}

impl Ground {
    /// With `up` upward.
    pub(super) fn of(outline: &Outline, patches: &[Patch], up: Up) -> Self {
        let vector = up.vector();
        let height = |patch: &Patch| patch.at.coords.dot(&vector);
        let low = patches.iter().map(height).fold(f64::INFINITY, f64::min);
        let tall = patches.iter().map(height).fold(f64::NEG_INFINITY, f64::max) - low;
        let silhouette = look(outline, -vector).silhouette;
        if !(silhouette > 0.0 && tall.is_finite()) {
            return Ground::default();
        }

        // On the ground: the two other axes, so that areas are positive counterclockwise.
        let axes = [(up.axis() + 1) % 3, (up.axis() + 2) % 3];
        fn below(point: &Point3<f64>, axes: &[usize; 2]) -> [f64; 2] {
            axes.map(|axis| point[axis])
        }
        let touching: Vec<&Patch> =
            patches.iter().filter(|patch| height(patch) <= low + TOUCHES * tall).collect();
        let (area, moment, rise) = patches.iter().fold((0.0, [0.0; 2], 0.0), |(area, [x, y], z), patch| {
            let (share, at) = (patch.normal.norm(), below(&patch.at, &axes));
            (area + share, [x + share * at[0], y + share * at[1]], z + share * (height(patch) - low))
        });
        let points = touching.iter().map(|patch| below(&patch.at, &axes)).collect();
        let (spanned, inside) = span(points, moment.map(|x| x / area));
        let stands = inside > -TOLERANCE * silhouette.sqrt();

        let facing_down =
            touching.iter().filter(|patch| patch.normal.dot(&vector) < -0.9 * patch.normal.norm());
        let base = facing_down.fold(0.0, |sum, patch| sum + patch.normal.norm());
        let open: f64 = patches.iter().map(|patch| patch.normal.dot(&vector)).sum();
        let longest = outline.bounds().1.max();
        Ground {
            support: if stands { (spanned / silhouette).min(1.0) } else { 0.0 },
            base: (base / silhouette).clamp(0.0, 1.0),
            open: (open / silhouette).clamp(-1.0, 1.0),
            height: tall / longest,
            steady: if stands && rise > 0.0 { (inside * area / rise).max(0.0) } else { 0.0 },
            // Of what is open above or below, that is no news.
            lopsided: (1.0 - open.abs() / silhouette).max(0.0)
                * lopsided(patches, up.axis(), outline.bounds().0, tall, longest / CELLS),
        }
    }
}

/// The share of a surface that is not where its mirror image is, to a cell. It begins at `low` and is `tall` along the axis.
fn lopsided(patches: &[Patch], axis: usize, low: Point3<f64>, tall: f64, cell: f64) -> f64 {
    // A cell more at every side, for the neighbours.
    const SIDE: usize = CELLS as usize + 3;
    fn place(at: &Point3<f64>, low: &Point3<f64>, cell: f64) -> usize {
        let [x, y, z] = [0, 1, 2].map(|axis| ((at[axis] - low[axis]) / cell).clamp(0.0, CELLS) as usize + 1);
        (z * SIDE + y) * SIDE + x
    }
    let mut near = vec![false; SIDE * SIDE * SIDE];
    for patch in patches {
        let center = place(&patch.at, &low, cell);
        for neighbour in 0..27 {
            let [x, y, z] = [neighbour % 3, neighbour / 3 % 3, neighbour / 9];
            // One back along every axis, and then from none to two on.
            near[center + (z * SIDE + y) * SIDE + x - (SIDE + 1) * SIDE - 1] = true;
        }
    }
    let (mut all, mut missed) = (0.0, 0.0);
    for patch in patches {
        let mut mirrored = patch.at;
        mirrored[axis] = low[axis] + (tall - (patch.at[axis] - low[axis]));
        let area = patch.normal.norm();
        all += area;
        missed += if near[place(&mirrored, &low, cell)] { 0.0 } else { area };
    }
    missed / all
}

/// The area of the convex hull of points, and how far another point is inside (negative: outside).
fn span(mut points: Vec<[f64; 2]>, center: [f64; 2]) -> (f64, f64) {
    fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));

    // The lower chain, and then the upper one.
    let mut hull: Vec<[f64; 2]> = Vec::new();
    for chain in 0..2 {
        let first = hull.len();
        for place in 0..points.len() {
            let point = points[if chain == 0 { place } else { points.len() - 1 - place }];
            while hull.len() > first + 1 && turn(hull[hull.len() - 2], hull[hull.len() - 1], point) <= 0.0 {
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
    }
    if hull.len() < 3 {
        return (0.0, f64::NEG_INFINITY);
    }
    let sides = (0..hull.len()).map(|n| (hull[n], hull[(n + 1) % hull.len()]));
    let area = 0.5 * sides.clone().map(|(a, b)| turn(hull[0], a, b)).sum::<f64>();
    let inside = sides.map(|(a, b)| turn(a, b, center) / (b[0] - a[0]).hypot(b[1] - a[1]));
    (area, inside.fold(f64::INFINITY, f64::min))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_span_their_hull() {
        let square = vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
        assert_eq!(span(square.clone(), [0.5, 1.0]), (4.0, 0.5));
        assert_eq!(span(square, [3.0, 1.0]), (4.0, -1.0));
        for few in [vec![], vec![[1.0, 1.0]], vec![[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]] {
            assert_eq!(span(few, [0.0, 0.0]).0, 0.0);
        }
    }
}
