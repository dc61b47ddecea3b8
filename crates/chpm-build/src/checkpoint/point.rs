//! How far a build is, and how that is written to a manifest and read back: the only place that knows how it is encoded.
//!
//! A point holds the tables, and says in which files the arrays and spools are.

use super::work::{Arranged, Left};
use crate::context::Context;
use crate::decompose::SavedLeaves;
use crate::emit::Known;
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::ingest::SavedSource;
use crate::progress::Stage;
use crate::report::Reached;
use crate::simplify::{Levels, SavedClusters, SavedLevels, level_reports};
use crate::trim::{Built, Trimmed};
use bincode::error::{DecodeError, EncodeError};
use bincode::serde::{decode_from_std_read, encode_into_std_write};
use chpm_extmem::{ExtmemError, SavedFile, Store, WorkDir};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::{self, BufReader};

/// Changes with the meaning of what is written.
const VERSION: u32 = 4;
/// Most bytes that decoding may take.
const LIMIT: usize = 1 << 36;

/// A checkpoint.
#[derive(Serialize, Deserialize)]
pub(super) struct Point<'a> {
    known: Cow<'a, Known>,
    work: SavedWork<'a>,
}

#[derive(Serialize, Deserialize)]
enum SavedWork<'a> {
    Ingested(SavedSource),
    Decomposed(SavedLeaves<'a>),
    Arranged(SavedLeaves<'a>, Cow<'a, Tree>, Cow<'a, [u8]>, Option<Box<SavedLevels<'a>>>),
    Simplified(Cow<'a, Tree>, SavedClusters<'a>, Option<Cow<'a, Trimmed>>),
}

impl<'a> Point<'a> {
    /// Saves what a stage has left.
    pub(super) fn of(known: &'a Known, left: &'a Left, store: &Store) -> Result<Self, BuildError> {
        let work = match left {
            Left::Nothing => unreachable!("the first stage has run"),
            Left::Ingested(source) => SavedWork::Ingested(source.save(store)?),
            Left::Decomposed(leaves) => SavedWork::Decomposed(leaves.save()?),
            Left::Arranged(arranged, levels) => return Self::of_levels(known, arranged, levels.as_deref()),
            Left::Simplified(Built { tree, clusters, trimmed }) => SavedWork::Simplified(
                Cow::Borrowed(tree),
                clusters.save()?,
                trimmed.as_ref().map(Cow::Borrowed),
            ),
        };
        Ok(Point { known: Cow::Borrowed(known), work })
    }

    /// Saves levels, and what they are built from.
    pub(super) fn of_levels(
        known: &'a Known,
        arranged: &'a Arranged,
        levels: Option<&'a Levels>,
    ) -> Result<Self, BuildError> {
        let Arranged { leaves, tree, release } = arranged;
        let levels = levels.map(Levels::save).transpose()?.map(Box::new);
        let work = SavedWork::Arranged(leaves.save()?, Cow::Borrowed(tree), Cow::Borrowed(release), levels);
        Ok(Point { known: Cow::Borrowed(known), work })
    }

    /// Publishes the manifest.
    pub(super) fn write(&self, dir: &WorkDir, key: u64) -> Result<(), ExtmemError> {
        dir.publish(self.names(), |mut out| {
            encode_into_std_write((VERSION, key), &mut out, config()).map_err(unwritten)?;
            encode_into_std_write(self, &mut out, config()).map_err(unwritten)?;
            Ok(())
        })
    }

    /// How far this is.
    pub(super) fn reached(&self) -> Reached {
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
            SavedWork::Simplified(_, clusters, _) => files.push(&clusters.pages),
        }
        files.into_iter().filter_map(SavedFile::name).map(str::to_owned).collect()
    }
}

impl Point<'static> {
    /// The checkpoint in `dir`, if there is one.
    ///
    /// # Errors
    /// [`ExtmemError::Damaged`] if it cannot be used, or is not for `key`.
    pub(super) fn read(dir: &WorkDir, key: u64) -> Result<Option<Self>, ExtmemError> {
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
    pub(super) fn restore(self, context: &Context<'_>) -> Result<(Known, Left), BuildError> {
        let store = &context.store;
        store.workdir.resume(self.names())?;

        let left = match self.work {
            SavedWork::Ingested(source) => Left::Ingested(Box::new(source.load(store)?)),
            SavedWork::Decomposed(leaves) => Left::Decomposed(leaves.load(store)?),
            SavedWork::Arranged(leaves, tree, release, levels) => Left::Arranged(
                Arranged {
                    leaves: leaves.load(store)?,
                    tree: tree.into_owned(),
                    release: release.into_owned(),
                },
                levels.map(|levels| levels.load(store).map(Box::new)).transpose()?,
            ),
            SavedWork::Simplified(tree, clusters, trimmed) => {
                let (tree, mut clusters) = (tree.into_owned(), clusters.load(store)?);
                clusters.levels = level_reports(&tree, &clusters.refs, &clusters.reports);
                Left::Simplified(Built { tree, clusters, trimmed: trimmed.map(Cow::into_owned) })
            }
        };

        Ok((self.known.into_owned(), left))
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
