//! A rasteriser on the CPU: what the pictures are compared with.
//!
//! In double precision, one triangle after the other, without hierarchy or culling: slow, and simple enough to be believed. Pixels are
//! sampled at their centres, an edge belongs to the triangle that it is the top or the left edge of, and along every ray the nearest
//! triangle is seen, from either side.
//!
//! Graphics hardware rounds corners to a fraction of a pixel and depths to single precision. So a [`Raster`] also knows which of its
//! pixels such rounding can change: [`Raster::is_certain`]. There every correct picture agrees.

mod project;

use chpm_format::Chpm;
use chpm_mesh::ClusterId;
use chpm_refine::{Camera, Cut, RefineError};
use chpm_viewer::{IdImage, TriangleId, ViewerError};
use project::{Corner, Projection};

/// An item buffer that is filled triangle by triangle.
#[derive(Clone, Debug)]
pub(crate) struct Raster {
    projection: Projection,
    pixels: Vec<Pixel>,
    /// Of the triangle that is being drawn.
    outline: Vec<Corner>,
}

/// Sample of a pixel. Nearness is one over depth along the line of sight: it is linear in the image.
#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    /// Triangle at the sample, and how near it is.
    seen: Option<(TriangleId, f64)>,
    /// Of those that cover the sample whatever is rounded, the nearest, and how near it is at least.
    sure: Option<(TriangleId, f64)>,
    /// Of those that may cover it, the two nearest, and how near they may be; two different triangles.
    rivals: [Option<(TriangleId, f64)>; 2],
}

/// How far hardware may move an edge, pixels: it rounds corners to 1/256, so by half of that along each axis. That is 0.0028; the rest
/// is for what was computed in single precision before.
const SNAP: f64 = 1.0 / 256.0;
/// The same for what grows with the coordinates, which are single precision with some operations behind them.
const RELATIVE: f64 = 1e-6;

impl Raster {
    /// An empty image of what a camera sees, in the coordinates of the triangles to come. Nothing nearer than the camera's near plane is
    /// drawn, or than `near` if that is farther.
    ///
    /// # Errors
    /// [`ViewerError::View`] for a camera or an image that none can be.
    pub(crate) fn new(camera: &Camera, viewport: [u32; 2], near: f64) -> Result<Self, ViewerError> {
        let projection = Projection::new(camera, viewport, near)?;
        let count = viewport[0] as usize * viewport[1] as usize;
        Ok(Raster { projection, pixels: vec![Pixel::default(); count], outline: Vec::new() })
    }

    /// The image of a cut; `camera` in the model's coordinates.
    ///
    /// # Errors
    /// As [`Raster::new`], and [`ViewerError::View`] for a damaged page.
    pub(crate) fn of_cut<D: AsRef<[u8]>>(
        file: &Chpm<D>,
        cut: &Cut,
        camera: &Camera,
        viewport: [u32; 2],
        near: f64,
    ) -> Result<Self, ViewerError> {
        let mut raster = Raster::new(&camera.relative_to(file.header().origin), viewport, near)?;
        raster.draw_cut(file, cut, 0, |position| position)?;
        Ok(raster)
    }

