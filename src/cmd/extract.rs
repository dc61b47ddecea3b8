//! `chpm extract`: one crack-free mesh out of a file, as a file of another program.

use super::{Verdict, open, reading};
use crate::memory::{self, MemoryArgs};
use crate::mesh_file::{self, MeshArgs};
use crate::number::{self, Triangles, Units};
use crate::output;
use crate::progress::{Meter, line};
use crate::report::count;
use crate::stop::Stop;
use crate::view::{self, ImageArgs};
use anyhow::{Result, ensure};
use chpm_build::config::Length;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Counted, Level};
use chpm_refine::{Camera, Cut, Extraction, Hierarchy, Member, View, is_visible, select, select_triangles};
use std::io::Write;
use std::path::PathBuf;

/// What `chpm extract` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    #[command(flatten)]
    wanted: Wanted,
    /// Where the picture is taken from, in the model's coordinates: position, target, and the vertical field of view in degrees (45 if
    /// not given); +y is upward. If not given, the whole model is looked at along the z axis, from its positive end: at the middle of
    /// the box, from where the sphere around the box fits the field of view
    #[arg(long, value_name = "PX,PY,PZ,TX,TY,TZ[,FOV]", value_parser = view::camera, allow_hyphen_values = true,
          conflicts_with_all = ["error", "level"])]
    camera: Option<Camera>,
    #[command(flatten)]
    image: ImageArgs,
    #[command(flatten)]
    mesh: MeshArgs,
    /// Exit with 1 where the file gives less than was asked for; it is a warning if not given
    #[arg(long)]
    strict: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Which mesh; one of these.
#[derive(clap::Args, Debug)]
#[group(required = true, multiple = false)]
struct Wanted {
    /// The finest mesh of at most N triangles, as in 20k, or of a share of the model's, as in 1%: of the least error everywhere, or in
    /// the image of the camera, and refined further where it is worst until they are used up
    #[arg(long, value_name = "N")]
    triangles: Option<Triangles>,
    /// The coarsest mesh that is nowhere farther than E from the source, nor the source from it, in the model's units or, as in 0.1%, of the
    /// diagonal of its box. Nothing is exempt: what has vanished counts by how far it is from what is left
    #[arg(long, value_name = "E")]
    error: Option<Length>,
    /// All clusters of level L at their finest; 0 is the source. Where a file has several roots, what has none of level L is at its root's
    /// finest
    #[arg(long, value_name = "L", value_parser = number::count(0..=u32::MAX))]
    level: Option<u32>,
    /// The coarsest mesh whose error covers at most P pixels, wherever it is seen by the camera
    #[arg(long, value_name = "P", value_parser = view::pixels)]
    poe: Option<f64>,
}

/// Selects and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    memory::divide(&file, args.memory.memory(), args.mesh.memory("extract", &file)?)?;
    reading(&file, || take(&file, args, stop))
}

fn take(file: &Chpm<MappedFile>, args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    // Created before the selection, which may take a while: a place that cannot be written is told at once.
    let target = args.mesh.create("extract", &[&args.file])?;
    let mut out = output::messages([&target.output], false, args.quiet)?;
    let cut = cut(file, args, target.rounding(file))?;
    let mesh = Extraction::new(file, &cut)?;
    let model = file.header().source_triangle_count;
    if let Some(limit) = args.wanted.triangles.map(|wanted| wanted.of(model)) {
        let least = mesh.triangle_count();
        ensure!(
            least <= limit,
            "the coarsest mesh of '{}' has {}; ask for at least as many",
            args.file.display(),
            Counted(least, "triangle")
        );
    }
    let bounds = target.bounds(file, &cut)?;
    if let Some(warning) = target.warning(file) {
        line(&format!("warning: {warning}"));
    }
    target.write(file, &mesh, bounds, &Meter::new(args.quiet), &cancel)?;
    let told = mesh_file::told(&args.mesh.output, &mesh, bounds, "units");
    writeln!(out, "{told}, from {}", Counted(cut.members().len() as u64, "cluster"))?;
    out.flush()?;
    let shortfall = shortfall(file, args, &cut, bounds.distance)?;
    if let Some(shortfall) = &shortfall {
        line(&format!("warning: {shortfall}"));
    }
    Ok(if shortfall.is_some() && args.strict { Verdict::Faulty } else { Verdict::Good })
}

/// What was asked for and the file does not have.
fn shortfall(file: &Chpm<MappedFile>, args: &Args, cut: &Cut, distance: f32) -> Result<Option<String>> {
    let (wanted, name) = (&args.wanted, args.file.display());
    let (model, diagonal) = (file.header().source_triangle_count, file.header().aabb().diagonal());
    if let Some(bound) = wanted.error.filter(|bound| distance > bound.of(diagonal) as f32) {
        let (least, asked) = (Units(distance.into()), number::told(bound, diagonal));
        return Ok(Some(format!("the finest mesh of '{name}' has an error of {least}, more than {asked}")));
    }
    if wanted.error.is_some() && !file.has_gaps() {
        return Ok(Some(format!(
            "'{name}' is of version 1.0, which does not tell how far what has vanished is: components that are missing may be \
             farther than was asked; build it again"
        )));
    }
    if let Some(Triangles::Count(asked)) = wanted.triangles.filter(|wanted| wanted.of(model) > model) {
        let (model, asked) = (Counted(model, "triangle"), count(asked));
        return Ok(Some(format!("the finest mesh of '{name}' has {model}, fewer than {asked}")));
    }
    let Some(pixels) = wanted.poe.filter(|_| args.image.cull) else { return Ok(None) };
    let view = view(file, args, pixels)?;
    let seen = |member: &Member| is_visible(&file.clusters()[member.cluster.index()], &view);
    let nothing = || format!("nothing of '{name}' is in the image: all of it is as coarse as it gets");
    Ok((!cut.members().iter().any(seen)).then(nothing))
}

fn view(file: &Chpm<MappedFile>, args: &Args, pixels: f64) -> Result<View> {
    let camera = args.camera.unwrap_or_else(|| view::framing(file));
    args.image.view(file, &camera, pixels)
}

/// What was asked for; where it is a distance, what the output rounds is a part of it.
fn cut(file: &Chpm<MappedFile>, args: &Args, rounding: f64) -> Result<Cut> {
    let wanted = &args.wanted;
    if let Some(pixels) = wanted.poe {
        return Ok(select(file, &Hierarchy::new(file), &view(file, args, pixels)?)?);
    }
    let limit = wanted.triangles.map(|wanted| wanted.of(file.header().source_triangle_count));
    if let (Some(limit), Some(_)) = (limit, args.camera) {
        return Ok(select_triangles(file, &Hierarchy::new(file), &view(file, args, 0.0)?, limit)?);
    }
    let diagonal = file.header().aabb().diagonal();
    Ok(match (limit, wanted.error, wanted.level) {
        (Some(limit), ..) => Cut::at_triangles(file, limit)?,
        (_, Some(bound), _) => Cut::at_distance(file, mesh_file::less(bound.of(diagonal), rounding))?,
        (_, _, level) => Cut::at_level(file, existing(file, args, level.unwrap_or(0))?),
    })
}

fn existing(file: &Chpm<MappedFile>, args: &Args, level: u32) -> Result<Level> {
    let (highest, name) = (file.header().level_count - 1, args.file.display());
    ensure!(level <= highest, "'{name}' has no level {level}: the highest is {highest}, the coarsest mesh");
    Ok(Level(level))
}
