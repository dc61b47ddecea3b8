//! Triangles get the new numbers of their vertices.
//!
//! Where the mapping is in memory, each corner looks its number up. Where it is on disk, triangles in a row whose vertices lie close
//! together look theirs up in the part of it that they need: in most sources nearly all do. For the rest the lookup is a join in
//! parts: corners are written to buckets by ranges of the mapping, each bucket is resolved against its range alone, and the
//! corners come back in the order of the triangles. Every pass is sequential then, whatever the order of the source.

use crate::context::Context;
use crate::error::BuildError;
use crate::ids::Id;
use chpm_extmem::{Buckets, Column, ExtmemError};
use rayon::prelude::*;
use std::ops::Range;

/// Triangles that are looked at in one step.
const STEP: usize = 1 << 15;
/// Numbers of the mapping that a step may have in memory.
const WINDOW: usize = 1 << 20;
/// Steps that are joined together: their corners are on disk twice meanwhile.
const SEGMENT: usize = 1 << 8;
/// Numbers of the mapping that a bucket is resolved against.
const SLICE: usize = 1 << 20;
/// Bytes that a bucket gathers.
const BLOCK: usize = 1 << 13;

/// Replaces vertices by what `mapping` has for them.
pub(crate) fn run<I: Id>(
    triangles: &mut Column<[I; 3]>,
    mapping: &Column<I>,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    let len = triangles.len();
    let phase = context.trace.phase();
    let parts = triangles.parts_mut(STEP).into_par_iter();
    let left = parts.map_init(Scratch::<I>::default, |scratch, part| {
        let _traced = phase.task("renumber");
        context.check()?;
        let start = part.start();
        match part
            .update(&mut scratch.triangles, |triangles| renumber(triangles, mapping, &mut scratch.window))
        {
            Ok(()) => {
                context.progress.advance((len.min(start + STEP) - start) as u64);
                Ok(None)
            }
            Err(Left::Apart) => Ok(Some(start..len.min(start + STEP))),
            Err(Left::Failed(error)) => Err(BuildError::from(error)),
        }
    });
    let left = left.collect::<Result<Vec<_>, BuildError>>()?;
    let left: Vec<Range<usize>> = left.into_iter().flatten().collect();
    left.chunks(SEGMENT).try_for_each(|steps| join(triangles, steps, mapping, context))
}

/// Buffers of a thread that looks up.
struct Scratch<I> {
    triangles: Vec<[I; 3]>,
    window: Vec<I>,
}

impl<I> Default for Scratch<I> {
    fn default() -> Self {
        Scratch { triangles: Vec::new(), window: Vec::new() }
    }
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

fn renumber<I: Id>(triangles: &mut [[I; 3]], mapping: &Column<I>, window: &mut Vec<I>) -> Result<(), Left> {
    let corners = triangles.as_flattened_mut();
    let (first, numbers) = match mapping.as_slice() {
        Some(numbers) => (0, numbers),
        None => {
            fn ends((low, high): (usize, usize), v: usize) -> (usize, usize) {
                (low.min(v), high.max(v))
            }
            let (low, high) = corners.iter().map(|v| v.index()).fold((usize::MAX, 0), ends);
            if high - low >= WINDOW {
                return Err(Left::Apart);
            }
            (low, mapping.read(low..high + 1, window)?)
        }
    };
    corners.iter_mut().for_each(|v| *v = numbers[v.index() - first]);
    Ok(())
}

fn join<I: Id>(
    triangles: &mut Column<[I; 3]>,
    steps: &[Range<usize>],
    mapping: &Column<I>,
    context: &Context<'_>,
) -> Result<(), BuildError> {
    let mut corners = Buckets::new(&context.store, "corners", mapping.len().div_ceil(SLICE), BLOCK);
    let mut scratch = Vec::new();

    for step in steps {
        context.check()?;
        for v in triangles.read(step.clone(), &mut scratch)?.as_flattened() {
            corners.push(v.index() / SLICE, *v)?;
        }
    }

    let (mut numbers, mut block) = (Vec::new(), Vec::new());
    for bucket in (0..corners.count()).filter(|b| !corners.is_empty(*b)).collect::<Vec<_>>() {
        context.check()?;
        let first = bucket * SLICE;
        let numbers = mapping.read(first..mapping.len().min(first + SLICE), &mut numbers)?;
        corners.update(bucket, &mut block, |corners| {
            corners.iter_mut().for_each(|v| *v = numbers[v.index() - first]);
        })?;
    }

    let mut resolved = corners.drain();
    let mut renumbered = Vec::new();
    for step in steps {
        context.check()?;
        renumbered.clear();
        for t in triangles.read(step.clone(), &mut scratch)? {
            let mut corner = |v: I| resolved.next(v.index() / SLICE);
            renumbered.push([corner(t[0])?, corner(t[1])?, corner(t[2])?]);
        }
        triangles.write(step.start, &renumbered)?;
        context.progress.advance(renumbered.len() as u64);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_extmem::{BufferWriter, Store};
    use chpm_extmem::{Cancel, Silent};

    fn column<T: bytemuck::Pod>(store: &Store, items: &[T]) -> Column<T> {
        let mut writer = BufferWriter::new(store, "items", items.len()).unwrap();
        writer.extend_from_slice(items).unwrap();
        writer.finish_column().unwrap()
    }

    #[test]
    fn vertices_close_together_and_far_apart_get_their_numbers() {
        const VERTICES: u32 = 2 * WINDOW as u32 + 1000;
        let parent = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let store = Store::create(parent.path(), 0).unwrap();
        let context = Context::new(store, pool, &Silent, Cancel::default());
        let numbers: Vec<u32> = (0..VERTICES).map(|v| v.wrapping_mul(0x9e37_79b9)).collect();
        let mapping = column(&context.store, &numbers);
        assert!(mapping.is_on_disk());
        // Steps in turn: close together, anywhere, and neighbours with one stray in a thousand; the last step is short.
        let triangle = |i: u32| match i / STEP as u32 % 3 {
            0 => [i, i + 1, i + WINDOW as u32 / 2],
            1 => [0, 1, 2].map(|k| (3 * i + k).wrapping_mul(0x85eb_ca6b) % VERTICES),
            _ => [i, i + 1, if i % 1000 == 7 { VERTICES - 1 } else { i + 2 }],
        };
        let all: Vec<[u32; 3]> = (0..5 * STEP as u32 + 77).map(triangle).collect();
        let mut triangles = column(&context.store, &all);
        context.pool.install(|| run(&mut triangles, &mapping, &context)).unwrap();
        let expected: Vec<[u32; 3]> = all.iter().map(|t| t.map(|v| numbers[v as usize])).collect();
        assert!(triangles.read(0..all.len(), &mut Vec::new()).unwrap() == expected);
    }
}
