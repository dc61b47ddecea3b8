//! A triangle on the grid of an image's texels: which texels it covers, and how much of each is a corner's.

use crate::images::Strips;
use crate::texels::{Sums, Texels, WEIGHT};
use crate::{Material, Wrap};
use bytemuck::{Pod, Zeroable};

/// Parts of a texel that corners are rounded to.
pub(crate) const PARTS: i64 = 256;
/// Repeats of an image that a triangle covers at most in either direction: of one that covers more, a part stands for all.
const REPEATS: f64 = 8.0;
/// Parts of one in [`Share`].
const FINE: f64 = 16_384.0;
/// Part of its weight that a triangle's middle has where texels are counted: a corner far from every texel gets that much.
const LITTLE: f64 = 1.0 / 1024.0;

/// Sums over texels: red, green and blue times their weight, that weight, and the weight without alpha.
pub(crate) type Parts = [i64; 5];

/// Sums that a corner gets of its triangles.
#[derive(Clone, Copy, Default, Debug, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Share {
    /// Texels times how near to the corner they are.
    pub(crate) near: Parts,
    /// Texels times a third.
    pub(crate) third: Parts,
}

/// Corners of a triangle on the grid, in [`PARTS`] of a texel, columns and rows. The grid goes on beyond the image as the material wraps it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Footprint {
    pub(crate) corners: [[i32; 2]; 3],
}

impl Footprint {
    /// The footprint on an image of a size, beginning in it; none if a coordinate is no number.
    pub(crate) fn new(uv: [[f32; 2]; 3], size: [u32; 2], wrap: [Wrap; 2]) -> Option<Self> {
        if uv.as_flattened().iter().any(|value| !value.is_finite()) {
            return None;
        }
        let u = wrapped(uv.map(|[u, _]| f64::from(u)), wrap[0]);
        let v = wrapped(uv.map(|[_, v]| 1.0 - f64::from(v)), wrap[1]);
        // None is below zero.
        let place = |value: f64, side: u32| (value * f64::from(side) * PARTS as f64 + 0.5) as i32;
        Some(Footprint { corners: std::array::from_fn(|i| [place(u[i], size[0]), place(v[i], size[1])]) })
    }

    /// Rows that it covers middles of texels in, or its own middle: from the first to one behind the last.
    pub(crate) fn rows(&self) -> [i32; 2] {
        let rows = self.corners.map(|corner| i64::from(corner[1]) - PARTS / 2);
        let low = rows.into_iter().min().map_or(0, |y| y + PARTS - 1).div_euclid(PARTS);
        let high = rows.into_iter().max().map_or(0, |y| y.div_euclid(PARTS));
        let middle = self.middle()[1];
        [low.min(middle) as i32, high.max(middle) as i32 + 1]
    }

    /// Texel of the middle.
    fn middle(&self) -> [i64; 2] {
        [0, 1].map(|axis| {
            let sum: i64 = self.corners.iter().map(|corner| i64::from(corner[axis])).sum();
            sum.div_euclid(3 * PARTS)
        })
    }

    /// Twice the area, in squares of parts; negative if it is mirrored.
    fn doubled_area(&self) -> i64 {
        let [a, b, c] = self.corners.map(|corner| corner.map(i64::from));
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }

    /// Shares of the corners in texels of the given rows, which are all in the strip at hand.
    pub(crate) fn shares(&self, rows: [i32; 2], strips: &Strips, material: &Material) -> [Share; 3] {
        let area = self.doubled_area();
        let size = strips.size().map(i64::from);
        let (texels, first) = strips.texels();
        let line = |row: i64| (inside(row, size[1], material.wrap[1]) - first) as usize;

        let mut gathered = Gathered::default();
        let is_small = area.abs() < 2 * PARTS * PARTS;
        if !is_small {
            let edges = Edges::new(self, area);
            for row in i64::from(rows[0])..i64::from(rows[1]) {
                let Some([begin, end]) = edges.span(row) else { continue };
                let sums = wrapped_sums(texels, line(row), [begin, end], size[0], material.wrap[0]);
                gathered.add(&edges.at(begin, row), &edges.steps, &sums, end - begin);
            }
            gathered.scale(area.unsigned_abs() as f64);
        }
        let [column, row] = self.middle();
        if (i64::from(rows[0])..i64::from(rows[1])).contains(&row) {
            let texel = texels.at(line(row), inside(column, size[0], material.wrap[0]) as usize);
            let covered = area.unsigned_abs() as f64 / (2 * PARTS * PARTS) as f64;
            gathered.add_middle(&texel, if is_small { covered.max(LITTLE) } else { LITTLE });
        }
        gathered.shares(material)
    }
}

