//! Pictures on the command line: what to draw with, how it looks, and what became of it.

pub(crate) mod plot;
pub(crate) mod proof;
pub(crate) mod rays;
pub(crate) mod sheet;
pub(crate) mod sketch;
pub(crate) mod walk;

use crate::json::seen;
use crate::number;
use crate::output::Output;
pub(crate) use crate::shown::StanceArgs;
use anyhow::Result;
use chpm_mesh::Bytes;
use chpm_refine::Camera;
use chpm_viewer::{
    AdapterChoice, Budgets, Clip, Coloring, Gpu, Image, Look, Shading, Stats, Transform, Viewer,
};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

/// Choice of the GPU.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Drawing")]
pub(crate) struct DeviceArgs {
    /// Who draws: "best", "software", or a part of an adapter's name
    #[arg(long, value_name = "NAME", default_value = "best")]
    pub(crate) adapter: AdapterChoice,
    /// GPU memory for vertices, triangles and textures, as in 256M. A picture takes more beside it, which is not counted: about 14 bytes a pixel, in
    /// a window that smooths edges 32 more, and for shadows up to 64M
    #[arg(long, value_name = "SIZE", default_value = "512M")]
    pub(crate) gpu_memory: Bytes,
}

impl DeviceArgs {
    /// Opens a file to draw it; `memory` is for pages and what is made of them.
    pub(crate) fn open(&self, file: &Path, memory: Bytes) -> Result<Viewer> {
        self.open_all(&[(file, Transform::STILL)], memory)
    }

    /// Opens files to draw them in one picture, each put somewhere.
    pub(crate) fn open_all(&self, files: &[(&Path, Transform)], memory: Bytes) -> Result<Viewer> {
        self.open_on(self.gpu()?, files, memory)
    }

    /// The chosen GPU.
    pub(crate) fn gpu(&self) -> Result<Arc<Gpu>> {
        Ok(Arc::new(Gpu::headless(&self.adapter)?))
    }

    /// Like [`Self::open_all`], where what draws was found before.
    pub(crate) fn open_on(
        &self,
        gpu: Arc<Gpu>,
        files: &[(&Path, Transform)],
        memory: Bytes,
    ) -> Result<Viewer> {
        self.open_colored(gpu, files, memory, None)
    }

    /// Like [`Self::open_on`], with vertices in the colours of a named scalar.
    pub(crate) fn open_colored(
        &self,
        gpu: Arc<Gpu>,
        files: &[(&Path, Transform)],
        memory: Bytes,
        color_by: Option<&str>,
    ) -> Result<Viewer> {
        let budgets = Budgets { memory, gpu_memory: self.gpu_memory };
        Ok(Viewer::open_colored(gpu, files, budgets, color_by)?)
    }
}

/// How it looks.
#[derive(clap::Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Looks")]
pub(crate) struct LookArgs {
    /// What colours show
    #[arg(long, value_name = "WHAT", value_parser = coloring(), default_value = Coloring::default().name())]
    color: Coloring,
    /// How light falls on triangles
    #[arg(long, value_name = "HOW", value_parser = shading(), default_value = Shading::default().name())]
    shading: Shading,
    /// What `--shading smooth` was called
    #[arg(long, hide = true, conflicts_with = "shading")]
    smooth: bool,
    /// Edges over the faces
    #[arg(long)]
    wireframe: bool,
    /// Leave out triangles that are seen from behind; both sides are drawn if not given
    #[arg(long)]
    one_sided: bool,
    /// The colour behind the model
    #[arg(long, value_name = "RRGGBB", value_parser = rgb)]
    background: Option<[f32; 3]>,
}

/// Options of pictures without a window.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Looks")]
pub(crate) struct StillArgs {
    /// Pictures, each moved by a part of a pixel, whose mean is written: smooth edges; 1 has hard ones
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = number::count(1..=256_u32), conflicts_with = "ids")]
    pub(crate) samples: u32,
    /// The light of a studio: from the sky and a lamp, less of it in corners and on the ground below it. The background is light then if not given
    #[arg(long, conflicts_with = "ids")]
    pub(crate) studio: bool,
    /// Where the key light is, as seen from the model: degrees to the right of the eye, and above it (24,31 if not given). With --rays it may be given several times: all together are as
    /// bright as one
    #[arg(long, value_name = "RIGHT,UP", value_parser = light, allow_hyphen_values = true, conflicts_with = "ids")]
    pub(crate) light: Vec<Light>,
    /// Leave out what is beyond a plane: z:10 what is above z = 10, -z:10 what is below, NX,NY,NZ:OFFSET what is beyond any; in the model's
    /// coordinates. The cut stays open
    #[arg(long, value_name = "AXIS:PLACE", allow_hyphen_values = true)]
    pub(crate) clip: Option<Clip>,
    /// Turn the picture by so many degrees, counterclockwise
    #[arg(long, value_name = "DEGREES", default_value = "0", value_parser = degrees, allow_hyphen_values = true, conflicts_with = "studio")]
    pub(crate) roll: f64,
    /// Nothing behind the model: its PNG can lie over anything
    #[arg(long, conflicts_with_all = ["background", "ids"])]
    pub(crate) transparent: bool,
}

