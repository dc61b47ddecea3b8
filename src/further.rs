//! Meshes that are taken further than the file goes, vertex by vertex, as long as that can be proven.

use crate::progress::{Meter, line};
use crate::threads::ThreadArgs;
use anyhow::Result;
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
pub(crate) use chpm_reduce::level;
use chpm_refine::Cut;
use chpm_verify::certify::{self, Further, Goal};

/// How far to go, and how long to look.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Effort {
    distance: f32,
    reduce: chpm_reduce::Effort,
}

impl Effort {
    /// Effort of `--effort`, unless it asks for what the file has.
    pub(crate) fn of(level: u8, distance: f32) -> Option<Self> {
        chpm_reduce::Effort::of(level).map(|reduce| Effort { distance, reduce })
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
    let (source, drawn) = (file.header().source_triangle_count, cut.triangle_count(file)?);
    let tiles = match certify::room(free, source, drawn) {
        Ok(tiles) => tiles,
        Err(missing) => {
            let missing = Bytes(missing);
            line(&format!(
                "warning: going on vertex by vertex would take {missing} more memory: --effort 1 it is"
            ));
            return Ok(None);
        }
    };
    let collapse = |goal: &Goal<'_>| {
        let source = (goal.source, goal.whole);
        let left = chpm_reduce::reduce(goal.mesh, source, goal.distance, reduce, &|| cancel.is_cancelled());
        (left.vertices, left.triangles)
    };
    let further = || certify::further(file, (cut, distance), tiles, meter, cancel, collapse);
    Ok(threads.pool()?.install(further)?)
}
