//! Models side by side: what is to be built is built, and a model that fails stops no other.

use super::display::Display;
use super::fingerprint::{self, Need};
use super::inputs::Model;
use super::summary::{Row, Status, Summary};
use crate::{cmd, report};
use anyhow::{Context, Result};
use chpm_build::{BuildConfig, BuildError, BuildProgress, BuildReport, Cancel, memo_beside};
use chpm_extmem::{FailPoints, PartFile};
use chpm_import::input;
use chpm_mesh::Bytes;
use std::any::Any;
use std::collections::BTreeMap;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// A model, how it is built, and what there is to do.
pub(crate) struct Task {
    config: BuildConfig,
    need: Need,
    row: Row,
}

/// Looks at every model's output; `earlier` is the summary of the last run here. With `anew` everything is built.
pub(crate) fn plan(
    models: Vec<(Model, BuildConfig)>,
    folder: &Path,
    earlier: &[Row],
    anew: bool,
    cancel: &Cancel,
) -> Vec<Task> {
    let earlier: BTreeMap<&str, &Row> = earlier.iter().map(|row| (row.name.as_str(), row)).collect();
    let tasks = models.into_iter().map(|(model, config)| {
        let output = folder.join(format!("{}.chpm", model.name));
        let before = earlier.get(model.name.as_str()).copied();
        let need = match anew {
            true => Need::Build("asked for"),
            false => fingerprint::need(&model.source, &output, &config.settings, before, cancel),
        };
        let is_ours = anew || fingerprint::is_ours(&model.source, &output, before);
        let mut row = row(model, &config, output, need, cancel);
        let foreign = match is_ours {
            true => foreign_memo(&config, &row.output).filter(|_| !anew),
            false => Some(row.output.clone()),
        };
        let Some(foreign) = foreign.filter(|_| need != Need::Nothing) else {
            return Task { config, need, row };
        };
        row.status = Status::Failed;
        row.error = Some(format!(
            "'{}' is there, and is not of this source: call the model otherwise in a list, choose another folder, or pass --force",
            foreign.display()
        ));
        Task { config, need: Need::Nothing, row }
    });
    tasks.collect()
}

/// A file that has the name of an output's memo, and is none.
fn foreign_memo(config: &BuildConfig, output: &Path) -> Option<PathBuf> {
    let path = memo_beside(output);
    let is_there = config.resources.memo && path.symlink_metadata().is_ok();
    (is_there && PartFile::open(&path, FailPoints::default()).is_err()).then_some(path)
}

/// What is known of a model before it is built.
fn row(model: Model, config: &BuildConfig, output: PathBuf, need: Need, cancel: &Cancel) -> Row {
    let (status, reason) = match need {
        Need::Nothing => (Status::Current, ""),
        Need::Build(reason) => (Status::Planned, reason),
    };
    let files = input::files(&model.source, config.settings.images(), cancel).unwrap_or_default();
    let lens = files.iter().map(|file| fs::metadata(file).map_or(0, |metadata| metadata.len()));

    let mut row = Row {
        name: model.name,
        status,
        reason: reason.to_owned(),
        seconds: 0.0,
        triangles: 0,
        source_bytes: lens.sum(),
        output_bytes: 0,
        error: None,
        warnings: Vec::new(),
        source: model.source,
        output,
        hash: String::new(),
        fingerprint: fingerprint::fingerprint(&files),
    };
    if need == Need::Nothing {
        // What was just read can be read again; if not, the numbers stay zero.
        let _ = row.describe_output();
    }
    row
}

/// Rows of a dry run.
pub(crate) fn planned(tasks: Vec<Task>) -> Vec<Row> {
    tasks.into_iter().map(|task| task.row).collect()
}

