//! Errors of the root found anew: its progressive mesh is held against meshes of the whole source that are finer, so that what errors of many levels add up to
//! is not what is stored. Each serves some of its meshes, apart from the others.

use super::group::GroupTask;
use crate::config::Bounds;
use crate::error::BuildError;
use chpm_format::Page;
use chpm_mesh::Aabb;
use chpm_qem::{Collapse, Course, Displacement, DroppedComponent, Limits, Record, Reference, tightened};
use rayon::prelude::*;

/// Levels below the root of which one's base meshes are what it is held against.
pub(super) const BELOW: u32 = 5;

/// Most triangles of the root: more are where clusters stalled, and would not fit into the memory of a thread.
const MOST: usize = 1 << 15;

/// Most triangles of what a root is held against.
const TIGHT_BELOW: u64 = 100_000;

/// Errors of more than a diagonal by this are not looked at: nobody asks for such.
const WORTH: f64 = 64.0;

/// How closely a root is looked at.
struct Look {
    /// Most triangles of what it is held against, and of the coarsest that there is.
    most: u64,
    coarsest: u64,
    /// How many times fewer triangles the next one has.
    shrink: u64,
    limits: Limits,
    /// Pieces on top of the limit for each triangle of a reference.
    pieces_each: u64,
}

/// Pieces for each triangle of a reference, which scans need 10 to 16 of, and mechanical parts more.
const PIECES_EACH: u64 = 48;

impl Look {
    /// For a model of so many triangles.
    fn new(bounds: Bounds, source: u64) -> Self {
        match bounds {
            // So that it takes about the same part of a build's time.
            Bounds::Quick => Look {
                most: (source / 100).clamp(4500, 1 << 14).min(source / 16),
                coarsest: 1 << 14,
                shrink: u64::MAX,
                limits: Limits {
                    ratio: if source < 4_000_000 { 12 } else { 6 },
                    next_ratio: 12,
                    pieces: source.clamp(1 << 16, 150_000).max(source / 8),
                },
                pieces_each: 0,
            },
            Bounds::Tight => Look {
                most: TIGHT_BELOW,
                coarsest: TIGHT_BELOW,
                shrink: 2,
                limits: Limits { ratio: 8, next_ratio: 24, pieces: 300_000 },
                pieces_each: PIECES_EACH,
            },
        }
    }
}

/// Lowers the errors of a root's record.
pub(super) fn lower(
    task: &GroupTask<'_>,
    root: u32,
    (positions, triangles): (&[[f32; 3]], &[[u16; 3]]),
    (dropped, dropped_before): (&[(usize, DroppedComponent)], &[DroppedComponent]),
    record: &mut Record,
) -> Result<(), BuildError> {
    let Some(first) = record.errors.last() else { return Ok(()) };
    let is_far = WORTH * f64::from(*first) > Aabb::of_points(positions).diagonal();
    if triangles.len() > MOST || is_far {
        return Ok(());
    }
    let look = Look::new(task.settings.bounds, task.decomposition.triangle_count());
    let references = match task.built.children(task.tree, root) {
        // It is all of the source itself.
        [] => vec![source(task, (positions, triangles))],
        _ => references(task, root, &look)?,
    };

    let base = record.base_vertex_count();
    let in_order = (0..record.targets.len()).rev().map(|index| Collapse {
        from: (base + index) as u16,
        to: record.targets[index],
        error: record.errors[index],
    });
    let collapses: Vec<Collapse> = in_order.collect();
    let course = Course { positions, triangles, collapses: &collapses, dropped, dropped_before };
    let found: Vec<Vec<f32>> = (0..references.len())
        .into_par_iter()
        .map(|finest| {
            let ratio = if finest == 0 { look.limits.ratio } else { look.limits.next_ratio };
            let pieces = look.limits.pieces + look.pieces_each * references[finest].triangle_count() as u64;
            tightened(&course, &references[finest..], Limits { ratio, pieces, ..look.limits })
        })
        .collect();

    // Each is a bound.
    for (index, stored) in record.errors.iter_mut().rev().enumerate() {
        *stored = found.iter().fold(*stored, |least, errors| least.min(errors[index]));
    }
    let mut last = 0.0_f32;
    for stored in record.errors.iter_mut().rev() {
        last = last.max(*stored);
        *stored = last;
    }
    Ok(())
}

