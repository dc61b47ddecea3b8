//! Triangles as a picture, drawn on the processor: that needs no driver, and is the same everywhere.

use crate::error::ReportError;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use chpm_refine::Camera;
use nalgebra::{Point3, Vector3};

const NOTHING: u32 = u32::MAX;
/// Samples of a pixel, along each side: edges are smooth.
const SAMPLES: usize = 2;

/// Triangle and depth of each sample.
pub struct Canvas {
    /// In pixels.
    size: [usize; 2],
    /// Which part was drawn, or nothing.
    part: Vec<u32>,
    /// Its light, 0 to 1.
    light: Vec<f32>,
    /// Colour, interpolated between the corners.
    tint: Vec<[f32; 3]>,
    /// Inverse depth: nothing is at zero.
    near: Vec<f32>,
}

/// From a model to samples.
pub struct Lens {
    eye: Point3<f64>,
    axes: [Vector3<f64>; 3],
    middle: [f64; 2],
    scale: f64,
    stretch: Vector3<f64>,
}

impl Lens {
    /// Of an image of so many pixels; positions are multiplied by `stretch` first.
    pub fn new(camera: &Camera, size: [usize; 2], stretch: Vector3<f64>) -> Self {
        let [width, height] = size.map(|n| (SAMPLES * n) as f64);
        let scale = 0.5 * height / (0.5 * camera.fov.to_radians()).tan();
        let (eye, axes) = (camera.position.into(), camera.axes());
        Lens { eye, axes, middle: [0.5 * width, 0.5 * height], scale, stretch }
    }

    fn place(&self, point: [f32; 3]) -> Point3<f64> {
        Point3::from(Vector3::from(point.map(f64::from)).component_mul(&self.stretch))
    }

    /// Sample and inverse depth; nothing for what is behind the eye, such as a speck that is not framed.
    fn at(&self, point: Point3<f64>) -> Option<[f64; 3]> {
        let arm = point - self.eye;
        let [right, up, forward] = self.axes.map(|axis| axis.dot(&arm));
        let near = 1.0 / forward;
        let at = [self.middle[0] + self.scale * right * near, self.middle[1] - self.scale * up * near, near];
        (forward > 0.0 && near.is_finite()).then_some(at)
    }
}

/// The first and the last of `count` samples between values along an axis; a sample is where its middle is.
fn samples(values: [f64; 3], count: usize) -> (f64, f64) {
    let low = values.into_iter().fold(f64::INFINITY, f64::min);
    let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
    ((low - 0.5).ceil().max(0.0), (high - 0.5).floor().min(count as f64 - 1.0))
}

/// A sample on a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Shares of the corners in its point.
    pub shares: [f32; 3],
    /// How far samples are apart there, in units of the picture.
    pub apart: f64,
}

impl Spot {
    /// The mixture of what the corners have.
    pub fn mix(&self, corners: &[[f32; 3]; 3]) -> [f32; 3] {
        [0, 1, 2].map(|n| (0..3).map(|i| self.shares[i] * corners[i][n]).sum())
    }
}

impl Canvas {
    /// With nothing on it.
    pub fn new(size: [usize; 2]) -> Self {
        let samples = SAMPLES * SAMPLES * size[0] * size[1];
        Canvas {
            size,
            part: vec![NOTHING; samples],
            light: vec![0.0; samples],
            tint: vec![[0.0; 3]; samples],
            near: vec![0.0; samples],
        }
    }