/// Coordinates that begin between 0 and 1, or are clamped to that; few repeats.
fn wrapped(values: [f64; 3], wrap: Wrap) -> [f64; 3] {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if low >= 0.0 && high <= 1.0 {
        return values;
    }
    let start = match wrap {
        Wrap::Clamp => return values.map(|value| value.clamp(0.0, 1.0)),
        Wrap::Repeat => low.floor(),
        Wrap::Mirror => (low / 2.0).floor() * 2.0,
    };
    let scale = if high - low > REPEATS { REPEATS / (high - low) } else { 1.0 };
    values.map(|value| (low - start) + (value - low) * scale)
}

/// The column or row of the image that one of the grid shows.
pub(crate) fn inside(place: i64, side: i64, wrap: Wrap) -> i64 {
    match wrap {
        _ if (0..side).contains(&place) => place,
        Wrap::Clamp => place.clamp(0, side - 1),
        Wrap::Repeat => place.rem_euclid(side),
        Wrap::Mirror => {
            let place = place.rem_euclid(2 * side);
            place.min(2 * side - 1 - place)
        }
    }
}

/// Sums over columns of the grid.
fn wrapped_sums(texels: &Texels, row: usize, span: [i64; 2], width: i64, wrap: Wrap) -> Sums {
    let [begin, end] = span;
    if begin >= 0 && end <= width {
        return texels.sums(row, begin as usize, end as usize);
    }
    let (mut sums, mut at) = (Sums::default(), begin);
    while at < end {
        let turn = at.div_euclid(width);
        let stop = end.min((turn + 1) * width);
        let (from, to) = ((at - turn * width) as usize, (stop - turn * width) as usize);
        let part = if wrap == Wrap::Mirror && turn % 2 != 0 {
            texels.sums(row, width as usize - to, width as usize - from).reversed(to - from)
        } else {
            texels.sums(row, from, to)
        };
        sums.append(&part, (at - begin) as usize);
        at = stop;
    }
    sums
}

/// Three functions that are zero on an edge and the doubled area at the corner across.
struct Edges {
    /// Values at the middle of texel (0, 0).
    start: [i64; 3],
    /// Differences from a column, and from a row, to the next.
    steps: [i64; 3],
    down: [i64; 3],
    /// One by the steps of columns.
    scales: [f64; 3],
}

impl Edges {
    fn new(footprint: &Footprint, area: i64) -> Self {
        let corners = footprint.corners.map(|corner| corner.map(i64::from));
        let mut edges = Edges { start: [0; 3], steps: [0; 3], down: [0; 3], scales: [0.0; 3] };
        for i in 0..3 {
            let (from, to) = (corners[(i + 1) % 3], corners[(i + 2) % 3]);
            let along = [0, 1].map(|axis| (to[axis] - from[axis]) * area.signum());
            edges.steps[i] = -along[1] * PARTS;
            edges.scales[i] = 1.0 / edges.steps[i] as f64;
            edges.down[i] = along[0] * PARTS;
            edges.start[i] = along[0] * (PARTS / 2 - from[1]) - along[1] * (PARTS / 2 - from[0]);
        }
        edges
    }

    fn at(&self, column: i64, row: i64) -> [i64; 3] {
        std::array::from_fn(|i| self.start[i] + self.steps[i] * column + self.down[i] * row)
    }

