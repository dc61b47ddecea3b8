//! A mesh of one cluster for rays: four boxes to a node, over the triangles of a patch.

use crate::fat;
use crate::ray::{Hit, Ready, Seek};
use crate::wide::{COUNT, FIRST, LEAF, Wide};
use chpm_format::ClusterRecord;
use chpm_mesh::ClusterId;
use chpm_space::{Node, Patch};

/// Triangles in the order of a patch's boxes, and these four by four.
#[derive(Debug)]
pub(crate) struct Mesh {
    nodes: Vec<Wide>,
    corners: Vec<[[f32; 3]; 3]>,
    /// Their places in the page.
    places: Vec<u32>,
}

/// The best so far of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    pub(crate) hit: Option<Hit>,
    /// Nothing beyond it matters: the ray's reach, or the distance of what was found.
    pub(crate) upper: f64,
    /// Whether something was.
    pub(crate) is_met: bool,
}

impl Found {
    /// The limit for boxes.
    pub(crate) fn limit(&self, ready: &Ready) -> f32 {
        ((self.upper - ready.slabs.start) as f32).next_up()
    }
}

/// Boxes that can wait: three of each four, and a tree of 65,536 triangles is eight deep.
const DEEP: usize = 64;

impl Mesh {
    pub(crate) fn new(patch: &Patch) -> Self {
        let mut nodes = Vec::new();
        if !patch.is_empty() {
            widen(patch.nodes(), 0, &mut nodes);
        }
        let count = patch.len();
        Mesh {
            nodes,
            corners: (0..count).map(|index| *patch.corners_of(index)).collect(),
            places: (0..count).map(|index| patch.place(index)).collect(),
        }
    }

    /// How many triangles it has.
    pub(crate) fn len(&self) -> usize {
        self.corners.len()
    }

    /// Bytes of memory that a cluster's mesh takes, or a little more; with what is only needed to make it.
    pub(crate) fn bytes_of(record: &ClusterRecord, is_finest: bool) -> u64 {
        let triangles = if is_finest { record.triangle_count } else { record.base_triangle_count };
        // A node of four boxes for every four triangles at most: halves of halves have three or four.
        let triangle = size_of::<[[f32; 3]; 3]>() + size_of::<u32>() + size_of::<Wide>() / 4;
        256 + u64::from(triangles) * triangle as u64
    }

    /// Takes what a ray meets.
    pub(crate) fn meet(&self, ready: &Ready, seek: Seek, cluster: u32, found: &mut Found) {
        if self.nodes.is_empty() {
            return;
        }
        let mut open = [(0.0_f32, 0_u32); DEEP];
        let mut count = 1;
        let mut limit = found.limit(ready);
        while count > 0 {
            count -= 1;
            let (enter, below) = open[count];
            if enter * (1.0 - crate::ray::LOST) > limit * (1.0 + crate::ray::LOST) {
                continue;
            }
            if below & LEAF != 0 {
                let first = (below & FIRST) as usize;
                let triangles = first..first + ((below & !LEAF) >> COUNT) as usize;
                for index in triangles {
                    if self.take(index, ready, seek, cluster, found) {
                        limit = found.limit(ready);
                    }
                }
                if seek == Seek::Any && found.hit.is_some() {
                    return;
                }
                continue;
            }

            // The nearest is taken first: it comes last onto the pile.
            let begin = count;
            for entry in self.nodes[below as usize].enter(ready, limit) {
                let mut at = count;
                while at > begin && open[at - 1].0 < entry.0 {
                    open[at] = open[at - 1];
                    at -= 1;
                }
                open[at] = entry;
                count += 1;
            }
        }
    }

    /// Whether a triangle comes before all others so far.
    #[inline]
    fn take(&self, index: usize, ready: &Ready, seek: Seek, cluster: u32, found: &mut Found) -> bool {
        let corners = &self.corners[index];
        if let Seek::Within(distance) = seek {
            let enter = fat::enter(ready, corners, distance).filter(|enter| *enter < found.upper);
            found.upper = enter.unwrap_or(found.upper);
            found.is_met |= enter.is_some();
            return enter.is_some();
        }
        let Some((distance, shares)) = ready.meet(corners) else { return false };
        let place = self.places[index];
        if distance > found.upper || found.hit.is_some_and(|hit| hit.is_before(distance, cluster, place)) {
            return false;
        }
        (found.upper, found.is_met) = (distance, true);
        found.hit = Some(hit(corners, distance, shares, cluster, place));
        true
    }
}

fn hit(corners: &[[f32; 3]; 3], distance: f64, shares: [f64; 3], cluster: u32, triangle: u32) -> Hit {
    let [a, b, c] = corners.map(|corner| corner.map(f64::from));
    let point = std::array::from_fn(|i| shares[0] * a[i] + shares[1] * b[i] + shares[2] * c[i]);
    let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
    let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let normal = crate::ray::unit(normal).unwrap_or([0.0; 3]);
    Hit { distance, point, normal, cluster: ClusterId(cluster), triangle }
}

/// Appends a node that has the boxes below a patch's node, and theirs where they are divided.
fn widen(from: &[Node], at: usize, nodes: &mut Vec<Wide>) -> u32 {
    let number = nodes.len() as u32;
    nodes.push(Wide::EMPTY);
    let mut parts = Vec::with_capacity(4);
    for half in halves(from, at) {
        parts.extend(halves(from, half));
    }
    for (i, part) in parts.into_iter().enumerate() {
        let node = &from[part];
        let below =
            if node.other == 0 { LEAF | node.count << COUNT | node.first } else { widen(from, part, nodes) };
        nodes[number as usize].put(i, &node.min, &node.max, below);
    }
    number
}

fn halves(from: &[Node], at: usize) -> impl Iterator<Item = usize> {
    let other = from[at].other as usize;
    let first = if other == 0 { at } else { at + 1 };
    std::iter::once(first).chain((other > 0).then_some(other))
}
