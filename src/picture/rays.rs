//! Pictures by rays, as they are asked for.

use super::Degrees;
use crate::number;
use crate::threads::ThreadArgs;
use anyhow::{Result, bail};
use chpm_mesh::{Length, Scalar, scalar_places};
use chpm_rays::still::Paint;
use chpm_viewer::Coloring;

/// Options of pictures by rays.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Rays")]
pub(crate) struct RayArgs {
    /// Take the picture by rays, on the processors alone: no GPU and no driver is needed. Lights throw shadows, and where much is near it is darker. Of one model, in its own colours,
    /// one or those of a scalar; --memory is for the whole process
    #[arg(long, conflicts_with_all = ["second", "triangles", "no_occlusion", "ids", "wireframe", "one_sided", "adapter", "gpu_memory"])]
    pub(crate) rays: bool,
    /// No shadows
    #[arg(long, requires = "rays")]
    no_shadows: bool,
    /// Angle under which a light is seen: the wider, the softer its shadows; 0 for hard ones
    #[arg(long, value_name = "DEGREES", default_value = "4", value_parser = width, requires = "rays", conflicts_with = "no_shadows")]
    light_width: Degrees,
    /// How near what takes light from all around is, at most, in the model's units or, as in 5%, of the diagonal; 0 for none of it
    #[arg(long, value_name = "LENGTH", default_value = "15%", requires = "rays")]
    occlusion: Length,
    /// A ground that the model stands on, seen only by shadows on it; --studio has one, too. The background is light then if not given
    #[arg(long, requires = "rays")]
    ground: bool,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
}

fn width(text: &str) -> Result<Degrees, String> {
    let degrees: f64 = number::decimal(text)?;
    if degrees <= 120.0 { Ok(Degrees(degrees)) } else { Err(format!("'{text}' is wider than 120 degrees")) }
}

impl RayArgs {
    /// Whether lights throw shadows, their width in degrees, how far the light from everywhere is looked for, and whether there is a ground.
    pub(crate) fn light(&self, diagonal: f64, studio: bool) -> (bool, f64, f64, bool) {
        (!self.no_shadows, self.light_width.0, self.occlusion.of(diagonal), self.ground || studio)
    }
}

/// The meaning of colours; `color_by` is a scalar of the file, by its name.
pub(crate) fn paint(colors: Coloring, color_by: Option<&str>, scalars: &[Scalar]) -> Result<Paint> {
    if let Some((words, scalar)) = scalar_places(scalars).find(|(_, scalar)| Some(&*scalar.name) == color_by)
    {
        return Ok(Paint::Scalar(words, scalar.clone()));
    }
    match colors {
        Coloring::Plain => Ok(Paint::Plain),
        Coloring::Vertex => Ok(Paint::Own),
        other => bail!("--rays shows plain and vertex colours; leave it out for --color {}", other.name()),
    }
}
