//! Baking: texels get the colours of the surface that they are of.

use super::directions::Faces;
use super::fill::Patch;
use super::plan::{Paint, Plan, Surface};
use super::raster::spans;
use super::sample::{Pixels, Samples};
use super::vector::dot;
use crate::TextureError;
use crate::srgb::light;
use chpm_mesh::Chart;

/// Texels of an image that a sample stands for along an axis, about, and most samples along one.
const SAMPLED: f64 = 1.25;
const MOST_SAMPLES: f64 = 4.0;
/// Cosine with a chart's direction from which on the triangles of others may stand for what is not in the chart.
const SEEN: f64 = 0.1;
/// Texels of the rows of a chart that are looked at together.
const BAND: u32 = 1 << 17;
/// Texels of an image that are near each other.
const NEAR: f64 = 64.0;
/// Parts that each edge of a triangle without a texel of its own is cut into, for samples.
const CUTS: u32 = 4;
/// Where nothing is needed.
const NONE: u32 = u32::MAX;

/// A function of a place in a sheet: a constant and the differences a column and a row on.
#[derive(Clone, Copy)]
struct Slope {
    at_zero: f64,
    right: f64,
    down: f64,
}

impl Slope {
    /// The function with these values at the corners of a triangle; none if it has no area.
    fn of(places: [[f64; 2]; 3], values: [f64; 3]) -> Option<Slope> {
        let [a, b, c] = places;
        let [[bx, by], [cx, cy]] = [b, c].map(|[x, y]| [x - a[0], y - a[1]]);
        let area = bx * cy - by * cx;
        let [v, w] = [values[1] - values[0], values[2] - values[0]];
        let (right, down) = ((v * cy - w * by) / area, (w * bx - v * cx) / area);
        let at_zero = values[0] - right * a[0] - down * a[1];
        (right.is_finite() && down.is_finite() && at_zero.is_finite()).then_some(Slope {
            at_zero,
            right,
            down,
        })
    }

    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.at_zero + self.right * x + self.down * y
    }
}

/// A triangle's paint as a function of a place in a sheet.
enum Brush {
    /// An image, where the first samples of texels are in it, and how many there are and how far apart, along a texel's width and height.
    Image {
        image: u32,
        place: [Slope; 2],
        counts: [u32; 2],
        steps: [[f64; 2]; 2],
        factor: [f32; 4],
    },
    Colors([Slope; 4]),
}

impl Brush {
    fn of(paint: &Paint, places: [[f64; 2]; 3]) -> Option<Brush> {
        Some(match paint {
            Paint::Image { image, corners, factor } => {
                let [x, y] = [0, 1].map(|axis| Slope::of(places, corners.map(|corner| corner[axis])));
                let (factor, x, y) = (tint(*factor), x?, y?);
                let sides = [[x.right, y.right], [x.down, y.down]];
                let counts = sides.map(|[dx, dy]| {
                    ((dx * dx + dy * dy).sqrt() / SAMPLED).ceil().clamp(1.0, MOST_SAMPLES) as u32
                });
                let steps = [0, 1].map(|way| sides[way].map(|side| side / f64::from(counts[way])));
                let first = |slope: Slope, axis: usize| Slope {
                    at_zero: slope.at_zero + (steps[0][axis] + steps[1][axis]) / 2.0,
                    ..slope
                };
                Brush::Image { image: *image, place: [first(x, 0), first(y, 1)], counts, steps, factor }
            }
            Paint::Colors(colors) => {
                let [r, g, b, a] =
                    [0, 1, 2, 3].map(|part| Slope::of(places, colors.map(|color| f64::from(color[part]))));
                Brush::Colors([r?, g?, b?, a?])
            }
        })
    }

