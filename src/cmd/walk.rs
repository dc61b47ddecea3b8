//! `chpm walk`: the incremental selection along a camera path, measured frame by frame.

#[cfg(feature = "viewer")]
use super::stdout;
use super::{Verdict, check_unchanged, open, reading};
use crate::json::{self, seen};
use crate::memory;
use crate::number;
use crate::output::{self, Output, TellArgs};
#[cfg(feature = "viewer")]
use crate::picture;
use crate::progress::{Meter, line};
use crate::report::{count, table};
use crate::stop::{self, Stop};
use crate::view::{self, ImageArgs};
use anyhow::{Context, Result, ensure};
use chpm_extmem::MappedFile;
use chpm_format::{Chpm, FormatError, PageBuf};
use chpm_mesh::{Bytes, ClusterId, Counted};
use chpm_refine::{ActiveList, Changes, Front, Hierarchy, Pager, PmCursor, View, is_visible};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Arguments of `chpm walk`.
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
    /// Memory that the whole process stays below, as in 256M: what the camera does not need makes room, and what does not fit is
    /// replaced by coarser clusters. Less than 64M, and with --render, it is what pages may take alone. Without a limit if not given
    #[arg(long, value_name = "SIZE")]
    memory: Option<Bytes>,
    /// Frames from the request of a page until it is there; 0 waits for every page
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = number::count(0..=u32::MAX))]
    latency: u32,
    /// Read ahead, at most this much a frame, as in 1M: what the camera will need if it goes on as it moves, and the children of what it
    /// needs then. What a split brings is read as a whole or not at all, so less than that, some 0.5M with the default
    /// cluster size, reads little. Nothing if not given
    #[arg(long, value_name = "SIZE")]
    prefetch: Option<Bytes>,
    #[command(flatten)]
    tell: TellArgs,
    #[cfg(feature = "viewer")]
    #[command(flatten)]
    pub(crate) pictures: picture::walk::RenderArgs,
}

/// How many runs of pages side by side there are among pages.
fn runs(pages: &[ClusterId]) -> u64 {
    let mut places: Vec<u32> = pages.iter().map(|page| page.0).collect();
    places.sort_unstable();
    places.chunk_by(|a, b| a + 1 == *b).count() as u64
}

/// Memory from which on it is the whole process's.
const PROCESS: Bytes = Bytes::mib(64);
/// Bytes that selecting takes for each cluster.
const SELECTION: u64 = 1024;

/// How many frames beyond the latency are read ahead: time to spread the reading over.
const LOOK_AHEAD: u32 = 5;

/// Work of one frame; times in milliseconds.
#[derive(Clone, Copy, Debug, Default)]
struct Frame {
    triangles: u64,
    clusters: u64,
    visible: u64,
    splits: u64,
    collapses: u64,
    pm_steps: u64,
    refine_ms: f64,
    pm_ms: f64,
    /// Checks of the pages that came.
    check_ms: f64,
    /// Finding what to read ahead.
    prefetch_ms: f64,
    requested_bytes: u64,
    prefetched_bytes: u64,
    resident_bytes: u64,
    /// Groups that the view wants split and that are not.
    withheld: u64,
    /// Runs of pages side by side that were asked for: reads.
    requested_runs: u64,
}

/// A column's name and its value.
type Column = (&'static str, fn(&Frame) -> f64);

const COLUMNS: [Column; 15] = [
    ("triangles", |f| f.triangles as f64),
    ("clusters", |f| f.clusters as f64),
    ("visible", |f| f.visible as f64),
    ("splits", |f| f.splits as f64),
    ("collapses", |f| f.collapses as f64),
    ("pm_steps", |f| f.pm_steps as f64),
    ("refine_ms", |f| f.refine_ms),
    ("pm_ms", |f| f.pm_ms),
    ("check_ms", |f| f.check_ms),
    ("prefetch_ms", |f| f.prefetch_ms),
    ("requested_bytes", |f| f.requested_bytes as f64),
    ("prefetched_bytes", |f| f.prefetched_bytes as f64),
    ("resident_bytes", |f| f.resident_bytes as f64),
    ("withheld", |f| f.withheld as f64),
    ("requested_runs", |f| f.requested_runs as f64),
];

/// Walks and reports.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    #[cfg(feature = "viewer")]
    if args.pictures.render {
        return draw(args, stop);
    }
    let file = open(&args.file)?;
    reading(&file, || follow(&file, args, stop))
}