    /// Columns whose middles are inside.
    fn span(&self, row: i64) -> Option<[i64; 2]> {
        let (mut begin, mut end) = (i64::MIN, i64::MAX);
        for ((value, step), scale) in self.at(0, row).into_iter().zip(self.steps).zip(self.scales) {
            let is_inside = |column: i64| value + step * column >= 0;
            // A division by whole numbers takes longer than an estimate that is put right.
            let mut zero = (-(value as f64) * scale) as i64;
            match step {
                0 if value < 0 => return None,
                0 => {}
                1.. => {
                    zero += i64::from(!is_inside(zero));
                    zero -= i64::from(is_inside(zero - 1));
                    begin = begin.max(zero);
                }
                _ => {
                    zero -= i64::from(!is_inside(zero));
                    zero += i64::from(is_inside(zero + 1));
                    end = end.min(zero + 1);
                }
            }
        }
        (begin < end).then_some([begin, end])
    }
}

/// Sums over rows, for two corners and for all three together.
#[derive(Default)]
struct Gathered {
    corners: [[f64; 5]; 2],
    all: [f64; 5],
}

impl Gathered {
    /// Adds a part of a row, with the values of the edges where it begins and what a column adds.
    fn add(&mut self, values: &[i64; 3], steps: &[i64; 3], sums: &Sums, len: i64) {
        let plain = with_weight(sums.plain, len as u64);
        let moment = with_weight(sums.moment, (len * (len - 1) / 2) as u64);
        for (corner, (value, step)) in self.corners.iter_mut().zip(values.iter().zip(steps)) {
            for (sum, (plain, moment)) in corner.iter_mut().zip(plain.iter().zip(&moment)) {
                *sum += *value as f64 * plain + *step as f64 * moment;
            }
        }
        for (sum, plain) in self.all.iter_mut().zip(plain) {
            *sum += plain;
        }
    }

    /// Makes values of edges parts of one.
    fn scale(&mut self, area: f64) {
        for sum in self.corners.as_flattened_mut() {
            *sum /= area;
        }
    }

    /// Adds a texel with a weight that all corners have a third of.
    fn add_middle(&mut self, texel: &Sums, weight: f64) {
        for (i, part) in with_weight(texel.plain, 1).into_iter().enumerate() {
            self.corners[0][i] += part * weight / 3.0;
            self.corners[1][i] += part * weight / 3.0;
            self.all[i] += part * weight;
        }
    }

    fn shares(&self, material: &Material) -> [Share; 3] {
        let [first, second] = self.corners;
        let third = std::array::from_fn(|i| (self.all[i] - first[i] - second[i]).max(0.0));
        let mean = material.parts(self.all.map(|sum| sum / 3.0));
        [first, second, third].map(|near| Share { near: material.parts(near), third: mean })
    }
}

fn with_weight(parts: [u64; 4], weight: u64) -> [f64; 5] {
    let [r, g, b, shown] = parts.map(|part| part as f64);
    [r, g, b, shown, (weight * WEIGHT) as f64]
}

impl Material {
    /// The share of all corners of a triangle without texels.
    pub(crate) fn plain_share(&self, weight: f64) -> Share {
        let shown = 256.0;
        let full = [65_535.0, 65_535.0, 65_535.0, shown * 255.0, 255.0].map(|part| part * weight);
        let parts = self.parts(full);
        Share { near: parts, third: parts }
    }

    fn parts(&self, sums: [f64; 5]) -> Parts {
        self.tint(sums).map(|sum| (sum * FINE + 0.5) as i64)
    }

    /// Multiplies by the factor.
    fn tint(&self, [r, g, b, shown, weight]: [f64; 5]) -> [f64; 5] {
        let [red, green, blue, alpha] = self.factor.map(|part| f64::from(part).clamp(0.0, 1.0));
        if [red, green, blue, alpha] == [1.0; 4] || shown == 0.0 {
            return [r, g, b, shown, weight];
        }
        let left = (alpha * (shown - weight) + weight) / shown;
        let [red, green, blue] = [red, green, blue].map(|part| crate::srgb::light(part) * left);
        [r * red, g * green, b * blue, shown * left, weight]
    }
}
