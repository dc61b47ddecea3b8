//! The cluster tree: leaves first, then inner nodes level by level.

use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use chpm_partition::{CsrGraph, rebalance_bisection};
use serde::{Deserialize, Serialize};

/// A node of the tree.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(crate) struct Node {
    pub(crate) level: u32,
    pub(crate) parent: Option<u32>,
    /// Two children, or none for a leaf; but see [`Tree::children`].
    pub(crate) children: Option<[u32; 2]>,
}

/// A binary tree over the leaf clusters; the last node is the root.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Tree {
    /// Leaves in their order, then inner nodes by level.
    pub(crate) nodes: Vec<Node>,
    /// The root's children where they are more than two.
    top: Vec<u32>,
}

impl Tree {
    /// Bisects the graph until single leaves are left. No part may hold more leaves than the height that is left for it
    /// allows, so the tree is as low as a tree can be.
    pub(crate) fn build(
        graph: &CsrGraph,
        settings: &Settings,
        context: &Context<'_>,
    ) -> Result<Self, BuildError> {
        let leaf_count = graph.node_count();
        let mut nodes = vec![Node { level: 0, parent: None, children: None }; leaf_count];
        let members: Vec<u32> = (0..leaf_count as u32).collect();
        nodes.extend(split(graph, &members, leaf_count as u32, settings, context)?.1);
        Ok(Tree::of_unsorted(nodes, leaf_count))
    }

    /// The tree of leaves and inner nodes, children before their parents, none of which is linked.
    pub(super) fn of_unsorted(nodes: Vec<Node>, leaf_count: usize) -> Self {
        let mut tree = Tree::new(nodes);
        tree.sort_by_level(leaf_count);
        tree
    }

    pub(crate) fn new(nodes: Vec<Node>) -> Self {
        Tree { nodes, top: Vec::new() }
    }

    /// The children of a node: two, for the root perhaps more, or none for a leaf.
    pub(crate) fn children(&self, node: u32) -> &[u32] {
        match &self.nodes[node as usize].children {
            Some(_) if self.is_root(node) && !self.top.is_empty() => &self.top,
            Some(pair) => pair,
            None => &[],
        }
    }

    pub(crate) fn is_root(&self, node: u32) -> bool {
        node as usize + 1 == self.nodes.len()
    }

    /// The nodes below a level that are all of the leaves together, ascending.
    pub(crate) fn front_below(&self, level: u32) -> Vec<u32> {
        let first = self.level(level).start as u32;
        let inner = self.nodes[first as usize..].iter();
        let mut front: Vec<u32> =
            inner.filter_map(|node| node.children).flatten().filter(|child| *child < first).collect();
        front.sort_unstable();
        front
    }

    /// Takes the inner nodes over `front` away but for the root, whose children they become; answers which these were.
    pub(crate) fn raise(&mut self, front: Vec<u32>) -> std::ops::Range<usize> {
        let below = front.iter().map(|node| self.nodes[*node as usize].level).max().unwrap_or(0);
        let between = self.level(below).end..self.nodes.len() - 1;
        self.nodes.drain(between.clone());
        let root = self.nodes.len() as u32 - 1;
        self.nodes[root as usize].level = below + 1;
        front.iter().for_each(|node| self.nodes[*node as usize].parent = Some(root));
        self.top = front;
        between
    }

    /// Brings the inner nodes, which came in post-order, into order of level, and links parents.
    fn sort_by_level(&mut self, leaf_count: usize) {
        let mut order: Vec<u32> = (0..self.nodes.len() as u32).collect();
        order[leaf_count..].sort_by_key(|n| self.nodes[*n as usize].level);
        let mut old_to_new = vec![0; order.len()];
        for (new, old) in order.iter().enumerate() {
            old_to_new[*old as usize] = new as u32;
        }
        self.nodes = order.iter().map(|old| self.nodes[*old as usize]).collect();
        for new in 0..self.nodes.len() {
            if let Some(children) = &mut self.nodes[new].children {
                *children = children.map(|c| old_to_new[c as usize]);
                for child in *children {
                    self.nodes[child as usize].parent = Some(new as u32);
                }
            }
        }
    }

    /// Number of levels.
    pub(crate) fn level_count(&self) -> u32 {
        self.nodes.last().map_or(0, |root| root.level + 1)
    }

    /// The nodes of a level.
    pub(crate) fn level(&self, level: u32) -> std::ops::Range<usize> {
        self.nodes.partition_point(|n| n.level < level)..self.nodes.partition_point(|n| n.level <= level)
    }

    /// The level of the lowest node above all of the given leaves.
    pub(crate) fn merge_level(&self, leaves: &[u32]) -> u8 {
        let mut meet = leaves[0];
        for &leaf in &leaves[1..] {
            let mut other = leaf;
            // Node numbers rise towards the root, so the lower number is never above the other.
            while meet != other {
                let lower = meet.min(other);
                let Some(parent) = self.nodes[lower as usize].parent else { break };
                if meet < other { meet = parent } else { other = parent }
            }
        }
        self.nodes[meet as usize].level as u8
    }
}

