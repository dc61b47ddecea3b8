//! `chpm contacts`: everywhere that two models come near, or that a model meets itself.

use super::Verdict;
use crate::number::Units;
use crate::output::{self, Output};
use crate::proximity::{AskArgs, Opened, Pair};
use crate::report::{count, table};
use crate::stop::{self, Stop};
use anyhow::{Context, Result, bail};
use chpm_build::config::Length;
use chpm_mesh::{Bytes, Counted};
use chpm_proximity::contacts::Near;
use chpm_proximity::{Contacts, Crossing, Model, Reads, Region, contacts, crossings};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

/// What `chpm contacts` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(flatten)]
    ask: AskArgs,
    /// Another, or the same
    #[arg(required_unless_present = "itself", conflicts_with = "itself")]
    second: Option<PathBuf>,
    /// Find where the source of the first model meets itself: triangles that have a point in common and no vertex. Exact, whatever the numbers
    #[arg(long = "self", conflicts_with_all = ["within", "error", "pose", "pose_a", "max_pages"])]
    itself: bool,
    /// Find all that is within this distance, in the models' units or, as in 1%, of the larger diagonal of their boxes. 0 finds where they touch
    #[arg(long, value_name = "D", default_value = "0")]
    within: Length,
    /// What is farther than D + E is not told; between them, it may be. 0 goes to the triangles of the sources; more allows coarser ones, which is
    /// quicker and reads less
    #[arg(long, value_name = "E", default_value = "0")]
    error: Length,
}

/// Bytes of a triangle that is near, and of what hangs on it.
const TRIANGLE: u64 = 512;

/// Finds and tells. Something found is no fault.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let first = args.ask.first.as_path();
    let inputs: Vec<&Path> = [Some(first), args.second.as_deref()].into_iter().flatten().collect();
    let (csv, mut out) = args.ask.tell.open(output::CONTACTS_CSV, &inputs)?;
    let csv = match &args.second {
        Some(second) => between(args, second, stop, csv, &mut out)?,
        None => within_itself(args, stop, csv, &mut out)?,
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
    let [still, pose] = args.ask.poses.poses();
    let diagonal = pair.diagonal();
    let most = (pair.waiting / TRIANGLE) as usize;
    let near = Near { within: args.within.of(diagonal), error: args.error.of(diagonal), most };
    let pool = args.ask.threads.pool()?;
    let found = pair.reading(|| {
        let [a, b] = pair.open(1)?;
        let limits = args.ask.limits.start(&cancel);
        let found = contacts(&a, &b, [&still, &pose], &near, &pool, &mut |read| limits.go_on(read))?;
        stop::check(&cancel)?;
        Ok(found)
    })?;
    if let Some(csv) = &mut csv {
        write_csv(&found.regions, csv)?;
    }
    if args.ask.tell.json {
        let value = json!({
            "schema": "chpm-contacts/1",
            "first": pair.models[0].json(),
            "second": pair.models[1].json(),
            "within": near.within,
            "error": near.error,
            "complete": found.complete,
            "rounding": found.margin,
            "pairs": found.pairs,
            "pages": found.reads.map(|read| read.pages),
            "page_bytes": found.reads.map(|read| read.bytes.0),
            "regions": found.regions.iter().map(region_json).collect::<Vec<_>>(),
        });
        writeln!(out, "{value:#}")?;
    } else {
        print(&pair, &found, &near, out)?;
    }
    Ok(csv)
}

fn region_json(region: &Region) -> Value {
    let Region { least, most, witness, triangles, area, depth, levels, low, high } = region;
    json!({
        "least": least,
        "most": most,
        "points": witness.points,
        "point_errors": witness.errors,
        "clusters": witness.clusters.map(|cluster| cluster.0),
        "nearest_triangles": witness.triangles,
        "triangles": triangles,
        "area": area,
        "depth": depth,
        "levels": levels,
        "low": low,
        "high": high,
    })
}

