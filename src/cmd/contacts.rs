//! `chpm contacts`: everywhere that two models come near, or that a model meets itself.

mod itself;

use super::Verdict;
use crate::json::{self, near};
use crate::number::{AtLeast, AtMost, Units};
use crate::output::{self, Output};
use crate::proximity::{AskArgs, Pair, PathArgs};
use crate::report::{coordinate, count, table};
use crate::stop::{self, Stop};
use anyhow::{Result, ensure};
use chpm_build::config::Length;
use chpm_mesh::{Bytes, Counted};
use chpm_proximity::contacts::Near;
use chpm_proximity::{Contacts, Region, contacts};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm contacts`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    ask: AskArgs,
    /// Another, or the same
    #[arg(required_unless_present = "itself", conflicts_with = "itself")]
    second: Option<PathBuf>,
    #[command(flatten)]
    path: PathArgs,
    /// Find where the source of the first model meets itself: triangles that have a point in common and no vertex. Exact, whatever the numbers
    #[arg(long = "self", conflicts_with_all = ["within", "error", "pose", "pose_a", "path", "max_pages"])]
    itself: bool,
    /// Find all that is within this distance, in the models' units or, as in 1%, of the larger diagonal of their boxes. 0 finds where they touch
    #[arg(long, value_name = "D", default_value = "0")]
    within: Length,
    /// What is farther than D + E is not told; between them, it may be. 0 goes to the triangles of the sources; more allows coarser ones, which is
    /// quicker and reads less
    #[arg(long, value_name = "E", default_value = "0")]
    error: Length,
}

/// Bytes of a region that is told as JSON.
const REGION: u64 = 4096;

/// Finds and tells. Something found is no fault.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let first = args.ask.first.as_path();
    let inputs: Vec<&Path> = [Some(first), args.second.as_deref()].into_iter().flatten().collect();
    let (csv, mut out) = args.ask.tell.open(output::CONTACTS_CSV, &inputs)?;
    let csv = match &args.second {
        Some(second) => between(args, second, stop, csv, &mut out)?,
        None => itself::within_itself(args, stop, csv, &mut out)?,
    };
    out.flush()?;
    drop(out);
    if let Some(csv) = csv {
        csv.publish()?;
    }
    Ok(Verdict::Good)
}

fn between(
    args: &Args,
    second: &Path,
    stop: &Stop,
    mut csv: Option<Output>,
    out: &mut dyn Write,
) -> Result<Option<Output>> {
    let pair = args.ask.pair(second, stop)?;
    let cancel = stop.heed();
    let ([still, _], path) = (args.ask.poses.poses(), args.path.poses(&args.ask.poses)?);
    let diagonal = pair.diagonal();
    let near =
        Near { within: args.within.of(diagonal), error: args.error.of(diagonal), limit: pair.most_near() };
    let pool = args.ask.threads.pool()?;
    let is_path = args.path.is_given();
    if let Some(csv) = &mut csv {
        writeln!(csv, "{}{HEADER}", if is_path { "step," } else { "" })?;
    }
    // All regions are kept where they are told; for a path in words, a row for each step.
    let (mut steps, mut rows, mut kept) = (Vec::new(), Vec::new(), 0);
    pair.reading(|| {
        let [a, b] = pair.open(1)?;
        for (step, pose) in path.iter().enumerate() {
            let limits = args.ask.limits.start(&cancel);
            let found = contacts(&a, &b, [&still, pose], &near, &pool, &mut |read| limits.go_on(read))?;
            stop::check(&cancel)?;
            if let Some(csv) = &mut csv {
                write_csv(is_path.then_some(step), &found.regions, csv)?;
            }
            if is_path && !args.ask.tell.json {
                rows.push(row_of(step, &found));
                continue;
            }
            kept += found.regions.len() as u64;
            ensure!(
                !is_path || kept <= pair.waiting / REGION,
                "too many regions for --json up to step {step} of the path; use --csv alone, which keeps none, or more --memory"
            );
            steps.push(found);
        }
        Ok(())
    })?;
    if args.ask.tell.json && is_path {
        json::print(&path_to_json(&pair, &near, &steps), out)?;
    } else if is_path {
        let header = ["step", "regions", "least", "depth", "triangles", "and", "pages", "complete"];
        writeln!(out, "{}", table(&header, rows))?;
    } else if let [found] = steps.as_slice() {
        match args.ask.tell.json {
            true => json::print(&to_json(&pair, &near, found), out)?,
            false => print(&pair, found, &near, out)?,
        }
    }
    Ok(csv)
}

/// The answer of one pose.
fn to_json(pair: &Pair, near: &Near, found: &Contacts) -> near::Contacts {
    near::Contacts {
        schema: "chpm-contacts/1",
        first: pair.models[0].json(),
        second: pair.models[1].json(),
        within: near.within,
        error: near.error,
        step: step_json(found),
    }
}

/// The answers of a path.
fn path_to_json(pair: &Pair, near: &Near, steps: &[Contacts]) -> near::ContactsPath {
    near::ContactsPath {
        schema: "chpm-contacts-path/1",
        first: pair.models[0].json(),
        second: pair.models[1].json(),
        within: near.within,
        error: near.error,
        steps: steps.iter().map(step_json).collect(),
    }
}

fn step_json(found: &Contacts) -> near::Step {
    near::Step {
        complete: found.complete,
        rounding: found.rounding,
        pairs: found.pairs,
        pages: found.reads.map(|read| read.pages),
        page_bytes: found.reads.map(|read| read.bytes.0),
        regions: found.regions.iter().map(region_json).collect(),
    }
}

/// Row of a step of a path, for people.
fn row_of(step: usize, found: &Contacts) -> Vec<String> {
    let Contacts { regions, complete, reads, .. } = found;
    fn triangles(side: usize, regions: &[Region]) -> String {
        count(regions.iter().map(|region| region.triangles[side]).sum())
    }
    let least = regions.iter().map(|region| region.lower).reduce(f64::min);
    let deepest = regions.iter().map(|region| region.depth).reduce(f64::max);
    fn units(length: Option<f64>) -> String {
        length.map_or("-".to_owned(), |x| Units(x).to_string())
    }
    vec![
        step.to_string(),
        count(regions.len() as u64),
        units(least),
        units(deepest),
        triangles(0, regions),
        triangles(1, regions),
        count(reads[0].plus(reads[1]).pages),
        if *complete { "yes" } else { "no: stopped" }.to_owned(),
    ]
}

fn region_json(region: &Region) -> near::Region {
    let Region { lower, upper, closest_points: closest, triangles, area, depth, levels, low, high } = *region;
    near::Region {
        least: lower,
        most: upper,
        points: closest.points,
        point_errors: closest.errors,
        clusters: closest.clusters.map(|cluster| cluster.0),
        nearest_triangles: closest.triangles,
        triangles,
        area,
        depth,
        levels,
        low,
        high,
    }
}

/// Columns of a region.
const HEADER: &str =
    "region,least,most,ax,ay,az,bx,by,bz,triangles_a,triangles_b,area_a,area_b,depth,level_a,level_b";

fn write_csv(step: Option<usize>, regions: &[Region], out: &mut impl Write) -> Result<()> {
    let lead = step.map_or(String::new(), |step| format!("{step},"));
    for (at, region) in regions.iter().enumerate() {
        let Region {
            lower,
            upper,
            closest_points: closest,
            triangles: [t, u],
            area: [r, s],
            depth,
            levels: [l, m],
            ..
        } = region;
        let points: Vec<String> = closest.points.as_flattened().iter().map(f64::to_string).collect();
        writeln!(out, "{lead}{at},{lower},{upper},{},{t},{u},{r},{s},{depth},{l},{m}", points.join(","))?;
    }
    Ok(())
}

/// Regions that are listed for people.
const LISTED: usize = 20;

fn print(pair: &Pair, found: &Contacts, near: &Near, out: &mut dyn Write) -> Result<()> {
    let [a, b] = &pair.models;
    let regions = Counted(found.regions.len() as u64, "region");
    // Rounding may have let in what is a little farther.
    let beyond = AtMost(near.error.max(found.farthest - near.within));
    let within = Units(near.within);
    writeln!(
        out,
        "{} and {}: {regions} within {within} units, and none beyond {beyond} more",
        a.path.display(),
        b.path.display()
    )?;
    if !found.regions.is_empty() {
        let diagonal = pair.diagonal();
        let rows = found.regions.iter().take(LISTED).enumerate().map(|(at, region)| {
            let [x, y, z] = region.closest_points.points[0].map(|x| coordinate(x, diagonal));
            let mut row = vec![at.to_string()];
            row.extend([AtLeast(region.lower).to_string(), AtMost(region.upper).to_string()]);
            row.push(Units(region.depth).to_string());
            row.extend(region.triangles.map(count));
            row.extend(region.area.map(|x| Units(x).to_string()));
            row.extend(region.levels.map(|level| level.to_string()));
            row.extend([x, y, z]);
            row
        });
        let header = [
            "region",
            "least",
            "most",
            "depth",
            "triangles",
            "and",
            "area",
            "and",
            "level",
            "and",
            "x",
            "y",
            "z",
        ];
        writeln!(out, "{}", table(&header, rows))?;
    }
    if let Some(more @ 1..) = found.regions.len().checked_sub(LISTED) {
        writeln!(out, "and {more} more; --csv or --json has all")?;
    }
    let pages: u64 = found.reads.iter().map(|read| read.pages).sum();
    let bytes = Bytes(found.reads.iter().map(|read| read.bytes.0).sum());
    writeln!(out, "read {} pages, {bytes}", count(pages))?;
    if !found.complete {
        writeln!(out, "stopped at the limit: there may be more")?;
    }
    Ok(())
}
