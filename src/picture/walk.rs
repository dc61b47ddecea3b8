//! A camera path in pictures: each frame drawn with and without occlusion culling, and what it took.

use super::{DeviceArgs, LookArgs, plot, write_png};
use crate::json::{self, seen};
use crate::output::{self, Output};
use crate::progress::Meter;
use crate::report::{count, table};
use crate::stop;
use anyhow::{Context, Result, ensure};
use chpm_build::Cancel;
use chpm_mesh::{Bytes, Counted};
use chpm_refine::CameraPath;
use chpm_viewer::{Accuracy, FrameRequest, Image, Stats, Viewer, headless};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Arguments of `chpm walk --render`, beside those of `chpm walk`.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "With pictures", mut_args(needs_render))]
pub(crate) struct RenderArgs {
    /// Draw every frame, once with occlusion culling and once without
    #[arg(long, conflicts_with_all = ["latency", "prefetch", "cull"])]
    pub(crate) render: bool,
    /// Let every frame wait for all that it wants: exact pictures instead of those that a window would have in time
    #[arg(long, requires = "render")]
    wait: bool,
    /// Draw no pictures but item buffers, each triangle in a colour of its own, and compare them: exit code 1 if culling changes which
    /// triangle a pixel shows. Give it memory for all that the path wants
    #[arg(long, requires = "render", conflicts_with_all = ["csv", "plot", "images"])]
    pub(crate) prove: bool,
    /// Write a plot over the frames (SVG); - for standard output
    #[arg(long, value_name = "FILE", requires = "render")]
    plot: Option<PathBuf>,
    /// Write the frames, those with culling, as PNGs into a folder that there is
    #[arg(long, value_name = "DIR", requires = "render")]
    images: Option<PathBuf>,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
}

/// Options of other commands too, which mean nothing without pictures here.
const OF_PICTURES: [&str; 8] =
    ["color", "shading", "smooth", "wireframe", "one_sided", "background", "adapter", "gpu_memory"];

fn needs_render(arg: clap::Arg) -> clap::Arg {
    if OF_PICTURES.contains(&arg.get_id().as_str()) { arg.requires("render") } else { arg }
}

/// State that it shares with the walk without pictures.
pub(crate) struct Walk<'a> {
    pub(crate) file: &'a Path,
    pub(crate) path_file: &'a Path,
    pub(crate) path: &'a CameraPath,
    pub(crate) viewport: [u32; 2],
    pub(crate) poe: f64,
    pub(crate) memory: Option<Bytes>,
    pub(crate) csv: Option<&'a Path>,
    pub(crate) force: bool,
    pub(crate) json: bool,
    pub(crate) quiet: bool,
}

/// One frame: what the viewer says, and how long it took from request to picture.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Frame {
    pub(super) stats: Stats,
    pub(super) time: Duration,
}

impl Frame {
    pub(super) fn milliseconds(&self) -> f64 {
        1e3 * self.time.as_secs_f64()
    }

    /// The part of the frame that something took, per cent.
    fn share(&self, part: Duration) -> f64 {
        let whole = self.time.as_secs_f64();
        if whole > 0.0 { 100.0 * part.as_secs_f64() / whole } else { 0.0 }
    }

    fn refining(&self) -> f64 {
        self.share(self.stats.times.refine + self.stats.times.pm)
    }

    fn occlusion(&self) -> f64 {
        self.share(self.stats.times.occlusion)
    }

    fn stalling(&self) -> f64 {
        self.share(self.stats.times.stall)
    }

    /// All that is none of the others: sending, drawing, bringing the picture back.
    fn rendering(&self) -> f64 {
        (100.0 - self.refining() - self.occlusion() - self.stalling()).max(0.0)
    }

    fn rate(&self) -> f64 {
        1e3 / self.milliseconds().max(1e-6)
    }
}

/// A column's name and its value.
type Column = (&'static str, fn(&Frame) -> f64);

const COLUMNS: [Column; 22] = [
    ("fps", Frame::rate),
    ("frame_ms", Frame::milliseconds),
    ("clusters", |f| f.stats.clusters_active as f64),
    ("splits", |f| f.stats.splits as f64),
    ("collapses", |f| f.stats.collapses as f64),
    ("pm_steps", |f| f.stats.pm_steps as f64),
    ("triangles", |f| f.stats.triangles as f64),
    ("drawn", |f| f.stats.clusters_drawn as f64),
    ("frustum_culled", |f| f.stats.frustum_culled as f64),
    ("occluded", |f| f.stats.occluded as f64),
    ("newly_visible", |f| f.stats.newly_visible as f64),
    ("refining_percent", Frame::refining),
    ("occlusion_percent", Frame::occlusion),
    ("rendering_percent", Frame::rendering),
    ("stalling_percent", Frame::stalling),
    ("stalls", |f| f.stats.stalls as f64),
    ("withheld", |f| f.stats.withheld as f64),
    ("poe", |f| f.stats.poe),
    ("requested_bytes", |f| f.stats.requested_bytes as f64),
    ("uploaded_bytes", |f| f.stats.uploaded_bytes as f64),
    ("resident_bytes", |f| f.stats.resident_bytes as f64),
    ("gpu_bytes", |f| f.stats.gpu_bytes as f64),
];

/// The frames of a path, drawn in one way.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) culling: bool,
    pub(super) frames: Vec<Frame>,
}