fn write_csv(regions: &[Region], out: &mut impl Write) -> Result<()> {
    writeln!(
        out,
        "region,least,most,ax,ay,az,bx,by,bz,triangles_a,triangles_b,area_a,area_b,depth,level_a,level_b"
    )?;
    for (at, region) in regions.iter().enumerate() {
        let Region { least, most, witness, triangles: [t, u], area: [r, s], depth, levels: [l, m], .. } =
            region;
        let points: Vec<String> = witness.points.as_flattened().iter().map(f64::to_string).collect();
        writeln!(out, "{at},{least},{most},{},{t},{u},{r},{s},{depth},{l},{m}", points.join(","))?;
    }
    Ok(())
}

/// Regions that are listed for people.
const LISTED: usize = 20;

fn print(pair: &Pair, found: &Contacts, near: &Near, out: &mut dyn Write) -> Result<()> {
    let [a, b] = &pair.models;
    let regions = Counted(found.regions.len() as u64, "region");
    let (within, error) = (Units(near.within), Units(near.error));
    writeln!(
        out,
        "{} and {}: {regions} within {within} units, and none beyond {error} more",
        a.path.display(),
        b.path.display()
    )?;
    if !found.regions.is_empty() {
        let rows = found.regions.iter().take(LISTED).enumerate().map(|(at, region)| {
            let [x, y, z] = region.witness.points[0].map(|x| Units(x).to_string());
            let mut row = vec![at.to_string()];
            row.extend([region.least, region.most, region.depth].map(|x| Units(x).to_string()));
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

fn within_itself(
    args: &Args,
    stop: &Stop,
    mut csv: Option<Output>,
    out: &mut dyn Write,
) -> Result<Option<Output>> {
    let AskArgs { first, limits, threads, tell, .. } = &args.ask;
    let model = Opened::new(first, limits.memory.0, tell.quiet, stop)?;
    let own = crate::proximity::GROUP * model.file.clusters().len() as u64;
    let pages = crate::memory::divide(&model.file, limits.memory.0, own)?;
    if model.file.is_trimmed() {
        bail!(
            "'{}' was built without detail below an error, so its leaves are not the source",
            model.path.display()
        );
    }
    let cancel = stop.heed();
    let origin = model.file.header().origin;
    let (mut pairs, mut first) = (0, None);
    let (limits, pool) = (limits.start(&cancel), threads.pool()?);
    let complete = super::reading(&model.file, || {
        let reader = Model::new(&model.file, Bytes(pages))
            .with_context(|| format!("cannot use '{}'", model.path.display()))?;
        if let Some(csv) = &mut csv {
            writeln!(csv, "cluster_a,triangle_a,cluster_b,triangle_b,x,y,z")?;
        }
        let mut take = |crossing: &Crossing| {
            pairs += 1;
            first = first.or(Some(*crossing));
            match &mut csv {
                Some(csv) => write_crossing(crossing, origin, csv),
                None => Ok(()),
            }
        };
        let mut go_on = || limits.go_on(Reads::default());
        let complete = crossings(&reader, &pool, &mut take, &mut go_on)?;
        stop::check(&cancel)?;
        Ok(complete)
    })?;
    if args.ask.tell.json {
        let value = json!({
            "schema": "chpm-contacts-self/1",
            "file": model.json(),
            "complete": complete,
            "pairs": pairs,
        });
        writeln!(out, "{value:#}")?;
    } else {
        let name = model.path.display();
        let found = Counted(pairs, "pair of triangles");
        writeln!(out, "{name}: {found} that meet and have no vertex in common")?;
        if let Some(crossing) = first {
            let [x, y, z] = place(&crossing, origin);
            writeln!(out, "  the first near {x} {y} {z}; --csv has all")?;
        }
        if !complete {
            writeln!(out, "stopped at the limit: there may be more")?;
        }
    }
    Ok(csv)
}

/// A corner of the first triangle, in the source's coordinates.
fn place(crossing: &Crossing, origin: [f64; 3]) -> [f64; 3] {
    let corner = crossing.corners[0][0];
    [0, 1, 2].map(|axis| f64::from(corner[axis]) + origin[axis])
}

fn write_crossing(crossing: &Crossing, origin: [f64; 3], out: &mut impl Write) -> Result<()> {
    let ([x, y], [t, u]) = (crossing.clusters.map(|cluster| cluster.0), crossing.triangles);
    let [px, py, pz] = place(crossing, origin);
    Ok(writeln!(out, "{x},{t},{y},{u},{px},{py},{pz}")?)
}
