//! Errors of the root found anew: its progressive mesh is held against a mesh of the whole source that is finer, so that what errors of many levels add up to
//! is not what is stored.

use super::group::GroupTask;
use crate::error::BuildError;
use chpm_format::Page;
use chpm_qem::{Collapse, Course, Displacement, DroppedComponent, Record, Reference, tightened};

/// Levels below the root of which one's base meshes are what it is held against.
pub(super) const BELOW: u32 = 6;

/// Most triangles of the root: more are where clusters stalled, and would not fit into the memory of a thread.
const MOST: usize = 1 << 14;
/// Most triangles of what it is held against, and as a share of the source's.
const MOST_BELOW: u64 = 1 << 15;
const SHARE_BELOW: u64 = 16;

/// Components that have vanished below the root and in its own progressive mesh, and the error from which on the latter are missing.
pub(super) struct Missing<'a> {
    pub(super) below: &'a [DroppedComponent],
    pub(super) own: &'a [DroppedComponent],
    pub(super) from: f32,
}

/// Lowers the errors of a root's record; answers from which error on its own components are missing then.
pub(super) fn lower(
    task: &GroupTask<'_>,
    root: u32,
    finest: (&[[f32; 3]], &[[u16; 3]]),
    record: &mut Record,
    missing: &Missing<'_>,
) -> Result<f32, BuildError> {
    let (positions, triangles) = finest;
    if triangles.len() > MOST || record.errors.is_empty() {
        return Ok(missing.from);
    }
    let Some(reference) = reference(task, root)? else { return Ok(missing.from) };

    let base = record.base_vertex_count();
    let in_order = record.targets.iter().zip(&record.errors).enumerate().rev();
    let collapses: Vec<Collapse> = in_order
        .map(|(index, (to, error))| Collapse { from: (base + index) as u16, to: *to, error: *error })
        .collect();
    let course = Course {
        positions,
        triangles,
        collapses: &collapses,
        dropped_below: missing.below,
        dropped: missing.own,
        vanishing: missing.from,
    };
    let errors = tightened(&course, &reference);
    let first = collapses.iter().position(|collapse| collapse.error >= missing.from);
    record.errors.iter_mut().zip(errors.iter().rev()).for_each(|(stored, error)| *stored = *error);
    Ok(first.map_or(missing.from, |first| errors[first]))
}

/// The mesh of the whole source that the root is held against; none where all that there are have too many triangles.
fn reference(task: &GroupTask<'_>, root: u32) -> Result<Option<Reference>, BuildError> {
    let top = task.tree.nodes[root as usize].level;
    let source = task.decomposition.triangle_count();
    let most = MOST_BELOW.min(source / SHARE_BELOW);
    // The finest that is small enough.
    let found = (top.saturating_sub(BELOW)..top).find_map(|level| {
        let front = front(task, root, Some(level));
        (front.iter().map(|node| count(task, *node, Some(level))).sum::<u64>() <= most).then_some((level, front))
    });
    let Some((level, front)) = found else { return Ok(None) };
    let level = Some(level);

    let mut reference = Reference::default();
    let (mut page, mut triangles, mut displacements) = (Vec::new(), Vec::new(), Vec::new());
    for node in front {
        if level.is_none() {
            let leaf = task.decomposition.read_leaf(node, &mut page)?;
            let error = task.decomposition.rounding.error();
            let each = leaf.page.triangles.iter().map(|triangle| (*triangle, error));
            reference.add(leaf.page.vertices.positions, each);
            continue;
        }

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

/// Clusters that are all of the source together: those of a level, or below it where there is none; leaves if there is no level.
fn front(task: &GroupTask<'_>, root: u32, level: Option<u32>) -> Vec<u32> {
    let (mut front, mut stack) = (Vec::new(), vec![root]);
    while let Some(node) = stack.pop() {
        let Some(children) = task.tree.nodes[node as usize].children else {
            front.push(node);
            continue;
        };
        if level.is_some_and(|level| task.tree.nodes[node as usize].level <= level) {
            front.push(node);
        } else {
            stack.extend([children[1], children[0]]);
        }
    }
    front
}

/// Triangles of a cluster of the front.
fn count(task: &GroupTask<'_>, node: u32, level: Option<u32>) -> u64 {
    match (level, task.refs[node as usize]) {
        (Some(_), Some(found)) => found.base_triangle_count.into(),
        _ => task.decomposition.leaves[node as usize].triangle_count.into(),
    }
}
