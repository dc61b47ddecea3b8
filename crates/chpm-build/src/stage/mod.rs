//! A build in steps, each a process of its own on whichever machine: what one leaves for the others is a file of a folder that all see.
//!
//! Steps call what [`build`](crate::build) calls, with parts of the work where it has all of it, and the file is the same, byte by byte, for any number of parts.
//! What is in a part does not depend on threads either, so that one that was lost is made again as it was, and nothing that was made of it
//! has to be.

mod folder;
mod job;
mod step;
#[cfg(test)]
mod tests;
mod work;

pub use step::{MOST_PARTS, Share, Step};
pub use work::work;

use crate::config::{Resources, Settings, Texture};
use crate::emit::{Facts, Known};
use crate::error::BuildError;
use crate::fingerprint::Fingerprint;
use crate::progress::{BuildProgress, Stage};
use crate::{decompose, ingest, pipeline};
use chpm_extmem::{Cancel, ExtmemError, Lock, WorkDir, process};
use chpm_import::Supply;
use folder::Folder;
use job::Plan;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Clusters of a level for each part, at least, so that it is worth a step of its own.
const LEVEL_SHARE: u32 = 64;

/// Report of a step.
#[derive(Clone, Debug)]
pub struct StepReport {
    /// The step.
    pub step: Step,
    /// Where its file, or the model, is.
    pub path: PathBuf,
    /// Whether it was there already, made of the same.
    pub was_there: bool,
    /// Bytes of the file.
    pub len: u64,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Seconds of the process's processors, where the system tells.
    pub processor_seconds: Option<f64>,
    /// Peak resident memory of the process, bytes, where the system tells.
    pub peak_resident: Option<u64>,
    /// Sentences about what the plan has chosen for the source.
    pub notes: Vec<String>,
}

/// How a plan divides the work.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Division {
    /// Parts of regions, levels and pages.
    pub parts: u32,
    /// Levels that are simplified in parts; a number that suits the source if not given.
    pub levels: Option<u32>,
}

impl Division {
    /// Levels that are worth parts where there are so many leaves.
    pub fn levels_of(self, leaves: u32) -> u32 {
        let least = self.parts.max(1).saturating_mul(LEVEL_SHARE);
        self.levels.unwrap_or((leaves / least).checked_ilog2().map_or(0, |above| above + 1))
    }
}

/// Makes the plan of a build of `source` in `folder`: reads the source and divides its vertices into regions.
///
/// # Errors
/// See [`BuildError`].
pub fn plan(
    source: &Path,
    folder: &Path,
    settings: &Settings,
    division: Division,
    resources: &Resources,
    progress: &dyn BuildProgress,
    cancel: &Cancel,
) -> Result<StepReport, BuildError> {
    let settings = &match settings.texture {
        Texture::Sheets => return Err(BuildError::NoSheets { setting: "chpm stage" }),
        Texture::Found => Settings { texture: Texture::FoundForVertices, ..settings.clone() },
        _ => settings.clone(),
    };
    crate::sheets::check(settings)?;
    let failed = |error| ExtmemError::io("make the folder", folder, 0, error);
    let _made = (!folder.is_dir()).then_some(Made(folder));
    std::fs::create_dir_all(folder).map_err(failed)?;
    let clock = Timer::start();
    let path = folder.join(Step::Plan.file());
    let _lock = Lock::acquire(&path)?;
    let scratch = resources.work_dir.as_deref().unwrap_or(folder);
    let source = &Supply::take(source, scratch, &resources.fail_points, cancel)?;
    let fingerprint = Fingerprint::of(source, settings.images(), cancel)?;
    let dir = WorkDir::create(scratch)?.with_fail_points(resources.fail_points.clone());
    let resources = &Resources { checkpoint: None, ..resources.clone() };
    let context = &pipeline::context(dir, fingerprint.len, resources, progress, cancel)?;

    let read = || ingest::run(source, settings, context);
    let ingested = context.stage(Stage::Ingest, fingerprint.len, read)?;
    fingerprint.check()?;
    let known = Known { facts: Facts::of(&ingested), repairs: ingest::repairs(&ingested) };
    context.progress.counted(known.facts.triangles);
    let notes = pipeline::notes_of(&known.facts, settings);

    let parts = Folder::new(folder, &resources.fail_points);
    parts.write(Step::Plan, &[], &context.store, |out| {
        let cut = || decompose::write_ground(ingested, settings, context, out);
        let ground = context.stage(Stage::Decompose, known.facts.triangles, cut)?;
        let levels = division.levels_of(ground.leaves);
        Ok(Plan { settings: settings.clone(), parts: division.parts, levels, known, ground })
    })?;
    clock.report(Step::Plan, path).map(|report| StepReport { notes, ..report })
}

