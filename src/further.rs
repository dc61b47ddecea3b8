//! Meshes that are taken further than the file goes, vertex by vertex, as long as that can be proven.

use crate::args::MemorySize;
use crate::progress::{Meter, line};
use crate::threads::ThreadArgs;
use anyhow::Result;
use chpm_extmem::{Cancel, MappedFile};
use chpm_format::Chpm;
use chpm_mesh::Bytes;
use chpm_refine::Cut;
use chpm_verify::certify::{self, CUT_BYTES, Further, Goal, SOURCE_BYTES};

/// Pieces of triangles that are looked at in a minute, about.
const MINUTE: u64 = 16_000_000;
/// Triangles of a source up to which a mesh is taken further if nothing else is asked for.
const FURTHER: u64 = 4_000_000;

/// Level of `--effort`; if nothing is asked for, as far as a minute goes, about, and of a large source what is stored.
pub(crate) fn level(asked: Option<u8>, triangles: u64) -> u8 {
    asked.unwrap_or(if triangles <= FURTHER { 2 } else { 0 })
}

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
            2 => chpm_reduce::Effort { pieces: MINUTE, places: 3 },
            _ => chpm_reduce::Effort { pieces: u64::MAX, places: 16 },
        };
        Some(Effort { distance, reduce })
    }
}

/// Bytes of `free` that are left beside a source and a cut of so many triangles, or how many are missing.
fn room(free: u64, source: u64, cut: u64) -> Result<u64, u64> {
    let takes = SOURCE_BYTES.saturating_mul(source).saturating_add(CUT_BYTES.saturating_mul(cut));
    free.checked_sub(takes).ok_or_else(|| takes - free)
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
    let tiles = match room(free, source, drawn) {
        Ok(tiles) => tiles,
        Err(missing) => {
            let missing = MemorySize(Bytes(missing));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_not_begun() {
        let (source, cut) = (1_000_000, 1_000);
        let takes = SOURCE_BYTES * source + CUT_BYTES * cut;
        assert_eq!(room(takes + 5, source, cut), Ok(5));
        assert_eq!(room(takes - 5, source, cut), Err(5));
        assert!(room(u64::MAX - 1, u64::MAX, cut).is_err());
    }

    #[test]
    fn large_sources_are_not_taken_further_unless_that_is_asked_for() {
        assert_eq!([level(None, FURTHER), level(None, FURTHER + 1)], [2, 0]);
        assert_eq!([level(Some(3), u64::MAX), level(Some(0), 1)], [3, 0]);
    }
}
