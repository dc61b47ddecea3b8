//! The image of a cluster's surface, as rays see it.

use chpm_format::{Sheet, SheetRecord};
use chpm_mesh::Chart;
use chpm_texture::sheet::{LEVELS, Sizes, fitted};

/// A sheet that was decoded.
#[derive(Debug)]
pub(super) struct Painted {
    origin: [f32; 3],
    charts: Vec<Chart>,
    /// By triangle of the page.
    chart_of: Vec<u16>,
    sizes: Sizes,
    /// Texels of the largest size for one of the sheet.
    scale: f64,
    /// Side of a texel of the largest size, units of the file.
    texel: f64,
}

/// Longest side, texels, that a sheet is seen with.
fn longest(record: &SheetRecord) -> u32 {
    let mut longest = u32::from(record.size[0].max(record.size[1]));
    while longest > 1 && Sizes::bytes_of(record.size, longest) > Painted::MOST {
        longest /= 2;
    }
    longest
}

impl Painted {
    /// Most bytes of its image in all sizes, which a million texels have: it is halved until it has no more, whatever the memory, which is not to show.
    pub(super) const MOST: u64 = 6 << 20;

    /// Bytes that it takes.
    pub(super) fn bytes_of(record: &SheetRecord, triangles: u32) -> u64 {
        let texels = Sizes::bytes_of(record.size, longest(record));
        texels + 40 * u64::from(record.chart_count) + 2 * u64::from(triangles)
    }

    /// Decodes a sheet; none where its image is damaged.
    pub(super) fn new(sheet: Sheet<'_>) -> Option<Self> {
        let Sheet { record, layout, image } = sheet;
        let longest = longest(&record);
        let sizes = Sizes::decode(record.size, image, longest)?;
        let scale = 1.0 / f64::from(1u32 << fitted(record.size, longest).0);
        let texel = f64::from(record.texel) / scale;
        Some(Painted {
            origin: layout.origin,
            charts: layout.charts,
            chart_of: layout.chart_of,
            sizes,
            scale,
            texel,
        })
    }

    /// Red, green, blue and alpha, 0 to 1, of a point of a triangle of which a ray sees so much, in units of the file.
    pub(super) fn texel(&self, triangle: u32, point: [f64; 3], seen: f64) -> [f64; 4] {
        let chart = &self.charts[usize::from(self.chart_of[triangle as usize])];
        let place = chart.place(self.origin, point.map(|x| x as f32)).map(|x| x * self.scale);
        let (mut level, mut side) = (0, self.texel);
        while level + 1 < LEVELS as usize && seen > 1.5 * side {
            (level, side) = (level + 1, 2.0 * side);
        }
        self.sizes.at(place, level)
    }
}
