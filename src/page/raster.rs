//! Pictures of a model, drawn on the processor: they need no driver, and are the same everywhere.

use crate::cmd;
use anyhow::Result;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::{Camera, Cut, Hierarchy, View, select_triangles};
use nalgebra::{Point3, Vector3};

/// Triangles of a picture, about: some for each pixel of the model.
const TRIANGLES: u64 = 150_000;
const NOTHING: u32 = u32::MAX;

/// What a picture's colours show.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Colors {
    Cluster,
    Level,
    Error,
}

/// What is seen in each pixel.
pub(super) struct Seen {
    size: [usize; 2],
    /// Which member of the cut, or nothing.
    member: Vec<u32>,
    /// Its light, 0 to 1.
    light: Vec<f32>,
    /// Inverse depth: nothing is at zero.
    near: Vec<f32>,
    /// Id, level and error of each member.
    members: Vec<(u32, u32, f32)>,
    levels: u32,
    pub(super) triangles: u64,
    pub(super) error: f32,
}

/// Draws the cut of so many triangles from the camera that looks at the whole model, a little from the side.
/// With `beside` the triangles are where an eye at the right needs them, so that levels differ.
pub(super) fn look(file: &Chpm<MappedFile>, size: [usize; 2], beside: bool) -> Result<Seen> {
    let coarsest: u64 =
        file.roots().map(|root| u64::from(file.clusters()[root.index()].base_triangle_count)).sum();
    let (camera, limit) = (aside(&Camera::framing(&file.header().aabb())), TRIANGLES.max(coarsest));
    let source = file.header().source_triangle_count;
    let cut = if beside {
        let [right, _, _] = camera.axes();
        let target = Point3::from(camera.target);
        // That of the sphere around the model, or of what is looked at in its place where it is a single point.
        let radius = (Point3::from(camera.position) - target).norm() * (0.5 * camera.fov.to_radians()).sin();
        let eye = Camera::looking((target + right * radius).into(), camera.target);
        select_triangles(
            file,
            &Hierarchy::new(file),
            &View::new(&eye, [512, 512], 0.0)?,
            limit.min(source / 4).max(coarsest),
        )?
    } else {
        Cut::at_triangles(file, limit)?
    };
    let pixels = size[0] * size[1];
    let mut seen = Seen {
        size,
        member: vec![NOTHING; pixels],
        light: vec![0.0; pixels],
        near: vec![0.0; pixels],
        members: Vec::new(),
        levels: file.header().level_count,
        triangles: cut.triangle_count(file)?,
        error: cut.error(file)?,
    };
    let mut triangles = Vec::new();
    for member in cut.members() {
        let page = file.page(member.cluster)?;
        let page = page.view();
        let place = seen.members.len() as u32;
        let n = member.vertices as usize;
        let level = file.clusters()[member.cluster.index()].level;
        seen.members.push((member.cluster.0, level, page.error_at(n)));
        triangles.clear();
        page.progressive_mesh().triangles_at(n, &mut triangles);
        let lens = Lens::new(&camera, size);
        for corners in &triangles {
            seen.draw(&lens, corners.map(|corner| page.positions[usize::from(corner)]), place);
        }
    }
    Ok(seen)
}

/// Turned by 30 degrees about the y axis and by 20 upward, so that a box shows three sides.
fn aside(camera: &Camera) -> Camera {
    let target = Point3::from(camera.target);
    let arm = Point3::from(camera.position) - target;
    let (turn, rise) = (30_f64.to_radians(), 20_f64.to_radians());
    let to = Vector3::new(turn.sin() * rise.cos(), rise.sin(), turn.cos() * rise.cos()) * arm.norm();
    Camera { position: (target + to).into(), ..*camera }
}

/// From the model to pixels.
struct Lens {
    eye: Point3<f64>,
    axes: [Vector3<f64>; 3],
    middle: [f64; 2],
    scale: f64,
}

impl Lens {
    fn new(camera: &Camera, size: [usize; 2]) -> Self {
        let [width, height] = size.map(|n| n as f64);
        // The sphere around the box fits both ways.
        let scale = 0.5 * width.min(height) / (0.5 * camera.fov.to_radians()).tan();
        Lens { eye: camera.position.into(), axes: camera.axes(), middle: [0.5 * width, 0.5 * height], scale }
    }

    /// Pixel and inverse depth.
    fn at(&self, point: [f32; 3]) -> [f64; 3] {
        let arm = Point3::from(point.map(f64::from)) - self.eye;
        let [right, up, forward] = self.axes.map(|axis| axis.dot(&arm));
        // The camera is outside the model, so that nothing is behind it.
        let near = 1.0 / forward.max(f64::MIN_POSITIVE);
        [self.middle[0] + self.scale * right * near, self.middle[1] - self.scale * up * near, near]
    }
}

