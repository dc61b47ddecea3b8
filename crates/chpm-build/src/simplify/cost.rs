//! Memory that simplifying a group takes, known before it begins: so many bytes for each triangle and vertex of its members.

use super::Clusters;
use crate::allowance::THREAD;
use crate::decompose::Decomposition;
use crate::hierarchy::Tree;

/// Bytes for each triangle and vertex of a member that is held while its group is worked on.
const TRIANGLE: u64 = 96;
const VERTEX: u64 = 80;
/// Bytes for each triangle and vertex of the one mesh that the kernel works on, and that is put in order.
const KERNEL_TRIANGLE: u64 = 192;
const KERNEL_VERTEX: u64 = 224;
/// Times that the words of a vertex's scalars are held in a member, and in the pages that are read and written beside it.
const SCALARS: u64 = 3;

/// Most that the members of a group of several may take together. Usual ones take a quarter of it.
pub(super) const GROUP: u64 = 24 << 20;

/// Triangles and vertices of a node's finest mesh, at most.
fn counts(node: u32, tree: &Tree, decomposition: &Decomposition, built: &Clusters) -> (u64, u64) {
    match built.children(tree, node) {
        [] => {
            let leaf = &decomposition.leaves[node as usize];
            (leaf.triangle_count.into(), leaf.vertex_count.into())
        }
        children => built.base_counts(children),
    }
}

/// Triangles of a node's finest mesh, at most.
pub(super) fn triangles(node: u32, tree: &Tree, decomposition: &Decomposition, built: &Clusters) -> u64 {
    counts(node, tree, decomposition, built).0
}

/// Bytes of one member, but for its named scalars: groups are formed alike with them and without.
pub(super) fn member(node: u32, tree: &Tree, decomposition: &Decomposition, built: &Clusters) -> u64 {
    let (triangles, vertices) = counts(node, tree, decomposition, built);
    TRIANGLE * triangles + VERTEX * vertices
}

/// Bytes that a group takes beyond what every thread has.
pub(super) fn beyond_usual(
    group: &[u32],
    tree: &Tree,
    decomposition: &Decomposition,
    built: &Clusters,
) -> u64 {
    let scalars = SCALARS * size_of::<u32>() as u64 * u64::from(decomposition.scalar_words);
    let bytes = |node: &u32, triangle: u64, vertex: u64| {
        let (triangles, vertices) = counts(*node, tree, decomposition, built);
        triangle * triangles + (vertex + scalars) * vertices
    };
    let members: u64 = group.iter().map(|node| bytes(node, TRIANGLE, VERTEX)).sum();
    let kernel = group.iter().map(|node| bytes(node, KERNEL_TRIANGLE, KERNEL_VERTEX)).max();
    (members + kernel.unwrap_or(0)).saturating_sub(THREAD)
}
