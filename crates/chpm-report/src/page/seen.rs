//! A model as a picture shows it: as it is, or in colours of its clusters, levels or errors.

use super::raster::{Canvas, Lens, Spot};
use crate::colors::Colors;
use crate::error::ReportError;
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, Sheet};
use chpm_mesh::pm::is_alive;
use chpm_mesh::{ClusterId, Places};
use chpm_refine::{Camera, Cut, Hierarchy, Portrait, View, select_triangles};
use chpm_texture::sheet::Painted;
use nalgebra::Point3;

/// Triangles of a picture, about: some for each pixel of the model.
const TRIANGLES: u64 = 150_000;
/// A surface without colours of its own.
const PLAIN: [f32; 3] = [199.0, 194.0, 184.0];

/// Longest side, texels, that an image of a cluster is seen with: about the pixels of a picture, whatever the memory.
const LONGEST: u32 = 1024;
/// Opacity below which there is a hole.
const OPAQUE: f64 = 0.5;

/// Meaning of a picture's colours.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Shows {
    Surface,
    Cluster,
    Level,
    Error,
}

/// A model from the side that it shows best.
pub(super) struct Seen {
    canvas: Canvas,
    /// Id, level and error of each member of the cut.
    members: Vec<(u32, u32, f32)>,
    levels: u32,
    pub(super) triangles: u64,
    pub(super) error: f32,
}

/// Draws the cut of so many triangles. With `beside` the triangles are where an eye at the right needs them, so that levels differ.
pub(super) fn look(
    file: &Chpm<MappedFile>,
    portrait: &Portrait,
    size: [usize; 2],
    beside: bool,
) -> Result<Seen, ReportError> {
    let coarsest: u64 =
        file.roots().map(|root| u64::from(file.clusters()[root.index()].base_triangle_count)).sum();
    let camera = portrait.camera(size[0] as f64 / size[1] as f64);
    let limit = TRIANGLES.max(coarsest);
    let source = file.header().source_triangle_count;

    let cut = if beside {
        let limit = limit.min(source / 4).max(coarsest);
        let view = View::new(&eye_at_the_right(portrait, &camera), [512, 512], 0.0)?;
        select_triangles(file, &Hierarchy::new(file), &view, limit)?
    } else {
        Cut::at_triangles(file, limit)?
    };
    let mut seen = Seen {
        canvas: Canvas::new(size),
        members: Vec::new(),
        levels: file.header().level_count,
        triangles: cut.triangle_count(file)?,
        error: cut.error(file)?,
    };

    let lens = Lens::new(&camera, size, portrait.stretch());
    let mut places = Places::default();
    for member in cut.members() {
        let page = file.page(member.cluster)?;
        let page = page.view();
        let part = seen.members.len() as u32;
        let n = member.vertices as usize;
        let level = file.clusters()[member.cluster.index()].level;
        seen.members.push((member.cluster.0, level, page.error_at(n)));
        let image = image_of(file, member.cluster)?;
        places.go_to(&page.progressive_mesh(), n);
        for (triangle, corners) in (0..).zip(page.triangles) {
            let corners = corners.map(|corner| places.of(corner));
            if !is_alive(&corners) {
                continue;
            }
            let positions = corners.map(|corner| page.positions[usize::from(corner)]);
            let tints = corners.map(|corner| match page.colors.get(usize::from(corner)) {
                Some([r, g, b, _]) => [r, g, b].map(|channel| f32::from(*channel)),
                None => PLAIN,
            });
            seen.canvas.draw(&lens, positions, part, |spot: Spot| {
                let Some(image) = &image else { return Some(spot.mix(&tints)) };
                let point = spot.mix(&positions).map(f64::from);
                let [red, green, blue, alpha] = image.texel(triangle, point, spot.apart);
                (alpha >= OPAQUE).then(|| [red, green, blue].map(|channel| 255.0 * channel as f32))
            });
        }
    }
    Ok(seen)
}

/// The image of a cluster's surface, if it has one.
fn image_of(file: &Chpm<MappedFile>, cluster: ClusterId) -> Result<Option<Painted>, ReportError> {
    let Some(Sheet { record, layout, image }) = file.sheet(cluster)? else { return Ok(None) };
    let triangles = (layout.origin, layout.charts, layout.chart_of);
    let painted = Painted::new((image, record.size, LONGEST), record.texel, triangles);
    painted.map(Some).ok_or(ReportError::Image(cluster))
}

/// A camera at the model's right side, as it is shown, that looks through it.
fn eye_at_the_right(portrait: &Portrait, camera: &Camera) -> Camera {
    let [right, ..] = camera.axes();
    let frame = portrait.frame();
    let away = Point3::from(camera.position) - Point3::from(camera.target);
    let middle = frame.center();
    let eye = middle + right * (0.5 * frame.diagonal());
    // A single point, and what is lost beside its coordinates, is looked at from somewhere, too.
    let eye = if eye == middle { middle + right * away.norm() } else { eye };
    let [eye, middle] = [eye, middle].map(|point| point.coords.component_div(&portrait.stretch()).into());
    Camera::looking(eye, middle)
}

impl Seen {
    /// The picture, to be embedded.
    pub(super) fn picture(&self, shows: Shows) -> Result<String, ReportError> {
        let [low, high] = self.errors();
        let ramp = Colors::new([0.0, 1.0], false);
        self.canvas.picture(|part, tint| {
            let (id, level, error) = self.members[part as usize];
            let value = match shows {
                Shows::Surface => return tint.map(|channel| channel as u8),
                Shows::Cluster => return own_color(id),
                Shows::Level => f64::from(level) / f64::from(self.levels.max(2) - 1),
                Shows::Error => share(error, low, high),
            };
            let [r, g, b, _] = ramp.of(value);
            [r, g, b]
        })
    }

    /// The least and the largest error that is seen, apart from none.
    pub(super) fn errors(&self) -> [f64; 2] {
        let errors = self.members.iter().map(|(.., error)| f64::from(*error)).filter(|error| *error > 0.0);
        let (low, high) = errors.fold((f64::INFINITY, 0.0_f64), |(low, high), e| (low.min(e), high.max(e)));
        if low <= high { [low, high] } else { [0.0; 2] }
    }

    /// The highest level that there is.
    pub(super) fn top(&self) -> u32 {
        self.levels.max(1) - 1
    }
}

fn share(error: f32, low: f64, high: f64) -> f64 {
    match f64::from(error) {
        error if error > low && high > low => (error / low).ln() / (high / low).ln(),
        _ => 0.0,
    }
}

/// A colour that the neighbours' ids do not have: the hue goes around by the golden ratio.
fn own_color(id: u32) -> [u8; 3] {
    let hue = f64::from(id.wrapping_mul(0x9e37_79b9)) / f64::from(u32::MAX);
    [channel(0.0, hue), channel(2.0 / 3.0, hue), channel(1.0 / 3.0, hue)]
}

fn channel(shift: f64, hue: f64) -> u8 {
    let wave = ((hue + shift).fract() * 6.0 - 3.0).abs() - 1.0;
    (90.0 + 150.0 * wave.clamp(0.0, 1.0)) as u8
}

/// A small picture of a model as it is, to be embedded.
///
/// # Errors
/// Damage of the file.
pub fn thumbnail(file: &Chpm<MappedFile>) -> Result<String, ReportError> {
    look(file, &Portrait::of_file(file)?, [240, 180], false)?.picture(Shows::Surface)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_have_colors_of_their_own() {
        assert_ne!(own_color(1), own_color(2));
    }
}
