//! Progress is data: stages report counts, the command draws them.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

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
    /// Order of clusters in the file, of vertices and triangles in a cluster.
    Layout,
    /// The file.
    Emit,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Stage; 6] =
        [Stage::Ingest, Stage::Decompose, Stage::Hierarchy, Stage::Simplify, Stage::Layout, Stage::Emit];
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Stage::Ingest => "ingest",
            Stage::Decompose => "decompose",
            Stage::Hierarchy => "hierarchy",
            Stage::Simplify => "simplify",
            Stage::Layout => "layout",
            Stage::Emit => "emit",
        })
    }
}

/// Receives progress; called from worker threads.
pub trait Progress: Sync {
    /// A stage starts; `total` units of work are expected (triangles, clusters or bytes, whatever the stage counts).
    fn begin(&self, stage: Stage, total: u64);
    /// `done` more units of the running stage are done.
    fn advance(&self, done: u64);
    /// The source has been read, and has so many triangles.
    fn counted(&self, _triangles: u64) {}
    /// The stage has ended.
    fn end(&self, stage: Stage);
    /// Something that whoever waits should know, about earlier work for example.
    fn note(&self, _text: &str) {}
}

/// Draws nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: Stage, _: u64) {}
    fn advance(&self, _: u64) {}
    fn end(&self, _: Stage) {}
}

/// A request to stop, shared with whoever may ask for it. A build looks at it between pieces of work of some milliseconds.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks for the stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked for.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