/// A folder that goes again if nothing comes into it.
struct Made<'a>(&'a Path);

impl Drop for Made<'_> {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir(self.0);
    }
}

/// Makes what `step` leaves in `folder`; [`Step::Finish`] makes `output`, or [`output_of`] the folder. What is there already, whole and of the same, stays.
///
/// # Errors
/// See [`BuildError`]; a file that it needs and that is missing, damaged, of another plan or of another version is named.
pub fn run(
    step: Step,
    folder: &Path,
    output: Option<(&Path, bool)>,
    resources: &Resources,
    progress: &dyn BuildProgress,
    cancel: &Cancel,
) -> Result<StepReport, BuildError> {
    let clock = Timer::start();
    let path = folder.join(step.file());
    let run = || -> Result<StepReport, BuildError> {
        let (parts, plan) = Folder::open::<Plan>(folder, &resources.fail_points, None)?;
        plan.record.check(step, folder)?;
        let _lock = Lock::acquire(&path)?;
        let default = output_of(folder);
        let (output, overwrite) = output.unwrap_or((&default, false));
        if parts.is_current(step, true) && (step != Step::Finish || job::is_finished(&parts, output)) {
            let told = if step == Step::Finish { output } else { &path };
            return clock
                .report(step, told.to_owned())
                .map(|report| StepReport { was_there: true, ..report });
        }
        let scratch = resources.work_dir.as_deref().unwrap_or(folder);
        let dir = WorkDir::create(scratch)?.with_fail_points(resources.fail_points.clone());
        let resources = &Resources { checkpoint: None, ..resources.clone() };
        let source_len = plan.record.known.facts.provenance.byte_len;
        let context = pipeline::context(dir, source_len, resources, progress, cancel)?;
        job::Job { folder: &parts, plan: &plan, context: &context }.run(step, output, overwrite)?;
        clock.report(step, if step == Step::Finish { output.to_owned() } else { path.clone() })
    };
    run().map_err(|error| explained(error, folder))
}

/// Condition of the file of a step.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Condition {
    /// As it was written, and made of what is there.
    Whole,
    /// Not there.
    Missing,
    /// Something else, with the reason.
    Wrong(String),
}

/// Looks at the files of all steps, to the last byte.
///
/// # Errors
/// See [`BuildError`]; a plan that cannot be read is one.
pub fn check(folder: &Path, cancel: &Cancel) -> Result<Vec<(Step, PathBuf, Condition)>, BuildError> {
    let opened = Folder::open::<Plan>(folder, &Resources::default().fail_points, None);
    let (parts, plan) = opened.map_err(|error| explained(error, folder))?;
    let condition = |step: Step| {
        cancel.check()?;
        let path = folder.join(step.file());
        let condition = match parts.examine(step, true) {
            Ok(()) => Condition::Whole,
            Err(_) if !path.exists() => Condition::Missing,
            Err(error) => Condition::Wrong(explained(error, folder).to_string()),
        };
        Ok((step, path, condition))
    };
    Step::all(plan.record.parts, plan.record.levels).into_iter().map(condition).collect()
}

/// The model that a folder is for, unless another is named: `scan.chpm` for `scan.stages`.
pub fn output_of(folder: &Path) -> PathBuf {
    folder.with_extension("chpm")
}

/// An error about a part, with the command that makes it again.
fn explained(error: BuildError, folder: &Path) -> BuildError {
    let (path, reason) = match error {
        BuildError::Extmem(ExtmemError::Damaged { path, reason }) => (path, reason.to_owned()),
        BuildError::Part { path, reason, .. } => (path, reason),
        error => return error,
    };
    let remedy = match job::step_of(folder, &path) {
        Some(step) => {
            let (before, behind) = step.words();
            format!("make it again: chpm stage {before} {}{behind}", folder.display())
        }
        None => "make it again".to_owned(),
    };
    BuildError::Part { path, reason, remedy }
}

/// Time since a step began.
struct Timer {
    begun: Instant,
    used: Option<std::time::Duration>,
}

impl Timer {
    fn start() -> Self {
        Timer { begun: Instant::now(), used: process::process_time() }
    }

    fn report(&self, step: Step, path: PathBuf) -> Result<StepReport, BuildError> {
        let used = process::process_time().zip(self.used).map(|(now, before)| now.saturating_sub(before));
        Ok(StepReport {
            step,
            was_there: false,
            len: path.metadata().map_err(|error| ExtmemError::io("examine", &path, 0, error))?.len(),
            path,
            seconds: self.begun.elapsed().as_secs_f64(),
            processor_seconds: used.map(|used| used.as_secs_f64()),
            peak_resident: process::peak_resident(),
            notes: Vec::new(),
        })
    }
}
