//! The finest mesh of one cluster, and boxes over it.

use crate::boxes::Block;
use crate::pose::Between;
use crate::triangle::{self, Corners, Near};
use chpm_format::{ClusterRecord, Page};
use chpm_mesh::Aabb;
use nalgebra::Vector3;
use std::ops::ControlFlow;

/// No shared id.
const NONE: u32 = u32::MAX;

/// Triangles of a box that is not divided.
const FEW: usize = 4;

/// Triangles in an order in which each box has a run of them.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    corners: Vec<[[f32; 3]; 3]>,
    /// Their places in the page.
    places: Vec<u32>,
    nodes: Vec<Node>,
    /// Their corners as vertices of the page.
    vertices: Vec<[u16; 3]>,
    /// By vertex of the page: its shared id, or none.
    shared: Vec<u32>,
}

/// A box. Those of a divided one lie behind it: the first at once, the second at `other`.
#[derive(Clone, Copy, Debug)]
struct Node {
    min: [f32; 3],
    max: [f32; 3],
    first: u32,
    count: u32,
    /// 0 where it is not divided.
    other: u32,
}

impl Node {
    fn block(&self) -> Block {
        Block::new(self.min, self.max)
    }

    /// The squared distance of a point.
    fn squared_from(&self, point: &Vector3<f64>) -> f64 {
        let mut squared = 0.0;
        for axis in 0..3 {
            let (low, high) = (f64::from(self.min[axis]), f64::from(self.max[axis]));
            let away = (low - point[axis]).max(point[axis] - high).max(0.0);
            squared += away * away;
        }
        squared
    }

    fn triangles(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }
}

/// Result of a search among the triangles of two patches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    /// No triangles of the patches are nearer.
    pub(crate) lower: f64,
    /// The nearest points found, and the places of their triangles in their pages.
    pub(crate) near: Option<(Near, [u32; 2])>,
}

impl Patch {
    /// `often`: boxes that are tighter, and take longer to make.
    pub(crate) fn new(page: &Page<'_>, often: bool) -> Self {
        let corners: Vec<[[f32; 3]; 3]> =
            page.triangles.iter().map(|t| t.map(|v| page.positions[usize::from(v)])).collect();
        let mut items = if often { each_alone(&corners) } else { in_runs(&corners) };
        let mut nodes = Vec::with_capacity(corners.len());
        if !corners.is_empty() {
            divide(&corners, &mut items, 0, &mut nodes);
        }
        let places: Vec<u32> = items.iter().flat_map(Item::places).collect();
        let corners = places.iter().map(|place| corners[*place as usize]).collect();
        let vertices = places.iter().map(|place| page.triangles[*place as usize]).collect();
        let mut shared = vec![NONE; page.vertex_count()];
        for (vertex, id) in page.shared() {
            shared[usize::from(vertex)] = id;
        }
        Patch { corners, places, nodes, vertices, shared }
    }

