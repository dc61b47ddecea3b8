//! A binary tree of boxes, searched from near to far.

use crate::parting::Parting;
use chpm_mesh::Aabb;
use nalgebra::Point3;

/// A hierarchy of boxes over items that have one each; the items themselves are elsewhere.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
    nodes: Vec<Node>,
    /// By node, what tells its children apart where their boxes do not; empty where few need it.
    partings: Vec<Option<Parting>>,
    /// Items in the order of the leaves.
    order: Vec<u32>,
}

/// A leaf has places `first..first + count`; an inner node has none, its children are the next node and `first`.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    /// No item below is asked for from farther away.
    reach: f32,
    first: u32,
    count: u32,
}

const LEAF: usize = 4;
/// Below so many items a parting is looked for only under another one: those of ordinary surfaces cost more than they spare.
const PARTABLE: usize = 4 * LEAF;
/// Items are split off unevenly only if they are at least this part of all.
const LEAST_SHARE: usize = 16;
/// Beyond this depth nodes are halved, so that no tree is deeper.
const DEEPEST: u32 = 44;
/// Where less than one node in so many has a parting, none is kept: boxes do for such a tree.
const FEW: usize = 64;

impl BoxTree {
    /// Builds over items `0..boxes.len()`; medians along the longest axis of the boxes' middles, ties by index.
    pub fn new(boxes: &[Aabb]) -> Self {
        BoxTree::reaching(boxes, |_| f64::INFINITY)
    }

    /// As [`BoxTree::new`], of items that each matter up to a distance of their own: a search does not come to those that are
    /// farther away than that, but for neighbours in the tree.
    pub fn reaching(boxes: &[Aabb], reach: impl Fn(usize) -> f64) -> Self {
        BoxTree::build(boxes, reach, |_, _| None)
    }

    /// As [`BoxTree::new`], over the boxes of triangles, and with what tells those apart that have their boxes in one another.
    pub fn of_triangles(triangles: &[[[f32; 3]; 3]]) -> Self {
        let boxes: Vec<Aabb> = triangles.iter().map(Aabb::of_points).collect();
        BoxTree::parted(&boxes, |between, sets| {
            Parting::find(triangles[between], Parting::corners_of(triangles, sets))
        })
    }

    /// As [`BoxTree::new`]; `part` looks for what tells two sets of items apart, given the first of the second set.
    pub(crate) fn parted(boxes: &[Aabb], part: impl Fn(usize, [&[u32]; 2]) -> Option<Parting>) -> Self {
        BoxTree::build(boxes, |_| f64::INFINITY, part)
    }

    fn build(
        boxes: &[Aabb],
        reach: impl Fn(usize) -> f64,
        part: impl Fn(usize, [&[u32]; 2]) -> Option<Parting>,
    ) -> Self {
        let middles = boxes.iter().map(|b| b.center().coords.into()).collect();
        let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
        let mut builder = Builder { boxes, middles, reach, part, tree: BoxTree::default() };
        if !order.is_empty() {
            let bounds = builder.bounds(&order);
            builder.build(&mut order, 0, bounds, false, 0);
        }
        let mut tree = BoxTree { order, ..builder.tree };
        if tree.partings.iter().flatten().count() * FEW < tree.nodes.len() {
            tree.partings = Vec::new();
        }
        tree
    }

    /// Items in the order of the leaves: a place is an index into it.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// What tells the two halves apart where their boxes do not.
    pub(crate) fn halves(&self) -> Option<Parting> {
        self.partings.first().copied().flatten()
    }

