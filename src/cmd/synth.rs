//! `chpm synth`: a generated mesh as a PLY. Shapes are streamed, whatever their size; hard meshes are made in memory first.

use super::{Verdict, stdout};
use crate::number;
use crate::output::{self, Output};
use crate::progress::Meter;
use crate::report::count;
use crate::stop::{self, Stop};
use anyhow::{Result, ensure};
use chpm_build::Cancel;
use chpm_import::ply::{Encoding, PlyWriter};
use chpm_mesh::{Attributes, Counted, VertexSlices};
use chpm_synth::hard::{CASES, Case};
use chpm_synth::odd::{ODDS, Odd, Plan};
use chpm_synth::{ParseShapeError, Shape, Synth};
use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Triangles of a shape unless told otherwise.
const TRIANGLES: u64 = 100_000;
/// Vertices or triangles of a hard mesh that are written between two looks at the signals.
const BATCH: usize = 8192;

/// Arguments of `chpm synth`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// What to generate: terrain, isosurface, sphere, torus, plates, plant (pipes, bolts and tanks), or one of the meshes of --list as hard:NAME or odd:NAME
    #[arg(value_name = "NAME", required_unless_present = "list")]
    model: Option<Model>,
    /// List the meshes that are hard to simplify, with their size and what they are, and the odd shapes of any size
    #[arg(long, exclusive = true)]
    list: bool,
    /// Triangles to aim for: 100000 if not given, or what --list says. Shapes are within 5 % from 3000 on
    #[arg(long, value_name = "N", value_parser = number::count(1_u64..=Synth::MAX_TRIANGLES))]
    triangles: Option<u64>,
    /// Parts of a plant, each closed and apart from the others; one for each 2000 triangles if not given
    #[arg(long, value_name = "N", value_parser = number::count(1_u64..=Synth::MAX_PARTS))]
    parts: Option<u64>,
    /// Another seed gives another terrain, isosurface, set of plates or plant
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// The PLY to write; - for standard output
    #[arg(short, long, value_name = "FILE", required_unless_present = "list")]
    output: Option<PathBuf>,
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

/// A generated mesh by name.
#[derive(Clone, Copy)]
enum Model {
    Shape(Shape),
    Hard(&'static Case),
    Odd(&'static Odd),
}

impl fmt::Debug for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Model::Shape(shape) => write!(f, "{shape}"),
            Model::Hard(case) => write!(f, "hard:{}", case.name),
            Model::Odd(odd) => write!(f, "odd:{}", odd.name),
        }
    }
}

impl FromStr for Model {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(name) = text.strip_prefix("odd:") {
            return Odd::find(name)
                .map(Model::Odd)
                .ok_or_else(|| format!("'{name}' is no odd shape: `chpm synth --list` names them"));
        }
        let Some(name) = text.strip_prefix("hard:") else {
            return text.parse().map(Model::Shape).map_err(|error: ParseShapeError| error.to_string());
        };
        Case::find(name)
            .map(Model::Hard)
            .ok_or_else(|| format!("'{name}' is no hard mesh: `chpm synth --list` names them"))
    }
}

/// Generates and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    // The command line has both unless it asks for the list.
    let (Some(model), Some(output)) = (args.model, &args.output) else { return list() };
    ensure!(
        args.parts.is_none() || matches!(model, Model::Shape(Shape::Plant)),
        "--parts: only a plant has parts; leave it out, or generate a plant"
    );
    let cancel = stop.heed();
    let encoding = if args.ascii { Encoding::Ascii } else { Encoding::BinaryLittleEndian };
    // Created before the mesh is planned, which may take a while: a place that cannot be written is told at once.
    let file = output::SYNTH.create(output, args.force, &[])?;
    let mut out = output::messages([&file], false, args.quiet)?;
    let meter = Meter::new(args.quiet);
    match model {
        Model::Shape(shape) => {
            let triangles = args.triangles.unwrap_or(TRIANGLES);
            let (synth, parts) = match args.parts {
                Some(parts) => (Synth::plant(parts, triangles, args.seed), format!(" --parts {parts}")),
                None => (Synth::new(shape, triangles, args.seed), String::new()),
            };
            let comment = format!("chpm synth {shape} --triangles {triangles}{parts} --seed {}", args.seed);
            write(&synth, file, encoding, &comment, &meter, &cancel)?;
            report(output, synth.vertex_count(), synth.triangle_count(), &mut out)?;
        }
        Model::Hard(case) => {
            let triangles = args.triangles.unwrap_or(case.full.into()).min(Case::MAX_TRIANGLES.into());
            let (vertices, triangles) = write_case(case, triangles as u32, file, encoding, &meter, &cancel)?;
            report(output, vertices, triangles, &mut out)?;
        }
        Model::Odd(odd) => {
            let triangles = args.triangles.unwrap_or(TRIANGLES).min(Odd::MAX_TRIANGLES.into());
            let plan = odd.plan(triangles as u32);
            let comment = format!("chpm synth odd:{} --triangles {triangles}", odd.name);
            write_odd(&plan, file, encoding, &comment, &meter, &cancel)?;
            report(output, plan.vertices.into(), plan.triangles.into(), &mut out)?;
        }
    }
    Ok(Verdict::Good)
}

