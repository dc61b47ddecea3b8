//! Two models and how they lie: what the verbs of proximity have in common.

mod args;
mod poses;
#[cfg(feature = "viewer")]
mod relate;

pub(crate) use args::{AskArgs, LimitArgs, PathArgs, PoseArgs, SecondArgs};
#[cfg(feature = "viewer")]
pub(crate) use relate::{RelateArgs, place};

use crate::args::MemorySize;
use crate::batch::inputs;
use crate::cmd::{build, open, reading, temporary};
use crate::json::{named, near};
use crate::memory;
use crate::progress::{Meter, line};
use crate::stop::{self, Stop};
use anyhow::{Context, Result};
use chpm_build::{BuildConfig, Cancel, Resources};
use chpm_extmem::{MappedFile, WorkDir};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_proximity::{Answer, End, Front, Model, Pose, Question, Reads, follow};
use rayon::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Notices when a search has to end.
pub(crate) struct Limits {
    pages: u64,
    until: Option<Instant>,
    cancel: Cancel,
}

impl Limits {
    pub(crate) fn go_on(&self, read: Reads) -> bool {
        read.pages < self.pages
            && !self.cancel.is_cancelled()
            && self.until.is_none_or(|until| Instant::now() < until)
    }
}

/// A model that was opened, and built first if it is a mesh.
pub(crate) struct Opened {
    pub(crate) path: PathBuf,
    pub(crate) file: Chpm<MappedFile>,
    /// The folder of a temporary file.
    _folder: Option<WorkDir>,
}

impl Opened {
    pub(crate) fn new(path: &Path, memory: Bytes, quiet: bool, stop: &Stop) -> Result<Self> {
        if !inputs::is_mesh(path) {
            return Ok(Opened { path: path.to_owned(), file: open(path)?, _folder: None });
        }
        let folder = temporary()?;
        let output = folder.path().join("model.chpm");
        if !quiet {
            let name = path.display();
            line(&format!(
                "note: '{name}' is built into a temporary .chpm first; build it with chpm build to ask more than once"
            ));
        }
        let memory = Bytes(memory.0.max(chpm_build::MIN_MEMORY));
        let config =
            BuildConfig { resources: Resources { memory, ..Resources::default() }, ..BuildConfig::default() };
        build::build(path, &output, &config, &Meter::new(quiet), stop)?;
        Ok(Opened { path: path.to_owned(), file: open(&output)?, _folder: Some(folder) })
    }

    pub(crate) fn diagonal(&self) -> f64 {
        self.file.header().aabb().diagonal()
    }

    /// Its name for programs.
    pub(crate) fn json(&self) -> near::Model {
        near::Model {
            path: named(&self.path),
            triangles: self.file.header().source_triangle_count,
            bytes: self.file.stored_len(),
            diagonal: self.diagonal(),
        }
    }
}

/// Two models, and the memory for a question about them.
pub(crate) struct Pair {
    pub(crate) models: [Opened; 2],
    /// For pages of each.
    pages: Bytes,
    /// For what waits to be looked at, and for what was found.
    pub(crate) waiting: u64,
    pub(crate) most_pairs: usize,
}

/// Bytes of a triangle that is near, and of what hangs on it.
const TRIANGLE: u64 = 512;
/// Bytes of a pair of groups that waits, and of a group that is known.
const PAIR: u64 = 160;
pub(crate) const GROUP: u64 = 160;

impl Pair {
    pub(crate) fn new(paths: [&Path; 2], memory: MemorySize, quiet: bool, stop: &Stop) -> Result<Self> {
        let [a, b] = paths.map(|path| Opened::new(path, memory.0, quiet, stop));
        let models = [a?, b?];
        let files = models.each_ref().map(|model| (&model.file, GROUP * model.file.groups().len() as u64));
        let [a, b] = memory::divide_among(files, memory.0)?;
        let least = a.min(b);
        // Of two quarters, one from each model.
        let waiting = least / 2;
        Ok(Pair { models, pages: Bytes(least / 4 * 3), waiting, most_pairs: (waiting / PAIR) as usize })
    }

