//! Progress of many models on stderr: a bar for all and one for each that runs on a terminal, a line for each that has ended
//! elsewhere, nothing with `--quiet`.

use super::summary::{Row, Status};
use crate::escape::{escaped, in_line};
use crate::progress::line;
use chpm_build::{BuildProgress, Progress};
use chpm_mesh::Counted;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{self, IsTerminal};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Display of a batch.
pub(super) struct Display {
    bars: Option<(MultiProgress, ProgressBar)>,
    quiet: bool,
    total: usize,
    done: AtomicUsize,
}

/// Display of one model that is being built.
pub(super) struct ModelMeter {
    bar: Option<ProgressBar>,
    name: String,
}

impl Display {
    pub(super) fn new(quiet: bool, total: usize) -> Self {
        let bars = (!quiet && io::stderr().is_terminal()).then(|| {
            let all = MultiProgress::with_draw_target(ProgressDrawTarget::stderr());
            let bar = all.add(
                ProgressBar::new(total as u64)
                    .with_style(style("{prefix} {wide_bar} {pos}/{len} {elapsed:>5}")),
            );
            bar.set_prefix("models");
            bar.tick();
            (all, bar)
        });
        Display { bars, quiet, total, done: AtomicUsize::new(0) }
    }

    pub(super) fn begin(&self, name: &str) -> ModelMeter {
        let bar = self.bars.as_ref().map(|(all, total)| {
            let bar = ProgressBar::new(0).with_style(style("{prefix} {wide_bar} {percent:>3} %"));
            all.insert_before(total, bar)
        });
        ModelMeter { bar, name: in_line(name).into_owned() }
    }

    /// A model has ended.
    pub(super) fn end(&self, meter: ModelMeter, row: &Row) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let what = match row.status {
            Status::Built => format!("{:.2} s, {}", row.seconds, Counted(row.triangles, "triangle")),
            _ => in_line(row.error.as_deref().unwrap_or("stopped")).into_owned(),
        };
        let text = format!("{}: {what}", meter.name);
        if let Some(bar) = &meter.bar {
            bar.finish_and_clear();
        }
        match &self.bars {
            Some((all, total)) => {
                total.set_position(done as u64);
                if row.status == Status::Failed {
                    let _ = all.println(escaped(&text));
                }
            }
            None if self.quiet => {}
            None => line(&format!("[{done}/{}] {text}", self.total)),
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        if let Some((all, _)) = &self.bars {
            let _ = all.clear();
        }
    }
}

impl Progress for ModelMeter {
    fn begin(&self, task: &str, total: u64) {
        if let Some(bar) = &self.bar {
            bar.set_length(total);
            bar.set_position(0);
            bar.set_prefix(format!("{} {task}", self.name));
        }
    }

    fn advance(&self, done: u64) {
        if let Some(bar) = &self.bar {
            bar.inc(done);
        }
    }

    fn end(&self) {}
}

impl BuildProgress for ModelMeter {}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}
