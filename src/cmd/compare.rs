//! `chpm compare`: how far each vertex of a scan is from a reference, as numbers, colours and a histogram.

use super::{Verdict, reading};
use crate::compare::{Colors, Painted, Parts, Summary, leaves, plot};
use crate::memory::{self, MemoryArgs};
use crate::number::{AtMost, Digits};
use crate::output;
use crate::progress::Meter;
use crate::proximity::{GROUP, Opened, PoseArgs};
use crate::report::table;
use crate::stop::{self, Stop};
use crate::threads::ThreadArgs;
use anyhow::{Context, Result};
use chpm_build::Cancel;
use chpm_build::config::Length;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId, Counted};
use chpm_proximity::{Gauge, Model};
use rayon::prelude::*;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

/// What `chpm compare` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The scan: a .chpm file; or a mesh (PLY, STL, OBJ, as it is or as .gz or .zst; a .conf set), which is built into a temporary one first
    scan: PathBuf,
    /// What it is compared with, likewise
    reference: PathBuf,
    /// How far a distance may be from the true one, all rounding included, in the models' units or, as in 0.1%, of the diagonal of the reference's box. 0 goes to
    /// the triangles of the reference's source; what holds is told where that is more
    #[arg(long, value_name = "T", default_value = "0.01%")]
    tolerance: Length,
    #[command(flatten)]
    poses: PoseArgs,
    /// Distances that the first and the last colour stand for; the 99th percentile if not given, from 0, or where distances are signed from as far on the
    /// other side
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Distances without a sign. They have one where the reference is closed and turns one way: negative behind its surface
    #[arg(long)]
    unsigned: bool,
    /// Write the scan with its distances as colours, evenly spaced for the eye. Its name says the format: .ply, .glb or .chpm, which is built from it;
    /// PLY where it says nothing; - for standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write a histogram as SVG; - for standard output
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Replace outputs that exist
    #[arg(short, long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadArgs,
    /// The summary as JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress, no notes
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect();
    match numbers.as_deref() {
        Some([low, high]) if low < high => Ok([*low, *high]),
        _ => Err(format!("'{text}' is no range: write two numbers, the smaller one first, as in -0.5,0.5")),
    }
}

/// Bytes of a vertex: its distance as measured, once in each leaf that has it, and as summed up or sorted.
const VERTEX: u64 = 20;

