//! Progress on stderr: a bar for each stage on a terminal, plain lines elsewhere, nothing with `--quiet`.

use chpm_build::{Progress, Stage};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Between two lines of the same stage.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Shows how far a stage is. Stages come one after the other; pieces of work may be reported from any thread.
pub(crate) struct Meter {
    face: Face,
    running: Mutex<Option<Running>>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Face {
    Bars,
    Lines,
    Nothing,
}

struct Running {
    label: String,
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
        Meter { face, running: Mutex::new(None) }
    }

    /// Something of `total` units begins.
    pub(crate) fn start(&self, label: &str, total: u64) {
        let bar = (self.face == Face::Bars).then(|| bar(label, total));
        if self.face == Face::Lines {
            line(&format!("{label} ..."));
        }
        let now = Instant::now();
        let label = label.to_owned();
        *self.running() = Some(Running { label, total, done: 0, started: now, told: now, bar });
    }

    /// `done` more units are done.
    pub(crate) fn add(&self, done: u64) {
        if self.face == Face::Nothing {
            return;
        }
        let mut running = self.running();
        let Some(stage) = running.as_mut() else { return };
        stage.done = stage.done.saturating_add(done);
        if let Some(bar) = &stage.bar {
            bar.set_position(stage.done);
        } else if stage.told.elapsed() >= LINE_INTERVAL {
            stage.told = Instant::now();
            let percent = 100.0 * stage.done as f64 / stage.total.max(1) as f64;
            line(&format!("{} {:.0} %", stage.label, percent.min(100.0)));
        }
    }

    /// What has begun has ended, well or not. Its bar goes: the table at the end tells the same, and an error more.
    pub(crate) fn finish(&self) {
        let Some(stage) = self.running().take() else { return };
        if let Some(bar) = stage.bar {
            bar.finish_and_clear();
        } else if self.face == Face::Lines {
            line(&format!("{} took {:.2} s", stage.label, stage.started.elapsed().as_secs_f64()));
        }
    }

    fn running(&self) -> MutexGuard<'_, Option<Running>> {
        self.running.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

impl Progress for Meter {
    fn begin(&self, stage: Stage, total: u64) {
        self.start(&stage.to_string(), total);
    }

    fn advance(&self, done: u64) {
        self.add(done);
    }

    fn end(&self, _: Stage) {
        self.finish();
    }

    fn note(&self, text: &str) {
        if self.face != Face::Nothing {
            line(text);
        }
    }
}

fn bar(label: &str, total: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix:<10} {wide_bar} {percent:>3} % {elapsed:>5}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr())
        .with_style(style)
        .with_prefix(label.to_owned())
}

/// A line on stderr; whoever closed it does not want to know.
pub(crate) fn line(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}