    /// The colour of a texel.
    fn color<P: Pixels + ?Sized>(
        &self,
        column: f64,
        row: f64,
        pixels: &mut P,
    ) -> Result<[u8; 4], TextureError> {
        match self {
            Brush::Image { image, place, counts: [across, along], steps, factor } => {
                let first = place.each_ref().map(|slope| slope.at([column, row]));
                let mut sums = Samples::default();
                for (down, right) in (0..*along).flat_map(|down| (0..*across).map(move |right| (down, right)))
                {
                    let [right, down] = [right, down].map(f64::from);
                    let at = [0, 1].map(|axis| first[axis] + right * steps[0][axis] + down * steps[1][axis]);
                    sums.add(pixels, *image, at)?;
                }
                Ok(sums.color(across * along, *factor))
            }
            Brush::Colors(slopes) => Ok(slopes
                .each_ref()
                .map(|slope| (slope.at([column + 0.5, row + 0.5]) + 0.5).clamp(0.0, 255.0) as u8)),
        }
    }
}

/// A factor as light.
fn tint(factor: [u8; 4]) -> [f32; 4] {
    let [r, g, b, a] = factor.map(|part| f64::from(part) / 255.0);
    [light(r), light(g), light(b), a].map(|part| part as f32)
}

/// The mean colour of a triangle's paint.
fn mean<P: Pixels + ?Sized>(paint: &Paint, pixels: &mut P) -> Result<[u8; 4], TextureError> {
    match paint {
        Paint::Image { image, corners: [a, b, c], factor } => {
            let mut sums = Samples::default();
            // Middles of the triangles that it is cut into, which have one corner up or down.
            let middles = |up: u32| {
                let count = CUTS - up + 1;
                (0..count).flat_map(move |i| (0..count - i).map(move |j| [3 * i + up, 3 * j + up]))
            };
            for parts in middles(1).chain(middles(2)) {
                let [u, v] = parts.map(|part| f64::from(part) / f64::from(3 * CUTS));
                let at = [0, 1].map(|axis| a[axis] + u * (b[axis] - a[axis]) + v * (c[axis] - a[axis]));
                sums.add(pixels, *image, at)?;
            }
            Ok(sums.color(CUTS * CUTS, tint(*factor)))
        }
        Paint::Colors(colors) => {
            Ok([0, 1, 2, 3].map(|i| (colors.iter().map(|color| u32::from(color[i])).sum::<u32>() / 3) as u8))
        }
    }
}

/// About where paint is: its image, and a row and a column of parts of it.
fn near(paint: &Paint) -> [i64; 3] {
    match paint {
        Paint::Image { image, corners: [[x, y], ..], .. } => {
            [i64::from(*image), (y / NEAR) as i64, (x / NEAR) as i64]
        }
        Paint::Colors(_) => [-1, 0, 0],
    }
}

/// A sheet while it is filled.
struct Canvas<'a> {
    plan: &'a Plan,
    surface: &'a Surface<'a>,
    paints: &'a [Paint],
    texels: Vec<[u8; 4]>,
    known: Vec<bool>,
}

impl Plan {
    /// The texels of the sheet, by rows from the top; `paints` has what each triangle of the finest mesh shows. Every texel gets a colour.
    ///
    /// # Errors
    /// What reading pixels fails with.
    pub fn bake<P: Pixels + ?Sized>(
        &self,
        surface: &Surface<'_>,
        paints: &[Paint],
        pixels: &mut P,
    ) -> Result<Vec<[u8; 4]>, TextureError> {
        let area = self.size[0] as usize * self.size[1] as usize;
        let (texels, known) = (vec![[0, 0, 0, 255]; area], vec![false; area]);
        let mut canvas = Canvas { plan: self, surface, paints, texels, known };
        let faces = Faces::new(surface);
        let mut of_chart: Vec<Vec<u32>> = vec![Vec::new(); self.charts.len()];
        for (triangle, chart) in (0..).zip(&self.chart_of) {
            of_chart[usize::from(*chart)].push(triangle);
        }
        let stride = self.size[0] as usize;
        // What lies side by side in an image is read together.
        let mut order: Vec<([i64; 3], u32)> = (paints.iter().map(near).zip(0..)).collect();
        order.sort_unstable();
        let mut missed = Vec::new();
        for (_, triangle) in order {
            if !canvas.cover(usize::from(self.chart_of[triangle as usize]), triangle, pixels)? {
                missed.push(triangle);
            }
        }
        for triangle in missed {
            canvas.dab(usize::from(self.chart_of[triangle as usize]), triangle, pixels)?;
        }
        for (number, triangles) in of_chart.iter().enumerate() {
            canvas.cover_needed(number, triangles, &faces, pixels)?;
            let rect = self.charts[number].rect.map(usize::from);
            Patch { texels: &mut canvas.texels, known: &mut canvas.known, stride, rect }.fill();
        }
        let rect = [0, 0, stride, self.size[1] as usize];
        Patch { texels: &mut canvas.texels, known: &mut canvas.known, stride, rect }.spread();
        Ok(canvas.texels)
    }
}