impl Seen {
    fn draw(&mut self, lens: &Lens, corners: [[f32; 3]; 3], member: u32) {
        let [a, b, c] = corners.map(|corner| lens.at(corner));
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if !area.is_normal() {
            return;
        }
        let [p, q, r] = corners.map(|corner| Point3::from(corner.map(f64::from)));
        let normal = (q - p).cross(&(r - p));
        let length = normal.norm();
        // From the eye and a little from above, on both sides.
        let toward = lens.axes[1] * 0.4 - lens.axes[2];
        let light = if length > 0.0 { (normal.dot(&toward) / length / 1.08).abs() as f32 } else { 0.0 };
        let span = |axis: usize| {
            let values = [a[axis], b[axis], c[axis]];
            let low = values.into_iter().fold(f64::INFINITY, f64::min);
            let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
            // A pixel is where its middle is.
            let last = self.size[axis] as f64 - 1.0;
            ((low - 0.5).ceil().max(0.0), (high - 0.5).floor().min(last))
        };
        let ((left, right), (top, bottom)) = (span(0), span(1));
        for y in top as usize..(bottom + 1.0).max(0.0) as usize {
            for x in left as usize..(right + 1.0).max(0.0) as usize {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let side = |u: [f64; 3], v: [f64; 3]| {
                    ((v[0] - u[0]) * (py - u[1]) - (v[1] - u[1]) * (px - u[0])) / area
                };
                let weights = [side(b, c), side(c, a), side(a, b)];
                if weights.iter().any(|weight| *weight < 0.0) {
                    continue;
                }
                let near = (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]) as f32;
                let pixel = y * self.size[0] + x;
                if near > self.near[pixel] {
                    (self.near[pixel], self.member[pixel], self.light[pixel]) = (near, member, light);
                }
            }
        }
    }

    /// The picture as a PNG in text, to be embedded; what shows nothing is transparent.
    pub(super) fn picture(&self, colors: Colors) -> Result<String> {
        let errors = self.members.iter().map(|(.., error)| f64::from(*error)).filter(|error| *error > 0.0);
        let (low, high) = errors.fold((f64::INFINITY, 0.0_f64), |(low, high), e| (low.min(e), high.max(e)));
        let paint = |(id, level, error): (u32, u32, f32)| match colors {
            Colors::Cluster => own_color(id),
            Colors::Level => ramp(f64::from(level) / f64::from(self.levels.max(2) - 1)),
            Colors::Error if error <= 0.0 || high <= low => ramp(0.0),
            Colors::Error => ramp((f64::from(error) / low).ln() / (high / low).ln()),
        };
        let mut bytes = Vec::with_capacity(4 * self.member.len());
        for (member, light) in self.member.iter().zip(&self.light) {
            match self.members.get(*member as usize) {
                Some(member) => {
                    let shade = 0.25 + 0.75 * light;
                    bytes.extend(paint(*member).map(|channel| (f32::from(channel) * shade) as u8));
                    bytes.push(255);
                }
                None => bytes.extend([0; 4]),
            }
        }
        let mut png = Vec::new();
        let mut encoder = png::Encoder::new(&mut png, self.size[0] as u32, self.size[1] as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(&bytes)?;
        Ok(STANDARD.encode(png))
    }
}

/// A colour that the neighbours' ids do not have: the hue goes around by the golden ratio.
fn own_color(id: u32) -> [u8; 3] {
    let hue = f64::from(id.wrapping_mul(0x9e37_79b9)) / f64::from(u32::MAX);
    let channel = |shift: f64| {
        let wave = ((hue + shift).fract() * 6.0 - 3.0).abs() - 1.0;
        (90.0 + 150.0 * wave.clamp(0.0, 1.0)) as u8
    };
    [channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0)]
}

/// From blue through green to yellow and red.
pub(super) fn ramp(at: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 5] = [
        [70.0, 90.0, 190.0],
        [40.0, 160.0, 170.0],
        [110.0, 190.0, 80.0],
        [240.0, 200.0, 60.0],
        [220.0, 70.0, 60.0],
    ];
    let at = at.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let (first, part) = ((at as usize).min(STOPS.len() - 2), at - (at as usize).min(STOPS.len() - 2) as f64);
    std::array::from_fn(|channel| {
        (STOPS[first][channel] * (1.0 - part) + STOPS[first + 1][channel] * part) as u8
    })
}

/// A small picture by cluster.
pub(crate) fn thumbnail(path: &std::path::Path) -> Result<String> {
    look(&cmd::open(path)?, [240, 180], false)?.picture(Colors::Cluster)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_nearer_is_seen() {
        let camera = Camera::looking([0.0, 0.0, 10.0], [0.0; 3]);
        let size = [40, 40];
        let lens = Lens::new(&camera, size);
        let mut seen = Seen {
            size,
            member: vec![NOTHING; 1600],
            light: vec![0.0; 1600],
            near: vec![0.0; 1600],
            members: vec![(7, 0, 0.0), (8, 1, 1.0)],
            levels: 2,
            triangles: 2,
            error: 1.0,
        };
        let triangle = |z: f32, s: f32| [[-s, -s, z], [s, -s, z], [0.0, s, z]];
        seen.draw(&lens, triangle(0.0, 2.0), 0);
        seen.draw(&lens, triangle(1.0, 1.0), 1);
        seen.draw(&lens, triangle(-3.0, 9.0), 0);
        assert_eq!((seen.member[20 * 40 + 20], seen.member[0]), (1, NOTHING));
        assert!(
            seen.member.contains(&0) && seen.member.iter().filter(|member| **member != NOTHING).count() > 100
        );
        assert!(seen.light[20 * 40 + 20] > 0.8);
        for colors in [Colors::Cluster, Colors::Level, Colors::Error] {
            assert!(seen.picture(colors).unwrap().starts_with("iVBORw0KGgo"));
        }
    }

    #[test]
    fn the_ramp_has_ends() {
        assert_eq!((ramp(-1.0), ramp(2.0)), ([70, 90, 190], [220, 70, 60]));
        assert_ne!(own_color(1), own_color(2));
    }
}
