//! Meshes that are taken further than the file goes, vertex by vertex, as long as that can be proven.

use crate::args::MemorySize;
use crate::progress::{Meter, line};
use crate::threads::ThreadArgs;
use anyhow::Result;
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_refine::Cut;
use chpm_verify::certify::{self, Further, Goal, SOURCE_BYTES};

/// Pieces of triangles that are looked at in a minute, about.
const MINUTE: u64 = 16_000_000;

/// How far to go, and how long to look.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Effort {
    distance: f32,
    reduce: chpm_reduce::Effort,
}

impl Effort {
    /// Effort of `--effort`, unless it asks for what the file has.
    pub(crate) fn of(level: u8, distance: f32) -> Option<Self> {
        let reduce = match level {
            0 | 1 => return None,
            2 => chpm_reduce::Effort { pieces: MINUTE, targets: 3 },
            _ => chpm_reduce::Effort { pieces: u64::MAX, targets: usize::MAX },
        };
        Some(Effort { distance, reduce })
    }
}

/// The mesh of a cut, taken further within a distance of the source; none where nothing is proven. It may take `free` bytes.
pub(crate) fn mesh(
    file: &Chpm<MappedFile>,
    cut: &Cut,
    Effort { distance, reduce }: Effort,
    free: u64,
    threads: &ThreadArgs,
    (meter, cancel): (&Meter, &Cancel),
) -> Result<Option<Further>> {
    let takes = SOURCE_BYTES * file.header().source_triangle_count;
    let Some(tiles) = free.checked_sub(takes) else {
        let missing = MemorySize(Bytes(takes - free));
        line(&format!(
            "warning: going on vertex by vertex would take {missing} more memory: --effort 1 it is"
        ));
        return Ok(None);
    };
    let collapse = |goal: &Goal<'_>| {
        let source = (goal.source, goal.triangles);
        chpm_reduce::reduce(goal.mesh, source, goal.distance, reduce, &|| cancel.is_cancelled())
    };
    let further = || certify::further(file, (cut, distance), tiles, meter, cancel, collapse);
    Ok(threads.pool()?.install(further)?)
}