    /// Bytes of memory.
    pub fn len_bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.partings[..]) + size_of_val(&self.order[..])
    }

    /// Calls `visit` with the place of every item whose box may be nearer than the square root of `best`, near boxes first; `visit`
    /// lowers `best` as it finds something.
    pub fn search(&self, point: Point3<f64>, best: &mut f64, visit: impl FnMut(usize, &mut f64)) {
        self.walk::<false>(point, best, visit);
    }

    /// As [`BoxTree::search`], in a tree of triangles: past those that lie askew in boxes that hold the point.
    pub fn search_triangles(&self, point: Point3<f64>, best: &mut f64, visit: impl FnMut(usize, &mut f64)) {
        // Measuring spends its time here, and ordinary surfaces have no partings.
        if self.partings.is_empty() {
            self.walk::<false>(point, best, visit);
        } else {
            self.walk::<true>(point, best, visit);
        }
    }

    fn walk<const PARTED: bool>(
        &self,
        point: Point3<f64>,
        best: &mut f64,
        mut visit: impl FnMut(usize, &mut f64),
    ) {
        // A node leaves one entry behind.
        let mut stack = [(0.0, 0); DEEPEST as usize + 4];
        let mut len = usize::from(!self.nodes.is_empty());
        while len > 0 {
            len -= 1;
            let (bound, index) = stack[len];
            let node = self.nodes[index];
            let reach = f64::from(node.reach);
            if bound >= *best || bound > reach * reach {
                continue;
            }
            if node.count > 0 {
                (node.first..node.first + node.count).for_each(|place| visit(place as usize, best));
                continue;
            }
            let child = |c: usize| (squared_distance_to_box(point, &self.nodes[c].bounds), c);
            let (mut left, mut right) = (child(index + 1), child(node.first as usize));
            if PARTED && let Some(parting) = &self.partings[index] {
                let [low, high] = parting.squared_distances(point);
                (left.0, right.0) = (left.0.max(low), right.0.max(high));
            }
            let (near, far) = if right.0 < left.0 { (right, left) } else { (left, right) };
            stack[len] = far;
            stack[len + 1] = near;
            len += 2;
        }
    }

    /// Calls `visit` with the place of every item that may reach `point`.
    pub fn for_each_reaching(&self, point: Point3<f64>, mut visit: impl FnMut(usize)) {
        let mut everything = f64::INFINITY;
        self.search(point, &mut everything, |place, _| visit(place));
    }
}

/// Where items are split: at a place in their order by a coordinate.
struct Half {
    at: usize,
    axis: usize,
}

/// Two sets of items.
struct Split {
    boxes: [Aabb; 2],
    parting: Option<Parting>,
    is_in_one_another: bool,
}

/// What a tree is built of.
struct Builder<'a, F, P> {
    boxes: &'a [Aabb],
    middles: Vec<[f64; 3]>,
    reach: F,
    part: P,
    tree: BoxTree,
}

impl<F: Fn(usize) -> f64, P: Fn(usize, [&[u32]; 2]) -> Option<Parting>> Builder<'_, F, P> {
    /// Adds the nodes of items in a box; `parted` is whether those above have a parting.
    fn build(&mut self, items: &mut [u32], first: usize, bounds: Aabb, parted: bool, depth: u32) {
        let farthest = items.iter().map(|&i| (self.reach)(i as usize)).fold(0.0, f64::max);
        // One step up, or more where it was rounded down, so that a box at exactly the distance is not missed.
        let reach = (farthest as f32).next_up().next_up();
        let node = self.tree.nodes.len();
        self.tree.nodes.push(Node { bounds, reach, first: first as u32, count: items.len() as u32 });
        self.tree.partings.push(None);
        if items.len() <= LEAF {
            return;
        }
        let mut extent = [(f64::INFINITY, f64::NEG_INFINITY); 3];
        for middle in items.iter().map(|&i| self.middles[i as usize]) {
            for (range, c) in extent.iter_mut().zip(middle) {
                *range = (range.0.min(c), range.1.max(c));
            }
        }
        let width = |a: &usize| extent[*a].1 - extent[*a].0;
        let axis = (0..3).max_by(|a, b| width(a).total_cmp(&width(b))).unwrap_or(0);
        let looks = parted || items.len() >= PARTABLE;
        let mut half = Half { at: items.len() / 2, axis };
        let mut split = self.split(items, &half, looks);
        if split.is_in_one_another {
            // Two heaps of different size are told apart between them, not in the middle of the larger one.
            let between = 0.5 * (extent[axis].0 + extent[axis].1);
            let count = items.iter().filter(|i| self.middles[**i as usize][axis] < between).count();
            let is_deep = depth + items.len().ilog2() >= DEEPEST;
            if !is_deep && count.min(items.len() - count) * LEAST_SHARE >= items.len() {
                half.at = count;
                let other = self.split(items, &half, looks);
                if other.is_in_one_another {
                    half.at = items.len() / 2;
                    split = self.split(items, &half, looks);
                } else {
                    split = other;
                }
            }
        }
        let (low, high) = items.split_at_mut(half.at);
        let is_parted = split.parting.is_some();
        self.tree.partings[node] = split.parting;
        self.build(low, first, split.boxes[0], is_parted, depth + 1);
        let right = self.tree.nodes.len() as u32;
        self.build(high, first + half.at, split.boxes[1], is_parted, depth + 1);
        self.tree.nodes[node] = Node { bounds, reach, first: right, count: 0 };
    }

    /// Puts those before a place, by the coordinate of their middles, in front of the others.
    fn split(&self, items: &mut [u32], half: &Half, looks: bool) -> Split {
        items.select_nth_unstable_by(half.at, |&a, &b| {
            let [x, y] = [a, b].map(|i| self.middles[i as usize][half.axis]);
            x.total_cmp(&y).then(a.cmp(&b))
        });
        let (low, high) = items.split_at(half.at);
        let boxes = [self.bounds(low), self.bounds(high)];
        let is_needed = looks && Parting::is_needed([&boxes[0], &boxes[1]]);
        let parting = is_needed.then(|| (self.part)(high[0] as usize, [low, high])).flatten();
        Split { boxes, parting, is_in_one_another: is_needed && parting.is_none() }
    }

    fn bounds(&self, items: &[u32]) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        items.iter().for_each(|&i| bounds.merge(&self.boxes[i as usize]));
        bounds
    }
}

