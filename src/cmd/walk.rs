//! `chpm walk`: the incremental selection along a camera path, measured frame by frame.

use super::{Verdict, open, stdout};
use crate::progress::Meter;
use crate::report::{count, table};
use crate::stop::{self, Stop};
use crate::view::{self, ImageArgs};
use anyhow::{Context, Result, ensure};
use chpm_extmem::{AtomicFile, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId};
use chpm_refine::{ActiveList, CameraPath, Hierarchy, PmCursor, View, is_visible};
use serde_json::{Map, Value, json};
use std::fs;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What `chpm walk` is told.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file
    file: PathBuf,
    /// The camera path (see chpm path): one camera a frame, in the model's coordinates
    path: PathBuf,
    /// Pixels of error that are allowed
    #[arg(long, value_name = "P", default_value = "1", value_parser = view::pixels)]
    poe: f64,
    #[command(flatten)]
    image: ImageArgs,
    /// Write one line of numbers for every frame
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Replace the CSV file if it exists
    #[arg(short, long)]
    force: bool,
    /// Write the summary as JSON
    #[arg(long)]
    json: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
}

/// What one frame took; times in milliseconds.
#[derive(Clone, Copy, Debug, Default)]
struct Frame {
    triangles: u64,
    clusters: u64,
    visible: u64,
    splits: u64,
    collapses: u64,
    checks: u64,
    pm_steps: u64,
    refine_ms: f64,
    pm_ms: f64,
    requested_bytes: u64,
}

const COLUMNS: [(&str, fn(&Frame) -> f64); 10] = [
    ("triangles", |f| f.triangles as f64),
    ("clusters", |f| f.clusters as f64),
    ("visible", |f| f.visible as f64),
    ("splits", |f| f.splits as f64),
    ("collapses", |f| f.collapses as f64),
    ("checks", |f| f.checks as f64),
    ("pm_steps", |f| f.pm_steps as f64),
    ("refine_ms", |f| f.refine_ms),
    ("pm_ms", |f| f.pm_ms),
    ("requested_bytes", |f| f.requested_bytes as f64),
];

/// Walks and reports.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    let file = open(&args.file)?;
    let cancel = stop.heed();
    let csv = args.csv.as_ref().map(|path| AtomicFile::create(path, args.force)).transpose()?;
    let path = read_path(args)?;
    let meter = Meter::new(args.quiet);
    meter.start("walk", path.cameras.len() as u64);
    let mut walk = Walk::new(&file);
    let mut frames = Vec::with_capacity(path.cameras.len());
    for (index, camera) in path.cameras.iter().enumerate() {
        stop::check(&cancel)?;
        let view = args.image.view(&file, camera, args.poe);
        let view = view.with_context(|| format!("frame {index} of '{}'", args.path.display()))?;
        frames.push(walk.frame(&view)?);
        meter.add(1);
    }
    meter.finish();
    if let Some(csv) = csv {
        write_csv(&frames, csv)?;
    }
    let mut out = stdout();
    if args.json {
        writeln!(out, "{:#}", as_json(&frames, args))?;
    } else {
        print(&frames, &mut out)?;
    }
    out.flush()?;
    Ok(Verdict::Good)
}

fn read_path(args: &Args) -> Result<CameraPath> {
    let name = args.path.display();
    let text = fs::read_to_string(&args.path).with_context(|| format!("cannot read '{name}'"))?;
    let path: CameraPath = text.parse().with_context(|| format!("cannot read '{name}'"))?;
    ensure!(!path.cameras.is_empty(), "'{name}' has no camera; make a path with chpm path");
    Ok(path)
}

/// A viewer without pictures: the active clusters, each with a mesh that follows its position.
struct Walk<'a> {
    file: &'a Chpm<MappedFile>,
    hierarchy: Hierarchy,
    list: ActiveList,
    /// By cluster, those of the cut.
    cursors: Vec<Option<Box<PmCursor>>>,
    /// Memory of those that left.
    free: Vec<Box<PmCursor>>,
    /// By cluster: its page was asked for.
    requested: Vec<bool>,
}

impl<'a> Walk<'a> {
    fn new(file: &'a Chpm<MappedFile>) -> Self {
        let count = file.clusters().len();
        Walk {
            file,
            hierarchy: Hierarchy::new(file),
            list: ActiveList::new(file),
            cursors: (0..count).map(|_| None).collect(),
            free: Vec::new(),
            requested: vec![false; count],
        }
    }

