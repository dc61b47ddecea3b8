//! Memory that simplifying a group takes, known before it begins: so many bytes for each triangle and vertex of its members.

use super::PageRef;
use crate::allowance::THREAD;
use crate::decompose::Decomposition;
use crate::hierarchy::Tree;

/// Bytes for each triangle and vertex of a member that is held while its group is worked on.
const TRIANGLE: u64 = 96;
const VERTEX: u64 = 80;
/// Bytes for each triangle and vertex of the one mesh that the kernel works on, and that is put in order.
const KERNEL_TRIANGLE: u64 = 192;
const KERNEL_VERTEX: u64 = 224;

/// Most that the members of a group of several may take together. Usual ones take a quarter of it.
pub(super) const GROUP: u64 = 24 << 20;

/// Triangles and vertices of a node's finest mesh, at most.
fn counts(node: u32, tree: &Tree, decomposition: &Decomposition, refs: &[Option<PageRef>]) -> (u64, u64) {
    match tree.nodes[node as usize].children {
        None => {
            let leaf = &decomposition.leaves[node as usize];
            (leaf.triangle_count.into(), leaf.vertex_count.into())
        }
        Some(children) => {
            children.iter().filter_map(|child| refs[*child as usize]).fold((0, 0), |sum, child| {
                (sum.0 + u64::from(child.base_triangle_count), sum.1 + u64::from(child.base_vertex_count))
            })
        }
    }
}

/// Bytes of one member.
pub(super) fn member(node: u32, tree: &Tree, decomposition: &Decomposition, refs: &[Option<PageRef>]) -> u64 {
    let (triangles, vertices) = counts(node, tree, decomposition, refs);
    TRIANGLE * triangles + VERTEX * vertices
}

/// Bytes that a group takes beyond what every thread has.
pub(super) fn beyond_usual(
    group: &[u32],
    tree: &Tree,
    decomposition: &Decomposition,
    refs: &[Option<PageRef>],
) -> u64 {
    let members: u64 = group.iter().map(|node| member(*node, tree, decomposition, refs)).sum();
    let kernel = |node: &u32| {
        let (triangles, vertices) = counts(*node, tree, decomposition, refs);
        KERNEL_TRIANGLE * triangles + KERNEL_VERTEX * vertices
    };
    (members + group.iter().map(kernel).max().unwrap_or(0)).saturating_sub(THREAD)
}
