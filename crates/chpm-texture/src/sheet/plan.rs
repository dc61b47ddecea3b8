//! The plan of a sheet: its charts, where they are, and how large it is.

use super::charts::{Flat, flatten};
use super::directions::Faces;
use super::pack::pack;
use super::vector::Vector;
use chpm_mesh::{Chart, ProgressiveMesh};

/// Texels about what a chart shows.
pub(super) const GUTTER: u32 = 4;
/// Sides of a sheet are multiples of this, and at most so long.
const STEP: u32 = 16;
const LONGEST: u32 = 8192;
/// Most texels of a sheet.
const MOST: f64 = (1u32 << 24) as f64;
/// Bytes that making a sheet takes for each of its texels: themselves, and then means of squares, or PNG of noise and a copy of it.
const BYTES: u64 = 12;
/// And beside them.
const BESIDE: u64 = 2 << 20;

/// The surface of a cluster: a progressive mesh, and how finely each triangle is to be shown.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// Vertices of the finest mesh.
    pub positions: &'a [[f32; 3]],
    /// Triangles of the finest mesh.
    pub triangles: &'a [[u16; 3]],
    /// Vertices of the base mesh; the others collapse.
    pub base_vertex_count: usize,
    /// Where those go.
    pub targets: &'a [u16],
    /// By triangle, the side of a texel in object units; no number where it does not matter.
    pub texels: &'a [f64],
    /// Texels are no smaller than this.
    pub least_texel: f64,
}

impl Surface<'_> {
    pub(super) fn mesh(&self) -> ProgressiveMesh<'_> {
        ProgressiveMesh {
            vertex_count: self.positions.len(),
            base_vertex_count: self.base_vertex_count,
            triangles: self.triangles,
            targets: self.targets,
        }
    }

    pub(super) fn corners(&self, corners: [u16; 3]) -> [Vector; 3] {
        corners.map(|corner| self.positions[usize::from(corner)].map(f64::from))
    }
}

/// Paint of a triangle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Paint {
    /// A part of an image, by number, with the places of the corners in it in texels. The colour is multiplied by a factor.
    Image {
        /// Its number for [`Pixels`](super::Pixels).
        image: u32,
        /// Columns and rows.
        corners: [[f64; 2]; 3],
        /// Red, green and blue as sRGB has them, and alpha.
        factor: [u8; 4],
    },
    /// Colours of its corners.
    Colors([[u8; 4]; 3]),
}

/// Charts of a cluster, packed.
#[derive(Clone, PartialEq, Debug)]
pub struct Plan {
    /// The point that charts project from.
    pub origin: [f32; 3],
    /// Charts, with their rectangles.
    pub charts: Vec<Chart>,
    /// By triangle, its chart.
    pub chart_of: Vec<u16>,
    /// By chart, the side of a texel in object units.
    pub texel_of: Vec<f64>,
    /// Directions that charts face.
    pub(super) directions: Vec<Vector>,
    /// Width and height, texels.
    pub size: [u32; 2],
}

impl Plan {
    /// Divides a surface into charts and packs them; none if it takes more charts than there are numbers for.
    pub fn new(surface: &Surface<'_>) -> Option<Self> {
        let origin = lowest(surface.positions);
        let faces = Faces::new(surface);
        let facings = faces.charts();
        let mut coarser = 1.0;
        loop {
            let flats = flatten(surface, &faces, &facings, origin, coarser);
            match Self::packed(surface, &flats, origin) {
                Ok(plan) => return plan,
                Err(more) => coarser *= more,
            }
        }
    }

    /// The plan of these charts; by how much coarser they have to be if they are too large.
    fn packed(surface: &Surface<'_>, flats: &[Flat], origin: [f32; 3]) -> Result<Option<Plan>, f64> {
        if flats.len() > usize::from(u16::MAX) {
            return Ok(None);
        }
        let sizes: Vec<[u32; 2]> = flats.iter().map(|flat| flat.size).collect();
        let area: f64 = sizes.iter().map(|[width, height]| f64::from(*width) * f64::from(*height)).sum();
        let widest = sizes.iter().map(|[width, _]| *width).max().unwrap_or(1);
        let width = widest.max((area * 1.05).sqrt() as u32).next_multiple_of(STEP);
        if width > LONGEST || area > MOST {
            return Err(1.1 * (f64::from(width) / f64::from(LONGEST)).max((area / MOST).sqrt()).max(1.0));
        }
        let (places, rows) = pack(&sizes, width);
        let height = rows.max(1).next_multiple_of(STEP);
        if height > LONGEST || f64::from(width) * f64::from(height) > MOST {
            return Err(1.1);
        }

        let mut chart_of = vec![0; surface.triangles.len()];
        for (number, flat) in (0..).zip(flats) {
            flat.triangles.iter().for_each(|triangle| chart_of[*triangle as usize] = number);
        }
        let charts = flats.iter().zip(&places).map(|(flat, [x, y])| {
            let offset = [flat.offset[0] + f64::from(*x), flat.offset[1] + f64::from(*y)];
            Chart {
                axes: flat.axes,
                offset: offset.map(|x| x as f32),
                rect: [*x, *y, flat.size[0], flat.size[1]].map(|side| side as u16),
            }
        });
        Ok(Some(Plan {
            origin,
            charts: charts.collect(),
            chart_of,
            texel_of: flats.iter().map(|flat| flat.texel).collect(),
            directions: flats.iter().map(|flat| flat.direction).collect(),
            size: [width, height],
        }))
    }

    /// The side of the largest texel.
    pub fn texel(&self) -> f64 {
        self.texel_of.iter().copied().fold(0.0, f64::max)
    }

    /// Bytes that baking takes.
    pub fn memory(&self) -> u64 {
        BESIDE + BYTES * u64::from(self.size[0]) * u64::from(self.size[1])
    }
}

fn lowest(positions: &[[f32; 3]]) -> [f32; 3] {
    let first = positions.first().copied().unwrap_or_default();
    positions.iter().fold(first, |low, place| std::array::from_fn(|i| low[i].min(place[i])))
}