    /// Draws a triangle of a part, where it is nearer than what is there; `tint` tells its colour, or that nothing is there.
    pub fn draw(
        &mut self,
        lens: &Lens,
        corners: [[f32; 3]; 3],
        part: u32,
        tint: impl Fn(Spot) -> Option<[f32; 3]>,
    ) {
        let [p, q, r] = corners.map(|corner| lens.place(corner));
        let [Some(a), Some(b), Some(c)] = [p, q, r].map(|point| lens.at(point)) else { return };
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if !area.is_normal() {
            return;
        }
        let normal = (q - p).cross(&(r - p));
        let length = normal.norm();
        // From the eye and a little from above, on both sides.
        let toward = lens.axes[1] * 0.4 - lens.axes[2];
        let light = if length > 0.0 { (normal.dot(&toward) / length / 1.08).abs() as f32 } else { 0.0 };
        let [width, height] = self.size.map(|n| SAMPLES * n);
        let (left, right) = samples([a[0], b[0], c[0]], width);
        let (top, bottom) = samples([a[1], b[1], c[1]], height);
        for y in top as usize..(bottom + 1.0).max(0.0) as usize {
            for x in left as usize..(right + 1.0).max(0.0) as usize {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let weights = [[b, c], [c, a], [a, b]]
                    .map(|[u, v]| ((v[0] - u[0]) * (py - u[1]) - (v[1] - u[1]) * (px - u[0])) / area);
                if weights.iter().any(|weight| *weight < 0.0) {
                    continue;
                }
                let shares = [weights[0] * a[2], weights[1] * b[2], weights[2] * c[2]];
                let near: f64 = shares.iter().sum();
                let sample = y * width + x;
                if near as f32 <= self.near[sample] {
                    continue;
                }
                let shares = shares.map(|share| (share / near) as f32);
                let Some(tint) = tint(Spot { shares, apart: 1.0 / (near * lens.scale) }) else { continue };
                (self.near[sample], self.part[sample], self.light[sample]) = (near as f32, part, light);
                self.tint[sample] = tint;
            }
        }
    }

    /// The picture as a PNG in text, to be embedded; what shows nothing is transparent. `paint` tells the colour of a part with a tint.
    pub fn picture(&self, paint: impl Fn(u32, [f32; 3]) -> [u8; 3]) -> Result<String, ReportError> {
        let [width, height] = self.size;
        let mut bytes = Vec::with_capacity(4 * width * height);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let (mut color, mut count) = ([0.0; 3], 0);
            for (v, u) in (0..SAMPLES).flat_map(|v| (0..SAMPLES).map(move |u| (v, u))) {
                let sample = (SAMPLES * y + v) * SAMPLES * width + SAMPLES * x + u;
                if self.part[sample] == NOTHING {
                    continue;
                }
                count += 1;
                let shade = 0.25 + 0.75 * self.light[sample];
                let own = paint(self.part[sample], self.tint[sample]);
                (0..3).for_each(|n| color[n] += f32::from(own[n]) * shade);
            }
            let samples = count.max(1) as f32;
            bytes.extend(color.map(|channel| (channel / samples) as u8));
            bytes.push((255 * count / (SAMPLES * SAMPLES)) as u8);
        }
        let mut png = Vec::new();
        let mut encoder = png::Encoder::new(&mut png, width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(&bytes)?;
        Ok(STANDARD.encode(png))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_nearer_is_seen() {
        let camera = Camera::looking([0.0, 0.0, 10.0], [0.0; 3]);
        let size = [20, 20];
        let lens = Lens::new(&camera, size, Vector3::from([1.0; 3]));
        let mut seen = Canvas::new(size);
        let triangle = |z: f32, s: f32| [[-s, -s, z], [s, -s, z], [0.0, s, z]];
        let tint = |tint: f32| move |spot: Spot| Some(spot.mix(&[[tint; 3]; 3]));
        seen.draw(&lens, triangle(0.0, 2.0), 0, tint(0.5));
        seen.draw(&lens, triangle(1.0, 1.0), 1, tint(1.0));
        seen.draw(&lens, triangle(-3.0, 9.0), 0, tint(0.0));
        // One that reaches behind the eye, and one that is a hole.
        seen.draw(&lens, [[-9.0, -9.0, 1.0], [9.0, -9.0, 1.0], [0.0, 0.0, 20.0]], 2, tint(0.0));
        seen.draw(&lens, triangle(2.0, 1.0), 3, |_| None);
        let middle = 20 * 40 + 20;
        assert_eq!((seen.part[middle], seen.part[0]), (1, NOTHING));
        assert!(seen.part.contains(&0) && seen.part.iter().filter(|part| **part != NOTHING).count() > 100);
        assert!(seen.light[middle] > 0.8 && (seen.tint[middle][0] - 1.0).abs() < 1e-6);
        assert!(!seen.part.contains(&3));
        assert!(seen.picture(|_, _| [200; 3]).unwrap().starts_with("iVBORw0KGgo"));
    }
}