fn list() -> Result<Verdict> {
    let mut out = stdout();
    for case in &CASES {
        writeln!(out, "hard:{:<12}{:>10}  {}", case.name, count(case.full.into()), case.is)?;
    }
    for odd in &ODDS {
        writeln!(out, "odd:{:<13}{:>10}  {}", odd.name, count(TRIANGLES), odd.is)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

/// Streams `synth` into `file` and gives it its name.
pub(super) fn write(
    synth: &Synth,
    file: Output,
    encoding: Encoding,
    comment: &str,
    meter: &Meter,
    cancel: &Cancel,
) -> Result<()> {
    let (vertices, triangles) = (synth.vertex_count(), synth.triangle_count());
    meter.start("synth", vertices + triangles);
    let mut ply = PlyWriter::new(file, encoding, vertices, triangles, Attributes::NONE, false, &[comment])?;
    synth.for_each_vertices(&mut |batch| {
        stop::check(cancel)?;
        meter.add(batch.len() as u64);
        anyhow::Ok(ply.vertices(VertexSlices::new(batch))?)
    })?;
    synth.for_each_triangles(&mut |batch| {
        stop::check(cancel)?;
        meter.add(batch.len() as u64);
        anyhow::Ok(ply.triangles(batch)?)
    })?;
    ply.finish()?.publish()?;
    meter.finish();
    Ok(())
}

/// Writes a hard mesh and answers how many vertices and triangles it has; in doubles where it lies away from the origin.
fn write_case(
    case: &Case,
    triangles: u32,
    file: Output,
    encoding: Encoding,
    meter: &Meter,
    cancel: &Cancel,
) -> Result<(u64, u64)> {
    let mesh = case.mesh(triangles);
    let counts @ (vertices, faces) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let comment = format!("chpm synth hard:{} --triangles {triangles}", case.name);
    let is_double = case.offset != [0.0; 3];
    meter.start("synth", vertices + faces);
    let mut ply = PlyWriter::new(file, encoding, vertices, faces, Attributes::NONE, is_double, &[&comment])?;
    for batch in mesh.positions.chunks(BATCH) {
        stop::check(cancel)?;
        meter.add(batch.len() as u64);
        if is_double {
            let moved = batch.iter().map(|p| [0, 1, 2].map(|axis| f64::from(p[axis]) + case.offset[axis]));
            ply.vertices_f64(&moved.collect::<Vec<_>>(), VertexSlices::default())?;
        } else {
            ply.vertices(VertexSlices::new(batch))?;
        }
    }
    for batch in mesh.triangles.chunks(BATCH) {
        stop::check(cancel)?;
        meter.add(batch.len() as u64);
        ply.triangles(batch)?;
    }
    ply.finish()?.publish()?;
    meter.finish();
    Ok(counts)
}

/// Streams an odd shape.
fn write_odd(
    plan: &Plan,
    file: Output,
    encoding: Encoding,
    comment: &str,
    meter: &Meter,
    cancel: &Cancel,
) -> Result<()> {
    let (vertices, triangles) = (plan.vertices, plan.triangles);
    meter.start("synth", u64::from(vertices) + u64::from(triangles));
    let counts = (vertices.into(), triangles.into());
    let mut ply =
        PlyWriter::new(file, encoding, counts.0, counts.1, Attributes::NONE, plan.double, &[comment])?;
    let batches = |end: u32| (0..end).step_by(BATCH).map(move |first| first..end.min(first + BATCH as u32));
    for batch in batches(vertices) {
        stop::check(cancel)?;
        meter.add(batch.len() as u64);
        let places: Vec<[f64; 3]> = batch.map(|v| plan.place(v)).collect();
        if plan.double {
            ply.vertices_f64(&places, VertexSlices::default())?;
        } else {
            let singles: Vec<[f32; 3]> = places.iter().map(|p| p.map(|x| x as f32)).collect();
            ply.vertices(VertexSlices::new(&singles))?;
        }
    }
    for batch in batches(triangles) {
        stop::check(cancel)?;
        meter.add(batch.len() as u64);
        ply.triangles(&batch.map(|t| plan.corners(t)).collect::<Vec<_>>())?;
    }
    ply.finish()?.publish()?;
    meter.finish();
    Ok(())
}

fn report(path: &Path, vertices: u64, triangles: u64, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "{}: {}, {}", path.display(), Counted(triangles, "triangle"), Counted(vertices, "vertex"))?;
    out.flush()?;
    Ok(())
}
