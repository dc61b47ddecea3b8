//! A tree of boxes, searched from near to far.

use crate::parting::Parting;
use chpm_mesh::Aabb;
use nalgebra::Point3;

/// A hierarchy of boxes over items that have one each; the items themselves are elsewhere.
///
/// Nodes have up to eight children, whose boxes are held against a point all at once, in singles rounded so that none is taken for farther than it is.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
    nodes: Vec<Node>,
    /// A power of two that brings the largest coordinate to about one, so that a square is neither too large nor too small for a single.
    scale: f64,
    /// By node, where its partings begin; empty where few need any.
    first_partings: Vec<u32>,
    partings: Vec<Parted>,
    halves: Option<Parting>,
    /// Items in the order of the leaves.
    order: Vec<u32>,
}

const WIDTH: usize = 8;
/// Halvings that make so many.
const HALVINGS: u32 = WIDTH.ilog2();

/// Children side by side, scaled.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Node {
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
    /// Squared; from farther away no item below is asked for. Of no child, nothing is near enough.
    reach: [f32; WIDTH],
    /// A node, or a place with [`ITEM`] set.
    child: [u32; WIDTH],
}

/// Separation of two sets of a node's children.
#[derive(Clone, Copy, Debug)]
struct Parted {
    parting: Parting,
    /// Of either set, the first child and the one after the last.
    sets: [[u8; 2]; 2],
}

const ITEM: u32 = 1 << 31;
/// No child.
const NONE: u32 = u32::MAX;
/// Factor that keeps a squared distance a lower bound: singles lose a few of their last bits.
const SAFE: f32 = 1.0 - 16.0 * f32::EPSILON;
/// Below so many items a parting is looked for only under another one: those of ordinary surfaces cost more than they spare.
const PARTABLE: usize = 2 * WIDTH;
/// Items are split off unevenly only if they are at least this part of all.
const LEAST_SHARE: usize = 16;
/// Beyond this number of halvings items are split evenly, so that no tree is deeper than by seven more.
const DEEPEST: u32 = 40;
/// Nodes and items that wait at most: of each node on the way down all children but one.
const WAITING: usize = 128;
/// Where less than one node in so many has a parting, none is kept: boxes do for such a tree.
const FEW: usize = 64;

impl Node {
    const EMPTY: Node = Node {
        low: [[f32::INFINITY; WIDTH]; 3],
        high: [[f32::NEG_INFINITY; WIDTH]; 3],
        reach: [-1.0; WIDTH],
        child: [NONE; WIDTH],
    };

    /// Squared distances from a point, which is between two singles along each axis, to the boxes, at least.
    fn bounds(&self, point: &[[f32; 2]; 3]) -> [f32; WIDTH] {
        let mut bounds = [0.0; WIDTH];
        add_squares(&mut bounds, point[0], &self.low[0], &self.high[0]);
        add_squares(&mut bounds, point[1], &self.low[1], &self.high[1]);
        add_squares(&mut bounds, point[2], &self.low[2], &self.high[2]);
        bounds
    }

    /// Children that are no farther than the root of `most`, and than they reach, as bits.
    fn within(&self, bounds: &[f32; WIDTH], most: f32) -> u32 {
        let mut bits = [0; WIDTH];
        for lane in 0..WIDTH {
            let reach = self.reach[lane];
            let least = if most < reach { most } else { reach };
            bits[lane] = if bounds[lane] <= least { 1 << lane } else { 0 };
        }
        let mut all = 0;
        for bit in bits {
            all |= bit;
        }
        all
    }

    fn count(&self) -> usize {
        self.child.iter().filter(|child| **child != NONE).count()
    }
}

/// Adds the squares of what a coordinate, which is between two singles, is beside ranges; written out, so that all are done at once.
#[inline]
fn add_squares(
    squares: &mut [f32; WIDTH],
    [below, above]: [f32; 2],
    low: &[f32; WIDTH],
    high: &[f32; WIDTH],
) {
    for lane in 0..WIDTH {
        let (a, b) = (low[lane] - above, below - high[lane]);
        let excess = if a > b { a } else { b };
        let excess = if excess > 0.0 { excess } else { 0.0 };
        squares[lane] += excess * excess * SAFE;
    }
}

