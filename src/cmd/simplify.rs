//! `chpm simplify`: from a mesh to a smaller one that is proven to be near it, in one go.

use super::build::of;
use super::{Verdict, open, reading};
use crate::args::{NormalsArg, StorageArgs, build_memory};
use crate::further::{self, Effort};
use crate::json::{self, made, named};
use crate::memory;
use crate::mesh_file::{self, MeshArgs, Ready};
use crate::number::{AtMost, Triangles, Units};
use crate::output;
use crate::progress::{Meter, line};
use crate::stop::{self, Stop};
use crate::threads::ThreadArgs;
use crate::tight;
use crate::tolerance::{Tolerance, Unit};
use anyhow::{Result, ensure};
use chpm_build::config::{Normals, Texture};
use chpm_build::{BuildConfig, Resources, Settings};
use chpm_extmem::WorkDir;
use chpm_mesh::Counted;
use chpm_refine::{Extraction, Request};
use chpm_verify::certify::Further;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm simplify`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The mesh: what `chpm build` takes
    source: PathBuf,
    #[command(flatten)]
    wanted: Wanted,
    /// What one unit of the model is; needed only where --within has a unit
    #[arg(long, value_name = "UNIT", value_enum)]
    unit: Option<Unit>,
    /// How long to look for a coarser mesh that is proven to be within --within: 0, by the distances that were stored, at once; 1, also by
    /// proof, as by verify --errors: half of the triangles may be left, ten seconds for a million of the source, about; 2, vertex by vertex from there on: a quarter may be
    /// left, a minute more at most, about; 3, as 2 without end, and five times as many places are tried for each vertex: some percent less. If not given, 2, and 0 of more than 4 million triangles
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=3), requires = "within", conflicts_with = "triangles")]
    effort: Option<u8>,
    /// As --effort 1
    #[arg(long, requires = "within", conflicts_with_all = ["triangles", "effort"])]
    tight: bool,
    #[command(flatten)]
    mesh: MeshArgs,
    /// Which normals vertices have
    #[arg(long, value_name = "WHICH", value_enum, default_value_t = NormalsArg::Source, conflicts_with = "no_normals")]
    normals: NormalsArg,
    /// Keep the images of the source, in new ones of N texels a side, as many as it takes: into a GLB, or beside a glTF, an OBJ or a binary PLY. Where one
    /// is enough, its texels are as fine as fit, up to the source's. --effort is 1 at most then
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(256..=16384),
          conflicts_with_all = ["up", "local_origin", "order"])]
    texture_size: Option<u32>,
    /// What was written as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    /// Drop and count invalid vertices and faces instead of refusing the file
    #[arg(long)]
    drop_invalid: bool,
    #[command(flatten)]
    threads: ThreadArgs,
    #[command(flatten)]
    storage: StorageArgs,
}

/// How small; one of these.
#[derive(clap::Args, Debug)]
#[group(required = true, multiple = false)]
struct Wanted {
    /// The coarsest mesh that is nowhere farther than E from the original, nor the original from it: in the model's units, as in 0.5; in
    /// percent of the diagonal of its box, as in 0.05%; or, with --unit, as in 1mm. The bound is proven, and nothing is exempt
    #[arg(long, value_name = "E")]
    within: Option<Tolerance>,
    /// The finest mesh of at most N triangles, as in 20k, or of a share of the model's, as in 1%
    #[arg(long, value_name = "N")]
    triangles: Option<Triangles>,
}

/// The most effort after which triangles have places in images.
const WITH_IMAGES: u8 = 1;

/// Builds, extracts, and leaves only the result.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let bound = args.wanted.within.map(|within| within.length(args.unit)).transpose()?;
    let source = super::source(&args.source);
    // Whatever is refused is refused before the work.
    let target = args.mesh.create("simplify", &[source])?;
    let mut out = output::messages([&target.output], args.json, args.quiet)?;
    if args.texture_size.is_some() {
        target.check_textured()?;
        let effort = args.effort.unwrap_or(0);
        ensure!(
            effort <= WITH_IMAGES,
            "--texture-size goes with --effort {WITH_IMAGES} at most: what goes on from there has no place in images"
        );
    }

    // All of the work is in one folder, so that all of it goes.
    let beside = args.mesh.output.parent().filter(|_| !target.output.is_stream());
    let beside = beside.map(|place| if place == Path::new("") { Path::new(".") } else { place });
    let place = args.storage.work_dir.as_deref().or(beside).map_or_else(std::env::temp_dir, Path::to_owned);
    let folder = WorkDir::create(&place)?;
    let config = config(args)?;
    let (meter, model) = (Meter::new(args.quiet), folder.path().join("model.chpm"));
    let report =
        chpm_build::build(source, &model, &config, &meter, &cancel).map_err(|error| of(source, error))?;

    let file = open(&model)?;
    let has_images = args.texture_size.is_none() || file.header().has_sheets();
    ensure!(
        has_images,
        "'{}' names no images that could be kept: leave out --texture-size",
        source.display()
    );
    let free = memory::divide(&file, config.resources.memory, args.mesh.memory("simplify", &file)?)?;
    reading(&file, || {
        let diagonal = file.header().aabb().diagonal();
        let request = match (bound, args.wanted.triangles) {
            (Some(bound), _) => Request::Within(bound),
            (_, Some(triangles)) => Request::Triangles(triangles, None),
            _ => Request::Level(0),
        };
        let rounding = target.rounding(&file);
        let effort = further::level(args.effort.or(args.tight.then_some(1)), report.triangles);
        let effort = if args.texture_size.is_some() { effort.min(WITH_IMAGES) } else { effort };
        let threads = (effort > 0).then_some(&args.threads);
        let (cut, proven) = tight::cut(&file, &request, (rounding, free), threads, &meter, &cancel)?;
        let further =
            match request.distance(&file, rounding).and_then(|distance| Effort::of(effort, distance)) {
                Some(effort) => further::mesh(&file, &cut, effort, free, &args.threads, (&meter, &cancel))?,
                None => None,
            };
        let mesh = Extraction::keeping(&file, &cut, args.mesh.to_keep(free), || stop::check(&cancel))?;
        request.check(&file, &mesh)?;
        let (mesh, proven) = match further {
            Some(Further { mesh: coarser, distance }) => (mesh.replaced(coarser, distance), Some(distance)),
            None => (mesh, proven),
        };
        let is_whole = mesh.triangle_count() == file.header().source_triangle_count;
        // What its order, or its images, take is known only now.
        let images = args
            .texture_size
            .map_or(0, |side| mesh_file::textured_memory(&file, side, mesh.triangle_count()));
        let bytes = args.mesh.memory("simplify", &file)? + args.mesh.order_memory(&mesh) + images;
        memory::divide(&file, config.resources.memory, bytes)?;
        let ready = Ready::new(target, &file, &[&mesh], proven, &cancel)?;
        let (finest, upright) = (ready.finest(), ready.upright.clone());
        let bounds = finest.bounds;
        if let Some(asked) = bound.map(|bound| bound.of(diagonal)) {
            let (distance, asked) = (f64::from(bounds.distance), Units(asked));
            ensure!(
                distance <= asked.0 || !is_whole,
                "nothing is within {asked} units: what writing rounds is {}; ask for at least that",
                AtMost(distance)
            );
            ensure!(
                distance <= asked.0,
                "'{}' has no mesh that is proven to be within {asked} units: the nearest that was found is within {}",
                args.source.display(),
                AtMost(distance)
            );
        }
        let warnings = ready.warnings.clone();
        for warning in &warnings {
            line(&format!("warning: {warning}"));
        }
        let simplify = made::Simplify {
            schema: "chpm-simplify/1",
            source: named(&args.source),
            source_triangles: report.triangles,
            diagonal,
            unit: args.unit.map(Unit::symbol),
            warnings: report.warnings.iter().chain(&warnings).cloned().collect(),
            mesh: ready.json(finest),
        };
        let written = match args.texture_size {
            Some(side) => ready.write_textured(&file, &[&cut], side, &|_| Ok(()), &meter, &cancel)?,
            None => ready.write(&file, &meter, &cancel)?,
        };
        written.publish()?;
        if args.json {
            json::print(&simplify, &mut out)?;
            return Ok(out.flush()?);
        }
        let unit = args.unit.map_or("units", Unit::symbol);
        writeln!(
            out,
            "{}, of {}",
            mesh_file::summary(&args.mesh.output, &mesh, bounds, unit),
            Counted(report.triangles, "triangle")
        )?;
        let distance = AtMost(bounds.distance.into());
        let share = AtMost(100.0 * f64::from(bounds.distance) / diagonal);
        writeln!(
            out,
            "proven: no point of either is farther than {distance} {unit} from the other{}",
            if diagonal > 0.0 { format!(", {share}% of the diagonal") } else { String::new() }
        )?;
        upright.iter().try_for_each(|why| writeln!(out, "{why}"))?;
        for warning in &report.warnings {
            writeln!(out, "warning: {warning}")?;
        }
        Ok(out.flush()?)
    })?;
    Ok(Verdict::Good)
}

/// A build that keeps nothing and leaves nothing out: then what is proven is proven of the source.
fn config(args: &Args) -> Result<BuildConfig> {
    let memory = build_memory(args.storage.memory())?;
    let normals = if args.mesh.no_normals { Normals::None } else { args.normals.normals() };
    let (colors, drop_invalid) = (!args.mesh.no_colors || args.texture_size.is_some(), args.drop_invalid);
    let texture = if args.texture_size.is_some() { Texture::Sheets } else { Texture::FoundForVertices };
    let threads = args.threads.count();
    Ok(BuildConfig {
        settings: Settings { normals, colors, drop_invalid, texture, ..Settings::default() },
        resources: Resources { threads, memory, checkpoint: None, ..Resources::default() },
        overwrite: true,
    })
}