fn follow(file: &Chpm<MappedFile>, args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let (csv, mut out) = args.tell.open(output::WALK_CSV, &[&args.file, &args.path])?;
    let path = view::read_path(&args.path)?;
    let meter = Meter::new(args.tell.quiet);
    meter.start("walk", path.cameras.len() as u64);
    let mut walk = Walk::new(file, args)?;
    let mut frames = Vec::with_capacity(path.cameras.len());
    for (index, camera) in path.cameras.iter().enumerate() {
        stop::check(&cancel)?;
        let view = args.image.view(file, camera, args.poe);
        let view = view.with_context(|| format!("frame {index} of '{}'", args.path.display()))?;
        // A camera that stands still in the end, or cannot go on, is foreseen where it is.
        let before = index.checked_sub(1).and_then(|before| path.cameras.get(before)).unwrap_or(camera);
        let ahead = camera.onward(before, f64::from(args.latency + LOOK_AHEAD));
        let ahead = args.image.view(file, &ahead, args.poe).unwrap_or(view);
        frames.push(walk.frame(&view, &ahead)?);
        meter.add(1);
    }
    meter.finish();
    check_unchanged(file)?;
    if let Some(csv) = csv {
        write_csv(&frames, csv)?;
    }
    if args.tell.json {
        json::print(&summary(&frames, args), &mut out)?;
    } else {
        print(&frames, &mut out)?;
    }
    out.flush()?;
    if frames.iter().all(|frame| frame.visible == 0) {
        let name = args.file.display();
        line(&format!("warning: no frame of '{}' sees anything of '{name}'", args.path.display()));
    }
    Ok(Verdict::Good)
}

/// The walk in pictures.
#[cfg(feature = "viewer")]
fn draw(args: &Args, stop: &Stop) -> Result<Verdict> {
    let cancel = stop.heed();
    let walk = picture::walk::Walk {
        file: &args.file,
        path_file: &args.path,
        path: &view::read_path(&args.path)?,
        viewport: args.image.viewport.0,
        poe: args.poe,
        memory: args.memory,
        csv: args.tell.csv.as_deref(),
        force: args.tell.force,
        json: args.tell.json,
        quiet: args.tell.quiet,
    };
    if !args.pictures.prove {
        picture::walk::run(&walk, &args.pictures, &cancel)?;
        return Ok(Verdict::Good);
    }
    let mut out = stdout();
    let verdict = picture::proof::run(&walk, &args.pictures.device, &cancel, &mut out)?;
    out.flush()?;
    Ok(verdict)
}

/// A viewer without pictures: the active clusters, each with a mesh that follows its position, and the pages that it would have in memory.
struct Walk<'a> {
    file: &'a Chpm<MappedFile>,
    hierarchy: Hierarchy,
    pager: Pager,
    prefetch: Option<Bytes>,
    /// Pages on their way, by the frames that they were asked for in.
    requests: VecDeque<Vec<ClusterId>>,
    latency: usize,
    list: ActiveList,
    /// By cluster, those that are there: one that was packed is unpacked once.
    pages: Vec<Option<Box<PageBuf<'a>>>>,
    /// By cluster, those of the cut.
    cursors: Vec<Option<PmCursor>>,
    /// Memory of those that left.
    free: Vec<PmCursor>,
}

impl<'a> Walk<'a> {
    fn new(file: &'a Chpm<MappedFile>, args: &Args) -> Result<Self> {
        let own = SELECTION * file.clusters().len() as u64;
        let pages = match args.memory {
            Some(memory) if memory >= PROCESS => {
                let half = memory::divide(file, memory, own)?;
                // Meshes that follow their positions are made of the pages at hand, and take up to 1.4 times as much. Pages that were packed
                // take memory of their own.
                let (pages, mapped) =
                    if file.header().is_packed() { (half / 4 * 3, half / 5) } else { (half, half / 2) };
                file.get_ref().keep_resident(mapped);
                Bytes(pages)
            }
            memory => {
                let pages = memory.unwrap_or(Bytes(u64::MAX));
                // The roots are never let go, so they have to fit.
                let attributes = file.header().attributes();
                let roots = file.roots().map(|root| file.clusters()[root.index()].unpacked_len(attributes));
                let needed = Bytes(roots.sum());
                ensure!(
                    needed <= pages,
                    "memory: at least {needed} needed for the coarsest mesh, {pages} allowed; allow more"
                );
                pages
            }
        };
        Ok(Walk {
            file,
            hierarchy: Hierarchy::new(file),
            pager: Pager::new(file, pages),
            prefetch: args.prefetch,
            requests: VecDeque::new(),
            latency: args.latency as usize,
            list: ActiveList::of_checked_pages(file),
            pages: file.clusters().iter().map(|_| None).collect(),
            cursors: file.clusters().iter().map(|_| None).collect(),
            free: Vec::new(),
        })
    }