impl BoxTree {
    /// Builds over items `0..boxes.len()`; split by the longest axis of the boxes' middles, ties by index.
    pub fn new(boxes: &[Aabb]) -> Self {
        BoxTree::reaching(boxes, |_| f64::INFINITY)
    }

    /// As [`BoxTree::new`], of items that each matter up to a distance of their own: a search does not come to those that are
    /// farther away than that, but for rounding.
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
        let sides = boxes.iter().flat_map(|b| b.min.into_iter().chain(b.max)).filter(|x| x.is_finite());
        let largest = sides.fold(f32::MIN_POSITIVE, |largest, x| largest.max(x.abs()));
        let scale = (-f64::from(largest).log2().floor()).exp2();
        let tree = BoxTree { scale, ..BoxTree::default() };
        let mut builder = Builder { boxes, middles, reach, part, tree, parted: Vec::new() };
        if !order.is_empty() {
            builder.node(&mut order, 0, false, 0);
        }
        let Builder { mut tree, parted, .. } = builder;
        tree.order = order;
        if !parted.is_empty() && parted.len() * FEW >= tree.nodes.len() {
            tree.keep(parted);
        }
        tree
    }

    /// Keeps partings, each with its node.
    fn keep(&mut self, mut parted: Vec<(u32, Parted)>) {
        parted.sort_by_key(|(node, _)| *node);
        self.first_partings = (0..=self.nodes.len() as u32)
            .map(|node| parted.partition_point(|(other, _)| *other < node) as u32)
            .collect();
        self.partings = parted.into_iter().map(|(_, parted)| parted).collect();
        let all = self.nodes[0].count() as u8;
        self.halves = self
            .partings_of(0)
            .iter()
            .find(|parted| parted.sets[0][0] == 0 && parted.sets[1][1] == all)
            .map(|parted| parted.parting);
    }

    fn partings_of(&self, node: usize) -> &[Parted] {
        &self.partings[self.first_partings[node] as usize..self.first_partings[node + 1] as usize]
    }

    /// Items in the order of the leaves: a place is an index into it.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Separation of the two halves where their boxes overlap.
    pub(crate) fn halves(&self) -> Option<Parting> {
        self.halves
    }

    /// Bytes of memory.
    pub fn len_bytes(&self) -> usize {
        size_of_val(&self.nodes[..])
            + size_of_val(&self.first_partings[..])
            + size_of_val(&self.partings[..])
            + size_of_val(&self.order[..])
    }

    /// Calls `visit` with the place of every item whose box may be nearer than the square root of `best`, near boxes first; `visit`
    /// lowers `best` as it finds something.
    pub fn search(&self, point: Point3<f64>, best: &mut f64, mut visit: impl FnMut(usize, &mut f64)) {
        let square = self.scale * self.scale;
        let scaled = point.coords * self.scale;
        let between =
            [[down(scaled.x), up(scaled.x)], [down(scaled.y), up(scaled.y)], [down(scaled.z), up(scaled.z)]];
        let (mut known, mut most) = (*best, up(*best * square));

        let mut stack = [(0.0f32, 0u32); WAITING];
        let mut len = usize::from(!self.nodes.is_empty());
        // Nothing is nearer than at no distance at all.
        while len > 0 && known > 0.0 {
            len -= 1;
            let (bound, child) = stack[len];
            if bound > most {
                continue;
            }
            if child & ITEM != 0 {
                visit((child ^ ITEM) as usize, best);
                if *best != known {
                    (known, most) = (*best, up(*best * square));
                }
                continue;
            }

            // A node: bounds of what its children are away at least.
            let node = &self.nodes[child as usize];
            let mut bounds = node.bounds(&between);
            // Ordinary surfaces have no partings.
            if !self.partings.is_empty() {
                for Parted { parting, sets } in self.partings_of(child as usize) {
                    for ([first, end], least) in sets.iter().zip(parting.squared_distances(point)) {
                        let least = down(least * square);
                        for bound in &mut bounds[usize::from(*first)..usize::from(*end)] {
                            *bound = bound.max(least);
                        }
                    }
                }
            }
            let mut near = node.within(&bounds, most);
            // The nearest is put last, and is looked at first.
            let first = len;
            while near != 0 {
                let lane = near.trailing_zeros() as usize % WIDTH;
                near &= near - 1;
                let mut at = len % WAITING;
                while at > first && stack[at - 1].0 < bounds[lane] {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = (bounds[lane], node.child[lane]);
                len += 1;
            }
        }
    }

    /// Calls `visit` with the place of every item that may reach `point`.
    pub fn for_each_reaching(&self, point: Point3<f64>, mut visit: impl FnMut(usize)) {
        let mut everything = f64::INFINITY;
        self.search(point, &mut everything, |place, _| visit(place));
    }
}