    fn frame(&mut self, view: &View) -> Result<Frame> {
        let start = Instant::now();
        let changes = self.list.update(self.file, &self.hierarchy, view, |_| true)?;
        let refined = start.elapsed();
        let start = Instant::now();
        let triangles = self.play()?;
        let played = start.elapsed();
        let clusters = self.file.clusters();
        let records = || self.list.members().map(|member| (member.cluster, &clusters[member.cluster.index()]));
        let mut requested_bytes = 0;
        for (cluster, record) in records() {
            if !std::mem::replace(&mut self.requested[cluster.index()], true) {
                requested_bytes += u64::from(record.page_len);
            }
        }
        Ok(Frame {
            triangles,
            clusters: self.list.len() as u64,
            visible: records().filter(|(_, record)| is_visible(record, view)).count() as u64,
            splits: changes.splits,
            collapses: changes.collapses,
            checks: changes.checks,
            pm_steps: changes.pm_steps,
            refine_ms: milliseconds(refined),
            pm_ms: milliseconds(played),
            requested_bytes,
        })
    }

    /// Moves every mesh to its position; answers the triangles of all.
    fn play(&mut self) -> Result<u64> {
        for ClusterId(left) in self.list.left() {
            self.free.extend(self.cursors[*left as usize].take());
        }
        let mut triangles = 0;
        for member in self.list.members() {
            let slot = &mut self.cursors[member.cluster.index()];
            let cursor = match slot {
                Some(cursor) => cursor,
                None => {
                    let mut cursor = self.free.pop().unwrap_or_default();
                    cursor.load(&self.file.page(member.cluster)?.progressive_mesh());
                    slot.insert(cursor)
                }
            };
            cursor.move_to(member.vertices as usize);
            triangles += cursor.triangles().len() as u64;
        }
        Ok(triangles)
    }
}

fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// The value that a share `q` of the frames does not exceed.
fn quantile(frames: &[Frame], q: f64, of: fn(&Frame) -> f64) -> f64 {
    let mut values: Vec<f64> = frames.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    let place = (q * values.len() as f64).ceil() as usize;
    values.get(place.saturating_sub(1)).copied().unwrap_or(0.0)
}

fn write_csv(frames: &[Frame], file: AtomicFile) -> Result<()> {
    let mut csv = BufWriter::new(file);
    let names: Vec<&str> = COLUMNS.iter().map(|(name, _)| *name).collect();
    writeln!(csv, "frame,{}", names.join(","))?;
    for (index, frame) in frames.iter().enumerate() {
        write!(csv, "{index}")?;
        for (_, value) in COLUMNS {
            write!(csv, ",{}", value(frame))?;
        }
        writeln!(csv)?;
    }
    csv.into_inner().map_err(|error| error.into_error())?.publish()?;
    Ok(())
}

fn print(frames: &[Frame], out: &mut impl Write) -> Result<()> {
    let requested = frames.iter().map(|frame| frame.requested_bytes).sum();
    writeln!(out, "{} frames, {} requested", count(frames.len() as u64), Bytes(requested))?;
    let number = |x: f64| if x.fract() == 0.0 { count(x as u64) } else { format!("{x:.3}") };
    let rows = COLUMNS.iter().map(|(name, value)| {
        let values = [0.5, 0.95, 1.0].map(|q| number(quantile(frames, q, *value)));
        [vec![(*name).replace('_', " ")], values.to_vec()].concat()
    });
    writeln!(out, "{}", table(&["a frame", "median", "95 %", "most"], rows))?;
    Ok(())
}

fn as_json(frames: &[Frame], args: &Args) -> Value {
    let summary = COLUMNS.iter().map(|(name, value)| {
        let [median, p95, most] = [0.5, 0.95, 1.0].map(|q| quantile(frames, q, *value));
        let total: f64 = frames.iter().map(value).sum();
        ((*name).to_owned(), json!({ "median": median, "p95": p95, "most": most, "total": total }))
    });
    json!({
        "frames": frames.len(),
        "poe": args.poe,
        "summary": Value::Object(summary.collect::<Map<_, _>>()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_frames_that_there_are() {
        let frames: Vec<Frame> = (0..20).rev().map(|n| Frame { splits: n, ..Frame::default() }).collect();
        let at = |q| quantile(&frames, q, |f| f.splits as f64);
        assert_eq!([at(0.5), at(0.95), at(1.0)], [9.0, 18.0, 19.0]);
        assert_eq!(quantile(&[], 0.5, |f| f.pm_ms), 0.0);
    }
}
