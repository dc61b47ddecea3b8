//! `chpm path`: makes a camera path for a file.

use super::{Verdict, check_unchanged, open, reading};
use crate::memory::{self, MemoryArgs};
use crate::number;
use crate::output;
use crate::stop::Stop;
use crate::view;
use anyhow::Result;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::Counted;
use chpm_refine::{Camera, CameraPath, Outline, Portrait};
use clap::ValueEnum;
use std::io::Write;
use std::path::PathBuf;

/// Width by height of the images that a path is made for: what fits a square fits whatever is wider, too.
const ASPECT: f64 = 1.0;
/// Bytes of a coarse mesh, and of what is found out about it, at most.
const OUTLINE: u64 = 16 << 20;
/// Sides from which an orbit has to see the whole model.
const SIDES: u32 = 72;

/// Arguments of `chpm path`.
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
    /// Once around the model as it stands, from the side that `render` shows, the whole model in view
    Orbit,
    /// From there straight towards the nearest vertex of the coarsest mesh, to 1/500 of the distance
    Dive,
    /// Smoothly between random cameras in and around the model
    Random,
}

/// Makes and writes.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    memory::divide(&file, args.memory.memory(), OUTLINE)?;
    reading(&file, || make(&file, args, stop))
}

fn make(file: &Chpm<MappedFile>, args: &Args, stop: &Stop) -> Result<Verdict> {
    let _cancel = stop.heed();
    let mut text = output::PATH.create(&args.output, args.force, &[&args.file])?;
    let mut out = output::messages([&text], false, false)?;
    // In the model's own coordinates, whatever heights mean there.
    let portrait = Portrait::new(Outline::of_file(file)?, file.header().aabb(), None, None);
    let frames = args.frames as usize;
    let up: [f64; 3] = portrait.stance().up().vector().into();
    let mut path = match args.way {
        Way::Orbit => {
            // From one distance, at which it fits from every side.
            let start = portrait.turn(ASPECT, SIDES.min(args.frames)).into_iter().next();
            start.map(|start| CameraPath::around(&start, frames)).unwrap_or_default()
        }
        Way::Dive => {
            let start = portrait.camera(ASPECT);
            CameraPath::towards(&start, nearest(file, &portrait)?, frames)
        }
        Way::Random => CameraPath::random(&portrait.frame(), args.seed, frames),
    };
    for camera in &mut path.cameras {
        *camera = Camera { up, ..view::from_file(file, camera) };
    }
    write!(text, "{path}")?;
    check_unchanged(file)?;
    text.publish()?;
    writeln!(out, "{}: {}", args.output.display(), Counted(args.frames.into(), "frame"))?;
    out.flush()?;
    Ok(Verdict::Good)
}

/// How far along a direction a point lies.
fn along(point: &[f32; 3], sight: &[f64; 3]) -> f64 {
    (0..3).map(|axis| f64::from(point[axis]) * sight[axis]).sum()
}

/// The base vertex of the roots that is nearest to who looks at the model.
fn nearest(file: &Chpm<MappedFile>, portrait: &Portrait) -> Result<[f64; 3]> {
    let (frame, sight) = (portrait.frame(), portrait.stance().sight().into());
    let is_framed = |p: &[f32; 3]| (0..3).all(|axis| (frame.min[axis]..=frame.max[axis]).contains(&p[axis]));
    let mut nearest = None;
    for root in file.roots() {
        let page = file.page(root)?;
        let page = page.view();
        let base = page.positions.get(..page.base_vertex_count).unwrap_or_default();
        for point in base.iter().filter(|point| is_framed(point)) {
            if nearest.is_none_or(|nearest| along(point, &sight) < along(&nearest, &sight)) {
                nearest = Some(*point);
            }
        }
    }
    Ok(nearest.map_or(frame.center().into(), |point| point.map(f64::from)))
}
