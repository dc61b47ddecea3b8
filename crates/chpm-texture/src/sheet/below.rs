//! Sheets of finer clusters, as what a coarser one is baked from.

use super::{Paint, Pixels, Region, Texel, rows};
use crate::TextureError;
use chpm_mesh::Chart;

/// Bits of a chart's number below that of the sheet.
const CHART_BITS: u32 = 16;

/// A sheet of which samples can be taken.
#[derive(Clone, Default, Debug)]
pub struct Sampled {
    /// The point that charts project from.
    pub origin: [f32; 3],
    /// Charts, with their rectangles.
    pub charts: Vec<Chart>,
    /// By triangle, its chart.
    pub chart_of: Vec<u16>,
    /// Texels of a row.
    pub width: usize,
    /// All of them, by rows from the top.
    pub texels: Vec<Texel>,
}

/// Sheets by number.
#[derive(Clone, Default, Debug)]
pub struct Below(pub Vec<Sampled>);

impl Below {
    /// The paint of a triangle that is number `triangle` in sheet `sheet`, and the side of a texel there in units of the model; no number where it has no area.
    pub fn paint(&self, sheet: u32, triangle: u32, corners: [[f32; 3]; 3]) -> (Paint, f64) {
        let Sampled { origin, charts, chart_of, .. } = &self.0[sheet as usize];
        let chart = chart_of[triangle as usize];
        let places = corners.map(|corner| charts[usize::from(chart)].place(*origin, corner));
        let image = sheet << CHART_BITS | u32::from(chart);
        (Paint::Image { image, corners: places, factor: [255; 4] }, texel_side(corners, places))
    }
}

impl Pixels for Below {
    fn region<'a>(
        &'a mut self,
        image: u32,
        column: i64,
        row: i64,
        room: &'a mut Region,
    ) -> Result<[&'a [Texel; 4]; 4], TextureError> {
        let sheet = &self.0[(image >> CHART_BITS) as usize];
        // Beyond its rectangle is another chart.
        let [left, top, width, height] = sheet.charts[(image & 0xffff) as usize].rect.map(i64::from);
        let (right, bottom) = (left + width, top + height);
        if column >= left && column + 4 <= right && row >= top && row + 4 <= bottom {
            return Ok(rows(&sheet.texels, row as usize * sheet.width + column as usize, sheet.width));
        }
        for (line, out) in (row..).zip(room.iter_mut()) {
            let line = line.clamp(top, bottom - 1) as usize * sheet.width;
            for (at, out) in (column..).zip(out) {
                *out = sheet.texels[line + at.clamp(left, right - 1) as usize];
            }
        }
        Ok(room.each_ref())
    }
}

/// The side of a texel of a triangle, in units of the model, given the places of its corners in an image; no number where it has no area, here or there.
pub fn texel_side(corners: [[f32; 3]; 3], places: [[f64; 2]; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| corner.map(f64::from));
    let [u, v]: [[f64; 3]; 2] = [b, c].map(|other| std::array::from_fn(|i| other[i] - a[i]));
    let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let area = (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
    let [p, q, r] = places;
    let texels = ((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])).abs();
    let side = (area / texels).sqrt();
    if side.is_finite() && side > 0.0 { side } else { f64::NAN }
}
