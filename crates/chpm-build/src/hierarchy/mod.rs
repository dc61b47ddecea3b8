//! Hierarchy: a balanced binary tree over the leaves, by recursive bisection of the cluster graph (Quick-VDR 4.2).
//!
//! Establishes I2: the height is at most `ceil(log2(leaves))`, or one more where each region has a subtree of its own.

mod by_region;
mod cluster_graph;
mod tree;

#[cfg(test)]
pub(crate) use tree::Node;
pub(crate) use tree::Tree;

use crate::config::{Division, Settings};
use crate::context::Context;
use crate::decompose::Decomposition;
use crate::error::BuildError;
use crate::pairs::graph_bytes;

/// Builds the tree, and finds for each interface of shared vertices the level at which the clusters that use it have merged.
pub(crate) fn run(
    decomposition: &Decomposition,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<(Tree, Vec<u8>), BuildError> {
    let tree = match settings.division {
        Division::Graph => {
            let edges = cluster_graph::edges(decomposition);
            let bytes = graph_bytes(edges.len());
            let _share = context.store.budget.reserve_work("the graph of clusters", bytes)?;
            let graph = cluster_graph::build(decomposition, edges)?;
            Tree::build(&graph, settings, context)?
        }
        Division::Cubes => by_region::tree(decomposition, settings, context)?,
    };
    let release = decomposition.shared.interfaces().map(|(users, _)| tree.merge_level(users)).collect();
    Ok((tree, release))
}
