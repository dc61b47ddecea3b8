//! `chpm extract`: one crack-free mesh out of a file, or levels of detail, as a file of another program.

mod lods;

use super::{Verdict, open, reading};
use crate::further::{self, Effort};
use crate::json::{self, made, named};
use crate::memory::{self, MemoryArgs};
use crate::mesh_file::{self, MeshArgs, MeshFile, Ready};
use crate::number::{self, Triangles};
use crate::output;
use crate::progress::{Meter, line};
use crate::stop::{self, Stop};
use crate::threads::ThreadArgs;
use crate::tight;
use crate::view::{self, ImageArgs};
use anyhow::{Context, Error, Result, ensure};
use chpm_build::config::Length;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::Counted;
use chpm_refine::{Camera, Extraction, RefineError, Request};
use chpm_verify::certify::Further;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `chpm extract`.
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
          conflicts_with_all = ["error", "level", "lods"])]
    camera: Option<Camera>,
    #[command(flatten)]
    image: ImageArgs,
    /// Go on to coarser meshes while these are proven to be within --error, as by verify --errors: stored distances are farther from the truth the
    /// coarser a mesh is. Half of the triangles may be left; it takes ten seconds for a million triangles of the source, about
    #[arg(long, requires = "error", conflicts_with_all = ["triangles", "level", "poe", "lods"])]
    tight: bool,
    /// How long to look for a coarser mesh that is proven to be within --error: 0, not at all; 1, as --tight; 2, vertex by vertex from there on, a minute more at most, about;
    /// 3, as 2 without end. The last two hold the source in memory
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=3), requires = "error",
          conflicts_with_all = ["triangles", "level", "poe", "lods", "tight"])]
    effort: u8,
    #[command(flatten)]
    threads: ThreadArgs,
    #[command(flatten)]
    mesh: MeshArgs,
    /// Write the sheets of a file that has them, in images of N texels a side, as many as it takes: into a GLB, or beside a glTF, an OBJ or a binary PLY.
    /// Where one is enough, its texels are as fine as fit, up to the source's. Colours of vertices are left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(256..=16384),
          conflicts_with_all = ["tight", "effort", "up", "local_origin", "order"])]
    texture_size: Option<u32>,
    /// Write each level of --lods into a file of its own, x.lod0.glb, x.lod1.glb and so on. PLY, STL and OBJ are written so in any case
    #[arg(long, requires = "lods", conflicts_with_all = ["triangles", "error", "level", "poe"])]
    lods_apart: bool,
    /// Exit with 1 where the file gives less than was asked for; it is a warning if not given
    #[arg(long)]
    strict: bool,
    /// What was written as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Which mesh; one of these.
#[derive(clap::Args, Clone, Debug)]
#[group(required = true, multiple = false)]
struct Wanted {
    /// The finest mesh of at most N triangles, as in 20k, or of a share of the model's, as in 1%: of the least error everywhere, or in
    /// the image of the camera, and refined further where it is worst until they are used up
    #[arg(long, value_name = "N")]
    triangles: Option<Triangles>,
    /// The coarsest mesh that is nowhere farther than E from the source, nor the source from it, in the model's units or, as in 0.1%, of the
    /// diagonal of its box. Nothing is exempt: what has vanished counts by how far it is from what is left
    #[arg(long, value_name = "E", conflicts_with_all = ["viewport", "cull"])]
    error: Option<Length>,
    /// All clusters of level L at their finest; 0 is the source. Where a file has several roots, what has none of level L is at its root's
    /// finest
    #[arg(long, value_name = "L", value_parser = number::count(0..=u32::MAX), conflicts_with_all = ["viewport", "cull"])]
    level: Option<u32>,
    /// The coarsest mesh whose error covers at most P pixels, wherever it is seen by the camera
    #[arg(long, value_name = "P", value_parser = view::pixels)]
    poe: Option<f64>,
    /// Levels of detail, as in 50k,10k,2k: for each the finest mesh of at most N triangles, or of a share of the model's, the finest first. A glTF
    /// has all of them, by MSFT_lod; readers that do not know that show the finest
    #[arg(long, value_name = "N,N", value_delimiter = ',', conflicts_with_all = ["camera", "viewport", "cull"])]
    lods: Vec<Triangles>,
}

/// Selects and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    let free = memory::divide(&file, args.memory.memory(), args.mesh.memory("extract", &file)?);
    // What an order or images take is known only when the mesh is: then a refusal counts that, too, unless the mesh takes long to find.
    let is_plain = args.mesh.is_streamed() && args.texture_size.is_none();
    let is_early = is_plain || args.tight || args.effort > 0;
    let free = if is_early { free? } else { free.unwrap_or(0) };
    reading(&file, || match args.wanted.lods.is_empty() {
        true => take(&file, args, free, stop),
        false => lods::take(&file, args, free, stop),
    })
}

