//! How far a build is, and how that is written to a manifest and read back: the only place that knows how it is encoded.
//!
//! A point holds the tables, and says in which files the arrays and spools are.

use crate::context::Context;
use crate::decompose::{Decomposition, SavedLeaves};
use crate::emit::Facts;
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::ingest::{SavedSource, Source};
use crate::progress::Stage;
use crate::report::{Reached, Repairs};
use crate::simplify::{Hierarchy, Levels, SavedHierarchy, SavedLevels, level_reports};
use bincode::error::{DecodeError, EncodeError};
use bincode::serde::{decode_from_std_read, encode_into_std_write};
use chpm_extmem::{ExtmemError, SavedFile, Store, WorkDir};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::{self, BufReader};

/// Changes with the meaning of what is written.
const VERSION: u32 = 2;
/// Most bytes that decoding may take.
const LIMIT: usize = 1 << 36;

/// What is known of a source once it was read.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Known {
    pub(crate) facts: Facts,
    pub(crate) repairs: Repairs,
}

/// What the stage that ran last has left for the next.
pub(crate) enum Work {
    Begin,
    Ingested(Box<Source>),
    Decomposed(Decomposition),
    /// With the level from which each interface is free and, if some groups are simplified, those.
    Arranged(Decomposition, Tree, Vec<u8>, Option<Box<Levels>>),
    Simplified(Tree, Hierarchy),
}

/// A checkpoint.
#[derive(Serialize, Deserialize)]
pub(crate) struct Point<'a> {
    known: Cow<'a, Known>,
    work: SavedWork<'a>,
}

#[derive(Serialize, Deserialize)]
enum SavedWork<'a> {
    Ingested(SavedSource),
    Decomposed(SavedLeaves<'a>),
    Arranged(SavedLeaves<'a>, Cow<'a, Tree>, Cow<'a, [u8]>, Option<Box<SavedLevels<'a>>>),
    Simplified(Cow<'a, Tree>, SavedHierarchy<'a>),
}

impl<'a> Point<'a> {
    /// Saves what a stage has left; none if there is nothing yet.
    pub(crate) fn of(known: &'a Known, work: &'a Work, store: &Store) -> Result<Option<Self>, BuildError> {
        let work = match work {
            Work::Begin => return Ok(None),
            Work::Ingested(source) => SavedWork::Ingested(source.save(store)?),
            Work::Decomposed(leaves) => SavedWork::Decomposed(leaves.save()?),
            Work::Arranged(leaves, tree, release, levels) => {
                let levels = levels.as_ref().map(|levels| levels.save()).transpose()?;
                return Self::of_levels(known, leaves, tree, release, levels).map(Some);
            }
            Work::Simplified(tree, clusters) => SavedWork::Simplified(Cow::Borrowed(tree), clusters.save()?),
        };
        Ok(Some(Point { known: Cow::Borrowed(known), work }))
    }

    /// Saves what belongs to levels that are saved.
    pub(crate) fn of_levels(
        known: &'a Known,
        leaves: &'a Decomposition,
        tree: &'a Tree,
        release: &'a [u8],
        levels: Option<SavedLevels<'a>>,
    ) -> Result<Self, BuildError> {
        let work = SavedWork::Arranged(
            leaves.save()?,
            Cow::Borrowed(tree),
            Cow::Borrowed(release),
            levels.map(Box::new),
        );
        Ok(Point { known: Cow::Borrowed(known), work })
    }

    /// Publishes the manifest.
    pub(crate) fn write(&self, dir: &WorkDir, key: u64) -> Result<(), ExtmemError> {
        dir.publish(self.names(), |mut out| {
            encode_into_std_write((VERSION, key), &mut out, config()).map_err(unwritten)?;
            encode_into_std_write(self, &mut out, config()).map_err(unwritten)?;
            Ok(())
        })
    }

    /// How far this is.
    pub(crate) fn reached(&self) -> Reached {
        match &self.work {
            SavedWork::Ingested(_) => Reached::Stage(Stage::Ingest),
            SavedWork::Decomposed(_) => Reached::Stage(Stage::Decompose),
            SavedWork::Arranged(.., None) => Reached::Stage(Stage::Hierarchy),
            SavedWork::Arranged(.., Some(levels)) => levels.reached(),
            SavedWork::Simplified(..) => Reached::Stage(Stage::Simplify),
        }
    }

    fn names(&self) -> BTreeSet<String> {
        let mut files: Vec<&SavedFile> = Vec::new();
        match &self.work {
            SavedWork::Ingested(source) => files.extend(source.files()),
            SavedWork::Decomposed(leaves) => files.push(&leaves.spool),
            SavedWork::Arranged(leaves, _, _, levels) => {
                files.push(&leaves.spool);
                files.extend(levels.iter().flat_map(|levels| levels.files()));
            }
            SavedWork::Simplified(_, clusters) => files.push(&clusters.pages),
        }
        files.into_iter().filter_map(SavedFile::name).map(str::to_owned).collect()
    }
}

impl Point<'static> {
    /// The checkpoint in `dir`, if there is one.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if it cannot be used, or is not for `key`.
    pub(crate) fn read(dir: &WorkDir, key: u64) -> Result<Option<Self>, ExtmemError> {
        let Some(content) = dir.manifest()? else { return Ok(None) };
        let mut content = BufReader::new(content);
        let path = || dir.path().join(WorkDir::MANIFEST);
        let wrong = |reason| ExtmemError::Damaged { path: path(), reason };
        let failed = |error| match error {
            DecodeError::Io { inner, .. } => ExtmemError::io("read", &path(), 0, inner),
            _ => wrong("cannot be understood"),
        };
        let (version, found): (u32, u64) = decode_from_std_read(&mut content, config()).map_err(failed)?;
        if version != VERSION {
            return Err(wrong("is of another version"));
        }
        if found != key {
            return Err(wrong("is of other work"));
        }
        decode_from_std_read(&mut content, config()).map(Some).map_err(failed)
    }

    /// Opens the files, all of which are checked; what else is in the folder goes.
    pub(crate) fn restore(self, context: &Context<'_>) -> Result<(Known, Work), BuildError> {
        let store = &context.store;
        store.workdir.resume(self.names())?;
        let work = match self.work {
            SavedWork::Ingested(source) => Work::Ingested(Box::new(source.load(store)?)),
            SavedWork::Decomposed(leaves) => Work::Decomposed(leaves.load(store)?),
            SavedWork::Arranged(leaves, tree, release, levels) => Work::Arranged(
                leaves.load(store)?,
                tree.into_owned(),
                release.into_owned(),
                levels.map(|levels| levels.load(store).map(Box::new)).transpose()?,
            ),
            SavedWork::Simplified(tree, clusters) => {
                let (tree, mut clusters) = (tree.into_owned(), clusters.load(store)?);
                clusters.levels = level_reports(&tree, &clusters.refs, &clusters.reports);
                Work::Simplified(tree, clusters)
            }
        };
        Ok((self.known.into_owned(), work))
    }
}

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<LIMIT>()
}

fn unwritten(error: EncodeError) -> io::Error {
    match error {
        EncodeError::Io { inner, .. } => inner,
        other => io::Error::other(other),
    }
}
