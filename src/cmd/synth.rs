//! `chpm synth`: a generated mesh as a PLY, streamed, whatever its size.

use super::{Verdict, stdout};
use crate::progress::Meter;
use crate::report::count;
use crate::stop::{self, Stop};
use anyhow::Result;
use chpm_build::Cancel;
use chpm_extmem::AtomicFile;
use chpm_mesh::Attributes;
use chpm_mesh::ply::{Encoding, PlyWriter};
use chpm_mesh::synth::{Shape, Synth};
use std::io::Write;
use std::path::{Path, PathBuf};

/// What `chpm synth` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// What to generate: terrain, isosurface, sphere, torus, plates
    #[arg(value_name = "NAME")]
    shape: Shape,
    /// Triangles to aim for; within 5 % from 3000 on
    #[arg(long, value_name = "N", default_value_t = 100_000,
          value_parser = clap::value_parser!(u64).range(1..=Synth::MAX_TRIANGLES))]
    triangles: u64,
    /// Another seed gives another terrain, isosurface or set of plates
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
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

/// Generates and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let encoding = if args.ascii { Encoding::Ascii } else { Encoding::BinaryLittleEndian };
    // Created before the mesh is planned, which may take a while: a place that cannot be written is told at once.
    let file = AtomicFile::create(&args.output, args.force)?;
    let synth = Synth::new(args.shape, args.triangles, args.seed);
    let comment = format!("chpm synth {} --triangles {} --seed {}", args.shape, args.triangles, args.seed);
    write(&synth, file, encoding, &comment, &Meter::new(args.quiet), &cancel)?;
    report(&args.output, &synth)?;
    Ok(Verdict::Good)
}

/// Streams `synth` into `file` and gives it its name.
pub(super) fn write(
    synth: &Synth,
    file: AtomicFile,
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
        anyhow::Ok(ply.vertices(batch, &[], &[])?)
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

fn report(path: &Path, synth: &Synth) -> Result<()> {
    let (vertices, triangles) = (count(synth.vertex_count()), count(synth.triangle_count()));
    let mut out = stdout();
    writeln!(out, "{}: {triangles} triangles, {vertices} vertices", path.display())?;
    out.flush()?;
    Ok(())
}
