//! Arguments of the verbs of proximity.

use super::poses::{read_path, typed};
use super::{Limits, Pair};
use crate::args::MemorySize;
use crate::number;
use crate::output::TellArgs;
use crate::stop::Stop;
use crate::threads::ThreadArgs;
use anyhow::Result;
#[cfg(feature = "viewer")]
use anyhow::ensure;
use chpm_build::Cancel;
use chpm_proximity::Pose;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Arguments of every question.
#[derive(clap::Args, Debug)]
pub(crate) struct AskArgs {
    /// A .chpm file; or a mesh ({meshes}), which is built into a temporary one first
    pub(crate) first: PathBuf,
    #[command(flatten)]
    pub(crate) poses: PoseArgs,
    #[command(flatten)]
    pub(crate) limits: LimitArgs,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    #[command(flatten)]
    pub(crate) tell: TellArgs,
}

impl AskArgs {
    pub(crate) fn pair(&self, second: &Path, stop: &Stop) -> Result<Pair> {
        Pair::new([&self.first, second], self.limits.memory, self.tell.quiet, stop)
    }
}

/// The second model, and where it is.
#[derive(clap::Args, Debug)]
pub(crate) struct SecondArgs {
    /// Another, or the same
    pub(crate) second: PathBuf,
    #[command(flatten)]
    pub(crate) path: PathArgs,
}

/// A motion of the second model.
#[derive(clap::Args, Debug)]
pub(crate) struct PathArgs {
    /// Ask for each pose of the second model in this file, one a line as for --pose, in this order. Each answer begins with what the one before has
    /// read and found, so that small motions cost little
    #[arg(long, visible_alias = "poses", value_name = "FILE", conflicts_with = "pose")]
    path: Option<PathBuf>,
}

impl PathArgs {
    pub(crate) fn is_given(&self) -> bool {
        self.path.is_some()
    }

    /// The poses that the second model takes.
    pub(crate) fn poses(&self, poses: &PoseArgs) -> Result<Vec<Pose>> {
        let [_, pose] = poses.poses();
        Ok(self.path.as_deref().map(read_path).transpose()?.unwrap_or_else(|| vec![pose]))
    }
}

/// Where the models are.
#[derive(clap::Args, Debug)]
pub(crate) struct PoseArgs {
    /// Where the second model is put, relative to where its file has it: a translation X,Y,Z; a translation and a quaternion X,Y,Z,QX,QY,QZ,QW; or
    /// the 12 or 16 numbers of a matrix, row by row. Rigid motions only: one that changes lengths by more than 0.01 % is refused, and what it changes them
    /// by below that widens the answer
    #[arg(long, visible_alias = "pose-b", value_name = "POSE", value_parser = typed, allow_hyphen_values = true)]
    pose: Option<Pose>,
    /// The same of the first model
    #[arg(long, value_name = "POSE", value_parser = typed, allow_hyphen_values = true)]
    pose_a: Option<Pose>,
}

impl PoseArgs {
    /// Refuses poses where there is one model.
    #[cfg(feature = "viewer")]
    pub(crate) fn check(&self, second: Option<&Path>) -> Result<()> {
        let is_given = self.pose.is_some() || self.pose_a.is_some();
        ensure!(second.is_some() || !is_given, "a pose needs a second model: name one behind the first");
        Ok(())
    }

    pub(crate) fn poses(&self) -> [Pose; 2] {
        [&self.pose_a, &self.pose].map(|pose| pose.unwrap_or(Pose::IDENTITY))
    }
}

/// How much may be spent.
#[derive(clap::Args, Debug)]
pub(crate) struct LimitArgs {
    /// Give up after about so many pages (each some thousand triangles), and tell what is proven by then. What that is may depend on --threads,
    /// as it does where --time or --memory ends the search; what is decided does not
    #[arg(long, value_name = "N", value_parser = number::count(0..=u64::MAX))]
    max_pages: Option<u64>,
    /// Give up after so many seconds, and tell what is proven by then
    #[arg(long, value_name = "SECONDS", value_parser = number::decimal)]
    time: Option<f64>,
    /// Memory that the whole process stays below, as in 64M; refused if the files' tables alone take more
    #[arg(long, value_name = "SIZE", default_value = "1G")]
    pub(crate) memory: MemorySize,
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