impl Run {
    fn mean(&self, of: fn(&Frame) -> f64) -> f64 {
        self.frames.iter().map(of).sum::<f64>() / self.frames.len().max(1) as f64
    }

    /// Frames by the time of all.
    fn rate(&self) -> f64 {
        let time: f64 = self.frames.iter().map(|frame| frame.time.as_secs_f64()).sum();
        self.frames.len() as f64 / time.max(1e-9)
    }

    pub(super) fn name(&self) -> &'static str {
        if self.culling { "culling on" } else { "culling off" }
    }
}

/// Draws and reports.
pub(crate) fn run(walk: &Walk<'_>, args: &RenderArgs, cancel: &Cancel) -> Result<()> {
    // All outputs can be written, or nothing is drawn.
    let inputs = [walk.file, walk.path_file];
    let csv = walk.csv.map(|path| output::WALK_CSV.create(path, walk.force, &inputs)).transpose()?;
    let plot = args.plot.as_deref().map(|path| output::WALK_PLOT.create(path, walk.force, &inputs));
    let plot = plot.transpose()?;
    let mut out = output::messages(csv.iter().chain(&plot), walk.json, walk.quiet)?;
    if let Some(folder) = &args.images {
        ensure!(folder.is_dir(), "'{}' is no folder that there is; make it first", folder.display());
        for frame in 0..walk.path.cameras.len() {
            chpm_extmem::target(&image_path(folder, frame), walk.force)?;
        }
    }

    // Each way with a viewer of its own, so that neither finds what the other has read.
    let meter = Meter::new(walk.quiet);
    meter.start("walk", 2 * walk.path.cameras.len() as u64);
    let mut adapter = String::new();
    let mut runs = Vec::new();
    for culling in [true, false] {
        let mut viewer = args.device.open(walk.file, walk.memory.unwrap_or(Bytes::mib(1024)))?;
        adapter = viewer.gpu().describe();
        let watch = Watch { meter: &meter, cancel };
        let frames = draw(walk, args, &mut viewer, culling, &watch)?;
        runs.push(Run { culling, frames });
    }
    meter.finish();

    if let Some(csv) = csv {
        write_csv(&runs, csv)?;
    }
    if let Some(mut plot) = plot {
        let [width, height] = walk.viewport;
        let name = walk.file.file_name().unwrap_or_default().to_string_lossy();
        let title = format!("{name}, {width}x{height}, {} pixels of error", walk.poe);
        plot.write_all(plot::svg(&runs, &title, &adapter)?.as_bytes())?;
        plot.publish()?;
    }
    if walk.json {
        json::print(&as_json(&runs, walk, &adapter), &mut out)?;
    } else {
        print(&runs, &adapter, &mut out)?;
    }
    Ok(out.flush()?)
}

/// Who hears of each frame, and may end the walk.
struct Watch<'a> {
    meter: &'a Meter,
    cancel: &'a Cancel,
}

fn draw(
    walk: &Walk<'_>,
    args: &RenderArgs,
    viewer: &mut Viewer,
    culling: bool,
    watch: &Watch<'_>,
) -> Result<Vec<Frame>> {
    let request = |camera| FrameRequest {
        accuracy: Accuracy::PoE(walk.poe),
        look: args.look.look(),
        occlusion_culling: culling,
        wait: args.wait,
        ..FrameRequest::new(camera, walk.viewport)
    };

    // What the first frame needs is there before it: the walk is about what changes.
    if let Some(first) = walk.path.cameras.first() {
        headless::image(viewer, &FrameRequest { wait: true, ..request(*first) })
            .with_context(|| format!("frame 0 of '{}'", walk.path_file.display()))?;
    }

    let mut frames = Vec::with_capacity(walk.path.cameras.len());
    for (index, camera) in walk.path.cameras.iter().enumerate() {
        stop::check(watch.cancel)?;
        // The clock stops before anything is written.
        let start = Instant::now();
        let drawn = headless::image(viewer, &request(*camera));
        let time = start.elapsed();
        let (image, stats) =
            drawn.with_context(|| format!("frame {index} of '{}'", walk.path_file.display()))?;
        frames.push(Frame { stats, time });
        if let Some(folder) = args.images.as_deref().filter(|_| culling) {
            write_image(&image, folder, index, walk.force)?;
        }
        watch.meter.add(1);
    }
    Ok(frames)
}

