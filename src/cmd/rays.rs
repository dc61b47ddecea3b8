//! `chpm rays`: what rays of a file meet.

use super::{Verdict, open, reading};
use crate::json::{self, made, named};
use crate::memory::{self, MemoryArgs};
use crate::number::AtMost;
use crate::output::{self, Output, Promise, Writes};
use crate::progress::Meter;
use crate::rays::{Answered, HitWriter, RayFile};
use crate::report::count;
use crate::stop::{self, Stop};
use crate::threads::ThreadArgs;
use anyhow::{Context, Result, bail};
use chpm_build::Cancel;
use chpm_build::config::Length;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, Counted};
use chpm_rays::{Bound, Caster, Memory, Ray, Seek};
use rayon::ThreadPool;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm rays`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The rays: text with x,y,z of the origin and of the direction on each line, and if wanted how far the ray goes, in the model's units; or an array of NumPy (.npy) of the shape (n, 6) or (n, 7)
    rays: PathBuf,
    /// How wrong the mesh may be that the rays meet, in the model's units or, as in 0.1%, of the diagonal. 0 is the source's own triangles: hits and misses are the source's. Of a coarse mesh each
    /// ray is told a distance before which it certainly does not meet the source, infinite for a proven miss; its hit is not proven
    #[arg(long, value_name = "E", default_value = "0")]
    error: Length,
    /// Only whether a ray meets anything: faster
    #[arg(long)]
    any: bool,
    /// Write a row for each ray: whether it hits, distance, point, normal, cluster, triangle, and with --error the least distance of the source. .csv or .npy; CSV where the
    /// name says nothing; - for standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replace the output if it exists
    #[arg(short, long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadArgs,
    /// The summary as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Casts, and writes what is asked for.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let inputs = [args.file.as_path(), args.rays.as_path()];
    let target = args.output.as_deref().map(|path| create(path, args.force, &inputs)).transpose()?;
    let mut out = output::messages(target.as_ref().map(|(_, output)| output), args.json, args.quiet)?;
    let cancel = stop.heed();
    let file = open(&args.file)?;
    let own = Memory::own(&file);
    let (pool, free) = memory::workers(&args.threads, &file, args.memory.memory(), own, Memory::THREAD)?;
    let memory = Memory::divide(Bytes(free), pool.current_num_threads());
    let work = Work { args, file: &file, pool: &pool, memory, cancel: &cancel };

    let (told, target) = reading(&file, || work.cast(target))?;
    if let Some(target) = target {
        target.publish()?;
    }
    if args.json {
        json::print(&told, &mut out)?;
    } else {
        print(&told, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

fn create(path: &Path, force: bool, inputs: &[&Path]) -> Result<(Writes, Output)> {
    let [csv, npy] = output::RAYS;
    let writes = match output::promised(path) {
        Promise::Nothing => csv,
        Promise::Format(format) if format == csv.format() => csv,
        Promise::Format(format) if format == npy.format() => npy,
        _ => bail!(
            "rays writes CSV and NumPy, and {}: choose another, or leave the extension out",
            output::otherwise(path)
        ),
    };
    Ok((writes, writes.create(path, force, inputs)?))
}

struct Work<'w> {
    args: &'w Args,
    file: &'w Chpm<MappedFile>,
    pool: &'w ThreadPool,
    memory: Memory,
    cancel: &'w Cancel,
}

impl Work<'_> {
    fn cast(&self, target: Option<(Writes, Output)>) -> Result<(made::Rays, Option<Output>)> {
        let Work { args, file, cancel, .. } = *self;
        let origin = file.header().origin;
        let error = args.error.of(file.header().aabb().diagonal());
        let bound = if error > 0.0 { Bound::within(error) } else { Bound::LEAVES };
        // All of them once, so that nothing is begun that a bad row would end.
        let total = self.each(origin, |_| Ok(()))?;

        let mut caster = Caster::new(file, self.memory);
        let distance = match caster.distance(&bound) {
            Err(error) if !bound.is_leaves() => return Err(error).context("no coarse mesh proves anything"),
            distance => distance.ok(),
        };
        let meter = Meter::new(args.quiet);
        meter.start("rays", total);
        let mut told = made::Rays {
            schema: "chpm-rays/1",
            file: named(&args.file),
            rays: named(&args.rays),
            output: args.output.as_deref().map(named),
            format: target.as_ref().map(|(writes, _)| writes.format()),
            error,
            distance,
            any: args.any,
            count: total,
            hits: 0,
            misses: 0,
            proven_misses: 0,
            nearest: None,
            farthest: None,
            pages: 0,
            page_bytes: 0,
            pages_different: 0,
        };
        let (is_array, mut target) = match target {
            Some((writes, output)) => (writes.format() == output::RAYS[1].format(), Some(output)),
            None => (false, None),
        };
        let writer = match &mut target {
            Some(out) => Some(HitWriter::begin(is_array, !bound.is_leaves(), args.any, origin, total, out)?),
            None => None,
        };

        let seek = if args.any { Seek::Any } else { Seek::Nearest };
        let go_on = memory::go_on(cancel);
        self.each(origin, |rays| {
            let mut answers: Vec<Answered> = Vec::with_capacity(rays.len());
            self.pool.install(|| {
                caster.cast(rays, &bound, seek, &go_on, |hit, _| answers.push(Answered { hit, least: None }))
            })?;
            if let Some(distance) = distance.filter(|_| !bound.is_leaves()) {
                let mut place = 0;
                self.pool.install(|| {
                    caster.cast(rays, &bound, Seek::Within(distance), &go_on, |_, least| {
                        answers[place].least = Some(least);
                        place += 1;
                    })
                })?;
            }
            for answered in &answers {
                told.add(answered, bound.is_leaves(), args.any);
                if let (Some(writer), Some(out)) = (&writer, &mut target) {
                    writer.add(answered, out)?;
                }
            }
            meter.add(rays.len() as u64);
            stop::check(cancel)
        })?;
        meter.finish();
        let reads = caster.reads();
        (told.pages, told.page_bytes, told.pages_different) = (reads.pages, reads.bytes, reads.different);
        Ok((told, target))
    }

    /// Hands out all rays, some at a time; answers how many there are.
    fn each(&self, origin: [f64; 3], mut each: impl FnMut(&[Ray]) -> Result<()>) -> Result<u64> {
        let mut from = RayFile::open(&self.args.rays)?;
        let (mut rays, mut total) = (Vec::new(), 0);
        loop {
            rays.clear();
            from.next(self.memory.rays, origin, &mut rays)?;
            if rays.is_empty() {
                return Ok(total);
            }
            total += rays.len() as u64;
            stop::check(self.cancel)?;
            each(&rays)?;
        }
    }
}

impl made::Rays {
    fn add(&mut self, answered: &Answered, is_proven: bool, any: bool) {
        match answered.hit {
            Some(hit) => {
                self.hits += 1;
                if !any {
                    self.nearest = Some(self.nearest.map_or(hit.distance, |least| least.min(hit.distance)));
                    self.farthest = Some(self.farthest.map_or(hit.distance, |most| most.max(hit.distance)));
                }
            }
            None => self.misses += 1,
        }
        let is_miss = answered.least.map_or(is_proven && answered.hit.is_none(), f64::is_infinite);
        self.proven_misses += u64::from(is_miss);
    }
}

fn print(told: &made::Rays, out: &mut impl Write) -> Result<()> {
    let made::Rays { hits, misses, proven_misses, pages, page_bytes, pages_different, .. } = *told;
    writeln!(out, "{}: {} hit, {} miss", Counted(told.count, "ray"), count(hits), count(misses))?;
    match told.distance {
        Some(distance) if told.error > 0.0 => writeln!(
            out,
            "a coarse mesh, within {} units of the source. Proven to miss the source: {}; no other meets it before the distance that is told for it. Hits are not proven",
            AtMost(distance),
            count(proven_misses)
        )?,
        Some(distance) if distance > 0.0 => {
            writeln!(out, "the source's own triangles, rounded by at most {} units", AtMost(distance))?;
        }
        _ => writeln!(out, "the source's own triangles: hits and misses are the source's")?,
    }
    writeln!(
        out,
        "{} read, {}; {} of them different",
        Counted(pages, "page"),
        Bytes(page_bytes),
        count(pages_different)
    )?;
    if let (Some(output), Some(format)) = (&told.output, told.format) {
        writeln!(out, "{output}: {format}")?;
    }
    Ok(())
}
