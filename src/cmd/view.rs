//! `chpm view`: a window on a model, which is built first if need be.

use super::{Verdict, build, open, stdout, temporary};
use crate::args::MemorySize;
use crate::batch::inputs;
use crate::beside::Beside;
use crate::forecast::Forecast;
use crate::number::{self, Triangles};
use crate::output;
use crate::picture::sketch::Sketch;
use crate::picture::{DeviceArgs, StanceArgs, shading};
use crate::progress::{Meter, line};
use crate::proximity::RelateArgs;
use crate::report::count;
use crate::section::Slicing;
use crate::stop::Stop;
use crate::view;
use anyhow::{Context, Result, bail, ensure};
use chpm_build::{BuildConfig, BuildProgress, Cancel, Progress, Settings, Silent, Stage};
use chpm_extmem::{Store, WorkDir};
use chpm_format::Metadata;
use chpm_import::ply::{Encoding, write_mesh};
use chpm_import::{Images, input};
use chpm_mesh::{Bytes, Counted};
use chpm_verify::against::each_corners;
use chpm_viewer::window::remember::Memory;
use chpm_viewer::window::{self, Options, Outcome, Prepare};
use chpm_viewer::{Accuracy, Budgets, Shading};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Arguments of `chpm view`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// The .chpm file; or a mesh ({meshes}), whose .chpm is built beside it first, unless it
    /// is there. A model can also be dropped on the window
    model: Option<PathBuf>,
    /// Another one, or the same, that is shown with it, put somewhere by --pose, and how near they are. Meshes are built before the window opens
    second: Option<PathBuf>,
    #[command(flatten)]
    relate: RelateArgs,
    /// Main memory for pages, as in 512M; of two models, half for each, and what one cannot use for the other. As much again is for what is asked
    /// about both
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    memory: Bytes,
    /// Pixels of error that are allowed; what was used last, or 1, if not given
    #[arg(long, value_name = "P", value_parser = view::pixels, conflicts_with = "triangles")]
    poe: Option<f64>,
    /// The finest mesh of about so many triangles, as in 20k, or of a share of the model's, as in 1%, in place of a bound on the error
    #[arg(long, value_name = "N")]
    triangles: Option<Triangles>,
    /// Colour by a named scalar of a .chpm, such as quality, from its lowest value (dark blue) to its highest (yellow)
    #[arg(long, value_name = "NAME", requires = "model", help_heading = "Looks")]
    color_by: Option<String>,
    /// How light falls on triangles; what was used last, or smooth, if not given
    #[arg(long, value_name = "HOW", value_parser = shading(), help_heading = "Looks")]
    shading: Option<Shading>,
    #[command(flatten)]
    stance: StanceArgs,
    /// Go along this camera path first (see chpm path), one camera a frame
    #[arg(long, value_name = "FILE", requires = "model")]
    path: Option<PathBuf>,
    /// Draw so many frames, one after the other, and quit; nothing is remembered
    #[arg(long, value_name = "N", requires = "model", value_parser = number::count(1..=u64::MAX))]
    frames: Option<u64>,
    /// With --frames: write the last picture as a PNG
    #[arg(long, value_name = "FILE", requires = "frames")]
    screenshot: Option<PathBuf>,
    /// Replace the screenshot, or a .chpm that was not built from the mesh as it is now
    #[arg(short, long)]
    force: bool,
    /// Begin as if the model had never been opened
    #[arg(long)]
    fresh: bool,
    /// No progress
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Builds if need be, and shows.
pub(crate) fn run(args: &Args, stop: &Stop) -> Result<Verdict> {
    // What would fail at the end fails now.
    args.relate.check(args.second.as_deref())?;
    if let Some(path) = &args.screenshot {
        output::SCREENSHOT.check(path)?;
        chpm_extmem::target(path, args.force)?;
    }
    let path = args.path.as_deref().map(view::read_path).transpose()?;
    for model in args.model.iter().chain(&args.second) {
        fs::metadata(model).with_context(|| format!("cannot open '{}'", model.display()))?;
    }

    // A mesh is built in the window, but first where a script or a share of its triangles needs it.
    let share = matches!(args.triangles, Some(Triangles::Percent(_)));
    let model = match &args.model {
        Some(model)
            if inputs::is_mesh(model)
                && (share || args.frames.is_some() || args.path.is_some() || args.second.is_some()) =>
        {
            Some(prepared(model, args, stop)?)
        }
        model => model.clone(),
    };
    let second = match (&model, &args.second) {
        (Some(model), Some(second)) => {
            let second = if inputs::is_mesh(second) { prepared(second, args, stop)? } else { second.clone() };
            Some(args.relate.second([model, &second], MemorySize(args.memory), stop)?)
        }
        _ => None,
    };
    let built = model.as_deref().filter(|model| !inputs::is_mesh(model));
    let triangles = args.triangles.map(|wanted| accuracy(wanted, built)).transpose()?;

    if let (Some(name), Some(model)) = (&args.color_by, &args.model) {
        has_scalar(model, name)?;
    }
    let cancel = stop.heed();
    let options = Options {
        model,
        second,
        budgets: Budgets { memory: args.memory, gpu_memory: args.device.gpu_memory },
        adapter: args.device.adapter.clone(),
        color_by: args.color_by.clone(),
        shading: args.shading,
        accuracy: args.poe.map(Accuracy::PoE).or(triangles),
        up: args.stance.up,
        side: args.stance.side,
        path,
        frames: args.frames,
        screenshot: args.screenshot.clone(),
        memory: Memory::of_user(),
        recall: !args.fresh,
        slice: Arc::new(Slicing { memory: Bytes(args.memory.0 / 4) }),
        prepare: Arc::new(Builder { overwrite: args.force, ..Builder::default() }),
        stop: {
            let cancel = cancel.clone();
            Box::new(move || cancel.is_cancelled())
        },
    };
    let outcome = window::run(options)?;

    // A signal closes the window, too, and is no success.
    ensure!(!cancel.is_cancelled(), "the window was closed on request");
    if let Some(why) = &outcome.forgot {
        line(&format!("note: {why}"));
    }
    if args.frames.is_some() {
        tell(&outcome)?;
    }
    Ok(Verdict::Good)
}