fn write_image(image: &Image, folder: &Path, index: usize, force: bool) -> Result<()> {
    write_png(image, output::RENDER.create(&image_path(folder, index), force, &[])?)?.publish()
}

fn image_path(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("frame-{index:05}.png"))
}

fn write_csv(runs: &[Run], file: Output) -> Result<()> {
    let mut csv = BufWriter::new(file);
    let names: Vec<&str> = COLUMNS.iter().map(|(name, _)| *name).collect();
    writeln!(csv, "culling,frame,{}", names.join(","))?;
    for run in runs {
        for (index, frame) in run.frames.iter().enumerate() {
            write!(csv, "{},{index}", u8::from(run.culling))?;
            for (_, value) in COLUMNS {
                write!(csv, ",{}", value(frame))?;
            }
            writeln!(csv)?;
        }
    }
    csv.into_inner().map_err(|error| error.into_error())?.publish()?;
    Ok(())
}

/// The tables of Quick-VDR: what a frame is (its table 2), and where its time goes (its table 3).
fn print(runs: &[Run], adapter: &str, out: &mut impl Write) -> Result<()> {
    let frames = runs.first().map_or(0, |run| run.frames.len());
    writeln!(out, "{} on {adapter}", Counted(frames as u64, "frame"))?;

    let means = runs.iter().map(|run| {
        fn whole(of: fn(&Frame) -> f64, run: &Run) -> String {
            count(run.mean(of).round() as u64)
        }
        vec![
            run.name().to_owned(),
            format!("{:.1}", run.rate()),
            whole(|f| f.stats.clusters_active as f64, run),
            whole(|f| f.stats.clusters_drawn as f64, run),
            whole(|f| (f.stats.splits + f.stats.collapses) as f64, run),
            whole(|f| f.stats.pm_steps as f64, run),
            whole(|f| f.stats.triangles as f64, run),
        ]
    });
    let names = ["mean of a frame", "fps", "front", "drawn", "splits + collapses", "PM steps", "triangles"];
    writeln!(out, "{}", table(&names, means))?;

    let shares = runs.iter().map(|run| {
        let parts = [Frame::refining, Frame::occlusion, Frame::rendering, Frame::stalling];
        let shares = parts.map(|part| format!("{:.1} %", run.mean(part)));
        [vec![run.name().to_owned()], shares.to_vec()].concat()
    });
    writeln!(
        out,
        "{}",
        table(&["time of a frame", "refining", "occlusion", "rendering", "stalling"], shares)
    )?;
    Ok(())
}

fn as_json(runs: &[Run], walk: &Walk<'_>, adapter: &str) -> seen::WalkRender {
    let runs = runs.iter().map(|run| {
        let means = COLUMNS.iter().map(|(name, value)| ((*name).to_owned(), run.mean(*value).into()));
        seen::Run { culling: run.culling, fps: run.rate(), mean: means.collect() }
    });
    seen::WalkRender {
        schema: "chpm-walk-render/1",
        frames: walk.path.cameras.len(),
        viewport: walk.viewport,
        poe: walk.poe,
        adapter: adapter.to_owned(),
        runs: runs.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_viewer::Times;

    #[test]
    fn shares_add_up() {
        let ms = Duration::from_millis;
        let times = Times { refine: ms(2), pm: ms(3), occlusion: ms(10), stall: ms(25), ..Times::default() };
        let frame = Frame { stats: Stats { times, ..Stats::default() }, time: ms(100) };
        let parts = [frame.refining(), frame.occlusion(), frame.stalling(), frame.rendering()];
        for (part, expected) in parts.into_iter().zip([5.0, 10.0, 25.0, 60.0]) {
            assert!((part - expected).abs() < 1e-9, "{parts:?}");
        }
        assert!((frame.rate() - 10.0).abs() < 1e-9);
        assert_eq!(Frame::default().refining(), 0.0);
    }

    #[test]
    fn rates_are_of_the_whole_run() {
        let frame = |ms| Frame { time: Duration::from_millis(ms), ..Frame::default() };
        let run = Run { culling: true, frames: vec![frame(10), frame(30)] };
        assert!((run.rate() - 50.0).abs() < 1e-9, "not the mean of 100 and 33.3");
    }
}
