//! Pictures without a window.

use crate::error::ViewerError;
use crate::frame::Viewer;
use crate::request::FrameRequest;
use crate::stats::Stats;
use chpm_mesh::ClusterId;
use std::io::Write;

/// Eight bits each of red, green, blue, alpha, as displayed (sRGB); rows from the top.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Image {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Four bytes a pixel.
    pub pixels: Vec<u8>,
}

impl Image {
    /// The pixel in column `x` of row `y`.
    ///
    /// # Panics
    /// Outside the image.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 4] {
        let first = 4 * (y as usize * self.size[0] as usize + x as usize);
        std::array::from_fn(|channel| self.pixels[first + channel])
    }

    /// Writes the image as a PNG.
    ///
    /// # Errors
    /// What writing fails with.
    pub fn write_png(&self, out: impl Write) -> std::io::Result<()> {
        let mut encoder = png::Encoder::new(out, self.size[0], self.size[1]);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.pixels)?;
        Ok(writer.finish()?)
    }
}

/// A triangle of a cluster's finest mesh.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct TriangleId {
    /// Which model, from 0.
    pub model: u32,
    /// The cluster.
    pub cluster: ClusterId,
    /// The triangle's place in the cluster's page.
    pub triangle: u32,
}

/// For each pixel the triangle that is seen there: the item buffer. Where several triangles are equally near, to the last bit of their
/// depths, it is one of the first model, of the least cluster id, and of its triangles the first one in the page: which one never depends on what
/// was drawn before or on what was culled.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct IdImage {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Rows from the top; `None` is background.
    pub pixels: Vec<Option<TriangleId>>,
}

/// Draws a frame and brings the picture back.
///
/// # Errors
/// As [`Viewer::frame`].
pub fn image(viewer: &mut Viewer, request: &FrameRequest) -> Result<(Image, Stats), ViewerError> {
    viewer.image(request)
}

/// Draws a frame with an id for every triangle in place of colours; the request's look is not used.
///
/// # Errors
/// As [`Viewer::frame`], and [`ViewerError::TooManyIds`].
pub fn ids(viewer: &mut Viewer, request: &FrameRequest) -> Result<(IdImage, Stats), ViewerError> {
    viewer.ids(request)
}