    fn frame(&mut self, view: &View, ahead: &View) -> Result<Frame> {
        let clusters = self.file.clusters();
        fn bytes(pages: &[ClusterId], clusters: &[chpm_format::ClusterRecord]) -> u64 {
            pages.iter().map(|id| u64::from(clusters[id.index()].page_len)).sum()
        }

        let mut watch = Watch(Instant::now());
        let traffic = self.pager.want(self.file, &self.hierarchy, view);
        self.let_go(&traffic.evictions);
        let mut requests = traffic.requests;
        let requested_bytes = bytes(&requests, clusters);
        let asked = watch.lap();
        let early = self.read_ahead(ahead);
        let prefetched_bytes = bytes(&early, clusters);
        requests.extend(early);
        let requested_runs = runs(&requests);
        let foreseen = watch.lap();

        self.deliver(requests)?;
        let checked = watch.lap();
        let changes = if self.pager.has_roots() {
            self.list.update_with(
                self.file,
                &self.hierarchy,
                |group| self.hierarchy.bound(group, view),
                |group| self.pager.is_ready(group),
                |id, _| Ok(page_at_hand(self.file, &self.pages, id)?),
            )?
        } else {
            Changes::default()
        };
        let refined = asked + watch.lap();
        let triangles = self.play()?;
        let played = watch.lap();

        let records = self.list.members().map(|member| &clusters[member.cluster.index()]);
        fn splits(front: &Front) -> u64 {
            front.split_groups().len() as u64
        }
        Ok(Frame {
            triangles,
            clusters: self.list.len() as u64,
            visible: records.filter(|record| is_visible(record, view)).count() as u64,
            splits: changes.splits,
            collapses: changes.collapses,
            pm_steps: changes.pm_steps,
            refine_ms: milliseconds(refined),
            pm_ms: milliseconds(played),
            check_ms: milliseconds(checked),
            prefetch_ms: milliseconds(foreseen),
            requested_bytes,
            prefetched_bytes,
            resident_bytes: self.pager.reserved().0,
            withheld: splits(self.pager.wanted()) - splits(self.list.front()),
            requested_runs,
        })
    }

    /// Clusters to prefetch for a view to come: all that it splits, and what it would split next.
    fn read_ahead(&mut self, ahead: &View) -> Vec<ClusterId> {
        let Some(limit) = self.prefetch else { return Vec::new() };
        let traffic = self.pager.foresee(self.file, &self.hierarchy, ahead, limit, |_| true, |_| true);
        self.let_go(&traffic.evictions);
        traffic.requests
    }

    fn let_go(&mut self, pages: &[ClusterId]) {
        pages.iter().for_each(|id| self.pages[id.index()] = None);
    }

    /// Lets the pages arrive whose time has come, and checks them: whoever uses one later need not.
    fn deliver(&mut self, requests: Vec<ClusterId>) -> Result<()> {
        self.requests.push_back(requests);
        if self.requests.len() > self.latency {
            let pages = self.requests.pop_front().unwrap_or_default();
            let checked: Vec<_> = pages.par_iter().map(|page| self.file.page(*page)).collect();
            for (page, checked) in pages.into_iter().zip(checked) {
                let checked = checked?;
                // What was let go on its way has come too late.
                if self.pager.arrive(self.file, page) {
                    self.pages[page.index()] = Some(Box::new(checked));
                }
            }
        }
        Ok(())
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
                    let page = page_at_hand(self.file, &self.pages, member.cluster)?;
                    cursor.load(&page.view().progressive_mesh());
                    slot.insert(cursor)
                }
            };
            cursor.move_to(member.vertices as usize);
            triangles += cursor.triangles().len() as u64;
        }
        Ok(triangles)
    }
}

/// A page that came, without a copy of it; from the file if it was let go since.
fn page_at_hand<'p>(
    file: &'p Chpm<MappedFile>,
    pages: &'p [Option<Box<PageBuf<'_>>>],
    id: ClusterId,
) -> Result<PageBuf<'p>, FormatError> {
    match &pages[id.index()] {
        Some(page) => Ok(page.view().into()),
        None => file.page_known(id),
    }
}

/// Times between laps.
struct Watch(Instant);

impl Watch {
    fn lap(&mut self) -> Duration {
        let now = Instant::now();
        now.duration_since(std::mem::replace(&mut self.0, now))
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

fn write_csv(frames: &[Frame], file: Output) -> Result<()> {
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
    fn sum(of: fn(&Frame) -> u64, frames: &[Frame]) -> Bytes {
        Bytes(frames.iter().map(of).sum())
    }
    let (requested, ahead) =
        (sum(|frame| frame.requested_bytes, frames), sum(|frame| frame.prefetched_bytes, frames));
    writeln!(out, "{}, {requested} requested, {ahead} read ahead", Counted(frames.len() as u64, "frame"))?;
    fn number(x: f64) -> String {
        if x.fract() == 0.0 { count(x as u64) } else { format!("{x:.3}") }
    }
    let rows = COLUMNS.iter().map(|(name, value)| {
        let values = [0.5, 0.95, 1.0].map(|q| number(quantile(frames, q, *value)));
        [vec![(*name).replace('_', " ")], values.to_vec()].concat()
    });
    writeln!(out, "{}", table(&["a frame", "median", "95 %", "most"], rows))?;
    Ok(())
}

fn summary(frames: &[Frame], args: &Args) -> seen::Walk {
    let columns = COLUMNS.iter().map(|(name, value)| {
        let [median, p95, most] = [0.5, 0.95, 1.0].map(|q| quantile(frames, q, *value));
        (*name, seen::Spread { median, p95, most, total: frames.iter().map(value).sum() })
    });
    seen::Walk { schema: "chpm-walk/1", frames: frames.len(), poe: args.poe, summary: columns.collect() }
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
