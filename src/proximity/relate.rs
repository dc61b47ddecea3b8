//! Relation of two models in the window: their distance, and where they come near.

use super::{Pair, PoseArgs};
use crate::args::MemorySize;
use crate::number::AtMost;
use crate::stop::Stop;
use anyhow::{Context, Result};
use chpm_build::Cancel;
use chpm_extmem::MappedFile;
use chpm_mesh::asked::Length;
use chpm_proximity::contacts::Near;
use chpm_proximity::{Answer, End, Front, Model, Pose, Question, contacts, follow};
use chpm_viewer::Transform;
use chpm_viewer::window::desk::Desk;
use chpm_viewer::window::relation::{Region, Regions, Relate, Relation, Second};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Question about two models in a window.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "Two models")]
pub(crate) struct RelateArgs {
    #[command(flatten)]
    poses: PoseArgs,
    /// The poses of the second model in this file, one a line as for --pose: a motion that can be played
    #[arg(long, value_name = "FILE", requires = "second", conflicts_with = "pose")]
    motion: Option<PathBuf>,
    /// Mark all that is within this distance, in the models' units or, as in 1%, of the larger diagonal of their boxes. 0 marks where they touch
    #[arg(long, value_name = "D", requires = "second")]
    within: Option<Length>,
    /// How wide the interval of the distance may be, and how much farther than D what is marked may be, likewise
    #[arg(long, value_name = "E", default_value = "0.1%", requires = "second")]
    error: Length,
}

impl RelateArgs {
    /// Refuses poses where there is one model.
    pub(crate) fn check(&self, second: Option<&Path>) -> Result<()> {
        self.poses.check(second)
    }

    /// The second model of a window, and who is asked about both, in a memory of its own.
    pub(crate) fn second(&self, models: [&Path; 2], memory: MemorySize, stop: &Stop) -> Result<Second> {
        let [still, pose] = self.poses.poses();
        let path = self.motion.as_deref().map(super::poses::read_path).transpose()?;
        let path = path.unwrap_or_else(|| vec![pose]);
        let pair = Pair::new(models, memory, true, stop)?;
        let (diagonal, error) = (pair.diagonal(), self.error.of(pair.diagonal()));
        Ok(Second {
            model: models[1].to_owned(),
            first: place(&still),
            steps: path.iter().map(place).collect(),
            relate: Arc::new(Relater {
                within: self.within.map(|within| within.of(diagonal)),
                error,
                pool: ThreadPoolBuilder::new().num_threads(1).build().context("cannot start a thread")?,
                cancel: stop.heed(),
                pair,
                still,
                path,
            }),
        })
    }
}

/// Where a picture has a model.
pub(crate) fn place(pose: &Pose) -> Transform {
    Transform::new(pose.rows(), pose.translation())
}

/// Answers about two files.
struct Relater {
    pair: Pair,
    still: Pose,
    /// Of the second one, step by step.
    path: Vec<Pose>,
    error: f64,
    within: Option<f64>,
    pool: ThreadPool,
    cancel: Cancel,
}

/// The first answer may be so many times as wide as the last: it is there sooner.
const ROUGH: f64 = 32.0;

impl Relate for Relater {
    fn relate(&self, desk: &Desk<usize, Relation>) {
        let mut asked = None;
        let done = self.pair.reading(|| {
            let models = self.pair.open(1)?;
            let mut front = Front::new();
            while let Some(step) = desk.take() {
                asked = Some(step);
                self.answer(desk, step, &models, &mut front)?;
            }
            Ok(())
        });
        // Who cannot answer once cannot answer at all.
        if let Err(error) = done {
            let told = format!("not known: {error:#}");
            let mut step = asked.or_else(|| desk.take());
            while let Some(at) = step {
                desk.tell(at, Err(told.clone()));
                step = desk.take();
            }
        }
    }
}

impl Relater {
    /// One answer after the other about a step, each better than the one before, until another step is asked about.
    fn answer(
        &self,
        desk: &Desk<usize, Relation>,
        step: usize,
        [a, b]: &[Model<'_, MappedFile>; 2],
        front: &mut Front,
    ) -> Result<()> {
        let Some(pose) = self.path.get(step) else { return Ok(()) };
        let go_on = || !desk.is_old(step) && !self.cancel.is_cancelled();
        let poses = [&self.still, pose];
        let mut relation = Relation::default();
        for error in [ROUGH * self.error, self.error] {
            let question = Question { error, above: None, most_pairs: self.pair.most_pairs };
            let answer = follow(front, a, b, poses, &question, &mut |_| go_on())?;
            if !go_on() {
                return Ok(());
            }
            relation = relation_of(&answer, error > self.error);
            desk.tell(step, Ok(relation.clone()));
        }
        let Some(within) = self.within else { return Ok(()) };
        let near = Near { within, error: self.error, limit: self.pair.most_near() };
        let found = contacts(a, b, poses, &near, &self.pool, &mut |_| go_on())?;
        if go_on() {
            let all = found.regions.iter().map(region).collect();
            relation.regions = Some(Regions { within, all, complete: found.complete });
            desk.tell(step, Ok(relation));
        }
        Ok(())
    }
}

fn region(region: &chpm_proximity::Region) -> Region {
    Region {
        low: region.low,
        high: region.high,
        ends: region.closest_points.points,
        distance: [region.lower, region.upper],
        area: region.area,
        levels: region.levels,
    }
}

fn relation_of(answer: &Answer, goes_on: bool) -> Relation {
    let state = match (answer.end, answer.closest_points) {
        (End::Decided, _) if goes_on => "looking closer ...".to_owned(),
        (End::Decided, Some(closest)) => {
            let [a, b] = closest.levels;
            let error = AtMost(closest.errors[0].max(closest.errors[1]));
            format!("proven at levels {a} and {b}; the ends are within {error} units of the sources")
        }
        (End::Decided, None) => "proven".to_owned(),
        (End::Exact, _) => "exact, but for rounding".to_owned(),
        (End::Stopped, _) => "undecided: stopped".to_owned(),
        (End::Crowded, _) => {
            "undecided: more pairs would wait than fit into the memory (--memory)".to_owned()
        }
    };
    let ends = answer.closest_points.map(|closest| closest.points);
    Relation { distance: [answer.lower, answer.upper], ends, state, regions: None }
}
