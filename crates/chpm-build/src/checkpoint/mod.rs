//! Checkpoints: what a build has done is kept in a work folder from time to time, so that a build that was killed goes on there.
//!
//! The folder lies beside the output (or in the work directory that was given). Its name says for which output it is, and holds a hash of
//! the source's identity, the settings and the program: other work has another name. Its manifest names the files of the last
//! checkpoint, and nothing else in it is ever read. Establishes I12.

mod key;
mod point;
mod work;

use crate::config::Resources;
use crate::context::Context;
use crate::error::BuildError;
use crate::progress::BuildProgress;
use crate::report::Reached;
use chpm_extmem::{ExtmemError, WorkDir};
pub(crate) use key::{Key, beside};
use point::{LeftRef, Point, Restored};
use std::path::Path;
use std::time::Instant;
pub(crate) use work::{Arranged, Work};

/// The checkpoints of one build.
#[derive(Debug, Default)]
pub(crate) struct Checkpoints {
    /// None: none are made, and none is looked for.
    key: Option<u64>,
    keep_work: bool,
    /// Progress that the manifest records.
    reached: Option<Reached>,
    /// Progress that this run began with.
    pub(crate) resumed: Option<Reached>,
    /// Notes about earlier work.
    pub(crate) notes: Vec<String>,
}

impl Checkpoints {
    /// Opens the folder of this work in `parent`.
    pub(crate) fn open(
        parent: &Path,
        key: &Key,
        resources: &Resources,
        progress: &dyn BuildProgress,
    ) -> Result<(Self, WorkDir), BuildError> {
        let dir = WorkDir::resumable(&parent.join(key.folder()), resources.fail_points.clone())?;
        let mut checkpoints =
            Checkpoints { key: Some(key.hash), keep_work: resources.keep_work, ..Checkpoints::default() };
        for other in key.others(parent) {
            let text = format!(
                "'{}' is the work of another source or other settings; it is not used: delete it if you do not need it",
                other.display()
            );
            checkpoints.note(text, progress);
        }
        Ok((checkpoints, dir))
    }

    /// Restores the last checkpoint of an earlier run, or begins. A checkpoint that is not as it was written is not used.
    fn restore(&mut self, context: &Context<'_>) -> Result<Restored, BuildError> {
        let Some(key) = self.key else { return Ok(Default::default()) };
        let dir = &context.store.workdir;
        match point::read(&context.store, key) {
            Ok(Some((known, painted, left))) => {
                let reached = LeftRef::of(&left).reached();
                self.note(format!("going on after {reached}"), context.progress);
                (self.reached, self.resumed) = (Some(reached), Some(reached));
                return Ok((known, painted, left));
            }
            Ok(None) => {}
            Err(BuildError::Extmem(error @ ExtmemError::Damaged { .. })) => {
                self.note(format!("earlier work is not used: {error}"), context.progress);
            }
            Err(error) => return Err(error),
        }

        dir.clear()?;
        Ok(Default::default())
    }

    fn note(&mut self, text: String, progress: &dyn BuildProgress) {
        progress.note(&text);
        self.notes.push(text);
    }

    /// Makes a checkpoint if it is time, or if this is the `last` one and is to be kept.
    fn offer(&mut self, context: &Context<'_>, last: bool, point: &Point<'_>) -> Result<(), BuildError> {
        let Some(key) = self.key.filter(|_| context.clock.is_due() || last && self.keep_work) else {
            return Ok(());
        };
        let begun = Instant::now();
        point.write(&context.store, key)?;
        context.clock.restart(begun);
        self.reached = Some(point.left.reached());
        Ok(())
    }

    /// The work is done.
    pub(crate) fn finish(&self, dir: &WorkDir) {
        dir.keep(self.keep_work && self.reached.is_some());
    }

    /// Says of an error where the next run goes on, if there is something, or that what there was is gone.
    pub(crate) fn explain(&self, error: BuildError, dir: &WorkDir) -> BuildError {
        let (error, folder) = (Box::new(error), dir.path().to_owned());
        match self.reached {
            _ if !folder.exists() => BuildError::WorkRemoved { error, folder },
            Some(reached) if folder.join(WorkDir::MANIFEST).exists() => {
                BuildError::Kept { error, reached, folder }
            }
            _ => *error,
        }
    }
}