/// Refuses a model without the scalar that colours are to show.
fn has_scalar(model: &Path, name: &str) -> Result<()> {
    let told = model.display();
    ensure!(
        !inputs::is_mesh(model),
        "--color-by is for a .chpm: build '{told}' with --keep {name}, and show that"
    );
    let file = open(model)?;
    let has = file.scalars().iter().any(|scalar| scalar.name == name);
    ensure!(
        has,
        "'{told}' has no scalar '{name}': build it with --keep {name}; chpm info lists those that it has"
    );
    Ok(())
}

/// A count of triangles, of the model that is shown first.
fn accuracy(wanted: Triangles, model: Option<&Path>) -> Result<Accuracy> {
    let Some(path) = model else {
        let Triangles::Count(count) = wanted else { bail!("--triangles with % needs the name of a model") };
        return Ok(Accuracy::Triangles(count));
    };
    let all = open(path)?.header().source_triangle_count;
    let wanted = wanted.of(all);
    if wanted > all {
        let (name, all) = (path.display(), Counted(all, "triangle"));
        line(&format!("warning: the finest mesh of '{name}' has {all}, fewer than {}", count(wanted)));
    }
    Ok(Accuracy::Triangles(wanted))
}

fn tell(outcome: &Outcome) -> Result<()> {
    let Outcome { frames, seconds, adapter, .. } = outcome;
    let mut out = stdout();
    let rate = *frames as f64 / seconds.max(1e-9);
    writeln!(out, "{} in {seconds:.2} s, {rate:.1} a second, on {adapter}", Counted(*frames, "frame"))?;
    if let Some([median, most]) = outcome.moving {
        writeln!(out, "moving: {median:.1} ms a frame, 95 of 100 within {most:.1} ms")?;
    }
    if let Some(seconds) = outcome.complete {
        writeln!(out, "at rest: complete after {seconds:.2} s")?;
    }
    Ok(out.flush()?)
}

/// Where the file of a mesh is.
fn place(source: &Path, cancel: &Cancel) -> Result<Beside> {
    Beside::of(source, |output| is_current(source, output, cancel) == Some(true))
}

/// Whether the file is built from the mesh as it is now, with whatever settings. `None` if there is no file.
fn is_current(source: &Path, output: &Path, cancel: &Cancel) -> Option<bool> {
    output.symlink_metadata().ok()?;
    // What is no file would be waited for; the build refuses it.
    chpm_extmem::target(output, true).ok()?;
    Some(is_built_from(source, output, cancel).unwrap_or(false))
}

fn is_built_from(source: &Path, output: &Path, cancel: &Cancel) -> Result<bool> {
    let Metadata { source: from, settings, .. } = open(output)?.metadata()?;
    // A file without colours of images was built without them.
    let is_textured = settings.iter().any(|(name, _)| name == Settings::TEXTURE[0]);
    let images = if is_textured { Images::Grey } else { Images::Ignored };
    Ok((from.byte_len, from.hash) == input::fingerprint(&input::files(source, images, cancel)?, cancel)?)
}

fn stale(source: &Path, output: &Path) -> String {
    format!(
        "'{}' was not built from '{}' as it is now; open it by its own name, or build it again with chpm build --force",
        output.display(),
        source.display()
    )
}

/// The file of a mesh, built with the usual progress if it is not there.
fn prepared(source: &Path, args: &Args, stop: &Stop) -> Result<PathBuf> {
    // Nothing is to be cleaned up: the first signal ends the process.
    let cancel = Cancel::default();
    let Beside { path: output, is_cached } = place(source, &cancel)?;
    let overwrite = args.force || is_cached;
    match is_current(source, &output, &cancel) {
        Some(true) => return Ok(output),
        Some(false) => ensure!(overwrite, stale(source, &output)),
        None => {}
    }
    let config = BuildConfig { overwrite, ..BuildConfig::default() };
    build::build(source, &output, &config, &Meter::new(args.quiet), stop)?;
    if !args.quiet {
        line(&format!("built: {}", output.display()));
    }
    Ok(output)
}

