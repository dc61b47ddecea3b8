//! Errors of the root found anew: its progressive mesh is held against meshes of the whole source that are finer, so that what errors of many levels add up to
//! is not what is stored. Each serves some of its meshes, apart from the others.

use super::group::GroupTask;
use crate::config::Bounds;
use crate::error::BuildError;
use chpm_format::Page;
use chpm_qem::{Collapse, Course, Displacement, Limits, Record, Reference, tightened};
use rayon::prelude::*;

/// Levels below the root of which one's base meshes are what it is held against.
pub(super) const BELOW: u32 = 5;

/// Most triangles of the root: more are where clusters stalled, and would not fit into the memory of a thread.
const MOST: usize = 1 << 14;

/// Most triangles of what a root is held against.
const TIGHT_BELOW: u64 = 48_000;

/// How closely a root is looked at.
struct Look {
    /// Most triangles of what it is held against, and of the coarsest that there is.
    most: u64,
    coarsest: u64,
    /// How many times fewer triangles the next one has.
    shrink: usize,
    limits: Limits,
}

impl Look {
    /// For a model of so many triangles.
    fn new(bounds: Bounds, source: u64) -> Self {
        match bounds {
            // So that it takes about the same part of a build's time.
            Bounds::Quick => Look {
                most: (source / 100).clamp(4500, 1 << 14).min(source / 16),
                coarsest: 1 << 14,
                shrink: usize::MAX,
                limits: Limits {
                    ratio: if source < 4_000_000 { 12 } else { 6 },
                    next_ratio: 12,
                    pieces: source.clamp(1 << 16, 150_000).max(source / 8),
                },
            },
            Bounds::Tight => Look {
                most: TIGHT_BELOW,
                coarsest: TIGHT_BELOW,
                shrink: 4,
                limits: Limits { ratio: 10, next_ratio: 16, pieces: 600_000 },
            },
        }
    }
}

/// Lowers the errors of a root's record.
pub(super) fn lower(
    task: &GroupTask<'_>,
    root: u32,
    (positions, triangles): (&[[f32; 3]], &[[u16; 3]]),
    record: &mut Record,
) -> Result<(), BuildError> {
    if triangles.len() > MOST || record.errors.is_empty() {
        return Ok(());
    }
    let look = Look::new(task.settings.bounds, task.decomposition.triangle_count());
    let references = references(task, root, &look)?;

    let base = record.base_vertex_count();
    let in_order = record.targets.iter().zip(&record.errors).enumerate().rev();
    let collapses: Vec<Collapse> = in_order
        .map(|(index, (to, error))| Collapse { from: (base + index) as u16, to: *to, error: *error })
        .collect();
    let course = Course { positions, triangles, collapses: &collapses };
    let found: Vec<Vec<f32>> = (0..references.len())
        .into_par_iter()
        .map(|finest| {
            let ratio = if finest == 0 { look.limits.ratio } else { look.limits.next_ratio };
            tightened(&course, &references[finest..], Limits { ratio, ..look.limits })
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
    let top = task.tree.nodes[root as usize].level;
    let mut references: Vec<Reference> = Vec::new();
    for level in top.saturating_sub(BELOW)..top {
        let front = front(task, root, level);
        let count = |node: &u32| task.refs[*node as usize].map(|page| u64::from(page.base_triangle_count));
        let Some(count) = front.iter().map(count).sum::<Option<u64>>() else { continue };
        let most = match references.last() {
            Some(finer) => (finer.triangle_count() / look.shrink) as u64,
            // The coarsest may be larger.
            None if level + 1 == top => look.coarsest,
            None => look.most,
        };
        if count <= most {
            references.extend(reference(task, front)?);
        }
    }
    Ok(references)
}

/// The mesh of clusters that are all of the source together.
fn reference(task: &GroupTask<'_>, front: Vec<u32>) -> Result<Option<Reference>, BuildError> {
    let mut reference = Reference::default();
    let (mut page, mut triangles, mut displacements) = (Vec::new(), Vec::new(), Vec::new());
    for node in front {
        let Some(found) = task.refs[node as usize] else { return Ok(None) };
        let spool = &task.displacements[task.tree.nodes[node as usize].level as usize];
        let count = found.base_triangle_count as usize;
        task.pages.read(found.offset, found.len as usize, &mut page)?;
        spool.read(found.base_triangles, count * size_of::<[u16; 3]>(), &mut triangles)?;
        spool.read(found.displacements, count * size_of::<Displacement>(), &mut displacements)?;

        let each =
            triangles.chunks_exact(size_of::<[u16; 3]>()).map(bytemuck::pod_read_unaligned::<[u16; 3]>);
        let errors = displacements.chunks_exact(size_of::<Displacement>());
        let errors = errors.map(|bytes| bytemuck::pod_read_unaligned::<Displacement>(bytes).error());
        reference.add(Page::view(&page)?.vertices.positions, each.zip(errors));
    }
    reference.join();
    Ok(Some(reference))
}

/// Clusters that are all of the source together: those of a level, or below it where there is none.
fn front(task: &GroupTask<'_>, root: u32, level: u32) -> Vec<u32> {
    let (mut front, mut stack) = (Vec::new(), vec![root]);
    while let Some(node) = stack.pop() {
        let at = &task.tree.nodes[node as usize];
        match at.children.filter(|_| at.level > level) {
            Some([first, second]) => stack.extend([second, first]),
            None => front.push(node),
        }
    }
    front
}
