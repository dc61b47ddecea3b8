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
}

/// Scratch of searches.
#[derive(Debug, Default)]
pub(crate) struct Search {
    /// Nodes that are still to be looked at, each with the square of its distance.
    open: Vec<(u32, f64)>,
    /// Nodes that searches for the nearest looked at.
    pub(crate) seen: u64,
}

impl BoxTree {
    /// Of the given ones among `targets`.
    pub(crate) fn new(targets: &[Target], of: Vec<u32>) -> Self {
        let mut tree = BoxTree { nodes: Vec::new(), order: of };
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

    /// Hands over the triangles whose boxes meet the one of these corners; answers how many boxes it looked at.
    pub(crate) fn meeting(
        &self,
        targets: &[Target],
        search: &mut Search,
        (low, high): &(Vector3<f64>, Vector3<f64>),
        mut take: impl FnMut(u32),
    ) -> usize {
        let meets = |other_low: &Vector3<f64>, other_high: &Vector3<f64>| {
            (0..3).all(|axis| low[axis] <= other_high[axis] && other_low[axis] <= high[axis])
        };
        let mut visited = 0;
        search.open.clear();
        if !self.nodes.is_empty() {
            search.open.push((0, 0.0));
        }
        while let Some((at, _)) = search.open.pop() {
            let node = &self.nodes[at as usize];
            visited += 1;
            if !meets(&node.low, &node.high) {
                continue;
            }
            if node.count == 0 {
                search.open.extend([(node.from, 0.0), (at + 1, 0.0)]);
                continue;
            }
            visited += node.count as usize;
            for target in &self.order[node.from as usize..(node.from + node.count) as usize] {
                let Target { low, high, .. } = &targets[*target as usize];
                if meets(low, high) {
                    take(*target);
                }
            }
        }
        visited
    }

    /// The triangle nearest to a point, and the square of how far it is, if it is nearer than `best`; or the first that is found whose square is `enough`.
    pub(crate) fn nearest(
        &self,
        targets: &[Target],
        search: &mut Search,
        point: &Point3<f64>,
        best: (u32, f64),
        enough: f64,
    ) -> (u32, f64) {
        let mut best = best;
        search.open.clear();
        if !self.nodes.is_empty() {
            search.open.push((0, 0.0));
        }
        while let Some((at, squared)) = search.open.pop() {
            if best.1 <= enough {
                break;
            }
            search.seen += 1;
            if squared >= best.1 {
                continue;
            }
            let node = &self.nodes[at as usize];
            if node.count > 0 {
                for index in &self.order[node.from as usize..(node.from + node.count) as usize] {
                    best = targets[*index as usize].nearer(*index, point, best);
                }
                continue;
            }

            // The nearer child first.
            let (a, b) = (at + 1, node.from);
            let [a, b] = [a, b].map(|child| (child, box_squared(&self.nodes[child as usize], point)));
            search.open.extend(if a.1 <= b.1 { [b, a] } else { [a, b] });
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
