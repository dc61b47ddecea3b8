//! The levels while they are worked off, group by group, which serialise themselves.

use super::Clusters;
use crate::hierarchy::Tree;
use crate::range::ErrorRange;
use crate::report::{LevelReport, Reached};
use chpm_extmem::{Spool, Store};
use serde::{Deserialize, Serialize};

/// Work on the levels, all groups up to one of them done.
#[derive(Serialize, Deserialize)]
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
            top: Vec::new(),
            range: ErrorRange::ALL,
        };
        Levels { built, level: 0, first: None, done: 0, left, displacements: Vec::new() }
    }

    /// The groups of the level.
    pub(super) fn groups(&self) -> &[Vec<u32>] {
        self.first.map_or(&[], |first| &self.built.groups[first..])
    }

    /// How far they are.
    pub(crate) fn reached(&self) -> Reached {
        Reached::Groups { level: self.level, done: self.done as u64, of: self.groups().len() as u64 }
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