    /// Bytes of memory that the patch of a cluster takes at most.
    pub(crate) fn bytes_of(record: &ClusterRecord) -> u64 {
        let triangle =
            size_of::<[[f32; 3]; 3]>() + size_of::<u32>() + size_of::<Node>() + size_of::<[u16; 3]>();
        u64::from(record.triangle_count) * triangle as u64 + 4 * u64::from(record.vertex_count)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The corners of the triangle at a place of the boxes' order.
    pub(crate) fn corners_of(&self, index: usize) -> &[[f32; 3]; 3] {
        &self.corners[index]
    }

    /// Its place in the page.
    pub(crate) fn place(&self, index: usize) -> u32 {
        self.places[index]
    }

    /// Where the triangle of a place in the page is in the boxes' order.
    pub(crate) fn index_of(&self, place: u32) -> Option<usize> {
        self.places.iter().position(|at| *at == place)
    }

    /// Whether a triangle has a vertex that one of another cluster, or of the same one, has too.
    pub(crate) fn has_common_vertex(&self, index: usize, other: &Patch, at: usize, is_one: bool) -> bool {
        self.vertices[index]
            .iter()
            .any(|v| other.vertices[at].iter().any(|w| same(*v, *w, is_one, &self.shared, &other.shared)))
    }

    /// The nearest triangles of two patches, if they are nearer than `below`; found to `slack`.
    pub(crate) fn nearest(&self, other: &Patch, between: &Between, below: f64, slack: f64) -> Found {
        let mut search = PatchSearch {
            a: self,
            b: other,
            between,
            slack,
            upper: below,
            lower: below,
            near: None,
            along: Vector3::zeros(),
        };
        if !self.is_empty() && !other.is_empty() {
            search.descend(0, 0);
        }
        Found { lower: search.lower, near: search.near }
    }

    /// Goes to the nearest point of the patch, if it is nearer than what was found. Answers its triangle, by its place in the boxes' order.
    pub(crate) fn nearest_to(&self, point: &Vector3<f64>, spot: &mut Spot) -> Option<usize> {
        if self.is_empty() {
            return None;
        }
        let away = |at: usize| self.nodes[at].squared_from(point);
        let mut nearest = None;
        let mut open = [(0.0, 0); DEEP];
        let mut count = 1;
        open[0] = (away(0), 0);
        while count > 0 {
            count -= 1;
            let (lower, at) = open[count];
            if lower > spot.reach() {
                continue;
            }
            let node = &self.nodes[at];
            if node.other == 0 {
                for index in node.triangles() {
                    if self.take(index, point, spot) {
                        nearest = Some(index);
                    }
                }
                continue;
            }
            let (first, second) = (at + 1, node.other as usize);
            let (x, y) = (away(first), away(second));
            // The nearer one is taken first.
            let pair = if x <= y { [(y, second), (x, first)] } else { [(x, first), (y, second)] };
            open[count..count + 2].copy_from_slice(&pair);
            count += 2;
        }
        nearest
    }

    /// Goes to the nearest point of one triangle; answers whether it is nearer.
    pub(crate) fn take(&self, index: usize, point: &Vector3<f64>, spot: &mut Spot) -> bool {
        spot.take(point, &self.triangle(index).0)
    }

    /// Calls `found` for every pair of triangles that may be within `reach`, until it breaks.
    pub(crate) fn pairs_within<X>(
        &self,
        other: &Patch,
        between: &Between,
        reach: f64,
        found: &mut dyn FnMut(usize, usize) -> ControlFlow<X>,
    ) -> ControlFlow<X> {
        if self.is_empty() || other.is_empty() {
            return ControlFlow::Continue(());
        }

        let squared = reach * reach;
        let mut open = vec![(0, 0)];
        while let Some((a, b)) = open.pop() {
            let (x, y) = (&self.nodes[a], &other.nodes[b]);
            if between.squared(&x.block(), &y.block()) > squared {
                continue;
            }

            match further(x, y) {
                None => {
                    for i in x.triangles() {
                        for j in y.triangles() {
                            found(i, j)?;
                        }
                    }
                }
                Some(true) => open.extend([(a + 1, b), (x.other as usize, b)]),
                Some(false) => open.extend([(a, b + 1), (a, y.other as usize)]),
            }
        }
        ControlFlow::Continue(())
    }

    /// The triangle at a place of the boxes' order, in f64, and its place in the page.
    pub(crate) fn triangle(&self, index: usize) -> (Corners, u32) {
        let corners = self.corners[index].map(|corner| Vector3::from(corner.map(f64::from)));
        (corners, self.places[index])
    }

    /// The same in the frame of another model.
    pub(crate) fn moved(&self, index: usize, between: &Between) -> (Corners, u32) {
        (self.corners[index].map(|corner| between.apply(corner)), self.places[index])
    }
}

fn same(v: u16, w: u16, is_one: bool, shared: &[u32], other_shared: &[u32]) -> bool {
    match is_one {
        true => v == w,
        false => {
            let id = shared[usize::from(v)];
            id != NONE && id == other_shared[usize::from(w)]
        }
    }
}

/// Boxes that can wait for a point: halves of halves of 65,536 triangles, one of each, and room.
const DEEP: usize = 32;

/// The nearest point that was found, and which side of the surface a point is on there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    squared: f64,
    /// No triangle that was looked at is nearer, but for rounding.
    lower: f64,
    /// Along the normal, as a share of the distance: of all triangles that are nearest, the one that is seen least aslant.
    upright: f64,
}

impl Spot {
    /// Nothing but what is nearer than `upper` is looked for.
    pub(crate) fn beyond(upper: f64) -> Self {
        Spot { squared: upper * upper, lower: upper, upright: 0.0 }
    }

