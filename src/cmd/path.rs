//! `chpm path`: makes a camera path for a file.

use super::{Verdict, open, reading};
use crate::memory::{self, MemoryArgs};
use crate::number;
use crate::output;
use crate::stop::Stop;
use crate::view;
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::Counted;
use chpm_refine::{Camera, CameraPath};
use clap::ValueEnum;
use std::io::Write;
use std::path::PathBuf;

/// What `chpm path` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The way of the camera
    #[arg(value_enum)]
    way: Way,
    /// The .chpm file that it goes around
    file: PathBuf,
    /// Frames
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = number::count(1_u32..=1_000_000))]
    frames: u32,
    /// Seed of the random way
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The path file to write; - for standard output
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

#[derive(Clone, Copy, ValueEnum, Debug)]
enum Way {
    /// Once around the y axis, the whole model in view
    Orbit,
    /// Straight towards the vertex of the coarsest mesh that has the largest z, to 1/500 of the distance
    Dive,
    /// Smoothly between random cameras in and around the model
    Random,
}

/// Makes and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    memory::divide(&file, args.memory.memory(), 0)?;
    reading(&file, || make(&file, args, stop))
}

fn make(file: &Chpm<MappedFile>, args: &Args, stop: &Stop) -> Result<Verdict> {
    let _cancel = stop.heed();
    let mut text = output::PATH.create(&args.output, args.force, &[&args.file])?;
    let mut out = output::messages([&text], false, false)?;
    let (bounds, frames) = (file.header().aabb(), args.frames as usize);
    let mut path = match args.way {
        Way::Orbit => CameraPath::orbit(&bounds, frames),
        Way::Dive => CameraPath::dive(&bounds, front(file)?, frames),
        Way::Random => CameraPath::random(&bounds, args.seed, frames),
    };
    let absolute = |camera: &mut Camera| *camera = view::from_file(file, camera);
    path.cameras.iter_mut().for_each(absolute);
    write!(text, "{path}")?;
    file.get_ref().check_unchanged()?;
    text.publish()?;
    writeln!(out, "{}: {}", args.output.display(), Counted(args.frames.into(), "frame"))?;
    out.flush()?;
    Ok(Verdict::Good)
}

/// The base vertex of the roots with the largest z.
fn front(file: &Chpm<MappedFile>) -> Result<[f64; 3]> {
    let mut front = [0.0, 0.0, f32::NEG_INFINITY];
    for root in file.roots() {
        let page = file.page(root)?;
        let page = page.view();
        let base = page.positions.get(..page.base_vertex_count).unwrap_or_default();
        front = base.iter().fold(front, |front, p| if p[2] > front[2] { *p } else { front });
    }
    Ok(front.map(f64::from))
}
