//! A mesh of one cluster, and boxes over it.

use crate::block::Block;
use chpm_format::{ClusterRecord, Page};
use chpm_mesh::pm::is_alive;
use chpm_mesh::{Aabb, Places};
use nalgebra::Vector3;

/// The corners of a triangle, which may have no area.
pub type Corners = [Vector3<f64>; 3];

/// No shared id.
const NONE: u32 = u32::MAX;

/// Triangles of a box that is not divided.
pub const FEW: usize = 4;

/// Triangles in an order in which each box has a run of them.
#[derive(Clone, Debug)]
pub struct Patch {
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
pub struct Node {
    /// Its least corner.
    pub min: [f32; 3],
    /// Its largest corner.
    pub max: [f32; 3],
    /// Its first triangle.
    pub first: u32,
    /// How many it has.
    pub count: u32,
    /// 0 where it is not divided.
    pub other: u32,
}

impl Node {
    /// The box itself.
    pub fn block(&self) -> Block {
        Block::new(self.min, self.max)
    }

    /// The squared distance of a point.
    pub fn squared_from(&self, point: &Vector3<f64>) -> f64 {
        let mut squared = 0.0;
        for axis in 0..3 {
            let (low, high) = (f64::from(self.min[axis]), f64::from(self.max[axis]));
            let away = (low - point[axis]).max(point[axis] - high).max(0.0);
            squared += away * away;
        }
        squared
    }

    /// Its triangles, by their places in the order of the boxes.
    pub fn triangles(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }
}

impl Patch {
    /// The finest mesh of a page. `often`: boxes that are tighter, and take longer to make.
    pub fn new(page: &Page<'_>, often: bool) -> Self {
        let all = (0..page.triangles.len() as u32).collect();
        Self::of(page, page.triangles, all, if often { Divided::Alone } else { Divided::Runs })
    }

    /// The mesh of `n` vertices of a page, in boxes of which rays come into few.
    pub fn at(page: &Page<'_>, n: usize) -> Self {
        let mut at = Places::default();
        at.go_to(&page.progressive_mesh(), n);
        let (mut triangles, mut places) = (Vec::new(), Vec::new());
        for (place, corners) in (0..).zip(page.triangles) {
            let corners = corners.map(|v| at.of(v));
            if is_alive(&corners) {
                triangles.push(corners);
                places.push(place);
            }
        }
        Self::of(page, &triangles, places, Divided::BySurface)
    }

    /// Triangles, and their places in the page.
    fn of(page: &Page<'_>, triangles: &[[u16; 3]], in_page: Vec<u32>, divided: Divided) -> Self {
        let corners: Vec<[[f32; 3]; 3]> =
            triangles.iter().map(|t| t.map(|v| page.positions[usize::from(v)])).collect();
        let mut items = if divided == Divided::Runs { in_runs(&corners) } else { each_alone(&corners) };
        let mut nodes = Vec::with_capacity(corners.len());
        if !corners.is_empty() {
            divide(&corners, &mut items, 0, divided, &mut nodes);
        }

        let order: Vec<u32> = items.iter().flat_map(Item::places).collect();
        let corners = order.iter().map(|at| corners[*at as usize]).collect();
        let vertices = order.iter().map(|at| triangles[*at as usize]).collect();
        let places = order.iter().map(|at| in_page[*at as usize]).collect();
        let mut shared = vec![NONE; page.vertex_count()];
        for (vertex, id) in page.shared() {
            shared[usize::from(vertex)] = id;
        }
        Patch { corners, places, nodes, vertices, shared }
    }

    /// Bytes of memory that the patch of a cluster takes at most.
    pub fn bytes_of(record: &ClusterRecord) -> u64 {
        let triangle =
            size_of::<[[f32; 3]; 3]>() + size_of::<u32>() + size_of::<Node>() + size_of::<[u16; 3]>();
        u64::from(record.triangle_count) * triangle as u64 + 4 * u64::from(record.vertex_count)
    }

    /// How many triangles it has.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether it has no triangles.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The corners of the triangle at a place of the boxes' order.
    pub fn corners_of(&self, index: usize) -> &[[f32; 3]; 3] {
        &self.corners[index]
    }

    /// Its place in the page.
    pub fn place(&self, index: usize) -> u32 {
        self.places[index]
    }