impl Canvas<'_> {
    fn places(&self, chart: &Chart, corners: [u16; 3]) -> [[f64; 2]; 3] {
        corners.map(|corner| chart.place(self.plan.origin, self.surface.positions[usize::from(corner)]))
    }

    /// Paints the texels of a triangle of a chart, whose middles it has; whether it has any.
    fn cover<P: Pixels + ?Sized>(
        &mut self,
        chart: usize,
        triangle: u32,
        pixels: &mut P,
    ) -> Result<bool, TextureError> {
        let stride = self.plan.size[0] as usize;
        let corners = self.surface.triangles[triangle as usize];
        let places = self.places(&self.plan.charts[chart], corners);
        let Some(brush) = Brush::of(&self.paints[triangle as usize], places) else { return Ok(false) };
        let mut result = Ok(false);
        spans(places, |row, begin, end| {
            for column in begin..end {
                if result.is_err() {
                    return;
                }
                match brush.color(column as f64, row as f64, pixels) {
                    Ok(color) => {
                        let at = row as usize * stride + column as usize;
                        (self.texels[at], self.known[at]) = (color, true);
                        result = Ok(true);
                    }
                    Err(error) => result = Err(error),
                }
            }
        });
        result
    }

    /// Paints the texel that has the middle of a triangle, unless another has: for one so small or so steep that it has no texel's middle. Without it, charts of such
    /// alone would have no colour.
    fn dab<P: Pixels + ?Sized>(
        &mut self,
        chart: usize,
        triangle: u32,
        pixels: &mut P,
    ) -> Result<(), TextureError> {
        let chart = &self.plan.charts[chart];
        let places = self.places(chart, self.surface.triangles[triangle as usize]);
        let [left, top, width, height] = chart.rect.map(f64::from);
        let middle = |axis: usize, first: f64, len: f64| {
            let sum: f64 = places.iter().map(|place| place[axis]).sum();
            (sum / 3.0).clamp(first, first + len - 1.0) as usize
        };
        let at = middle(1, top, height) * self.plan.size[0] as usize + middle(0, left, width);
        if !self.known[at] {
            (self.texels[at], self.known[at]) = (mean(&self.paints[triangle as usize], pixels)?, true);
        }
        Ok(())
    }

    /// Paints texels that a coarser state of the chart's triangles has, and the finest has not: with the surface of the cluster that is nearest along the chart's
    /// direction. Some rows at a time.
    fn cover_needed<P: Pixels + ?Sized>(
        &mut self,
        number: usize,
        triangles: &[u32],
        faces: &Faces<'_>,
        pixels: &mut P,
    ) -> Result<(), TextureError> {
        let Chart { rect: [left, top, width, height], .. } = self.plan.charts[number];
        let rows = (BAND / u32::from(width).max(1)).clamp(1, u16::MAX.into()) as u16;
        for first in (0..height).step_by(rows.into()) {
            let band = [left, top + first, width, rows.min(height - first)];
            self.cover_band(number, band, triangles, faces, pixels)?;
        }
        Ok(())
    }

    fn cover_band<P: Pixels + ?Sized>(
        &mut self,
        number: usize,
        band: [u16; 4],
        triangles: &[u32],
        faces: &Faces<'_>,
        pixels: &mut P,
    ) -> Result<(), TextureError> {
        let (chart, direction) = (self.plan.charts[number], self.plan.directions[number]);
        let stride = self.plan.size[0] as usize;
        let bounds = band.map(f64::from);
        let [left, top, width, height] = band.map(usize::from);
        let rows = top as i64..(top + height) as i64;
        // By texel of the band: how deep the state is, how far the nearest surface, and which.
        let mut needed: Vec<(f32, f32, u32)> = Vec::new();
        let surface = self.surface;
        let depths = |corners: [u16; 3]| surface.corners(corners).map(|corner| dot(corner, direction));
        for triangle in triangles {
            for state in surface.mesh().states(surface.triangles[*triangle as usize]).skip(1) {
                let Some(places) = within(self.places(&chart, state), bounds) else { continue };
                let Some(depth) = Slope::of(places, depths(state)) else { continue };
                spans(places, |row, begin, end| {
                    if !rows.contains(&row) {
                        return;
                    }
                    for column in begin..end {
                        if self.known[row as usize * stride + column as usize] {
                            continue;
                        }
                        if needed.is_empty() {
                            needed.resize(width * height, (f32::NAN, f32::INFINITY, NONE));
                        }
                        let at = (row as usize - top) * width + column as usize - left;
                        if needed[at].0.is_nan() {
                            needed[at].0 = depth.at([column as f64 + 0.5, row as f64 + 0.5]) as f32;
                        }
                    }
                });
            }
        }
        if needed.is_empty() {
            return Ok(());
        }

        for (triangle, corners) in (0..).zip(surface.triangles) {
            if usize::from(self.plan.chart_of[triangle as usize]) == number
                || dot(faces.normal(triangle), direction) < SEEN
            {
                continue;
            }
            let places = self.places(&chart, *corners);
            let Some(places) = within(places, bounds) else { continue };
            let Some(depth) = Slope::of(places, depths(*corners)) else { continue };
            let [first, last] = [left as i64, (left + width) as i64];
            spans(places, |row, begin, end| {
                if !rows.contains(&row) {
                    return;
                }
                for column in begin.max(first)..end.min(last) {
                    let found = &mut needed[(row as usize - top) * width + column as usize - left];
                    let far = (depth.at([column as f64 + 0.5, row as f64 + 0.5]) as f32 - found.0).abs();
                    // What is not needed has no depth, and nothing is nearer than that.
                    if far < found.1 {
                        (found.1, found.2) = (far, triangle);
                    }
                }
            });
        }
        for (at, (.., triangle)) in needed.iter().enumerate().filter(|(_, (.., triangle))| *triangle != NONE)
        {
            let places = self.places(&chart, surface.triangles[*triangle as usize]);
            let (column, row) = (left + at % width, top + at / width);
            if let Some(brush) = Brush::of(&self.paints[*triangle as usize], places) {
                let at = row * stride + column;
                (self.texels[at], self.known[at]) = (brush.color(column as f64, row as f64, pixels)?, true);
            }
        }
        Ok(())
    }
}

/// The places, if some of their box may be in a rectangle and none is so far away that it cannot be counted.
fn within(places: [[f64; 2]; 3], [left, top, width, height]: [f64; 4]) -> Option<[[f64; 2]; 3]> {
    let extent = |axis: usize| {
        let all = places.map(|place| place[axis]);
        (all[0].min(all[1]).min(all[2]), all[0].max(all[1]).max(all[2]))
    };
    let ((x0, x1), (y0, y1)) = (extent(0), extent(1));
    let meets = x1 >= left && x0 <= left + width && y1 >= top && y0 <= top + height;
    let near = x0 > -1e6 && y0 > -1e6 && x1 < 1e6 && y1 < 1e6;
    (meets && near).then_some(places)
}
