//! Triangles get the new numbers of their vertices.
//!
//! Where the mapping is in memory, each corner looks its number up. Where it is on disk, the lookup is a join in parts: corners
//! are written to buckets by ranges of the mapping, each bucket is resolved against its range alone, and the corners come
//! back in the order of the triangles. Every pass is sequential then, whatever the order of the source.

use crate::context::Context;
use crate::error::BuildError;
use chpm_extmem::{Buckets, Column};
use rayon::prelude::*;

/// Triangles that are looked at in one step.
const STEP: usize = 1 << 15;
/// Triangles that are joined together: their corners are on disk twice meanwhile.
const SEGMENT: usize = 1 << 23;
/// Numbers of the mapping that a bucket is resolved against.
const SLICE: usize = 1 << 20;
/// Bytes that a bucket gathers.
const BLOCK: usize = 1 << 13;

/// Replaces vertices by what `mapping` has for them.
pub(crate) fn run(
    triangles: &mut Column<[u32; 3]>,
    mapping: &Column<u32>,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    if let Some(numbers) = mapping.as_slice() {
        let renumber = |t: &mut [u32; 3]| *t = t.map(|v| numbers[v as usize]);
        return triangles.parts_mut(STEP).into_par_iter().try_for_each_init(Vec::new, |scratch, part| {
            context.check()?;
            part.update(scratch, |triangles| {
                triangles.iter_mut().for_each(renumber);
                Ok(())
            })
        });
    }
    let segments = triangles.len().div_ceil(SEGMENT);
    (0..segments).try_for_each(|segment| {
        let start = segment * SEGMENT;
        let end = triangles.len().min(start + SEGMENT);
        join(triangles, start..end, mapping, context)
    })
}

fn join(
    triangles: &mut Column<[u32; 3]>,
    range: std::ops::Range<usize>,
    mapping: &Column<u32>,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    let mut corners = Buckets::new(&context.store, "corners", mapping.len().div_ceil(SLICE), BLOCK);
    let mut scratch = Vec::new();
    let steps = || range.clone().step_by(STEP).map(|start| start..range.end.min(start + STEP));
    for step in steps() {
        context.check()?;
        for v in triangles.read(step, &mut scratch)?.as_flattened() {
            corners.push(*v as usize / SLICE, *v)?;
        }
    }
    let (mut numbers, mut block) = (Vec::new(), Vec::new());
    for bucket in (0..corners.count()).filter(|b| !corners.is_empty(*b)).collect::<Vec<_>>() {
        context.check()?;
        let first = bucket * SLICE;
        let numbers = mapping.read(first..mapping.len().min(first + SLICE), &mut numbers)?;
        corners.update(bucket, &mut block, |corners| {
            corners.iter_mut().for_each(|v| *v = numbers[*v as usize - first]);
        })?;
    }
    let mut resolved = corners.drain();
    let mut renumbered = Vec::new();
    for step in steps() {
        context.check()?;
        let start = step.start;
        renumbered.clear();
        for t in triangles.read(step, &mut scratch)? {
            let mut corner = |v: u32| resolved.next(v as usize / SLICE);
            renumbered.push([corner(t[0])?, corner(t[1])?, corner(t[2])?]);
        }
        triangles.write(start, &renumbered)?;
    }
    Ok(())
}