/// Measures, and writes what is asked for.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let inputs = [args.scan.as_path(), args.reference.as_path()];
    let painted =
        args.output.as_deref().map(|path| Painted::create(path, args.force, &inputs)).transpose()?;
    let svg = args.svg.as_deref().map(|path| output::COMPARE_SVG.create(path, args.force, &inputs));
    let svg = svg.transpose()?;
    let streams = painted.iter().filter_map(Painted::output).chain(&svg);
    let mut out = output::messages(streams, args.json, args.quiet)?;
    let [scan, reference] = inputs.map(|path| Opened::new(path, args.memory.memory(), args.quiet, stop));
    let (scan, reference) = (scan?, reference?);
    let header = scan.file.header();
    let own = VERTEX * header.source_vertex_count + 4 * u64::from(header.shared_vertex_count);
    let groups = GROUP * reference.file.groups().len() as u64;
    let [_, pages] =
        memory::divide_among([(&scan.file, own), (&reference.file, groups)], args.memory.memory())?;
    let cancel = stop.heed();
    let meter = Meter::new(args.quiet);

    let tolerance = args.tolerance.of(reference.diagonal());
    let signed = !args.unsigned && is_closed(&reference.file);
    let work = Work { args, scan: &scan, reference: &reference, pages, tolerance, signed };
    let Measured { values, within, rounding } =
        reading(&reference.file, || reading(&scan.file, || work.measure(&meter, &cancel)))?;
    let parts = reading(&scan.file, || Parts::new(&scan.file, values))?;
    let summary = Summary::new(&parts.values, signed, args.range);
    let tolerance = tolerance.max(within + summary.lost());
    if let Some(painted) = painted {
        let colors = Colors::new(summary.range, signed);
        reading(&scan.file, || painted.write(&scan.file, &parts, &colors, &cancel))?.build(
            args.memory.memory(),
            args.quiet,
            stop,
        )?;
    }
    if let Some(mut svg) = svg {
        let title = format!("{} from {}", name(&args.scan), name(&args.reference));
        let note = format!("{}, each within {} units", Counted(summary.count, "vertex"), AtMost(tolerance));
        svg.write_all(plot(&summary, &title, &note)?.as_bytes())?;
        svg.publish()?;
    }
    if args.json {
        let mut value = json!({
            "schema": "chpm-compare/1",
            "scan": scan.json(),
            "reference": reference.json(),
            "tolerance": tolerance,
            "rounding": rounding,
            "signed": signed,
        });
        if let (Some(value), serde_json::Value::Object(found)) = (value.as_object_mut(), summary.json()) {
            value.extend(found);
        }
        writeln!(out, "{value:#}")?;
    } else {
        print(&summary, signed, &scan, &reference, tolerance, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Whether a source is closed and all of it turns one way, as its file tells.
fn is_closed(file: &Chpm<MappedFile>) -> bool {
    let Ok(metadata) = file.metadata() else { return false };
    let is_none = |wanted: &str| metadata.repairs.iter().any(|(name, count)| name == wanted && *count == 0);
    ["boundary-edges", "non-manifold-edges", "mixed-winding-edges"].into_iter().all(is_none)
}

struct Work<'w> {
    args: &'w Args,
    scan: &'w Opened,
    reference: &'w Opened,
    /// Bytes for pages of the reference.
    pages: u64,
    tolerance: f64,
    signed: bool,
}

/// What was measured.
struct Measured {
    /// The distances of the vertices of each leaf, in the order of the file.
    values: Vec<Vec<f64>>,
    /// How far each may be from the true one.
    within: f64,
    /// Which part of that no tolerance makes less.
    rounding: f64,
}

impl Work<'_> {
    fn measure(&self, meter: &Meter, cancel: &Cancel) -> Result<Measured> {
        let leaves = leaves(&self.scan.file);
        let pool = self.args.threads.pool()?;
        meter.start("compare", leaves.len() as u64);
        let unproven = |path: &Path| format!("cannot use '{}'", path.display());
        let scan = Model::new(&self.scan.file, Bytes(0)).with_context(|| unproven(&self.scan.path))?;
        let reference = Model::new(&self.reference.file, Bytes(self.pages));
        let reference = reference.with_context(|| unproven(&self.reference.path))?;
        let [still, pose] = self.args.poses.poses();
        let gauge = Gauge::new(&scan, &reference, [&still, &pose], self.tolerance)?;
        let measure = |leaf: &ClusterId| {
            stop::check(cancel)?;
            let mut found = Vec::new();
            let within = gauge.measure(self.scan.file.page(*leaf)?.view().positions, &mut found)?;
            if !self.signed {
                found.iter_mut().for_each(|x| *x = x.abs());
            }
            meter.add(1);
            Ok((found, within))
        };
        let done = pool.install(|| leaves.par_iter().map(measure).collect::<Result<Vec<_>>>())?;
        meter.finish();
        stop::check(cancel)?;
        let within = done.iter().map(|(_, within)| *within).fold(0.0, f64::max);
        let values = done.into_iter().map(|(values, _)| values).collect();
        Ok(Measured { values, within, rounding: gauge.rounding() })
    }
}

fn print(
    summary: &Summary,
    signed: bool,
    scan: &Opened,
    reference: &Opened,
    tolerance: f64,
    out: &mut impl Write,
) -> Result<()> {
    let digits = Digits::within(tolerance, summary.min.abs().max(summary.max.abs()));
    let told = |x: f64| digits.of(x);
    let kind = if signed { "signed, negative behind the reference" } else { "without a sign" };
    writeln!(
        out,
        "{} from {}: {}, each within {} units; {kind}",
        scan.path.display(),
        reference.path.display(),
        Counted(summary.count, "vertex"),
        AtMost(tolerance + digits.lost())
    )?;
    let [p50, p90, p95, p99, p999] = summary.percentiles;
    let row = [summary.min, summary.max, summary.mean, summary.rms, p50, p90, p95, p99, p999];
    let header = ["", "least", "most", "mean", "rms", "50 %", "90 %", "95 %", "99 %", "99.9 %"];
    let mut cells = vec!["units".to_owned()];
    cells.extend(row.map(told));
    writeln!(out, "{}", table(&header, [cells]))?;
    writeln!(out, "percentages: of the vertices, that are no farther by size")?;
    Ok(())
}