/// The largest single that is not above.
fn down(x: f64) -> f32 {
    let single = x as f32;
    if f64::from(single) > x { single.next_down() } else { single }
}

/// The smallest single that is not below.
fn up(x: f64) -> f32 {
    let single = x as f32;
    if f64::from(single) < x { single.next_up() } else { single }
}

/// Where items are split: at a place in their order by a coordinate.
struct Half {
    at: usize,
    axis: usize,
}

/// How two sets of items lie.
struct Split {
    parting: Option<Parting>,
    is_in_one_another: bool,
}

/// Input of a tree's construction.
struct Builder<'a, F, P> {
    boxes: &'a [Aabb],
    middles: Vec<[f64; 3]>,
    reach: F,
    part: P,
    tree: BoxTree,
    parted: Vec<(u32, Parted)>,
}

/// A node whose items are being split.
#[derive(Default)]
struct Draft {
    /// Items that each child may have without a node below that is not full.
    room: usize,
    /// Where each child's items begin, and whether a parting tells them from those beside them.
    children: Vec<(usize, bool)>,
    parted: Vec<Parted>,
}

impl<F: Fn(usize) -> f64, P: Fn(usize, [&[u32]; 2]) -> Option<Parting>> Builder<'_, F, P> {
    /// Adds the node of items, the first of which has place `first`, and those below; `parted` is whether those above have a parting.
    fn node(&mut self, items: &mut [u32], first: usize, parted: bool, depth: u32) -> u32 {
        let index = self.tree.nodes.len();
        self.tree.nodes.push(Node::EMPTY);
        let mut draft = Draft { room: 1, ..Draft::default() };
        while draft.room * WIDTH < items.len() {
            draft.room *= WIDTH;
        }
        self.spread(items, 0, parted, depth, depth + HALVINGS, &mut draft);
        self.parted.extend(draft.parted.into_iter().map(|parted| (index as u32, parted)));
        let ends = draft.children.iter().skip(1).map(|(start, _)| *start).chain([items.len()]);
        for (lane, ((start, parted), end)) in draft.children.iter().zip(ends).enumerate() {
            let (below, place) = (&mut items[*start..end], first + start);
            let (bounds, scale) = (self.bounds(below), self.tree.scale);
            let reach = below.iter().map(|&i| (self.reach)(i as usize)).fold(0.0, f64::max);
            let child = match below.len() {
                1 => place as u32 | ITEM,
                _ => self.node(below, place, *parted, depth + HALVINGS),
            };
            let node = &mut self.tree.nodes[index];
            for axis in 0..3 {
                node.low[axis][lane] = down(f64::from(bounds.min[axis]) * scale);
                node.high[axis][lane] = up(f64::from(bounds.max[axis]) * scale);
            }
            // One step up, so that a box at exactly the distance is not missed.
            node.reach[lane] = up((reach * scale).powi(2)).next_up();
            node.child[lane] = child;
        }
        index as u32
    }

    /// Splits items, which begin at `start` of their node's, into children.
    fn spread(
        &mut self,
        items: &mut [u32],
        start: usize,
        parted: bool,
        depth: u32,
        deepest: u32,
        draft: &mut Draft,
    ) {
        let looks = parted || items.len() >= PARTABLE;
        if draft.room == 1 && !looks {
            draft.children.extend((start..start + items.len()).map(|at| (at, false)));
            return;
        }
        if items.len() <= draft.room || depth == deepest {
            draft.children.push((start, parted));
            return;
        }
        let (at, split) = self.split_best(items, draft.room, looks, depth);
        let (low, high) = items.split_at_mut(at);
        let is_parted = split.parting.is_some();
        let before = draft.children.len() as u8;
        self.spread(low, start, is_parted, depth + 1, deepest, draft);
        let between = draft.children.len() as u8;
        self.spread(high, start + at, is_parted, depth + 1, deepest, draft);
        let sets = [[before, between], [between, draft.children.len() as u8]];
        draft.parted.extend(split.parting.map(|parting| Parted { parting, sets }));
    }

    /// Splits items in two along their longest axis; answers how many come first.
    fn split_best(&self, items: &mut [u32], room: usize, looks: bool, depth: u32) -> (usize, Split) {
        let mut extent = [(f64::INFINITY, f64::NEG_INFINITY); 3];
        for middle in items.iter().map(|&i| self.middles[i as usize]) {
            for (range, c) in extent.iter_mut().zip(middle) {
                *range = (range.0.min(c), range.1.max(c));
            }
        }
        fn width(a: &usize, extent: &[(f64, f64); 3]) -> f64 {
            extent[*a].1 - extent[*a].0
        }
        let axis = (0..3).max_by(|a, b| width(a, &extent).total_cmp(&width(b, &extent))).unwrap_or(0);
        // As many children on either side, all but the last of them full.
        let even = Half { at: items.len().div_ceil(room) / 2 * room, axis };
        let split = self.split(items, &even, looks);
        if !split.is_in_one_another {
            return (even.at, split);
        }
        // Two heaps of different size are told apart between them, not in the middle of the larger one.
        let between = 0.5 * (extent[axis].0 + extent[axis].1);
        let count = items.iter().filter(|i| self.middles[**i as usize][axis] < between).count();
        let is_deep = depth + items.len().ilog2() >= DEEPEST;
        if !is_deep && count.min(items.len() - count) * LEAST_SHARE >= items.len() {
            let uneven = Half { at: count, axis };
            let other = self.split(items, &uneven, looks);
            if !other.is_in_one_another {
                return (uneven.at, other);
            }
            return (even.at, self.split(items, &even, looks));
        }
        (even.at, split)
    }

    /// Puts those before a place, by the coordinate of their middles, in front of the others.
    fn split(&self, items: &mut [u32], half: &Half, looks: bool) -> Split {
        items.select_nth_unstable_by(half.at, |&a, &b| {
            let [x, y] = [a, b].map(|i| self.middles[i as usize][half.axis]);
            x.total_cmp(&y).then(a.cmp(&b))
        });
        if !looks {
            return Split { parting: None, is_in_one_another: false };
        }
        let (low, high) = items.split_at(half.at);
        let is_needed = Parting::is_needed([&self.bounds(low), &self.bounds(high)]);
        let parting = is_needed.then(|| (self.part)(high[0] as usize, [low, high])).flatten();
        Split { parting, is_in_one_another: is_needed && parting.is_none() }
    }

    fn bounds(&self, items: &[u32]) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        items.iter().for_each(|&i| bounds.merge(&self.boxes[i as usize]));
        bounds
    }
}

