//! `chpm compare`: how far each vertex of a scan is from a reference, as numbers, colours and a histogram.

use super::{Verdict, reading};
use crate::compare::{Painted, Parts, Pass, Summary, Told, leaves, page, plot};
use crate::json::{self, near};
use crate::memory::{self, MemoryArgs};
use crate::number::{AtMost, Digits, Units};
use crate::output;
use crate::progress::Meter;
use crate::proximity::{GROUP, Opened, PoseArgs};
use crate::report::{count, table};
use crate::stop::{self, Stop};
use crate::threads::{ThreadArgs, Workers};
use crate::tolerance::{Tolerance, Unit};
use anyhow::{Context, Result};
use chpm_build::Cancel;
use chpm_build::config::Length;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, Counted};
use chpm_proximity::{Gauge, Model};
use chpm_report::colors::Colors;
use rayon::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `chpm compare`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The scan: a .chpm file; or a mesh ({meshes}), which is built into a temporary one first
    scan: PathBuf,
    /// What it is compared with, likewise
    reference: PathBuf,
    /// How far from the reference is near enough: the share of the vertices within is told. In the models' units, as in 0.1% of the diagonal of the
    /// reference's box, or as in 0.2mm with --unit
    #[arg(long, value_name = "T")]
    tolerance: Option<Tolerance>,
    /// What one unit of the models is
    #[arg(long, value_name = "UNIT", value_enum, requires = "tolerance")]
    unit: Option<Unit>,
    /// Exit with 1 unless all vertices are certainly within --tolerance, or as many as in --strict=99.5%
    #[arg(long, value_name = "SHARE", value_parser = share, num_args = 0..=1, require_equals = true, default_missing_value = "100%",
        requires = "tolerance")]
    strict: Option<f64>,
    /// How far a told distance may be from the true one, all rounding included, in the models' units or, as in 0.1%, of the diagonal of the reference's box; 0
    /// goes to the triangles of the reference's source; what holds is told where that is more. If not given 0.01%, or a tenth of --tolerance where that is less
    #[arg(long, value_name = "E")]
    error: Option<Length>,
    #[command(flatten)]
    poses: PoseArgs,
    /// Distances that the first and the last colour stand for; the 99th percentile if not given, from 0, or where distances are signed from as far on the
    /// other side
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Distances without a sign. They have one where the reference is closed and turns one way: negative behind its surface
    #[arg(long)]
    unsigned: bool,
    /// Write the scan with its distances as colours, evenly spaced for the eye. Its name says the format: .ply, .glb, .gltf or .chpm, which is built from it;
    /// PLY where it says nothing; - for standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Round positions in a glTF to 16 bits an axis, colours to 8 (KHR_mesh_quantization)
    #[arg(long, requires = "output")]
    quantize: bool,
    /// Write a histogram as SVG; - for standard output
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Write a page with a picture in these colours, the histogram and all numbers; - for standard output
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
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

pub(super) fn range(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect();
    match numbers.as_deref() {
        Some([low, high]) if low < high => Ok([*low, *high]),
        _ => Err(format!("'{text}' is no range: write two numbers, the smaller one first, as in -0.5,0.5")),
    }
}

/// `99.5%`, as a part of one.
fn share(text: &str) -> Result<f64, String> {
    let percent = text.strip_suffix('%').and_then(|number| number.trim().parse::<f64>().ok());
    let percent = percent.filter(|percent| (0.0..=100.0).contains(percent));
    percent
        .map(|percent| percent / 100.0)
        .ok_or_else(|| format!("'{text}' is no share: write percent, as in 99.5%"))
}

/// Of the diagonal, how far a told distance may be from the true one, if nobody says so.
const ERROR: Length = Length::OfDiagonal(0.01);
/// Bytes of the page and its picture.
const PAGE: u64 = 96 << 20;

/// Bytes of a vertex: its distance as measured, once in each leaf that has it, and as summed up or sorted.
const VERTEX: u64 = 20;

/// Bytes of a thread, with the points that it measures.
const THREAD: u64 = 1 << 20;

