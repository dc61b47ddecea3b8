//! A tree of boxes about triangles, which tells the nearest of many.

use super::target::Target;
use nalgebra::{Point3, Vector3};

/// Most triangles of a leaf.
const LEAF: usize = 4;

/// A box in single precision, so that many are in the cache; it holds all of what it is about.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

impl Bounds {
    fn around(low: &Vector3<f64>, high: &Vector3<f64>) -> Self {
        let up = |value: f64| {
            let nearest = value as f32;
            if f64::from(nearest) < value { nearest.next_up() } else { nearest }
        };
        Bounds { low: [0, 1, 2].map(|axis| -up(-low[axis])), high: [0, 1, 2].map(|axis| up(high[axis])) }
    }

    #[inline]
    fn meets(&self, other: &Bounds) -> bool {
        (0..3).fold(true, |meets, axis| {
            meets & (self.low[axis] <= other.high[axis]) & (other.low[axis] <= self.high[axis])
        })
    }

    /// The square of how far a point is away.
    #[inline]
    fn squared(&self, point: &Point3<f64>) -> f64 {
        (0..3).fold(0.0, |sum, axis| {
            let (low, high) = (f64::from(self.low[axis]), f64::from(self.high[axis]));
            let beyond = (low - point[axis]).max(point[axis] - high).max(0.0);
            sum + beyond * beyond
        })
    }
}

#[derive(Debug)]
struct Node {
    bounds: Bounds,
    /// A leaf's triangles in the order; of any other, the second child, and zero: the first follows it.
    from: u32,
    count: u32,
}

/// Boxes about triangles, halved along their longest side.
#[derive(Debug, Default)]
pub(crate) struct BoxTree {
    nodes: Vec<Node>,
    order: Vec<u32>,
    /// Boxes about each, in this order.
    items: Vec<Bounds>,
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
        let mut tree = BoxTree { nodes: Vec::new(), order: of, items: Vec::new() };
        if !tree.order.is_empty() {
            tree.halve(targets, 0, tree.order.len());
        }
        let items = tree.order.iter().map(|index| &targets[*index as usize]);
        tree.items = items.map(|target| Bounds::around(&target.low, &target.high)).collect();
        tree
    }

    /// The order in which triangles near each other are side by side; once they are in it, it is their own.
    pub(crate) fn take_order(&mut self) -> Vec<u32> {
        let count = self.order.len() as u32;
        std::mem::replace(&mut self.order, (0..count).collect())
    }

    fn halve(&mut self, targets: &[Target], from: usize, to: usize) {
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for target in &self.order[from..to] {
            let Target { low: least, high: most, .. } = &targets[*target as usize];
            (low, high) = (low.inf(least), high.sup(most));
        }

        let at = self.nodes.len();
        let count = if to - from <= LEAF { (to - from) as u32 } else { 0 };
        self.nodes.push(Node { bounds: Bounds::around(&low, &high), from: from as u32, count });
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
        search: &mut Search,
        (low, high): &(Vector3<f64>, Vector3<f64>),
        mut take: impl FnMut(u32),
    ) -> usize {
        let around = Bounds::around(low, high);
        let mut visited = 0;
        search.open.clear();
        if !self.nodes.is_empty() {
            search.open.push((0, 0.0));
        }
        while let Some((at, _)) = search.open.pop() {
            let node = &self.nodes[at as usize];
            visited += 1;
            if !around.meets(&node.bounds) {
                continue;
            }
            if node.count == 0 {
                search.open.extend([(node.from, 0.0), (at + 1, 0.0)]);
                continue;
            }
            visited += node.count as usize;
            let leaf = node.from as usize..(node.from + node.count) as usize;
            for (index, bounds) in self.order[leaf.clone()].iter().zip(&self.items[leaf]) {
                if around.meets(bounds) {
                    take(*index);
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
                let leaf = node.from as usize..(node.from + node.count) as usize;
                for (index, bounds) in self.order[leaf.clone()].iter().zip(&self.items[leaf]) {
                    if bounds.squared(point) < best.1 {
                        let squared = targets[*index as usize].squared(point);
                        best = if squared < best.1 { (*index, squared) } else { best };
                    }
                }
                continue;
            }

            // The nearer child first.
            let (a, b) = (at + 1, node.from);
            let [a, b] = [a, b].map(|child| (child, self.nodes[child as usize].bounds.squared(point)));
            search.open.extend(if a.1 <= b.1 { [b, a] } else { [a, b] });
        }
        best
    }
}
