//! Speed against error: who competes, what each is asked for, and what the figures come to.

mod clod;
pub(crate) mod contend;
mod figures;
mod in_core;
mod plot;

pub(crate) use figures::{Figure, Point, equal_deviation, median};
pub(crate) use plot::svg;

/// The source's triangles are divided by these.
pub(crate) const DIVISORS: [u64; 4] = [4, 16, 64, 256];
/// Further ones for the contender that others are compared with at equal deviation.
pub(crate) const REFERENCE_DIVISORS: [u64; 6] = [2, 8, 32, 128, 512, 1024];

/// Vertices that a cluster, and so the kernel, may have.
const KERNEL_VERTICES: usize = 65_535;
/// Triangles up to which the plain simplifier is patient enough.
const PLAIN_TRIANGLES: usize = 200_000;

/// Who competes. Each does the whole way in a process of its own: from the PLY to a file.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Contender {
    /// This project with its defaults
    Chpm,
    /// On one thread
    ChpmOneThread,
    /// With locked boundaries
    ChpmLock,
    /// Keeping the topology
    ChpmKeep,
    /// Without a layout
    ChpmNoLayout,
    /// meshopt's cluster hierarchy in core, default settings, clusters of 128 triangles
    MeshoptClod,
    /// meshopt's simplifier on the whole mesh in core
    MeshoptSimplify,
    /// This project's kernel on the whole mesh in core; up to 65,535 vertices
    Kernel,
    /// A plain in-core quadric simplifier that recomputes everything; up to 200,000 triangles
    Plain,
}

impl Contender {
    pub(crate) const ALL: [Contender; 9] = [
        Contender::Chpm,
        Contender::ChpmOneThread,
        Contender::ChpmLock,
        Contender::ChpmKeep,
        Contender::ChpmNoLayout,
        Contender::MeshoptClod,
        Contender::MeshoptSimplify,
        Contender::Kernel,
        Contender::Plain,
    ];

    /// As it is typed and shown.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Contender::Chpm => "chpm",
            Contender::ChpmOneThread => "chpm-one-thread",
            Contender::ChpmLock => "chpm-lock",
            Contender::ChpmKeep => "chpm-keep",
            Contender::ChpmNoLayout => "chpm-no-layout",
            Contender::MeshoptClod => "meshopt-clod",
            Contender::MeshoptSimplify => "meshopt-simplify",
            Contender::Kernel => "kernel",
            Contender::Plain => "plain",
        }
    }

    /// Settings that it runs with, for the record.
    pub(crate) fn settings(self) -> &'static str {
        match self {
            Contender::Chpm => "defaults, all processors; a file of all levels",
            Contender::ChpmOneThread => "as chpm, --threads 1",
            Contender::ChpmLock => "as chpm, --boundary lock",
            Contender::ChpmKeep => "as chpm, --topology keep",
            Contender::ChpmNoLayout => "as chpm, --no-layout",
            Contender::MeshoptClod => {
                "clod_build, clod_default_config(128), one thread; a file of all clusters"
            }
            Contender::MeshoptSimplify => {
                "simplify, no options, no error limit, one thread; one run to a 256th"
            }
            Contender::Kernel => "chpm-qem, topology may change, one thread; one run to a 256th",
            Contender::Plain => "half edges, quadrics by area, topology kept, one thread; one run to a 256th",
        }
    }

    pub(crate) fn is_chpm(self) -> bool {
        self.name().starts_with("chpm")
    }

    /// Why it does not compete on such a mesh, if it does not.
    pub(crate) fn declines(self, vertices: usize, triangles: usize) -> Option<&'static str> {
        match self {
            Contender::Kernel if vertices > KERNEL_VERTICES => Some("more than 65,535 vertices"),
            Contender::Plain if triangles > PLAIN_TRIANGLES => Some("more than 200,000 triangles"),
            _ => None,
        }
    }
}
