//! Progress on stderr: on a terminal a bar for a whole build, or for each other work, plain lines elsewhere, nothing with `--quiet`.

use crate::escape;
use crate::forecast::Forecast;
use chpm_build::{BuildProgress, Progress, Stage};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};
use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Steps of the bar of a whole build.
const PARTS: u64 = 1000;
/// Between two looks of the bar of a build.
const TICK: Duration = Duration::from_millis(200);
/// Between two lines of the same stage.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Shows how far a stage is. Stages come one after the other; pieces of work may be reported from any thread.
pub(crate) struct Meter {
    face: Face,
    running: Mutex<Option<Running>>,
    build: Mutex<Option<Build>>,
}

/// A build, from its first stage to its last.
#[derive(Clone)]
struct Build {
    forecast: Forecast,
    begun: Instant,
    /// One for all of it; it goes with the last of these.
    bar: Option<ProgressBar>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Face {
    Bars,
    Lines,
    Nothing,
}

struct Running {
    label: String,
    /// The whole build that it is a stage of, if it is one.
    build: Option<Build>,
    total: u64,
    done: u64,
    started: Instant,
    told: Instant,
    bar: Option<ProgressBar>,
}

impl Meter {
    /// A meter that fits what stderr is.
    pub(crate) fn new(quiet: bool) -> Self {
        let face = match (quiet, io::stderr().is_terminal()) {
            (true, _) => Face::Nothing,
            (false, true) => Face::Bars,
            (false, false) => Face::Lines,
        };
        Meter { face, running: Mutex::new(None), build: Mutex::new(None) }
    }

    /// Something of `total` units begins.
    pub(crate) fn start(&self, label: &str, total: u64) {
        let bar = (self.face == Face::Bars).then(|| bar(label, total));
        self.set_out(label, total, bar, None);
    }

    fn set_out(&self, label: &str, total: u64, bar: Option<ProgressBar>, build: Option<Build>) {
        if self.face == Face::Lines {
            line(&format!("{label} ..."));
        }
        let now = Instant::now();
        let label = label.to_owned();
        *self.running() = Some(Running { label, build, total, done: 0, started: now, told: now, bar });
    }

    /// `done` more units are done.
    pub(crate) fn add(&self, done: u64) {
        if self.face == Face::Nothing {
            return;
        }
        let mut running = self.running();
        let Some(stage) = running.as_mut() else { return };
        stage.done = stage.done.saturating_add(done);
        if let Some(build) = &stage.build
            && let Some(bar) = &build.bar
        {
            build.show(bar, stage.share());
        } else if let Some(bar) = &stage.bar {
            bar.set_position(stage.done);
        } else if stage.told.elapsed() >= LINE_INTERVAL {
            stage.told = Instant::now();
            line(&format!("{} {:.0} %{}", stage.label, 100.0 * stage.share(), stage.whole()));
        }
    }

    /// Ends a stage, well or not. Its bar goes: the table at the end tells the same, and an error more. That of a build
    /// stays until the last stage of it has ended.
    pub(crate) fn finish(&self) {
        let Some(stage) = self.running().take() else { return };
        if let Some(bar) = stage.bar {
            bar.finish_and_clear();
        } else if self.face == Face::Lines {
            line(&format!("{} took {:.2} s", stage.label, stage.started.elapsed().as_secs_f64()));
        }
    }

    fn build(&self) -> MutexGuard<'_, Option<Build>> {
        self.build.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn running(&self) -> MutexGuard<'_, Option<Running>> {
        self.running.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

impl Running {
    /// Share that is done, 0 to 1.
    fn share(&self) -> f64 {
        (self.done as f64 / self.total.max(1) as f64).min(1.0)
    }

    /// `; 62 % of all, 758 k triangles/s, 12 s left`, where there is a whole.
    fn whole(&self) -> String {
        let Some(Build { forecast, begun, .. }) = &self.build else { return String::new() };
        let told = forecast.message(self.share(), begun.elapsed());
        let comma = if told.is_empty() { "" } else { ", " };
        format!("; {:.0} % of all{comma}{told}", 100.0 * forecast.share(self.share()))
    }
}

impl Build {
    fn begin(with_bar: bool) -> Self {
        Build { forecast: Forecast::default(), begun: Instant::now(), bar: with_bar.then(whole_bar) }
    }

    /// Shows how far it is, where this share of the running stage is done.
    fn show(&self, bar: &ProgressBar, of_stage: f64) {
        bar.set_position((PARTS as f64 * self.forecast.share(of_stage)) as u64);
        bar.set_message(self.forecast.message(of_stage, self.begun.elapsed()));
    }
}

impl BuildProgress for Meter {
    fn begin_stage(&self, stage: Stage, total: u64) {
        let mut build = self.build();
        let build = build.get_or_insert_with(|| Build::begin(self.face == Face::Bars));
        build.forecast.begin(stage);
        if let Some(bar) = &build.bar {
            bar.set_prefix(stage.to_string());
            build.show(bar, 0.0);
        }
        self.set_out(&stage.to_string(), total, None, Some(build.clone()));
    }

    fn counted(&self, triangles: u64) {
        if let Some(build) = self.build().as_mut() {
            build.forecast.counted(triangles);
        }
    }

    fn end_stage(&self, stage: Stage) {
        self.finish();
        // The next build is another one.
        if stage == Stage::Emit {
            *self.build() = None;
        }
    }
}

impl Progress for Meter {
    fn begin(&self, task: &str, total: u64) {
        self.start(task, total);
    }

    fn advance(&self, done: u64) {
        self.add(done);
    }

    fn end(&self) {
        self.finish();
    }

    fn note(&self, text: &str) {
        let bar = self.build().as_ref().and_then(|build| build.bar.clone());
        match (self.face, bar) {
            (Face::Nothing, _) => {}
            (_, Some(bar)) => bar.suspend(|| line(text)),
            (_, None) => line(text),
        }
    }
}

/// The bar of a whole build. It moves also while nothing is counted.
fn whole_bar() -> ProgressBar {
    let style =
        ProgressStyle::with_template("{spinner} {prefix:<10} {wide_bar} {percent:>3} % {elapsed:>4} {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::with_draw_target(Some(PARTS), ProgressDrawTarget::stderr())
        .with_style(style)
        .with_finish(ProgressFinish::AndClear);
    bar.enable_steady_tick(TICK);
    bar
}

fn bar(label: &str, total: u64) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{prefix:<10} {wide_bar} {percent:>3} % {elapsed:>5}, {eta} left")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr())
        .with_style(style)
        .with_prefix(label.to_owned())
}

/// A line on stderr; whoever closed it does not want to know.
pub(crate) fn line(text: &str) {
    let _ = writeln!(io::stderr(), "{}", escape::escaped(text));
}
