//! A tree of boxes about triangles, which tells the nearest of many.

use super::target::Target;
use nalgebra::{Point3, Vector3};

/// Most triangles of a leaf.
const LEAF: usize = 4;

#[derive(Debug)]
struct Node {
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// A leaf's triangles in the order; of any other, the second child, and zero: the first follows it.
    from: u32,
    count: u32,
}

/// Boxes about triangles, halved along their longest side.
#[derive(Debug, Default)]
pub(crate) struct BoxTree {
    nodes: Vec<Node>,
    order: Vec<u32>,
    stack: Vec<u32>,
}

impl BoxTree {
    /// Of the given ones among `targets`.
    pub(crate) fn new(targets: &[Target], of: Vec<u32>) -> Self {
        let mut tree = BoxTree { nodes: Vec::new(), order: of, stack: Vec::new() };
        if !tree.order.is_empty() {
            tree.halve(targets, 0, tree.order.len());
        }
        tree
    }

    fn halve(&mut self, targets: &[Target], from: usize, to: usize) {
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for target in &self.order[from..to] {
            let Target { low: least, high: most, .. } = &targets[*target as usize];
            (low, high) = (low.inf(least), high.sup(most));
        }

        let at = self.nodes.len();
        let count = if to - from <= LEAF { (to - from) as u32 } else { 0 };
        self.nodes.push(Node { low, high, from: from as u32, count });
        if count > 0 {
            return;
        }

        let axis = (high - low).imax();
        let key = |t: &u32| targets[*t as usize].low[axis] + targets[*t as usize].high[axis];
        let middle = (from + to) / 2;
        self.order[from..to]
            .select_nth_unstable_by(middle - from, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        self.halve(targets, from, middle);
        self.nodes[at].from = self.nodes.len() as u32;
        self.halve(targets, middle, to);
    }

    /// The triangle nearest to a point, and the square of how far it is, if it is nearer than `best`.
    pub(crate) fn nearest(
        &mut self,
        targets: &[Target],
        point: &Point3<f64>,
        best: (u32, f64),
    ) -> (u32, f64) {
        let mut best = best;
        self.stack.clear();
        if !self.nodes.is_empty() {
            self.stack.push(0);
        }
        while let Some(at) = self.stack.pop() {
            let node = &self.nodes[at as usize];
            if box_squared(node, point) >= best.1 {
                continue;
            }
            if node.count > 0 {
                for target in &self.order[node.from as usize..(node.from + node.count) as usize] {
                    let squared = targets[*target as usize].squared(point);
                    if squared < best.1 {
                        best = (*target, squared);
                    }
                }
                continue;
            }

            // The nearer child first.
            let (a, b) = (at + 1, node.from);
            let [to_a, to_b] = [a, b].map(|child| box_squared(&self.nodes[child as usize], point));
            self.stack.extend(if to_a <= to_b { [b, a] } else { [a, b] });
        }
        best
    }
}

fn box_squared(node: &Node, point: &Point3<f64>) -> f64 {
    let mut sum = 0.0;
    for axis in 0..3 {
        let beyond = (node.low[axis] - point[axis]).max(point[axis] - node.high[axis]).max(0.0);
        sum += beyond * beyond;
    }
    sum
}
