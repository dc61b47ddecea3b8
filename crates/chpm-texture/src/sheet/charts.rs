//! Charts on their planes: turned so that they take little room, and split where one would lie over itself.

use super::directions::{Faces, Facing};
use super::plan::{GUTTER, Surface};
use super::raster::spans;
use super::vector::{Vector, add, beside, dot, scale, sub};
use chpm_mesh::Chart;

/// Cosines and sines of the turns that are tried: each a sixteenth of a right angle more.
const TURNS: [[f64; 2]; 8] = [
    [1.0, 0.0],
    [0.9807852804032304, 0.19509032201612825],
    [0.9238795325112867, 0.3826834323650898],
    [0.8314696123025452, 0.5555702330196022],
    [std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2],
    [0.5555702330196022, 0.8314696123025452],
    [0.3826834323650898, 0.9238795325112867],
    [0.19509032201612825, 0.9807852804032304],
];
/// Longest side of a chart, and most texels.
const LONGEST: f64 = 8000.0;
const MOST: f64 = (1u32 << 24) as f64;
/// How much smaller texels get for triangles that are turned away, at most.
const MOST_TURNED: f64 = 0.7;
/// Texels across a chart that shows nothing to go by.
const PLAIN: f64 = 8.0;
/// Texels that a triangle is high, at least, for its wish to count: a needle's would be for texels far smaller than what is beside it.
const THIN: f64 = 0.125;

/// A chart on its plane.
#[derive(Clone, Debug)]
pub(super) struct Flat {
    pub(super) triangles: Vec<u32>,
    pub(super) direction: Vector,
    pub(super) axes: [[f32; 3]; 2],
    /// Where the origin is, when the chart's rectangle begins at zero.
    pub(super) offset: [f64; 2],
    /// Width and height of the rectangle.
    pub(super) size: [u32; 2],
    /// Side of a texel.
    pub(super) texel: f64,
}

/// Lays charts out.
pub(super) fn flatten(
    surface: &Surface<'_>,
    faces: &Faces<'_>,
    facings: &[Facing],
    origin: [f32; 3],
    coarser: f64,
) -> Vec<Flat> {
    let (mut flats, mut covered, mut scratch) = (Vec::new(), Vec::new(), Vec::new());
    for Facing { direction, triangles } in facings {
        let texel = texel(surface, faces, triangles, *direction) * coarser;
        let mut left = vec![triangles.clone()];
        while let Some(triangles) = left.pop() {
            let flat = lay(surface, triangles, *direction, texel, origin);
            let (flat, rest) = split(surface, faces, flat, origin, &mut covered);
            flats.push(flat);
            left.extend(faces.parts(&rest, &mut scratch));
        }
    }
    flats
}

/// The median of what triangles ask for, by area. As the chart is seen, they are smaller, and so are its texels: it has as many as they asked for.
fn texel(surface: &Surface<'_>, faces: &Faces<'_>, triangles: &[u32], direction: Vector) -> f64 {
    let asked = |triangle: &u32| {
        let (texel, area) = (surface.texels[*triangle as usize], faces.area(*triangle));
        let height = 2.0 * area / longest(surface.corners(surface.triangles[*triangle as usize]));
        let is_asked = texel.is_finite() && texel > 0.0 && height > THIN * texel;
        is_asked.then_some((texel, area))
    };
    let mut asked: Vec<(f64, f64)> = triangles.iter().filter_map(asked).collect();
    asked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let half = asked.iter().map(|(_, area)| area).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    let median = asked.iter().find(|(_, area)| {
        sum += area;
        sum >= half
    });
    let extent = extent(surface, triangles, direction);
    // A chart has one texel at least.
    let seen = |triangle: &u32| faces.area(*triangle) * dot(faces.normal(*triangle), direction).max(0.0);
    let [area, seen]: [f64; 2] =
        [triangles.iter().map(|triangle| faces.area(*triangle)).sum(), triangles.iter().map(seen).sum()];
    let smaller = (seen / area).sqrt().clamp(MOST_TURNED, 1.0);
    let found =
        median.map_or(extent / PLAIN, |(texel, _)| (texel * smaller).max(surface.least_texel).min(extent));
    // Of no extent at all: any will do, which a single can hold.
    if found > f64::from(f32::MIN_POSITIVE) * 1e6 { found } else { 1.0 }
}

/// The longest edge.
fn longest([a, b, c]: [Vector; 3]) -> f64 {
    let edges = [sub(b, a), sub(c, b), sub(a, c)];
    edges.map(|edge| dot(edge, edge)).into_iter().fold(0.0, f64::max).sqrt()
}

