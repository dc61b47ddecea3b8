//! Triangles get the new numbers of their vertices.
//!
//! Where the mapping is in memory, each corner looks its number up. Where it is on disk, triangles in a row whose vertices lie close
//! together look theirs up in the part of it that they need: in most sources nearly all do. For the rest the lookup is a join in
//! parts: corners are written to buckets by ranges of the mapping, each bucket is resolved against its range alone, and the
//! corners come back in the order of the triangles. Every pass is sequential then, whatever the order of the source.

use crate::context::Context;
use crate::error::BuildError;
use chpm_extmem::{Buckets, Column, ExtmemError, Part};
use rayon::prelude::*;
use std::ops::Range;

/// Triangles that are looked at in one step.
const STEP: usize = 1 << 15;
/// Numbers of the mapping that a step may have in memory.
const WINDOW: u32 = 1 << 20;
/// Steps that are joined together: their corners are on disk twice meanwhile.
const SEGMENT: usize = 1 << 8;
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
    let len = triangles.len();
    let look_up = |scratch: &mut Scratch, part: Part<'_, [u32; 3]>| {
        context.check()?;
        let start = part.start();
        match part
            .update(&mut scratch.triangles, |triangles| renumber(triangles, mapping, &mut scratch.window))
        {
            Ok(()) => Ok(None),
            Err(Left::Apart) => Ok(Some(start..len.min(start + STEP))),
            Err(Left::Failed(error)) => Err(BuildError::from(error)),
        }
    };
    let parts = triangles.parts_mut(STEP).into_par_iter();
    let left = parts.map_init(Scratch::default, look_up).collect::<Result<Vec<_>, BuildError>>()?;
    let left: Vec<Range<usize>> = left.into_iter().flatten().collect();
    left.chunks(SEGMENT).try_for_each(|steps| join(triangles, steps, mapping, context))
}

/// What a thread looks up with.
#[derive(Default)]
struct Scratch {
    triangles: Vec<[u32; 3]>,
    window: Vec<u32>,
}

/// Why triangles were left as they are.
enum Left {
    /// Their vertices lie too far apart.
    Apart,
    Failed(ExtmemError),
}

impl From<ExtmemError> for Left {
    fn from(error: ExtmemError) -> Self {
        Left::Failed(error)
    }
}

fn renumber(triangles: &mut [[u32; 3]], mapping: &Column<u32>, window: &mut Vec<u32>) -> Result<(), Left> {
    let corners = triangles.as_flattened_mut();
    let (first, numbers) = match mapping.as_slice() {
        Some(numbers) => (0, numbers),
        None => {
            let ends = |(low, high): (u32, u32), v: &u32| (low.min(*v), high.max(*v));
            let (low, high) = corners.iter().fold((u32::MAX, 0), ends);
            if high - low >= WINDOW {
                return Err(Left::Apart);
            }
            (low, mapping.read(low as usize..high as usize + 1, window)?)
        }
    };
    corners.iter_mut().for_each(|v| *v = numbers[(*v - first) as usize]);
    Ok(())
}

fn join(
    triangles: &mut Column<[u32; 3]>,
    steps: &[Range<usize>],
    mapping: &Column<u32>,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    let mut corners = Buckets::new(&context.store, "corners", mapping.len().div_ceil(SLICE), BLOCK);
    let mut scratch = Vec::new();
    for step in steps {
        context.check()?;
        for v in triangles.read(step.clone(), &mut scratch)?.as_flattened() {
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
    for step in steps {
        context.check()?;
        renumbered.clear();
        for t in triangles.read(step.clone(), &mut scratch)? {
            let mut corner = |v: u32| resolved.next(v as usize / SLICE);
            renumbered.push([corner(t[0])?, corner(t[1])?, corner(t[2])?]);
        }
        triangles.write(step.start, &renumbered)?;
    }
    Ok(())
}