    /// Draws a cut of one of several models, each position where it is put.
    ///
    /// # Errors
    /// For a damaged page.
    pub(crate) fn draw_cut<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        cut: &Cut,
        model: u32,
        place: impl Fn([f64; 3]) -> [f64; 3],
    ) -> Result<(), RefineError> {
        for member in cut.members() {
            self.draw_cluster(file, (model, member.cluster), member.vertices as usize, &place)?;
        }
        Ok(())
    }

    fn draw_cluster<D: AsRef<[u8]>>(
        &mut self,
        file: &Chpm<D>,
        (model, cluster): (u32, ClusterId),
        vertices: usize,
        place: &impl Fn([f64; 3]) -> [f64; 3],
    ) -> Result<(), RefineError> {
        let page = file.page(cluster)?;
        let page = page.view();
        let mesh = page.progressive_mesh();
        for (triangle, corners) in (0..).zip(page.triangles) {
            let [a, b, c] = corners.map(|corner| mesh.resolve(corner, vertices));
            if a != b && b != c && c != a {
                let position = |v: u16| place(page.positions[usize::from(v)].map(f64::from));
                self.draw(TriangleId { model, cluster, triangle }, [a, b, c].map(position));
            }
        }
        Ok(())
    }

    /// Draws a triangle. Of triangles that are equally near the first one is seen.
    pub(crate) fn draw(&mut self, id: TriangleId, corners: [[f64; 3]; 3]) {
        let mut outline = std::mem::take(&mut self.outline);
        self.projection.project(corners, &mut outline);
        if let [first, rest @ ..] = &outline[..] {
            for pair in rest.windows(2) {
                self.fill(id, [*first, pair[0], pair[1]]);
            }
        }
        self.outline = outline;
    }

    /// Draws a triangle of the image.
    fn fill(&mut self, id: TriangleId, corners: [Corner; 3]) {
        let Some(flat) = Flat::new(corners) else { return };
        let [columns, rows] = flat.span(self.projection.viewport);
        for y in rows {
            for x in columns.clone() {
                let place = y as usize * self.projection.viewport[0] as usize + x as usize;
                let sample = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                self.pixels[place].take(id, &flat, sample);
            }
        }
    }

    /// Width and height, pixels.
    pub(crate) fn size(&self) -> [u32; 2] {
        self.projection.viewport
    }

    /// Triangle at each pixel.
    pub(crate) fn ids(&self) -> IdImage {
        let pixels = self.pixels.iter().map(|pixel| pixel.seen.map(|(id, _)| id)).collect();
        IdImage { size: self.size(), pixels }
    }

    /// The depths of the pixels, along the line of sight, object units; infinite where nothing is seen.
    pub(crate) fn depths(&self) -> Vec<f64> {
        let depth = |pixel: &Pixel| pixel.seen.map_or(f64::INFINITY, |(_, near)| 1.0 / near);
        self.pixels.iter().map(depth).collect()
    }

    /// Whether every picture that rounds as hardware may shows the same triangle (or the background) at a pixel, by its place
    /// in the image.
    ///
    /// # Panics
    /// For a place outside the image.
    pub(crate) fn is_certain(&self, place: usize) -> bool {
        let pixel = &self.pixels[place];
        let Some((sure, least)) = pixel.sure else { return pixel.rivals[0].is_none() };
        pixel.rivals.iter().flatten().all(|(id, most)| *id == sure || *most < least)
    }
}

impl Pixel {
    fn take(&mut self, id: TriangleId, flat: &Flat, sample: [f64; 2]) {
        let edges = flat.edges(sample);
        let inside = flat.inside(&edges);
        // Smallest distance to an edge's line, positive inside.
        let depth = (0..3).map(|i| edges[i] / flat.lengths[i]).fold(f64::INFINITY, f64::min);
        if depth < -flat.margin && !inside {
            return;
        }
        let (near, slack) = flat.nearness(&edges);
        let low = (near - slack).max(flat.range[0]) * (1.0 - RELATIVE);
        let high = (near + slack).min(flat.range[1]) * (1.0 + RELATIVE);
        if inside && self.seen.is_none_or(|(_, best)| near > best) {
            self.seen = Some((id, near));
        }
        if inside && depth > flat.margin && self.sure.is_none_or(|(_, best)| low > best) {
            self.sure = Some((id, low));
        }
        self.rival(id, high);
    }

    fn rival(&mut self, id: TriangleId, high: f64) {
        let same = self.rivals.iter().position(|rival| rival.is_some_and(|(other, _)| other == id));
        let is_nearer = |rival: Option<(TriangleId, f64)>| rival.is_none_or(|(_, best)| high > best);
        match same {
            Some(place) if is_nearer(self.rivals[place]) => self.rivals[place] = Some((id, high)),
            None if is_nearer(self.rivals[1]) => self.rivals[1] = Some((id, high)),
            _ => return,
        }
        let [first, second] = &mut self.rivals;
        if second.is_some_and(|(_, second)| first.is_none_or(|(_, first)| second > first)) {
            std::mem::swap(first, second);
        }
    }
}