/// Squared distance from a point to a box; 0 inside.
pub fn squared_distance_to_box(point: Point3<f64>, bounds: &Aabb) -> f64 {
    let excess = |a: usize| {
        let (low, high) = (f64::from(bounds.min[a]), f64::from(bounds.max[a]));
        (low - point[a]).max(point[a] - high).max(0.0)
    };
    let (x, y, z) = (excess(0), excess(1), excess(2));
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_as_far_as_its_nearest_corner_side_or_inside() {
        let unit = Aabb { min: [0.0; 3], max: [1.0; 3] };
        for (point, expected) in
            [([0.5; 3], 0.0), ([2.0, 0.5, 0.5], 1.0), ([2.0, 3.0, -1.0], 6.0), ([1.0; 3], 0.0)]
        {
            assert_eq!(squared_distance_to_box(point.into(), &unit), expected, "{point:?}");
        }
    }

    #[test]
    fn near_items_are_visited_and_far_ones_are_not() {
        let boxes: Vec<Aabb> =
            (0..100).map(|i| Aabb { min: [i as f32, 0.0, 0.0], max: [i as f32 + 0.5, 1.0, 1.0] }).collect();
        let tree = BoxTree::reaching(&boxes, |i| if i == 7 { 33.0 } else { 0.25 });
        let mut near = Vec::new();
        tree.for_each_reaching([42.75, 0.5, 0.5].into(), |place| near.push(tree.order()[place]));
        assert!(near.contains(&42) && near.contains(&43) && !near.contains(&7), "{near:?}");
        // Whole leaves are handed over, and those beside them are not; one that reaches far brings nobody from elsewhere.
        assert!(near.len() <= 2 * LEAF, "{near:?}");
        let mut far = Vec::new();
        tree.for_each_reaching([40.4, 0.5, 0.5].into(), |place| far.push(tree.order()[place]));
        assert!(far.contains(&7) && far.contains(&40) && far.len() <= 2 * LEAF, "{far:?}");
        let tree = BoxTree::new(&boxes);
        let mut visits = 0;
        let mut best = f64::INFINITY;
        tree.search([7.2, 0.5, 0.5].into(), &mut best, |place, best| {
            visits += 1;
            let bounds = &boxes[tree.order()[place] as usize];
            *best = best.min(squared_distance_to_box([7.2, 0.5, 0.5].into(), bounds));
        });
        assert_eq!(best, 0.0);
        assert!(visits <= LEAF, "{visits}");
        BoxTree::new(&[]).search([0.0; 3].into(), &mut best, |_, _| panic!("there is nothing"));
    }
}