/// Measures, and writes what is asked for.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let inputs = [args.scan.as_path(), args.reference.as_path()];
    let painted = args
        .output
        .as_deref()
        .map(|path| Painted::create("compare", path, args.quantize, args.force, &inputs))
        .transpose()?;
    let svg = args.svg.as_deref().map(|path| output::COMPARE_SVG.create(path, args.force, &inputs));
    let svg = svg.transpose()?;
    let html = args.html.as_deref().map(|path| output::COMPARE_HTML.create(path, args.force, &inputs));
    let html = html.transpose()?;
    let streams = painted.iter().filter_map(Painted::output).chain(&svg).chain(&html);
    let mut out = output::messages(streams, args.json, args.quiet)?;
    let [scan, reference] = inputs.map(|path| Opened::new(path, args.memory.memory(), args.quiet, stop));
    let (scan, reference) = (scan?, reference?);
    let header = scan.file.header();
    let page_bytes = if html.is_some() { PAGE } else { 0 };
    // A header may claim any number of vertices; more than its leaves have there are not.
    let leaves = scan.file.clusters().iter().filter(|cluster| cluster.is_leaf());
    let vertices =
        leaves.map(|leaf| u64::from(leaf.vertex_count)).sum::<u64>().min(header.source_vertex_count);
    let own = VERTEX * vertices + 4 * u64::from(header.shared_vertex_count) + page_bytes;
    let groups = GROUP * reference.file.groups().len() as u64;
    let each = THREAD + Gauge::memory(&reference.file);
    let files = [(&scan.file, own), (&reference.file, groups)];
    let (pool, [_, pages]) = memory::workers_among(&args.threads, files, args.memory.memory(), each)?;
    let cancel = stop.heed();
    let meter = Meter::new(args.quiet);

    let diagonal = reference.diagonal();
    let limit = args.tolerance.map(|tolerance| tolerance.length(args.unit)).transpose()?;
    let limit = limit.map(|limit| limit.of(diagonal));
    let usual = ERROR.of(diagonal).min(limit.map_or(f64::INFINITY, |limit| 0.1 * limit));
    let tolerance = args.error.map_or(usual, |error| error.of(diagonal));
    let signed = !args.unsigned && is_closed(&reference.file);
    let work = Work { args, scan: &scan, reference: &reference, pool, pages, tolerance, limit, signed };
    let Measured { values, within, exact, rounding } =
        reading(&reference.file, || reading(&scan.file, || work.measure(&meter, &cancel)))?;
    drop(work);
    let parts = reading(&scan.file, || Parts::new(&scan.file, values))?;
    let summary = Summary::new(&parts.values, signed, args.range);
    let tolerance = tolerance.max(within + summary.lost());
    let pass = limit.map(|limit| Pass::new(&parts.values, limit, exact));
    let verdict = pass.as_ref().map(|pass| verdict(pass, args));
    let colors = Colors::new(summary.range, signed);
    if let Some(painted) = painted {
        reading(&scan.file, || painted.write("compare", &scan.file, &parts, &colors, &cancel))?.build(
            args.memory.memory(),
            args.quiet,
            stop,
        )?;
    }
    let title = format!("{} from {}", name(&args.scan), name(&args.reference));
    let note = format!("{}, each within {} units", Counted(summary.count, "vertex"), AtMost(tolerance));
    if let Some(mut svg) = svg {
        svg.write_all(plot(&summary, &colors, limit, "distance, units", [&title, &note])?.as_bytes())?;
        svg.publish()?;
    }
    if let Some(mut html) = html {
        let told = Told {
            title: &title,
            note: &note,
            summary: &summary,
            pass: pass.as_ref(),
            verdict: verdict.clone(),
            signed,
        };
        html.write_all(reading(&scan.file, || page(&scan.file, &parts, &told))?.as_bytes())?;
        html.publish()?;
    }
    if args.json {
        let compare = near::Compare {
            schema: "chpm-compare/1",
            scan: scan.json(),
            reference: reference.json(),
            tolerance,
            rounding,
            signed,
            summary: summary.json(),
            pass: pass.map(|pass| pass.json()),
        };
        json::print(&compare, &mut out)?;
    } else {
        print(&summary, signed, &scan, &reference, tolerance, &mut out)?;
        if let Some((words, _)) = &verdict {
            writeln!(out, "{words}")?;
        }
    }
    out.flush()?;
    let is_good = verdict.is_none_or(|(_, is_good)| is_good) || args.strict.is_none();
    Ok(if is_good { Verdict::Good } else { Verdict::Faulty })
}

