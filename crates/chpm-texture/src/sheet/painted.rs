//! The image of a surface, as points of its triangles see it.

use super::{LEVELS, Sizes, fitted};
use chpm_mesh::Chart;

/// An image that was decoded, and where the triangles of a mesh are in it.
#[derive(Debug)]
pub struct Painted {
    origin: [f32; 3],
    charts: Vec<Chart>,
    /// By triangle of the mesh at its finest.
    chart_of: Vec<u16>,
    sizes: Sizes,
    /// Texels of the largest size that was decoded for one of the image.
    scale: f64,
    /// Side of such a texel, units of the model.
    texel: f64,
}

impl Painted {
    /// Decodes an image of this size, with no side longer than `longest`; none where it is damaged. `texel` is the side of a texel of the image, units of the
    /// model; `charts`, whose origin is `origin`, are those of triangles by `chart_of`.
    pub fn new(
        (image, size, longest): (&[u8], [u16; 2], u32),
        texel: f32,
        (origin, charts, chart_of): ([f32; 3], Vec<Chart>, Vec<u16>),
    ) -> Option<Self> {
        let sizes = Sizes::decode(size, image, longest)?;
        let scale = 1.0 / f64::from(1u32 << fitted(size, longest).0);
        Some(Painted { origin, charts, chart_of, sizes, scale, texel: f64::from(texel) / scale })
    }

    /// Red, green, blue and alpha, 0 to 1, of a point of a triangle of which an eye sees so much at once, in units of the model.
    pub fn texel(&self, triangle: u32, point: [f64; 3], seen: f64) -> [f64; 4] {
        let chart = &self.charts[usize::from(self.chart_of[triangle as usize])];
        let place = chart.place(self.origin, point.map(|x| x as f32)).map(|x| x * self.scale);
        let (mut level, mut side) = (0, self.texel);
        while level + 1 < LEVELS as usize && seen > 1.5 * side {
            (level, side) = (level + 1, 2.0 * side);
        }
        self.sizes.at(place, level)
    }
}
