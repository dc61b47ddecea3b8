//! The levels while they are worked off, group by group, and how that is saved.

use super::{Clusters, PageRef};
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::range::ErrorRange;
use crate::report::{LevelReport, Reached};
use chpm_extmem::{SavedFile, Spool, Store};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Work on the levels, all groups up to one of them done.
pub(crate) struct Levels {
    pub(super) built: Clusters,
    /// The level that is worked on.
    pub(super) level: u32,
    /// Where its groups begin in the list of all, once they are formed; how many of them are done.
    pub(super) first: Option<usize>,
    pub(super) done: usize,
    /// By interface: shared vertices that have not collapsed.
    pub(super) left: Vec<u32>,
    /// Displacements of base meshes, a spool for each level up to this one, empty where all have been read.
    pub(super) displacements: Vec<Spool>,
}

impl Levels {
    /// Before the first level; `left` are all shared vertices by interface.
    pub(super) fn new(tree: &Tree, left: Vec<u32>, store: &Store) -> Self {
        let built = Clusters {
            pages: Spool::named(store, "pages", "pages"),
            refs: vec![None; tree.nodes.len()],
            reports: vec![LevelReport::default(); tree.nodes.len()],
            levels: Vec::new(),
            groups: Vec::new(),
            range: ErrorRange::ALL,
        };
        Levels { built, level: 0, first: None, done: 0, left, displacements: Vec::new() }
    }

    /// The groups of the level.
    pub(super) fn groups(&self) -> &[Vec<u32>] {
        self.first.map_or(&[], |first| &self.built.groups[first..])
    }

    pub(crate) fn save(&self) -> Result<SavedLevels<'_>, BuildError> {
        let displacements = self.displacements.iter().map(Spool::save).collect::<Result<_, _>>()?;
        Ok(SavedLevels {
            built: self.built.save()?,
            level: self.level,
            first: self.first,
            done: self.done,
            left: Cow::Borrowed(&self.left),
            displacements,
        })
    }
}

/// An empty spool for the displacements that a level leaves.
pub(super) fn displacements(store: &Store, level: usize) -> Spool {
    Spool::named(store, WHAT, &name(level))
}

const WHAT: &str = "displacements";

fn name(level: usize) -> String {
    format!("{WHAT}-{level}")
}

/// [`Levels`] in a checkpoint.
#[derive(Serialize, Deserialize)]
pub(crate) struct SavedLevels<'a> {
    built: SavedClusters<'a>,
    level: u32,
    first: Option<usize>,
    done: usize,
    left: Cow<'a, [u32]>,
    displacements: Vec<SavedFile>,
}

impl SavedLevels<'_> {
    pub(crate) fn reached(&self) -> Reached {
        let of = self.first.map_or(0, |first| self.built.groups.len() - first) as u64;
        Reached::Groups { level: self.level, done: self.done as u64, of }
    }

    pub(crate) fn files(&self) -> impl Iterator<Item = &SavedFile> {
        self.displacements.iter().chain([&self.built.pages])
    }

    pub(crate) fn load(self, store: &Store) -> Result<Levels, BuildError> {
        let spool = |(level, saved): (usize, &SavedFile)| Spool::load(store, WHAT, &name(level), saved);
        let displacements = self.displacements.iter().enumerate().map(spool).collect::<Result<_, _>>()?;
        Ok(Levels {
            built: self.built.load(store)?,
            level: self.level,
            first: self.first,
            done: self.done,
            left: self.left.into_owned(),
            displacements,
        })
    }
}

/// [`Clusters`] in a checkpoint; the sums of its levels are made again.
#[derive(Serialize, Deserialize)]
pub(crate) struct SavedClusters<'a> {
    pub(crate) pages: SavedFile,
    refs: Cow<'a, [Option<PageRef>]>,
    reports: Cow<'a, [LevelReport]>,
    groups: Cow<'a, [Vec<u32>]>,
    range: ErrorRange,
}

impl Clusters {
    pub(crate) fn save(&self) -> Result<SavedClusters<'_>, BuildError> {
        Ok(SavedClusters {
            pages: self.pages.save()?,
            refs: Cow::Borrowed(&self.refs),
            reports: Cow::Borrowed(&self.reports),
            groups: Cow::Borrowed(&self.groups),
            range: self.range,
        })
    }
}

impl SavedClusters<'_> {
    pub(crate) fn load(self, store: &Store) -> Result<Clusters, BuildError> {
        Ok(Clusters {
            pages: Spool::load(store, "pages", "pages", &self.pages)?,
            refs: self.refs.into_owned(),
            reports: self.reports.into_owned(),
            levels: Vec::new(),
            groups: self.groups.into_owned(),
            range: self.range,
        })
    }
}
