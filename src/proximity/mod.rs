//! Two models and how they lie: what the verbs of proximity have in common.

mod poses;

pub(crate) use poses::{read_path, typed};

use crate::args::MemorySize;
use crate::batch::inputs;
use crate::cmd::{build, open, temporary};
use crate::memory;
use crate::number;
use crate::progress::{Meter, line};
use crate::stop::{self, Stop};
use anyhow::{Context, Result};
use chpm_build::{BuildConfig, Cancel, Resources};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_proximity::{Answer, End, Model, Pose, ProximityError, Question, Reads, Witness};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Where the models are.
#[derive(clap::Args, Debug)]
pub(crate) struct PoseArgs {
    /// Where the second model is put, relative to where its file has it: a translation X,Y,Z; a translation and a quaternion X,Y,Z,QX,QY,QZ,QW; or
    /// the 12 or 16 numbers of a matrix, row by row. Rigid motions only: one that changes lengths by more than 0.01 % is refused, and what it changes them
    /// by below that widens the answer
    #[arg(long, visible_alias = "pose-b", value_name = "POSE", value_parser = typed, allow_hyphen_values = true)]
    pub(crate) pose: Option<Pose>,
    /// The same of the first model
    #[arg(long, value_name = "POSE", value_parser = typed, allow_hyphen_values = true)]
    pub(crate) pose_a: Option<Pose>,
}

impl PoseArgs {
    pub(crate) fn poses(&self) -> [Pose; 2] {
        [&self.pose_a, &self.pose].map(|pose| pose.unwrap_or(Pose::IDENTITY))
    }
}

/// How much may be spent.
#[derive(clap::Args, Debug)]
pub(crate) struct LimitArgs {
    /// Give up after about so many pages (each some thousand triangles), and tell what is proven by then
    #[arg(long, value_name = "N", value_parser = number::count(0..=u64::MAX))]
    max_pages: Option<u64>,
    /// Give up after so many seconds, and tell what is proven by then
    #[arg(long, value_name = "SECONDS", value_parser = number::decimal)]
    time: Option<f64>,
    /// Memory that the whole process stays below, as in 64M; refused if the files' tables alone take more
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    pub(crate) memory: MemorySize,
}

/// Notices when a search has to end.
pub(crate) struct Limits {
    pages: u64,
    until: Option<Instant>,
    cancel: Cancel,
}

impl LimitArgs {
    pub(crate) fn start(&self, cancel: &Cancel) -> Limits {
        let time = self.time.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        Limits {
            pages: self.max_pages.unwrap_or(u64::MAX),
            until: time.and_then(|time| Instant::now().checked_add(time)),
            cancel: cancel.clone(),
        }
    }
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
    _folder: Option<TempDir>,
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

    pub(crate) fn json(&self) -> Value {
        json!({
            "path": self.path.display().to_string(),
            "triangles": self.file.header().source_triangle_count,
            "bytes": self.file.header().file_len,
            "diagonal": self.diagonal(),
        })
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

/// Bytes of a pair of groups that waits, and of a group that is known.
const PAIR: u64 = 160;
pub(crate) const GROUP: u64 = 160;

impl Pair {
    pub(crate) fn new(paths: [&Path; 2], memory: MemorySize, quiet: bool, stop: &Stop) -> Result<Self> {
        let [a, b] = paths.map(|path| Opened::new(path, memory.0, quiet, stop));
        let models = [a?, b?];
        let mut least = u64::MAX;
        for model in &models {
            let own = GROUP * model.file.groups().len() as u64;
            least = least.min(memory::divide(&model.file, Bytes(memory.0.0 / 2), own)?);
        }
        // Of two quarters, one from each model.
        let waiting = least / 2;
        Ok(Pair { models, pages: Bytes(least / 4 * 3), waiting, most_pairs: (waiting / PAIR) as usize })
    }

    /// The larger diagonal of the two, which a percentage is of.
    pub(crate) fn diagonal(&self) -> f64 {
        self.models[0].diagonal().max(self.models[1].diagonal())
    }

    pub(crate) fn open(&self) -> Result<[Model<'_, MappedFile>; 2]> {
        let [a, b] = [0, 1].map(|i| {
            let model = &self.models[i];
            Model::new(&model.file, self.pages)
                .with_context(|| format!("cannot use '{}'", model.path.display()))
        });
        Ok([a?, b?])
    }

    /// Does what reads both files; see [`crate::cmd::reading`].
    pub(crate) fn reading<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let [a, b] = &self.models;
        let result = work();
        a.file.get_ref().check_unchanged()?;
        b.file.get_ref().check_unchanged()?;
        result.map_err(|error| match error.downcast_ref() {
            Some(ProximityError::Format(_)) => {
                let (a, b) = (a.path.display(), b.path.display());
                error.context(format!("cannot read '{a}' or '{b}'"))
            }
            _ => error,
        })
    }
}

/// One question after the other, with what the last one has read and found.
pub(crate) struct Asker<'p> {
    models: [Model<'p, MappedFile>; 2],
    last: Option<Witness>,
}

impl<'p> Asker<'p> {
    pub(crate) fn new(pair: &'p Pair) -> Result<Self> {
        Ok(Asker { models: pair.open()?, last: None })
    }

    pub(crate) fn ask(&mut self, poses: &[Pose; 2], question: &Question, limits: &Limits) -> Result<Answer> {
        let [a, b] = &mut self.models;
        let go_on = &mut |read| limits.go_on(read);
        let last = self.last.as_ref();
        let answer = chpm_proximity::distance(a, b, [&poses[0], &poses[1]], question, last, go_on)?;
        stop::check(&limits.cancel)?;
        self.last = answer.witness.or(self.last);
        Ok(answer)
    }
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
pub(crate) fn answer_json(answer: &Answer) -> Value {
    let Answer { least, most, witness, end, reads, pairs, margin } = answer;
    json!({
        "least": least,
        "most": most.is_finite().then_some(most),
        "ended": ended(*end),
        "rounding": margin,
        "points": witness.map(|w| w.points),
        "point_errors": witness.map(|w| w.errors),
        "levels": witness.map(|w| w.levels),
        "clusters": witness.map(|w| w.clusters.map(|cluster| cluster.0)),
        "triangles": witness.map(|w| w.triangles),
        "pages": reads.map(|read| read.pages),
        "page_bytes": reads.map(|read| read.bytes.0),
        "pairs": pairs,
    })
}
