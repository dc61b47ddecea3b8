//! Order of the clusters in the file (Yoon 7.2).
//!
//! A tree of n nodes is cut into a root cluster of `ceil(sqrt(n + 1))` nodes, those most likely to be visited, and the subtrees
//! below it; the root cluster comes first, then the subtrees in cache-oblivious order of their neighbourhood, and each piece is
//! laid out in the same way. Here a "cluster" of Yoon is a set of nodes, each of which is a cluster of the model.

use super::multilevel::{Graph, Multilevel};
use crate::decompose::nearest_pairs;
use crate::hierarchy::Tree;
use chpm_mesh::Aabb;
use std::collections::BinaryHeap;

/// Nearest subtrees that a subtree is tied to.
const NEIGHBORS: u32 = 6;

/// All nodes of the tree for which `bounds` answers, in the order of the file. A built node's children are built.
pub(super) fn order(tree: &Tree, bounds: impl Fn(u32) -> Option<Aabb>) -> Vec<u32> {
    let count = tree.nodes.len();
    let mut layout = Layout {
        tree,
        centers: vec![[0.0; 3]; count],
        leaves: vec![0; count],
        piece: vec![0; count],
        next_piece: 1,
        out: Vec::with_capacity(count),
        multilevel: Multilevel::default(),
    };

    let bounds: Vec<Option<Aabb>> = (0..count as u32).map(bounds).collect();
    for (node, aabb) in bounds.iter().enumerate() {
        let center = aabb.map_or([0.0; 3], |b| b.center().coords.map(|x| x as f32).into());
        layout.centers[node] = center;
        let below = tree.children(node as u32).iter().map(|child| layout.leaves[*child as usize]);
        layout.leaves[node] = below.sum::<u32>().max(1);
    }

    fn built(node: u32, bounds: &[Option<Aabb>]) -> bool {
        bounds[node as usize].is_some()
    }
    let roots: Vec<u32> = (0..count as u32)
        .rev()
        .filter(|node| {
            built(*node, &bounds) && tree.nodes[*node as usize].parent.is_none_or(|p| !built(p, &bounds))
        })
        .collect();
    for root in layout.neighbors_first(roots) {
        layout.place(root, 0);
    }
    layout.out
}

struct Layout<'a> {
    tree: &'a Tree,
    centers: Vec<[f32; 3]>,
    /// Leaves below a node: how likely it is visited, up to a factor (Yoon 7.2.2).
    leaves: Vec<u32>,
    /// The piece that a node belongs to. A piece is a connected part of the tree that is laid out in one go.
    piece: Vec<u32>,
    next_piece: u32,
    out: Vec<u32>,
    multilevel: Multilevel,
}

impl Layout<'_> {
    fn children(&self, node: u32, piece: u32) -> impl Iterator<Item = u32> + use<'_> {
        let children = self.tree.children(node).iter().copied();
        children.filter(move |c| self.piece[*c as usize] == piece)
    }

    /// Lays out what of `piece` lies at and below `root`.
    fn place(&mut self, root: u32, piece: u32) {
        let mut nodes = vec![root];
        let mut next = 0;
        while let Some(node) = nodes.get(next).copied() {
            nodes.extend(self.children(node, piece));
            next += 1;
        }
        if nodes.len() <= 3 {
            self.out.extend(nodes);
            return;
        }
        let wanted = ((nodes.len() + 1) as f64).sqrt().ceil() as usize;
        let top = self.next_piece;
        self.next_piece += 1;
        // Likeliest first; among equals the one nearer to the root, which has the larger number.
        let mut frontier = BinaryHeap::from([(self.leaves[root as usize], root)]);
        for _ in 0..wanted {
            let Some((_, node)) = frontier.pop() else { break };
            frontier.extend(self.children(node, piece).map(|c| (self.leaves[c as usize], c)));
            self.piece[node as usize] = top;
        }
        let mut below: Vec<u32> = frontier.into_iter().map(|(_, node)| node).collect();
        below.sort_unstable();
        self.place(root, top);
        for subtree in self.neighbors_first(below) {
            self.place(subtree, piece);
        }
    }

    /// The nodes in cache-oblivious order of the graph of their nearest neighbours.
    fn neighbors_first(&mut self, nodes: Vec<u32>) -> Vec<u32> {
        if nodes.len() <= 2 {
            return nodes;
        }
        let centers: Vec<[f32; 3]> = nodes.iter().map(|n| self.centers[*n as usize]).collect();
        let pairs = nearest_pairs(&centers, NEIGHBORS, |_| true);
        let mut graph = Graph::default();
        graph.fill(nodes.len(), pairs.iter().map(|p| (p.0, p.1)), &mut Vec::new());
        self.multilevel.order(&mut graph).iter().map(|i| nodes[*i as usize]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hierarchy::Node;

    #[test]
    fn every_node_is_placed_once_and_the_root_first() {
        // A complete tree of 64 leaves, numbered level by level from the leaves up.
        let mut nodes: Vec<Node> = vec![Node { level: 0, parent: None, children: None }; 64];
        let (mut first, mut count, mut level) = (0, 64, 0);
        while count > 1 {
            level += 1;
            for i in 0..count / 2 {
                let parent = nodes.len() as u32;
                let children = [first + 2 * i, first + 2 * i + 1];
                children.iter().for_each(|c| nodes[*c as usize].parent = Some(parent));
                nodes.push(Node { level, parent: None, children: Some(children) });
            }
            first += count;
            count /= 2;
        }
        let tree = Tree::new(nodes);
        let place = |n: u32| Some(Aabb::of_points(&[[(n % 8) as f32, (n / 8) as f32, 0.0]]));
        let order = order(&tree, place);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..127));
        assert_eq!(order[0], 126);
        // Parents come before their children within the root cluster of twelve.
        let at = |n: u32| order.iter().position(|m| *m == n);
        assert!(at(125) < Some(12) && at(124) < Some(12));
    }
}