/// How long a chart is, along the longer of two axes.
fn extent(surface: &Surface<'_>, triangles: &[u32], direction: Vector) -> f64 {
    let axes = beside(direction);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for triangle in triangles {
        for corner in surface.corners(surface.triangles[*triangle as usize]) {
            for axis in 0..2 {
                let at = dot(corner, axes[axis]);
                (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
            }
        }
    }
    (high[0] - low[0]).max(high[1] - low[1])
}

/// Projects triangles, turned so that their box is small. A chart that is too large is coarser by itself, not all of the sheet with it.
fn lay(
    surface: &Surface<'_>,
    triangles: Vec<u32>,
    direction: Vector,
    mut texel: f64,
    origin: [f32; 3],
) -> Flat {
    let mesh = surface.mesh();
    let mut corners: Vec<u16> = triangles
        .iter()
        .flat_map(|triangle| mesh.states(surface.triangles[*triangle as usize]).flatten())
        .collect();
    corners.sort_unstable();
    corners.dedup();
    let [right, down] = beside(direction);
    let from = origin.map(f64::from);
    let places: Vec<[f64; 2]> = (corners.iter())
        .map(|corner| sub(surface.positions[usize::from(*corner)].map(f64::from), from))
        .map(|place| [dot(place, right), dot(place, down)])
        .collect();
    let extent = |[cos, sin]: [f64; 2]| {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for [x, y] in &places {
            for (axis, at) in [cos * x + sin * y, cos * y - sin * x].into_iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
            }
        }
        (low, [high[0] - low[0], high[1] - low[1]])
    };
    let room = |turn: [f64; 2]| {
        let (_, [width, height]) = extent(turn);
        let gutters = 2.0 * f64::from(GUTTER) * texel;
        (width + gutters) * (height + gutters)
    };
    let turn =
        TURNS.into_iter().fold(TURNS[0], |best, turn| if room(turn) < room(best) { turn } else { best });
    let (low, sides) = extent(turn);
    let size = |texel: f64| sides.map(|side| (side / texel).ceil() + 1.0 + 2.0 * f64::from(GUTTER));
    let [mut width, mut height] = size(texel);
    while width.max(height) > LONGEST || width * height > MOST {
        texel *= 1.1 * (width.max(height) / LONGEST).max((width * height / MOST).sqrt()).max(1.0);
        [width, height] = size(texel);
    }

    let [cos, sin] = turn;
    let axes = [add(scale(right, cos), scale(down, sin)), sub(scale(down, cos), scale(right, sin))];
    let axes = axes.map(|axis| axis.map(|part| (part / texel) as f32));
    let offset = low.map(|low| f64::from(GUTTER) + 0.5 - low / texel);
    Flat { triangles, direction, axes, offset, size: [width as u32, height as u32], texel }
}

impl Flat {
    /// The chart, its rectangle at zero.
    fn chart(&self) -> Chart {
        let rect = [0, 0, self.size[0] as u16, self.size[1] as u16];
        Chart { axes: self.axes, offset: self.offset.map(|x| x as f32), rect }
    }
}

/// Keeps what covers no texel twice, in the order in which triangles are met from the largest on, and answers with the rest.
fn split(
    surface: &Surface<'_>,
    faces: &Faces<'_>,
    mut flat: Flat,
    origin: [f32; 3],
    covered: &mut Vec<u64>,
) -> (Flat, Vec<u32>) {
    let chart = flat.chart();
    let [width, height] = flat.size.map(|side| side as usize);
    let texels = |triangle: u32, visit: &mut dyn FnMut(usize)| {
        let corners = surface.triangles[triangle as usize];
        let places = corners.map(|corner| chart.place(origin, surface.positions[usize::from(corner)]));
        spans(places, |row, begin, end| {
            (begin..end).for_each(|column| visit(row as usize * width + column as usize))
        });
    };
    covered.clear();
    covered.resize((width * height).div_ceil(64), 0);
    let mut is_twice = false;
    for triangle in &flat.triangles {
        texels(*triangle, &mut |at| {
            is_twice |= covered[at / 64] >> (at % 64) & 1 == 1;
            covered[at / 64] |= 1 << (at % 64);
        });
    }
    if !is_twice {
        return (flat, Vec::new());
    }

    covered.fill(0);
    let largest = flat.triangles.iter().copied().fold(flat.triangles[0], |best, triangle| {
        if faces.area(triangle) > faces.area(best) { triangle } else { best }
    });
    // Triangles of the chart that were not met yet, by number.
    let mut open = flat.triangles.clone();
    let take =
        |open: &mut Vec<u32>, triangle: u32| open.binary_search(&triangle).map(|at| open.remove(at)).is_ok();
    take(&mut open, largest);
    let (mut queue, mut kept, mut refused, mut at) = (vec![largest], Vec::new(), Vec::new(), 0);
    while let Some(triangle) = queue.get(at).copied() {
        at += 1;
        let mut is_free = true;
        texels(triangle, &mut |at| is_free &= covered[at / 64] >> (at % 64) & 1 == 0);
        if !is_free {
            refused.push(triangle);
            continue;
        }
        texels(triangle, &mut |at| covered[at / 64] |= 1 << (at % 64));
        kept.push(triangle);
        for other in faces.beside(triangle) {
            if take(&mut open, other) {
                queue.push(other);
            }
        }
    }
    refused.extend(open);
    refused.sort_unstable();
    kept.sort_unstable();
    let texel = flat.texel;
    flat = lay(surface, kept, flat.direction, texel, origin);
    (flat, refused)
}