    /// Where the triangle of a place in the page is in the boxes' order.
    pub fn index_of(&self, place: u32) -> Option<usize> {
        self.places.iter().position(|at| *at == place)
    }

    /// Whether a triangle has a vertex that one of another cluster, or of the same one, has too.
    pub fn has_common_vertex(&self, index: usize, other: &Patch, at: usize, is_one: bool) -> bool {
        self.vertices[index]
            .iter()
            .any(|v| other.vertices[at].iter().any(|w| same(*v, *w, is_one, &self.shared, &other.shared)))
    }

    /// The triangle at a place of the boxes' order, in f64, and its place in the page.
    pub fn triangle(&self, index: usize) -> (Corners, u32) {
        let corners = self.corners[index].map(|corner| Vector3::from(corner.map(f64::from)));
        (corners, self.places[index])
    }

    /// Its boxes, the one about all first.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
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

/// How boxes are made.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Divided {
    /// Of runs of the page, by halves.
    Runs,
    /// Of single triangles, by halves.
    Alone,
    /// Of single triangles, where the surfaces of both boxes, each by its triangles, are least.
    BySurface,
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

/// Places along an axis where boxes may be cut.
const BINS: usize = 16;

/// Puts those first that are below the best of some cuts, and answers how many they are; none where a quarter at least would not be on either side, so that trees stay
/// low.
fn cut_by_surface(
    corners: &[[[f32; 3]; 3]],
    items: &mut [Item],
    axis: usize,
    middles: &Aabb,
) -> Option<usize> {
    let (low, size) = (middles.min[axis], middles.max[axis] - middles.min[axis]);
    let bin = |item: &Item| (((item.middle[axis] - low) / size * BINS as f32) as usize).min(BINS - 1);
    let mut bins = [(0_usize, Aabb::EMPTY); BINS];
    for item in &*items {
        let (count, bounds) = &mut bins[bin(item)];
        *count += 1;
        item.places().for_each(|place| corners[place as usize].iter().for_each(|corner| bounds.add(*corner)));
    }

    let mut below = [0.0; BINS];
    let (mut count, mut bounds) = (0, Aabb::EMPTY);
    for (cost, part) in below.iter_mut().zip(&bins) {
        *cost = surface(&bounds) * count as f64;
        count += part.0;
        bounds.merge(&part.1);
    }
    let (mut count, mut bounds) = (0, Aabb::EMPTY);
    let mut best = (f64::INFINITY, 0);
    for (cut, part) in bins.iter().enumerate().skip(1).rev() {
        count += part.0;
        bounds.merge(&part.1);
        let cost = below[cut] + surface(&bounds) * count as f64;
        let least = count.min(items.len() - count);
        if 4 * least >= items.len() && cost < best.0 {
            best = (cost, cut);
        }
    }
    if best.1 == 0 {
        return None;
    }
    let mut half = 0;
    for at in 0..items.len() {
        if bin(&items[at]) < best.1 {
            items.swap(at, half);
            half += 1;
        }
    }
    Some(half)
}

fn surface(Aabb { min, max }: &Aabb) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|axis| f64::from(max[axis]) - f64::from(min[axis]));
    if x < 0.0 { 0.0 } else { x * y + y * z + z * x }
}

/// Appends the box of a run of triangles and all below it, and answers it; halves by the middles along the longest axis.
fn divide(
    corners: &[[[f32; 3]; 3]],
    items: &mut [Item],
    first: u32,
    divided: Divided,
    nodes: &mut Vec<Node>,
) -> Aabb {
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
        let cut = match divided {
            Divided::BySurface => cut_by_surface(corners, items, axis, &middles),
            Divided::Runs | Divided::Alone => None,
        };
        let half = cut.unwrap_or(items.len() / 2);
        if cut.is_none() {
            items.select_nth_unstable_by(half, |x, y| {
                x.middle[axis].total_cmp(&y.middle[axis]).then(x.place.cmp(&y.place))
            });
        }
        let (low, high) = items.split_at_mut(half);
        bounds = divide(corners, low, first, divided, nodes);
        let begun = nodes[at + 1].count;
        nodes[at].other = nodes.len() as u32;
        bounds.merge(&divide(corners, high, first + begun, divided, nodes));
    }

    (nodes[at].min, nodes[at].max) = (bounds.min, bounds.max);
    bounds
}