fn degrees(text: &str) -> Result<f64, String> {
    let degrees = text.trim().parse().ok().filter(|x: &f64| x.is_finite());
    degrees.ok_or_else(|| format!("'{text}' is no angle: write degrees, as in 15 or -7.5"))
}

/// Where a light is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Light(pub(crate) [f64; 2]);

/// An angle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Degrees(pub(crate) f64);

fn light(text: &str) -> Result<Light, String> {
    let (right, up) = text.split_once(',').ok_or_else(|| {
        format!("'{text}' is no place of a light: write degrees to the right and upward, as in 60,20")
    })?;
    Ok(Light([degrees(right)?, degrees(up)?]))
}

/// The background of a ground where none is told: shadows are not seen on a dark one.
const LIGHT: [f32; 3] = [0.93, 0.93, 0.92];

impl LookArgs {
    /// How it looks where shadows may have to be seen behind the model.
    pub(crate) fn look_on(&self, has_ground: bool) -> Look {
        let look = self.look();
        let background = if has_ground && self.background.is_none() { LIGHT } else { look.background };
        Look { background, ..look }
    }

    pub(crate) fn look(&self) -> Look {
        let default = Look::default();
        Look {
            shading: if self.smooth { Shading::Smooth } else { self.shading },
            colors: self.color,
            wireframe: self.wireframe,
            one_sided: self.one_sided,
            background: self.background.unwrap_or(default.background),
            ..default
        }
    }
}

/// Colours by their names.
fn coloring() -> impl TypedValueParser<Value = Coloring> {
    let names = Coloring::ALL.map(|(_, name, shows)| PossibleValue::new(name).help(shows));
    PossibleValuesParser::new(names).map(|name| Coloring::named(&name).unwrap_or_default())
}

/// Ways of shading by their names.
pub(crate) fn shading() -> impl TypedValueParser<Value = Shading> {
    let names = Shading::ALL.map(|(_, name, does)| PossibleValue::new(name).help(does));
    PossibleValuesParser::new(names).map(|name| Shading::named(&name).unwrap_or_default())
}

/// `ff8000`, with or without a `#`.
fn rgb(text: &str) -> Result<[f32; 3], String> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let is_hex = digits.len() == 6 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    let number = if is_hex { u32::from_str_radix(digits, 16).ok() } else { None };
    let number = number.ok_or_else(|| format!("'{text}' is no colour: write RRGGBB, as in ffffff"))?;
    Ok([16, 8, 0].map(|shift| (number >> shift & 0xff) as f32 / 255.0))
}

/// A camera, for programs.
pub(crate) fn camera_as_json(camera: &Camera) -> seen::Camera {
    let Camera { position, target, up, fov, .. } = *camera;
    seen::Camera { position, target, up, fov }
}

/// Writes a PNG, which appears when it is published.
pub(crate) fn write_png(image: &Image, file: Output) -> Result<Output> {
    let mut png = BufWriter::new(file);
    image.write_png(&mut png)?;
    png.flush()?;
    Ok(png.into_inner().map_err(|error| error.into_error())?)
}

/// Statistics of a frame, for programs.
pub(crate) fn as_json(stats: &Stats) -> seen::Frame {
    let ms = |time: std::time::Duration| 1e3 * time.as_secs_f64();
    let times = &stats.times;
    let parts = [
        ("refine", times.refine),
        ("pm", times.pm),
        ("upload", times.upload),
        ("occlusion", times.occlusion),
        ("draw", times.draw),
        ("stall", times.stall),
        ("total", times.total),
    ];

    seen::Frame {
        poe: stats.poe,
        triangles: stats.triangles,
        clusters_active: stats.clusters_active,
        clusters_drawn: stats.clusters_drawn,
        frustum_culled: stats.frustum_culled,
        occluded: stats.occluded,
        newly_visible: stats.newly_visible,
        tested: stats.tested,
        splits: stats.splits,
        collapses: stats.collapses,
        pm_steps: stats.pm_steps,
        withheld: stats.withheld,
        unpainted: stats.unpainted,
        resident_bytes: stats.resident_bytes,
        gpu_bytes: stats.gpu_bytes,
        uploaded_bytes: stats.uploaded_bytes,
        requested_bytes: stats.requested_bytes,
        stalls: stats.stalls,
        rounds: stats.rounds,
        milliseconds: parts.into_iter().map(|(name, time)| (name.to_owned(), ms(time).into())).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_six_digits() {
        assert_eq!(rgb("ff0080"), Ok([1.0, 0.0, 128.0 / 255.0]));
        assert_eq!(rgb("#000000"), Ok([0.0; 3]));
        assert!(["", "fff", "+12345", "gggggg", "fffffff"].iter().all(|bad| rgb(bad).is_err()));
    }
}