    /// Triangles that may be near each other.
    pub(crate) fn most_near(&self) -> usize {
        (self.waiting / TRIANGLE) as usize
    }

    /// The larger diagonal of the two, which a percentage is of.
    pub(crate) fn diagonal(&self) -> f64 {
        self.models[0].diagonal().max(self.models[1].diagonal())
    }

    /// The models for one of so many threads.
    pub(crate) fn open(&self, threads: usize) -> Result<[Model<'_, MappedFile>; 2]> {
        let pages = Bytes(self.pages.0 / threads as u64);
        let [a, b] = [0, 1].map(|i| {
            let model = &self.models[i];
            Model::new(&model.file, pages).with_context(|| format!("cannot use '{}'", model.path.display()))
        });
        Ok([a?, b?])
    }

    /// Does what reads both files; see [`crate::cmd::reading`].
    pub(crate) fn reading<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let [a, b] = &self.models;
        reading(&b.file, || reading(&a.file, work))
    }
}

/// Poses that are asked for one after the other, each with what the ones before it have read and found. Their number is fixed, so that answers do not
/// depend on the number of threads.
const RUN: usize = 32;

/// The answers to one question at each pose of the second model, on the threads of rayon's current pool.
pub(crate) fn ask_all(
    pair: &Pair,
    still: &Pose,
    path: &[Pose],
    question: &Question,
    limits: &LimitArgs,
    cancel: &Cancel,
) -> Result<Vec<Answer>> {
    let threads = rayon::current_num_threads().min(path.len().div_ceil(RUN)).max(1);
    let question = Question { most_pairs: pair.most_pairs / threads, ..*question };
    let runs = path.par_chunks(RUN).map(|run| {
        let [a, b] = pair.open(threads)?;
        let mut front = Front::new();
        let answers = run.iter().map(|pose| {
            let limits = limits.start(cancel);
            let go_on = &mut |read| limits.go_on(read);
            let answer = follow(&mut front, &a, &b, [still, pose], &question, go_on)?;
            stop::check(cancel)?;
            Ok(answer)
        });
        answers.collect::<Result<Vec<Answer>>>()
    });
    Ok(runs.collect::<Result<Vec<_>>>()?.concat())
}

/// A line of numbers for every answer.
pub(crate) fn write_csv(answers: &[Answer], out: &mut impl Write) -> Result<()> {
    writeln!(out, "step,least,most,ended,ax,ay,az,bx,by,bz,pages,page_bytes")?;
    for (step, answer) in answers.iter().enumerate() {
        let points = answer.closest_points.map_or([[f64::NAN; 3]; 2], |closest| closest.points);
        let points: Vec<String> = points.as_flattened().iter().map(f64::to_string).collect();
        let Reads { pages, bytes } = read(answer);
        let Answer { lower, upper, end, .. } = answer;
        writeln!(out, "{step},{lower},{upper},{},{},{pages},{}", ended(*end), points.join(","), bytes.0)?;
    }
    Ok(())
}

/// Reads of both models.
pub(crate) fn read(answer: &Answer) -> Reads {
    let [a, b] = answer.reads;
    a.plus(b)
}

/// Why an answer is not narrower, in a word for programs.
pub(crate) fn ended(end: End) -> &'static str {
    match end {
        End::Decided => "decided",
        End::Exact => "exact",
        End::Stopped => "stopped",
        End::Crowded => "crowded",
    }
}

/// An answer for programs.
pub(crate) fn answer_json(answer: &Answer) -> near::Answer {
    let Answer { lower, upper, closest_points, end, reads, pairs, rounding, .. } = answer;
    near::Answer {
        least: *lower,
        most: upper.is_finite().then_some(*upper),
        ended: ended(*end),
        rounding: *rounding,
        points: closest_points.map(|w| w.points),
        point_errors: closest_points.map(|w| w.errors),
        levels: closest_points.map(|w| w.levels),
        clusters: closest_points.map(|w| w.clusters.map(|cluster| cluster.0)),
        triangles: closest_points.map(|w| w.triangles),
        pages: reads.map(|read| read.pages),
        page_bytes: reads.map(|read| read.bytes.0),
        pairs: *pairs,
    }
}