/// Builds what the window is given.
#[derive(Default)]
struct Builder {
    overwrite: bool,
    /// Of the build that was begun last.
    cancel: Mutex<Cancel>,
    /// Previews, looked at meanwhile; gone with it.
    previews: Mutex<Vec<WorkDir>>,
}

impl Builder {
    /// A coarse model of a source, built in a folder of its own. `tell` hears how far reading is, which takes the time.
    fn preview(&self, source: &Path, cancel: &Cancel, tell: impl Fn(f32)) -> Result<PathBuf> {
        let folder = temporary()?;
        let store = Store::create(folder.path(), PREVIEW.0)?;
        let mut sketch = Sketch::default();
        let lens = input::files(source, Images::Ignored, cancel)?
            .into_iter()
            .map(|file| Ok(fs::metadata(file)?.len()));
        let len: u64 = lens.sum::<Result<u64>>()?;
        let mut told = 0;
        let tell_read = |read: u64| {
            // A window need not hear of less than a hundredth.
            let hundredths = 100 * read / len.max(1);
            if hundredths > told {
                told = hundredths;
                tell(hundredths.min(100) as f32 / 100.0);
            }
        };
        each_corners(source, &store, cancel, tell_read, |corners| sketch.push(corners))?;
        let mesh = sketch.finish().context("nothing to show")?;
        let (ply, output) = (folder.path().join("preview.ply"), folder.path().join("preview.chpm"));
        write_mesh(BufWriter::new(File::create(&ply)?), &mesh, Encoding::BinaryLittleEndian)?;
        chpm_build::build(&ply, &output, &config(false), &Silent, cancel)?;
        self.previews.lock().unwrap_or_else(PoisonError::into_inner).push(folder);
        Ok(output)
    }
}

/// Memory for reading what a preview is made of.
const PREVIEW: Bytes = Bytes::mib(512);

/// A build that leaves nothing behind if it is stopped.
fn config(overwrite: bool) -> BuildConfig {
    let mut config = BuildConfig { overwrite, ..BuildConfig::default() };
    config.resources.checkpoint = None;
    config
}

impl Prepare for Builder {
    fn takes(&self, path: &Path) -> bool {
        inputs::is_mesh(path)
    }

    fn begin(&self) {
        *self.cancel.lock().unwrap_or_else(PoisonError::into_inner) = Cancel::default();
    }

    fn prepare(
        &self,
        source: &Path,
        tell: &(dyn Fn(&str, f32) + Sync),
        show: &dyn Fn(PathBuf),
    ) -> Result<PathBuf, String> {
        let cancel = self.cancel.lock().unwrap_or_else(PoisonError::into_inner).clone();
        tell("reading", 0.0);
        let Beside { path: output, is_cached } =
            place(source, &cancel).map_err(|error| format!("{error:#}"))?;
        let overwrite = self.overwrite || is_cached;
        match is_current(source, &output, &cancel) {
            Some(true) => return Ok(output),
            _ if cancel.is_cancelled() => return Err("stopped".to_owned()),
            Some(false) if !overwrite => return Err(stale(source, &output)),
            _ => {}
        }
        // What cannot be shown early is told of by the build.
        tell("a first look", 0.0);
        if let Ok(preview) = self.preview(source, &cancel, |share| tell("a first look", share)) {
            show(preview);
        }
        let teller = Teller { tell, stage: Mutex::default() };
        match chpm_build::build(source, &output, &config(overwrite), &teller, &cancel) {
            Ok(_) => Ok(output),
            Err(error) if error.is_cancelled() => Err("stopped".to_owned()),
            Err(error) => Err(error.to_string()),
        }
    }

    fn cancel(&self) {
        self.cancel.lock().unwrap_or_else(PoisonError::into_inner).cancel();
    }
}

/// Progress for the window: how far the whole build is.
struct Teller<'a> {
    tell: &'a (dyn Fn(&str, f32) + Sync),
    stage: Mutex<Running>,
}

#[derive(Default)]
struct Running {
    name: String,
    total: u64,
    done: u64,
    forecast: Forecast,
    /// Hundredths of the whole that were told.
    told: Option<u32>,
}

impl Teller<'_> {
    fn change(&self, change: impl FnOnce(&mut Running)) {
        let running = &mut *self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        change(running);
        let share = running.forecast.share(running.done as f64 / running.total.max(1) as f64);
        // A window need not hear of less than a hundredth.
        let hundredths = Some((100.0 * share) as u32);
        if running.told != hundredths {
            running.told = hundredths;
            (self.tell)(&running.name, share as f32);
        }
    }
}

impl BuildProgress for Teller<'_> {
    fn begin_stage(&self, stage: Stage, total: u64) {
        self.change(|running| running.forecast.begin(stage));
        self.begin(stage.name(), total);
    }
}

impl Progress for Teller<'_> {
    fn begin(&self, task: &str, total: u64) {
        self.change(|running| {
            (running.name, running.total, running.done, running.told) = (task.to_owned(), total, 0, None);
        });
    }

    fn advance(&self, done: u64) {
        self.change(|running| running.done += done);
    }

    fn end(&self) {}
}