/// Squared distance from a point to a box; 0 inside.
pub fn squared_distance_to_box(point: Point3<f64>, bounds: &Aabb) -> f64 {
    let (x, y, z) = (
        excess(0, &point, &bounds.min, &bounds.max),
        excess(1, &point, &bounds.min, &bounds.max),
        excess(2, &point, &bounds.min, &bounds.max),
    );
    x * x + y * y + z * z
}

fn excess(a: usize, point: &Point3<f64>, bounds_min: &[f32; 3], bounds_max: &[f32; 3]) -> f64 {
    let (low, high) = (f64::from(bounds_min[a]), f64::from(bounds_max[a]));
    (low - point[a]).max(point[a] - high).max(0.0)
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
        assert!(near.len() <= 2 * WIDTH, "{near:?}");
        let mut far = Vec::new();
        tree.for_each_reaching([40.4, 0.5, 0.5].into(), |place| far.push(tree.order()[place]));
        assert!(far.contains(&7) && far.contains(&40) && far.len() <= 2 * WIDTH, "{far:?}");
        let tree = BoxTree::new(&boxes);
        let mut visits = 0;
        let mut best = f64::INFINITY;
        tree.search([7.2, 0.5, 0.5].into(), &mut best, |place, best| {
            visits += 1;
            let bounds = &boxes[tree.order()[place] as usize];
            *best = best.min(squared_distance_to_box([7.2, 0.5, 0.5].into(), bounds));
        });
        assert_eq!(best, 0.0);
        assert!(visits <= 1, "{visits}");
        BoxTree::new(&[]).search([0.0; 3].into(), &mut best, |_, _| panic!("there is nothing"));
    }
}