/// Builds `jobs` models at a time, the largest first, each with its share of threads and memory.
pub(crate) fn run(mut tasks: Vec<Task>, jobs: usize, quiet: bool, cancel: &Cancel) -> Vec<Row> {
    let mut order: Vec<usize> = (0..tasks.len()).filter(|i| tasks[*i].need != Need::Nothing).collect();
    order.sort_by_key(|i| std::cmp::Reverse(tasks[*i].row.source_bytes));
    let jobs = jobs.min(order.len()).max(1);
    for task in &mut tasks {
        share(&mut task.config, jobs);
    }
    let display = Display::new(quiet, order.len());
    let next = AtomicUsize::new(0);
    let built: Mutex<Vec<(usize, Row)>> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                while let Some(index) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let task = &tasks[*index];
                    let meter = display.begin(&task.row.name);
                    let row = make(task, &meter, cancel);
                    display.end(meter, &row);
                    built.lock().unwrap_or_else(PoisonError::into_inner).push((*index, row));
                }
            });
        }
    });
    drop(display);
    let mut rows: Vec<Row> = tasks.into_iter().map(|task| task.row).collect();
    for (index, row) in built.into_inner().unwrap_or_else(PoisonError::into_inner) {
        rows[index] = row;
    }
    rows
}

/// One of `jobs` equal parts of what the batch may use.
fn share(config: &mut BuildConfig, jobs: usize) {
    let resources = &mut config.resources;
    let threads = match resources.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    };
    resources.threads = (threads / jobs).max(1);
    resources.memory = Bytes(resources.memory.0 / jobs as u64);
}

/// Builds one model and says what became of it.
fn make(task: &Task, meter: &dyn BuildProgress, cancel: &Cancel) -> Row {
    let mut row = task.row.clone();
    if cancel.is_cancelled() {
        row.status = Status::Stopped;
        return row;
    }
    let start = Instant::now();
    let built = catch_unwind(AssertUnwindSafe(|| build(&row, &task.config, meter, cancel)));
    row.seconds = start.elapsed().as_secs_f64();
    fn failed(error: String) -> (Status, Option<String>) {
        (Status::Failed, Some(error))
    }
    (row.status, row.error) = match built {
        Ok(Ok(report)) => {
            row.warnings = report.warnings;
            if let Some(taken) = report.taken_over {
                row.reason = format!("{}; {taken}", row.reason);
            }
            if let Some(reached) = report.resumed {
                row.reason = format!("{}; went on after {reached}", row.reason);
            }
            match row.describe_output() {
                Ok(()) => (Status::Built, None),
                Err(error) => failed(report::causes(&error).join(": ")),
            }
        }
        Ok(Err(error)) if error.downcast_ref().is_some_and(BuildError::is_cancelled) => {
            (Status::Stopped, None)
        }
        Ok(Err(error)) => failed(report::causes(&error).join(": ")),
        Err(panic) => failed(format!("a fault of this program: {}", panic_message(&*panic))),
    };
    row
}

fn build(row: &Row, config: &BuildConfig, meter: &dyn BuildProgress, cancel: &Cancel) -> Result<BuildReport> {
    if let Some(folder) = row.output.parent() {
        fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder '{}'", folder.display()))?;
    }
    // What is replaced is an older result of the same name: the plan has looked at it.
    let mut config = BuildConfig { overwrite: true, ..config.clone() };
    let build = |config: &BuildConfig| chpm_build::build(&row.source, &row.output, config, meter, cancel);
    if config.resources.memo && row.reason == fingerprint::CHANGED {
        config.resources.update = Some(row.output.clone());
        match build(&config) {
            // Of a memo that is of no use nothing is taken.
            Err(BuildError::Part { .. }) => config.resources.update = None,
            built => return Ok(built?),
        }
    }
    Ok(build(&config)?)
}

/// Message of a panic.
fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}

impl Row {
    /// Fills in what the output says of itself.
    fn describe_output(&mut self) -> Result<()> {
        let file = cmd::open(&self.output)?;
        let metadata = file.metadata()?;
        self.triangles = file.header().source_triangle_count;
        self.output_bytes = file.stored_len();
        self.hash = fingerprint::hash_text(metadata.source.hash);
        self.warnings = metadata.warnings;
        Ok(())
    }
}

/// The summary of the last run in `folder`, if there was one that can still be read.
pub(crate) fn earlier(summary: &Path) -> Vec<Row> {
    Summary::read(summary).map(|summary| summary.models).unwrap_or_default()
}
