//! The stages of a build, and who is told how far it is.

use chpm_extmem::{Progress, Silent};
use std::fmt;

/// The stages of a build, in order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Stage {
    /// PLY to validated vertex and triangle arrays.
    Ingest,
    /// Arrays to leaf clusters with shared vertices marked.
    Decompose,
    /// Cluster graph to a balanced binary tree.
    Hierarchy,
    /// Progressive meshes, level by level from the leaves.
    Simplify,
    /// Images of clusters, where they have any.
    Sheets,
    /// Order of clusters in the file, of vertices and triangles in a cluster.
    Layout,
    /// The file.
    Emit,
}

impl Stage {
    /// All stages in order. A build without sheets passes over theirs.
    pub const ALL: [Stage; 7] = [
        Stage::Ingest,
        Stage::Decompose,
        Stage::Hierarchy,
        Stage::Simplify,
        Stage::Sheets,
        Stage::Layout,
        Stage::Emit,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Ingest => "ingest",
            Stage::Decompose => "decompose",
            Stage::Hierarchy => "hierarchy",
            Stage::Simplify => "simplify",
            Stage::Sheets => "sheets",
            Stage::Layout => "layout",
            Stage::Emit => "emit",
        }
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Receives the progress of a build, stage by stage. Whoever does not care for stages has nothing to add to [`Progress`].
pub trait BuildProgress: Progress {
    /// A stage starts; `total` units of work are expected (triangles, clusters or bytes, whatever the stage counts).
    fn begin_stage(&self, stage: Stage, total: u64) {
        self.begin(stage.name(), total);
    }

    /// The source has been read, and has so many triangles.
    fn counted(&self, _triangles: u64) {}

    /// The stage has ended.
    fn end_stage(&self, _stage: Stage) {
        self.end();
    }
}

impl BuildProgress for Silent {}