/// The root of the subtree over `members`, and its inner nodes in post-order: they are numbered from `leaf_count` on, and no parent is linked.
/// Both halves are worked on side by side.
pub(super) fn split(
    graph: &CsrGraph,
    members: &[u32],
    leaf_count: u32,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<(u32, Vec<Node>), BuildError> {
    if let [leaf] = members {
        return Ok((*leaf, Vec::new()));
    }
    context.check()?;
    let sides = bisect(graph, members.len(), settings)?;
    let phase = context.trace.phase();
    let half = |side: u8| {
        let _traced = phase.task("half");
        let chosen: Vec<u32> = (0..members.len() as u32).filter(|i| sides[*i as usize] == side).collect();
        let below: Vec<u32> = chosen.iter().map(|i| members[*i as usize]).collect();
        let half = split(&graph.subgraph(&chosen), &below, leaf_count, settings, context)?;
        context.progress.advance(u64::from(below.len() == 1));
        Ok::<_, BuildError>(half)
    };
    let (first, second) = rayon::join(|| half(0), || half(1));
    let ((first, mut nodes), (second, others)) = (first?, second?);

    let second = append(&mut nodes, (second, others), leaf_count);
    Ok((join(&mut nodes, [first, second], leaf_count), nodes))
}

/// Appends a subtree's inner nodes to others; answers which its root is there.
pub(super) fn append(nodes: &mut Vec<Node>, (root, others): (u32, Vec<Node>), leaf_count: u32) -> u32 {
    let before = nodes.len() as u32;
    let moved = |node: u32| if node < leaf_count { node } else { node + before };
    nodes.extend(
        others.into_iter().map(|node| Node { children: node.children.map(|pair| pair.map(moved)), ..node }),
    );
    moved(root)
}

/// Appends the parent of two nodes to the inner nodes; answers which it is.
pub(super) fn join(nodes: &mut Vec<Node>, children: [u32; 2], leaf_count: u32) -> u32 {
    let level = |node: u32| node.checked_sub(leaf_count).map_or(0, |inner| nodes[inner as usize].level);
    let level = 1 + level(children[0]).max(level(children[1]));
    nodes.push(Node { level, parent: None, children: Some(children) });
    leaf_count + nodes.len() as u32 - 1
}

/// Sides of the `count` nodes of `graph`, both fitting a tree of the least height.
fn bisect(graph: &CsrGraph, count: usize, settings: &Settings) -> Result<Vec<u8>, BuildError> {
    if count == 2 {
        return Ok(vec![0, 1]);
    }
    let most = count.next_power_of_two() / 2;
    let parts = settings.partitioner.bisect(graph, [0.5, 0.5], settings.seed)?.parts;
    let mut side: Vec<u8> = parts.into_iter().map(|p| p as u8).collect();
    rebalance_bisection(graph, &mut side, [most, most])?;
    Ok(side)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merge_levels_are_those_of_common_ancestors() {
        let leaf = |parent| Node { level: 0, parent: Some(parent), children: None };
        let inner = |level, parent, children| Node { level, parent, children: Some(children) };
        let nodes = vec![
            leaf(4),
            leaf(4),
            leaf(5),
            leaf(5),
            inner(1, Some(6), [0, 1]),
            inner(1, Some(6), [2, 3]),
            inner(2, None, [4, 5]),
        ];
        let tree = Tree::new(nodes);
        assert_eq!(tree.merge_level(&[0, 1]), 1);
        assert_eq!(tree.merge_level(&[2, 3]), 1);
        assert_eq!(tree.merge_level(&[1, 2]), 2);
        assert_eq!(tree.merge_level(&[0, 1, 3]), 2);
        assert_eq!((tree.level(0), tree.level(1), tree.level(2)), (0..4, 4..6, 6..7));
        assert_eq!(
            (tree.children(6), tree.children(4), tree.children(1)),
            (&[4, 5][..], &[0, 1][..], &[][..])
        );

        // The same without what is between.
        let mut raised = tree.clone();
        assert_eq!((tree.front_below(2), tree.front_below(1)), (vec![4, 5], vec![0, 1, 2, 3]));
        assert_eq!(raised.raise(tree.front_below(1)), 4..6);
        assert_eq!((raised.nodes.len(), raised.level_count()), (5, 2));
        assert_eq!((raised.children(4), raised.children(3)), (&[0, 1, 2, 3][..], &[][..]));
        assert!((0..4).all(|leaf| raised.nodes[leaf].parent == Some(4)));
        assert_eq!(tree.level_count(), 3);
    }
}
