//! The dependency groups as a selection asks for them: errors that never grow from a group to those below, spheres and boxes that nest.

use crate::splits::top_down;
use crate::view::{Region, View};
use chpm_format::{Chpm, GroupRecord};
use chpm_mesh::{GroupId, geom};

/// Split criteria of all groups of a file. Whatever the file, a group that a view wants split has only
/// groups above that it wants split too: so there are no forced splits. A file that keeps I6 loses nothing by it; in
/// another one errors are raised, spheres and boxes widened as far as needed.
#[derive(Clone, Debug)]
pub struct Hierarchy {
    nodes: Vec<Node>,
    order: Vec<GroupId>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    region: Region,
    /// Below this bound the group is split; negative for a group of leaves, which never is.
    split_error: f32,
    /// Place in the order.
    rank: u32,
}

impl Hierarchy {
    /// Reads the tables of a file, once for all views. O(groups).
    pub fn new<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let order = top_down(file);
        let mut nodes: Vec<Node> = file.groups().iter().map(Node::new).collect();
        for (rank, id) in (0..order.len() as u32).zip(&order).rev() {
            let mut node = nodes[id.index()];
            node.rank = rank;
            for coarse in file.coarse(*id) {
                let record = &file.clusters()[*coarse as usize];
                node.region.widen(record.aabb_min.map(f64::from), record.aabb_max.map(f64::from));
            }
            let center = file.groups()[id.index()].center;
            for fine in file.fine(*id) {
                let below = file.clusters()[*fine as usize].group();
                let inner = &nodes[below.index()];
                let away = geom::distance(center, file.groups()[below.index()].center);
                // The factor pays for the rounding of the sum.
                let radius = (away + inner.region.radius) * (1.0 + 4.0 * f64::EPSILON);
                node.region.radius = node.region.radius.max(radius);
                let (low, high) = (inner.region.low, inner.region.high);
                node.region.widen(low, high);
                node.split_error = node.split_error.max(inner.split_error);
            }
            nodes[id.index()] = node;
        }
        Hierarchy { nodes, order }
    }

    /// The groups, every one after those above it.
    pub fn top_down(&self) -> &[GroupId] {
        &self.order
    }

    /// Where in [`Hierarchy::top_down`] a group is.
    ///
    /// # Panics
    /// For a group that the file does not have, here and below.
    pub fn rank(&self, group: GroupId) -> u32 {
        self.nodes[group.index()].rank
    }

    /// The sphere and the box around a group and everything below.
    pub fn region(&self, group: GroupId) -> &Region {
        &self.nodes[group.index()].region
    }

    /// The error-bound of a view for a group: the clusters of the group are positioned by it.
    pub fn bound(&self, group: GroupId, view: &View) -> f32 {
        view.bound(self.region(group))
    }

    /// Whether an error-bound asks for the split of a group.
    pub fn wants(&self, group: GroupId, bound: f32) -> bool {
        self.nodes[group.index()].split_error > bound
    }

    /// The error that is gone when a group is split; `None` for a group of leaves.
    pub fn split_error(&self, group: GroupId) -> Option<f32> {
        Some(self.nodes[group.index()].split_error).filter(|error| *error >= 0.0)
    }
}

impl Node {
    fn new(group: &GroupRecord) -> Self {
        Node {
            region: Region {
                center: group.center.map(f64::from),
                radius: f64::from(group.radius),
                slack: Region::SLACK * (f64::from(group.level) + 1.0),
                low: [f64::INFINITY; 3],
                high: [f64::NEG_INFINITY; 3],
            },
            split_error: if group.is_leaf() { -1.0 } else { group.min_error },
            rank: 0,
        }
    }
}