    /// How much nearer than what was found a triangle may be, where the formulas cannot tell.
    pub(crate) fn unsure(&self) -> f64 {
        (self.squared.sqrt() - self.lower).max(0.0)
    }

    /// Squared distances up to this are of interest.
    pub(crate) fn reach(&self) -> f64 {
        self.squared * (1.0 + 1e-12)
    }

    /// Negative behind the surface.
    pub(crate) fn distance(&self) -> f64 {
        if self.upright < 0.0 { -self.squared.sqrt() } else { self.squared.sqrt() }
    }

    /// Answers whether the triangle is nearer than all before.
    fn take(&mut self, point: &Vector3<f64>, corners: &Corners) -> bool {
        let way = point - triangle::nearest_point(point, corners);
        let mut squared = way.norm_squared();
        // What lies beyond the corners along the way, too, is no nearer than it seems.
        let nearest = corners.iter().map(|corner| way.dot(&(point - corner))).fold(f64::INFINITY, f64::min);
        if nearest.max(0.0).powi(2) < self.squared * squared {
            let away = squared.sqrt();
            let mut lower = nearest.max(0.0) / away;
            if away - lower > SURE * (point.amax() + corners[0].amax()) {
                let (careful, upper) = triangle::distance_of_point(point, corners);
                lower = lower.max(careful);
                squared = squared.min(upper * upper);
            }
            self.lower = self.lower.min(lower);
        }
        if squared > self.reach() {
            return false;
        }
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let lengths = normal.norm_squared() * squared;
        let upright = if lengths > 0.0 { normal.dot(&way) / lengths.sqrt() } else { 0.0 };
        if squared < self.squared * (1.0 - 1e-12) || upright.abs() > self.upright.abs() {
            self.upright = upright;
        }
        let is_nearer = squared < self.squared;
        self.squared = self.squared.min(squared);
        is_nearer
    }
}

/// Relative width of an interval that needs no further work.
const SURE: f64 = 1e-13;

/// Whether to divide the first box (or the second); none where neither is divided.
fn further(x: &Node, y: &Node) -> Option<bool> {
    match (x.other > 0, y.other > 0) {
        (false, false) => None,
        (true, true) => Some(x.block().size() >= y.block().size()),
        (first, _) => Some(first),
    }
}

/// Triangles that are put in order together.
#[derive(Clone, Copy)]
struct Item {
    middle: [f32; 3],
    /// The place of the first in the page; others follow.
    place: u32,
    count: u32,
}

impl Item {
    fn places(&self) -> std::ops::Range<u32> {
        self.place..self.place + self.count
    }
}

/// Runs of a few triangles of the page, where these lie beside each other, as in pages that are ordered for drawing; each on its own where they do not.
fn in_runs(corners: &[[[f32; 3]; 3]]) -> Vec<Item> {
    let (mut together, mut alone) = (0.0, 0.0);
    let mut runs = Vec::with_capacity(corners.len() / FEW + 1);
    for (at, run) in corners.chunks(FEW).enumerate() {
        let mut bounds = Aabb::EMPTY;
        for corners in run {
            let own = Aabb::of_points(corners);
            alone += own.diagonal();
            bounds.merge(&own);
        }
        together += bounds.diagonal();
        let middle = [0, 1, 2].map(|axis| bounds.min[axis] / 2.0 + bounds.max[axis] / 2.0);
        runs.push(Item { middle, place: (at * FEW) as u32, count: run.len() as u32 });
    }
    if together <= COHERENT * alone { runs } else { each_alone(corners) }
}

fn each_alone(corners: &[[[f32; 3]; 3]]) -> Vec<Item> {
    fn middle([a, b, c]: &[[f32; 3]; 3]) -> [f32; 3] {
        [0, 1, 2].map(|axis| a[axis] / 3.0 + b[axis] / 3.0 + c[axis] / 3.0)
    }
    (0..).zip(corners).map(|(place, corners)| Item { middle: middle(corners), place, count: 1 }).collect()
}

/// Runs that are no larger than this share of their triangles, one after the other.
const COHERENT: f64 = 0.75;