/// Meshes of the whole source that the root is held against, from the finest on that is small enough; none where all that there are have too many triangles.
fn references(task: &GroupTask<'_>, root: u32, look: &Look) -> Result<Vec<Reference>, BuildError> {
    let mut taken: Vec<(u64, Vec<Part>)> = Vec::new();
    let highest = highest_below(task, root);
    let lowest = task.level.saturating_sub(BELOW);
    let has_source = task.settings.bounds == Bounds::Tight && lowest == 0;
    for level in has_source.then_some(None).into_iter().chain((lowest..=highest).map(Some)) {
        let parts = parts(task, root, level);
        let count = parts.iter().map(|part| part.triangle_count(task)).sum::<u64>();
        let most = match taken.last() {
            Some((finer, _)) => finer / look.shrink,
            // The coarsest may be larger.
            None if level == Some(highest) => look.coarsest,
            None => look.most,
        };
        if count <= most {
            taken.push((count, parts));
        }
    }
    taken.into_par_iter().map(|(_, parts)| reference(task, &parts)).collect()
}

/// A leaf that is all of the source.
fn source(task: &GroupTask<'_>, (positions, triangles): (&[[f32; 3]], &[[u16; 3]])) -> Reference {
    let mut reference = Reference::default();
    let rounding = task.decomposition.rounding.error();
    reference.add(positions, triangles.iter().map(|triangle| (*triangle, rounding)));
    reference.join();
    reference
}

/// The highest level of what a root is made of.
fn highest_below(task: &GroupTask<'_>, root: u32) -> u32 {
    let below =
        task.built.children(task.tree, root).iter().map(|child| task.tree.nodes[*child as usize].level);
    below.max().unwrap_or(0)
}

/// Part of a reference.
#[derive(Clone, Copy)]
enum Part {
    /// A leaf's part of the source.
    Source(u32),
    /// A base mesh.
    Base(u32),
}

impl Part {
    fn triangle_count(self, task: &GroupTask<'_>) -> u64 {
        match self {
            Part::Source(leaf) => task.decomposition.leaves[leaf as usize].triangle_count.into(),
            Part::Base(node) => task.built.page(node).base_triangle_count.into(),
        }
    }
}

/// The mesh of parts that are all of the source together.
fn reference(task: &GroupTask<'_>, parts: &[Part]) -> Result<Reference, BuildError> {
    let mut reference = Reference::default();
    let (mut page, mut triangles, mut displacements) = (Vec::new(), Vec::new(), Vec::new());
    for part in parts {
        let (Part::Source(node) | Part::Base(node)) = *part;
        let found = task.built.page(node);
        task.built.pages.read(found.offset, found.len as usize, &mut page)?;
        let page = Page::view(&page)?;
        let positions = page.vertices.positions;
        if let Part::Source(_) = part {
            let rounding = task.decomposition.rounding.error();
            reference.add(positions, page.triangles.iter().map(|triangle| (*triangle, rounding)));
            continue;
        }
        let spool = &task.displacements[task.tree.nodes[node as usize].level as usize];
        let count = found.base_triangle_count as usize;
        spool.read(found.base_triangles, count * size_of::<[u16; 3]>(), &mut triangles)?;
        spool.read(found.displacements, count * size_of::<Displacement>(), &mut displacements)?;

        let each =
            triangles.chunks_exact(size_of::<[u16; 3]>()).map(bytemuck::pod_read_unaligned::<[u16; 3]>);
        let errors = displacements.chunks_exact(size_of::<Displacement>());
        let errors = errors.map(|bytes| bytemuck::pod_read_unaligned::<Displacement>(bytes).error());
        reference.add(positions, each.zip(errors));
    }
    reference.join();
    Ok(reference)
}

/// Parts that are all of the source together: base meshes of a level, or below it where there is none; without a level the source.
fn parts(task: &GroupTask<'_>, root: u32, level: Option<u32>) -> Vec<Part> {
    let (mut parts, mut stack) = (Vec::new(), task.built.children(task.tree, root).to_vec());
    stack.reverse();
    while let Some(node) = stack.pop() {
        let children = task.built.children(task.tree, node);
        match level {
            Some(level) if task.tree.nodes[node as usize].level <= level => parts.push(Part::Base(node)),
            _ if children.is_empty() => {
                parts.push(if level.is_none() { Part::Source(node) } else { Part::Base(node) })
            }
            _ => stack.extend(children.iter().rev()),
        }
    }
    parts
}