/// A triangle in the image, its corners turned so that its inside is on the positive side of its edges.
struct Flat {
    corners: [Corner; 3],
    /// Lengths of the edges; edge i is opposite corner i.
    lengths: [f64; 3],
    /// Twice the area.
    area: f64,
    /// Least and greatest nearness.
    range: [f64; 2],
    /// By how much nearness may change when edges move by the margin.
    slack: f64,
    /// How far edges may be moved by rounding, pixels.
    margin: f64,
}

impl Flat {
    /// None where numbers are none. What has no area shows nothing, but rounding may give it some.
    fn new(mut corners: [Corner; 3]) -> Option<Self> {
        let area = edge(corners[0].at, corners[1].at, corners[2].at);
        if area < 0.0 {
            corners.swap(1, 2);
        }
        let [a, b, c] = corners;
        let area = area.abs();
        if !area.is_finite() {
            return None;
        }
        let near = corners.map(|corner| corner.near);
        let largest = corners.iter().flat_map(|corner| corner.at).fold(0.0, |most: f64, x| most.max(x.abs()));
        let margin = SNAP + RELATIVE * largest;
        // Gradient of the plane through the three nearnesses.
        let along = |axis: usize| {
            let across = 1 - axis;
            let sign = if axis == 0 { 1.0 } else { -1.0 };
            let [a, b, c] = [a, b, c].map(|corner| corner.at[across]);
            sign * (near[0] * (b - c) + near[1] * (c - a) + near[2] * (a - b)) / area
        };
        Some(Flat {
            corners,
            lengths: [distance(b.at, c.at), distance(c.at, a.at), distance(a.at, b.at)],
            area,
            range: [
                near.iter().copied().fold(f64::INFINITY, f64::min),
                near.iter().copied().fold(0.0, f64::max),
            ],
            slack: if area > 0.0 { margin * (along(0).abs() + along(1).abs()) } else { f64::INFINITY },
            margin,
        })
    }

    /// Columns and rows of the pixels whose samples it may cover.
    fn span(&self, viewport: [u32; 2]) -> [std::ops::Range<u32>; 2] {
        [0, 1].map(|axis| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for corner in &self.corners {
                (low, high) = (low.min(corner.at[axis]), high.max(corner.at[axis]));
            }
            // From numbers to pixels: what is outside the image goes to its border.
            let first = (low - self.margin - 0.5).ceil().max(0.0) as u32;
            let last = (high + self.margin - 0.5).floor() + 1.0;
            first..(last.clamp(0.0, f64::from(viewport[axis])) as u32)
        })
    }

    /// Edge functions: twice the areas of the triangles of each edge and the sample.
    fn edges(&self, sample: [f64; 2]) -> [f64; 3] {
        let [a, b, c] = self.corners.map(|corner| corner.at);
        [edge(b, c, sample), edge(c, a, sample), edge(a, b, sample)]
    }

    /// The sample is inside, or on an edge that is a top or a left one.
    fn inside(&self, edges: &[f64; 3]) -> bool {
        (0..3).all(|i| {
            let (from, to) = (self.corners[(i + 1) % 3].at, self.corners[(i + 2) % 3].at);
            // Rows grow downward: the inside is to the right of what goes up, and below what goes right.
            let is_top_left = to[1] < from[1] || (to[1] == from[1] && to[0] > from[0]);
            edges[i] > 0.0 || (edges[i] == 0.0 && is_top_left)
        })
    }

    /// Nearness at a sample, and how much rounding may change it.
    fn nearness(&self, edges: &[f64; 3]) -> (f64, f64) {
        // Not a number where there is no area; the slack has the last word then.
        let sum: f64 = edges.iter().zip(&self.corners).map(|(edge, corner)| edge * corner.near).sum();
        ((sum / self.area).clamp(self.range[0], self.range[1]), self.slack)
    }
}

/// Positive if `p` is on the inner side of the edge. The same but for its sign from both sides, to the last bit, so that triangles side by
/// side leave no sample out and take none twice.
fn edge(from: [f64; 2], to: [f64; 2], p: [f64; 2]) -> f64 {
    let cross = |a: [f64; 2], b: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
    if from <= to { cross(from, to) } else { -cross(to, from) }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

#[cfg(test)]
mod tests;
