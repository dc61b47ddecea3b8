//! `chpm extract`: one crack-free mesh out of a file, as a PLY.

use super::{Verdict, open, stdout};
use crate::progress::Meter;
use crate::report::count;
use crate::stop::{self, Stop};
use crate::view::{self, ImageArgs};
use anyhow::{Result, ensure};
use chpm_build::Cancel;
use chpm_extmem::{AtomicFile, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::Level;
use chpm_mesh::ply::{Encoding, PlyWriter};
use chpm_refine::{Camera, Cut, Extraction, Hierarchy, select, select_triangles};
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
    /// The PLY to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Write text instead of binary little endian
    #[arg(long)]
    ascii: bool,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
}

/// Which mesh; one of these.
#[derive(clap::Args, Debug)]
#[group(required = true, multiple = false)]
struct Wanted {
    /// The finest mesh of at most N triangles: of the least error everywhere, or in the image of the camera, and refined further where it is
    /// worst until they are used up
    #[arg(long, value_name = "N")]
    triangles: Option<u64>,
    /// The coarsest mesh whose error is at most E, in the model's units
    #[arg(long, value_name = "E", value_parser = error_bound)]
    error: Option<f32>,
    /// All clusters of level L at their finest; 0 is the source
    #[arg(long, value_name = "L")]
    level: Option<u32>,
    /// The coarsest mesh whose error covers at most P pixels, wherever it is seen by the camera
    #[arg(long, value_name = "P", value_parser = view::pixels)]
    poe: Option<f64>,
}

fn error_bound(text: &str) -> Result<f32, String> {
    let bound: f32 = text.parse().map_err(|_| format!("'{text}' is not a number"))?;
    if bound >= 0.0 { Ok(bound) } else { Err(format!("an error is at least 0, not {text}")) }
}

/// Selects and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    let cancel = stop.heed();
    // Created before the selection, which may take a while: a place that cannot be written is told at once.
    let ply = AtomicFile::create(&args.output, args.force)?;
    let cut = cut(&file, args)?;
    let mesh = Extraction::new(&file, &cut)?;
    if let Some(limit) = args.wanted.triangles {
        let least = mesh.triangle_count();
        ensure!(
            least <= limit,
            "the coarsest mesh of the file has {least} triangles; ask for at least as many"
        );
    }
    let error = cut.error(&file)?;
    let comment = format!("chpm extract, error {error:e}");
    write(&mesh, ply, args, &comment, &cancel)?;
    let mut out = stdout();
    writeln!(
        out,
        "{}: {} triangles, {} vertices, error {error:.3e}, from {} clusters",
        args.output.display(),
        count(mesh.triangle_count()),
        count(mesh.vertex_count().into()),
        count(cut.members().len() as u64),
    )?;
    out.flush()?;
    Ok(Verdict::Good)
}

fn cut(file: &Chpm<MappedFile>, args: &Args) -> Result<Cut> {
    let wanted = &args.wanted;
    let view = |pixels| {
        let camera = args.camera.unwrap_or_else(|| view::framing(file));
        args.image.view(file, &camera, pixels)
    };
    if let Some(pixels) = wanted.poe {
        return Ok(select(file, &Hierarchy::new(file), &view(pixels)?)?);
    }
    if let (Some(limit), Some(_)) = (wanted.triangles, args.camera) {
        return Ok(select_triangles(file, &Hierarchy::new(file), &view(0.0)?, limit)?);
    }
    Ok(match (wanted.triangles, wanted.error, wanted.level) {
        (Some(limit), ..) => Cut::at_triangles(file, limit)?,
        (_, Some(bound), _) => Cut::at_error(file, bound)?,
        (_, _, level) => Cut::at_level(file, Level(level.unwrap_or(0))),
    })
}

/// Streams the mesh, in doubles if the model is far from the zero point: single precision would move vertices there.
fn write(
    mesh: &Extraction<'_, MappedFile>,
    file: AtomicFile,
    args: &Args,
    comment: &str,
    cancel: &Cancel,
) -> Result<()> {
    let encoding = if args.ascii { Encoding::Ascii } else { Encoding::BinaryLittleEndian };
    let (vertices, triangles) = (u64::from(mesh.vertex_count()), mesh.triangle_count());
    let origin = mesh.origin();
    let meter = Meter::new(args.quiet);
    meter.start("extract", vertices + triangles);
    let mut ply =
        PlyWriter::new(file, encoding, vertices, triangles, mesh.attributes(), origin.is_some(), &[comment])?;
    let mut absolute = Vec::new();
    mesh.vertices(|batch| {
        stop::check(cancel)?;
        meter.add(batch.positions.len() as u64);
        if let Some(origin) = origin {
            absolute.clear();
            absolute.extend(batch.absolute(origin));
            ply.vertices_f64(&absolute, batch.normals, batch.colors)?;
        } else {
            ply.vertices(batch.positions, batch.normals, batch.colors)?;
        }
        anyhow::Ok(())
    })?;
    mesh.triangles(|batch| {
        stop::check(cancel)?;
        meter.add(batch.len() as u64);
        anyhow::Ok(ply.triangles(batch)?)
    })?;
    ply.finish()?.publish()?;
    meter.finish();
    Ok(())
}