/// How much is within the tolerance, in words, and whether that is enough.
fn verdict(pass: &Pass, args: &Args) -> (String, bool) {
    let Pass { tolerance, within, beyond, undecided } = *pass;
    let asked = args.tolerance.and_then(Tolerance::measured).map_or_else(
        || format!("{} units", Units(tolerance)),
        |(count, unit)| format!("{count} {}", unit.symbol()),
    );
    let needed = args.strict.unwrap_or(1.0);
    let is_good = pass.share() >= needed;
    // Rounded down, so that 100 % are all.
    let percent = (10_000.0 * pass.share()).floor() / 100.0;
    let all = within + beyond + undecided;
    let rest =
        if undecided > 0 { format!("; of {} rounding decides", count(undecided)) } else { String::new() };
    let words = if is_good { "passes" } else { "fails" };
    let text = format!(
        "{words}: {percent} % of the vertices, {} of {}, are within {asked}; {} % are needed{rest}",
        count(within),
        count(all),
        100.0 * needed
    );
    (text, is_good)
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Whether a source is closed and all of it turns one way, as its file tells.
fn is_closed(file: &Chpm<MappedFile>) -> bool {
    let Ok(metadata) = file.metadata() else { return false };
    ["boundary-edges", "non-manifold-edges", "mixed-winding-edges"]
        .into_iter()
        .all(|wanted| metadata.repairs.iter().any(|(name, count)| name == wanted && *count == 0))
}

struct Work<'w> {
    args: &'w Args,
    scan: &'w Opened,
    reference: &'w Opened,
    pool: Workers,
    /// Bytes for pages of the reference.
    pages: u64,
    tolerance: f64,
    /// Distance that is near enough: points on either side of it are told apart exactly.
    limit: Option<f64>,
    signed: bool,
}

/// Measured distances.
struct Measured {
    /// The distances of the vertices of each leaf, in the order of the file.
    values: Vec<Vec<f64>>,
    /// How far each may be from the true one.
    within: f64,
    /// The same for those of which that does not tell whether they are near enough: they are measured again.
    exact: f64,
    /// Which part of that no tolerance makes less.
    rounding: f64,
}

impl Work<'_> {
    fn measure(&self, meter: &Meter, cancel: &Cancel) -> Result<Measured> {
        let leaves = leaves(&self.scan.file);
        meter.start("compare", leaves.len() as u64);
        fn unproven(path: &Path) -> String {
            format!("cannot use '{}'", path.display())
        }
        let scan = Model::new(&self.scan.file, Bytes(0)).with_context(|| unproven(&self.scan.path))?;
        let reference = Model::new(&self.reference.file, Bytes(self.pages));
        let reference = reference.with_context(|| unproven(&self.reference.path))?;
        let [still, pose] = self.args.poses.poses();
        let gauge = Gauge::new(&scan, &reference, [&still, &pose], self.tolerance)?;
        let closest = Gauge::new(&scan, &reference, [&still, &pose], 0.0)?;
        let measured = leaves.par_iter().map(|leaf| {
            stop::check(cancel)?;
            let mut found = Vec::new();
            let page = self.scan.file.page(*leaf)?;
            let positions = page.view().positions;
            let within = gauge.measure(positions, &mut found)?;
            let exact = self.decide(&closest, positions, within, &mut found)?;
            if !self.signed {
                found.iter_mut().for_each(|x| *x = x.abs());
            }
            meter.add(1);
            Ok((found, [within, exact]))
        });

        let done = self.pool.install(|| measured.collect::<Result<Vec<_>>>())?;
        meter.finish();
        stop::check(cancel)?;
        fn most(which: usize, done: &[(Vec<f64>, [f64; 2])]) -> f64 {
            done.iter().map(|(_, bounds)| bounds[which]).fold(0.0, f64::max)
        }
        let (within, exact) = (most(0, &done), most(1, &done));
        let values = done.into_iter().map(|(values, _)| values).collect();
        Ok(Measured { values, within, exact, rounding: gauge.rounding() })
    }

    /// Measures again, to the triangles of the source, what may be on either side of what is near enough. Answers how far these may be from
    /// the truth; all distances may be off by `within`.
    fn decide(
        &self,
        closest: &Gauge<'_, '_, MappedFile>,
        positions: &[[f32; 3]],
        within: f64,
        found: &mut [f64],
    ) -> Result<f64> {
        let Some(limit) = self.limit.filter(|_| self.tolerance > 0.0) else { return Ok(within) };
        let open: Vec<usize> =
            (0..found.len()).filter(|place| (found[*place].abs() - limit).abs() <= within).collect();
        let points: Vec<[f32; 3]> = open.iter().map(|place| positions[*place]).collect();
        let mut again = Vec::new();
        let exact = closest.measure(&points, &mut again)?;
        open.into_iter().zip(again).for_each(|(place, distance)| found[place] = distance);
        Ok(exact.max(closest.rounding()))
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
    cells.extend(row.map(|x| digits.of(x)));
    writeln!(out, "{}", table(&header, [cells]))?;
    writeln!(out, "percentages: of the vertices, that are no farther by size")?;
    Ok(())
}
