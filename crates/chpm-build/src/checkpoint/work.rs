//! Results of the stages of a build so far. Each stage is run unless an earlier run has done it, and may be followed by a checkpoint.

use super::Checkpoints;
use super::point::{LeftRef, Point};
use crate::context::Context;
use crate::decompose::Decomposition;
use crate::emit::{Facts, Known};
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::ingest::{self, Painted, Source};
use crate::simplify::Levels;
use crate::trim::Built;
use serde::{Deserialize, Serialize};

/// Results of the last stage for the next.
#[derive(Default, Deserialize)]
pub(crate) enum Left {
    #[default]
    Nothing,
    Ingested(Box<Source>),
    Decomposed(Decomposition),
    /// With the levels, if some groups are simplified.
    Arranged(Arranged, Option<Box<Levels>>),
    Simplified(Built),
}

/// Leaves under a tree.
#[derive(Serialize, Deserialize)]
pub(crate) struct Arranged {
    pub(crate) leaves: Decomposition,
    pub(crate) tree: Tree,
    /// By interface, the level from which its shared vertices are free.
    pub(crate) release: Vec<u8>,
}

/// Saves levels if it is time.
pub(crate) type Keep<'a> = dyn FnMut(&Arranged, &Levels) -> Result<(), BuildError> + Send + 'a;

/// A build on its way.
pub(crate) struct Work<'a> {
    context: &'a Context<'a>,
    checkpoints: &'a mut Checkpoints,
    known: Known,
    painted: Option<Painted>,
    left: Left,
}

impl<'a> Work<'a> {
    /// Goes on where an earlier run was, or begins.
    pub(crate) fn resume(
        checkpoints: &'a mut Checkpoints,
        context: &'a Context<'a>,
    ) -> Result<Self, BuildError> {
        let (known, painted, left) = checkpoints.restore(context)?;
        Ok(Work { context, checkpoints, known, painted, left })
    }

    /// Reads the source.
    pub(crate) fn ingest(
        &mut self,
        stage: impl FnOnce() -> Result<Source, BuildError>,
    ) -> Result<(), BuildError> {
        let Left::Nothing = self.left else { return Ok(()) };
        let mut source = stage()?;
        self.painted = source.painted.take();
        self.known = Known { facts: Facts::of(&source), repairs: ingest::repairs(&source) };
        self.leave(Left::Ingested(Box::new(source)))
    }

    /// Cuts the source into leaves.
    pub(crate) fn decompose(
        &mut self,
        stage: impl FnOnce(Source, &mut Known) -> Result<Decomposition, BuildError>,
    ) -> Result<(), BuildError> {
        let source = match std::mem::take(&mut self.left) {
            Left::Ingested(source) => *source,
            later => {
                self.left = later;
                return Ok(());
            }
        };
        let leaves = stage(source, &mut self.known)?;
        self.known.facts.add_leaves(&leaves);
        self.leave(Left::Decomposed(leaves))
    }

    /// Puts a tree over the leaves.
    pub(crate) fn arrange(
        &mut self,
        stage: impl FnOnce(&Decomposition) -> Result<(Tree, Vec<u8>), BuildError>,
    ) -> Result<(), BuildError> {
        let leaves = match std::mem::take(&mut self.left) {
            Left::Decomposed(leaves) => leaves,
            later => {
                self.left = later;
                return Ok(());
            }
        };
        let (tree, release) = stage(&leaves)?;
        self.leave(Left::Arranged(Arranged { leaves, tree, release }, None))
    }

    /// Nodes of the tree, once there is one.
    pub(crate) fn node_count(&self) -> usize {
        match &self.left {
            Left::Arranged(Arranged { tree, .. }, _) | Left::Simplified(Built { tree, .. }) => {
                tree.nodes.len()
            }
            Left::Nothing | Left::Ingested(_) | Left::Decomposed(_) => 0,
        }
    }

    /// Simplifies level by level. The stage goes on with levels that were begun, and hands them to `Keep` when a checkpoint is due.
    pub(crate) fn simplify(
        &mut self,
        stage: impl FnOnce(Arranged, Option<Box<Levels>>, &mut Keep<'_>) -> Result<Built, BuildError>,
    ) -> Result<(), BuildError> {
        let (arranged, begun) = match std::mem::take(&mut self.left) {
            Left::Arranged(arranged, begun) => (arranged, begun),
            later => {
                self.left = later;
                return Ok(());
            }
        };
        let (known, painted) = (&self.known, self.painted.as_ref());
        let (context, checkpoints) = (self.context, &mut *self.checkpoints);
        let built = stage(arranged, begun, &mut |arranged, levels| {
            let left = LeftRef::Arranged(arranged, Some(levels));
            checkpoints.offer(context, false, &Point { known, painted, left })
        })?;
        self.leave(Left::Simplified(built))
    }

    /// Results of all stages.
    ///
    /// # Panics
    /// Before [`Work::simplify`].
    pub(crate) fn finish(self) -> (Known, Option<Painted>, Built) {
        match self.left {
            Left::Simplified(built) => (self.known, self.painted, built),
            _ => unreachable!("the stages are run in order"),
        }
    }

    /// Takes what a stage has left.
    fn leave(&mut self, left: Left) -> Result<(), BuildError> {
        self.left = left;
        let last = matches!(self.left, Left::Simplified(..));
        let painted = self.painted.as_ref();
        let point = Point { known: &self.known, painted, left: LeftRef::of(&self.left) };
        self.checkpoints.offer(self.context, last, &point)
    }
}