/// Appends the box of a run of triangles and all below it, and answers it; halves by the middles along the longest axis.
fn divide(corners: &[[[f32; 3]; 3]], items: &mut [Item], first: u32, nodes: &mut Vec<Node>) -> Aabb {
    let at = nodes.len();
    let count: u32 = items.iter().map(|item| item.count).sum();
    nodes.push(Node { min: [0.0; 3], max: [0.0; 3], first, count, other: 0 });

    let mut bounds = Aabb::EMPTY;
    if count as usize <= FEW {
        let places = items.iter().flat_map(Item::places);
        places.for_each(|place| corners[place as usize].iter().for_each(|corner| bounds.add(*corner)));
    } else {
        // Two halves by the median along the longest axis.
        let mut middles = Aabb::EMPTY;
        items.iter().for_each(|item| middles.add(item.middle));
        let size = [0, 1, 2].map(|axis| middles.max[axis] - middles.min[axis]);
        let axis = (1..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
        let half = items.len() / 2;
        items.select_nth_unstable_by(half, |x, y| {
            x.middle[axis].total_cmp(&y.middle[axis]).then(x.place.cmp(&y.place))
        });
        let (low, high) = items.split_at_mut(half);
        bounds = divide(corners, low, first, nodes);
        let begun = nodes[at + 1].count;
        nodes[at].other = nodes.len() as u32;
        bounds.merge(&divide(corners, high, first + begun, nodes));
    }

    (nodes[at].min, nodes[at].max) = (bounds.min, bounds.max);
    bounds
}

struct PatchSearch<'a> {
    a: &'a Patch,
    b: &'a Patch,
    between: &'a Between,
    slack: f64,
    /// Distance from which on nothing matters.
    upper: f64,
    lower: f64,
    near: Option<(Near, [u32; 2])>,
    /// From the second of the nearest points to the first.
    along: Vector3<f64>,
}

impl PatchSearch<'_> {
    /// Whether boxes that are so far apart have nothing to add; then they are not nearer than what is told.
    fn is_done(&mut self, away: f64) -> bool {
        let done = away >= self.upper - self.slack;
        if done {
            self.lower = self.lower.min(away);
        }
        done
    }

    fn descend(&mut self, a: usize, b: usize) {
        let (x, y) = (self.a.nodes[a], self.b.nodes[b]);
        let pairs = match further(&x, &y) {
            None => return self.compare(&x, &y),
            Some(true) => [(a + 1, b), (x.other as usize, b)],
            Some(false) => [(a, b + 1), (a, y.other as usize)],
        };
        let away = pairs
            .map(|(a, b)| self.between.squared(&self.a.nodes[a].block(), &self.b.nodes[b].block()).sqrt());
        // The nearer one first.
        let order = if away[1] < away[0] { [1, 0] } else { [0, 1] };
        for i in order {
            if !self.is_done(away[i]) {
                self.descend(pairs[i].0, pairs[i].1);
            }
        }
    }

    fn compare(&mut self, x: &Node, y: &Node) {
        let mut moved = [([Vector3::zeros(); 3], 0); FEW];
        for (slot, j) in moved.iter_mut().zip(y.triangles()) {
            *slot = self.b.moved(j, self.between);
        }
        for i in x.triangles() {
            let (t, place) = self.a.triangle(i);
            for (u, other) in &moved[..y.count as usize] {
                // Along the way of the nearest points so far, most are far enough apart.
                if self.is_done(triangle::apart_along(self.along, &t, u)) || self.is_done(boxes_apart(&t, u))
                {
                    continue;
                }
                let near = triangle::distance(&t, u);
                self.lower = self.lower.min(near.lower);
                if near.upper < self.upper {
                    self.upper = near.upper;
                    self.along = near.a - near.b;
                    self.near = Some((near, [place, *other]));
                }
            }
        }
    }
}

/// The distance of the boxes of two triangles.
fn boxes_apart(t: &Corners, u: &Corners) -> f64 {
    fn low(c: &Corners) -> Vector3<f64> {
        c[0].inf(&c[1]).inf(&c[2])
    }
    fn high(c: &Corners) -> Vector3<f64> {
        c[0].sup(&c[1]).sup(&c[2])
    }
    let away = (low(u) - high(t)).sup(&(low(t) - high(u)));
    away.map(|x| x.max(0.0)).norm()
}