fn take(file: &Chpm<MappedFile>, args: &Args, free: u64, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    // Created before the selection, which may take a while: a place that cannot be written is told at once.
    let target = args.mesh.create("extract", &[&args.file])?;
    let mut out = output::messages([&target.output], args.json, args.quiet)?;
    check_textured(file, args, std::slice::from_ref(&target))?;
    let request = request(file, args)?;
    let lacks = || format!("'{}' does not have that", args.file.display());
    let (meter, rounding) = (Meter::new(args.quiet), target.rounding(file));
    let effort = args.effort.max(args.tight.into());
    let threads = (effort > 0).then_some(&args.threads);
    let cut = tight::cut(file, &request, (rounding, free), threads, &meter, &cancel);
    let (cut, proven) = cut.map_err(|error: Error| match error.downcast_ref() {
        Some(RefineError::Level { .. }) => error.context(lacks()),
        _ => error,
    })?;
    let further = match request.distance(file, rounding).and_then(|distance| Effort::of(effort, distance)) {
        Some(effort) => further::mesh(file, &cut, effort, free, &args.threads, (&meter, &cancel))?,
        None => None,
    };
    let mesh = Extraction::keeping(file, &cut, args.mesh.to_keep(free), || stop::check(&cancel))?;
    request.check(file, &mesh).with_context(lacks)?;
    let (mesh, proven) = match further {
        Some(Further { mesh: coarser, distance }) => (mesh.replaced(coarser, distance), Some(distance)),
        None => (mesh, proven),
    };
    // What its order, or its images, take is known only now.
    let images =
        args.texture_size.map_or(0, |side| mesh_file::textured_memory(file, side, mesh.triangle_count()));
    let bytes = args.mesh.memory("extract", file)? + args.mesh.order_memory(&mesh) + images;
    memory::divide(file, args.memory.memory(), bytes)?;
    let ready = Ready::new(target, file, &[&mesh], proven, &cancel)?;
    let (finest, upright) = (ready.finest(), ready.upright.clone());
    let bounds = finest.bounds;
    let shortfall = request.shortfall(file, &cut, bounds.distance);
    let less = shortfall.map(|less| less.describe(args.file.display(), file.header().aabb().diagonal()));
    let blurred = args.texture_size.is_none().then(|| mesh_file::without_images(file, &args.mesh)).flatten();
    let warnings: Vec<String> = ready.warnings.iter().cloned().chain(less).chain(blurred).collect();
    let extract = made::Extract {
        schema: "chpm-extract/1",
        file: named(&args.file),
        clusters: cut.members().len(),
        satisfied: shortfall.is_none(),
        warnings: warnings.clone(),
        mesh: ready.json(finest),
    };
    let written = match args.texture_size {
        Some(side) => ready.write_textured(file, &[&cut], side, &|_| Ok(()), &meter, &cancel)?,
        None => ready.write(file, &meter, &cancel)?,
    };
    written.publish()?;
    if args.json {
        json::print(&extract, &mut out)?;
    } else {
        let told = mesh_file::summary(&args.mesh.output, &mesh, bounds, "units");
        writeln!(out, "{told}, from {}", Counted(cut.members().len() as u64, "cluster"))?;
        upright.iter().try_for_each(|why| writeln!(out, "{why}"))?;
    }
    out.flush()?;
    warnings.iter().for_each(|warning| line(&format!("warning: {warning}")));
    Ok(if shortfall.is_some() && args.strict { Verdict::Faulty } else { Verdict::Good })
}

/// Refuses images that a file does not have, or formats.
fn check_textured(file: &Chpm<MappedFile>, args: &Args, targets: &[MeshFile<'_>]) -> Result<()> {
    if args.texture_size.is_some() {
        targets.iter().try_for_each(MeshFile::check_textured)?;
        let remedy = "build it with --texture sheets from a source with images";
        ensure!(file.header().has_sheets(), "'{}' has no sheets; {remedy}", args.file.display());
    }
    Ok(())
}

/// Request of the arguments.
fn request(file: &Chpm<MappedFile>, args: &Args) -> Result<Request> {
    let camera = args.camera.unwrap_or_else(|| view::framing(file));
    let view = |pixels| args.image.view(file, &camera, pixels);
    let Wanted { triangles, error, level, poe, .. } = args.wanted;
    Ok(match (triangles, error, poe) {
        (Some(triangles), ..) => {
            let view = args.camera.is_some().then(|| view(0.0)).transpose()?;
            Request::Triangles(triangles, view)
        }
        (_, Some(bound), _) => Request::Within(bound),
        (.., Some(pixels)) => Request::View(view(pixels)?),
        _ => Request::Level(level.unwrap_or(0)),
    })
}
