//! The tree of groups that rays go down.

use crate::bound::Bound;
use crate::wide::Wide;
use chpm_format::Chpm;
use chpm_mesh::{Aabb, GroupId};
use chpm_refine::Hierarchy;

/// A mesh of a cluster: twice its number, and one more for the finest.
pub(crate) type MeshKey = u32;

/// Groups with their boxes and errors, and which lie below which.
#[derive(Debug)]
pub(crate) struct Tree {
    pub(crate) boxes: Vec<Aabb>,
    /// No less than those below.
    pub(crate) errors: Vec<f32>,
    /// Groups of which none has a group above.
    pub(crate) top: Vec<u32>,
    /// Clusters without a group above.
    pub(crate) roots: Vec<u32>,
    /// By group, where its own in `below` begin.
    starts: Vec<u32>,
    below: Vec<u32>,
}

impl Tree {
    pub(crate) fn new<D: AsRef<[u8]>>(file: &Chpm<D>) -> Self {
        let hierarchy = Hierarchy::new(file);
        let count = file.groups().len();
        let mut errors: Vec<f32> = file.groups().iter().map(|group| group.max_error).collect();
        for group in hierarchy.top_down().iter().rev() {
            let finer = file.fine(*group).iter().map(|fine| file.clusters()[*fine as usize].group());
            let largest = finer.map(|group| errors[group.index()]).fold(0.0, f32::max);
            errors[group.index()] = errors[group.index()].max(largest);
        }
        // Boxes of f32 numbers, held in f64 meanwhile.
        let narrow = |group: u32| {
            let region = hierarchy.region(GroupId(group));
            Aabb { min: region.low.map(|x| x as f32), max: region.high.map(|x| x as f32) }
        };
        let boxes = (0..count as u32).map(narrow).collect();

        // A group with a root among its coarse clusters is at the top, as one above it would be.
        let above = |group: u32| {
            let coarse = file.coarse(GroupId(group));
            let parents = coarse.iter().map(|coarse| file.clusters()[*coarse as usize].parent_group());
            let mut first = None;
            for parent in parents {
                if !parent.is_some() {
                    return None;
                }
                first = first.or(Some(parent.0));
            }
            first
        };
        let parents: Vec<Option<u32>> = (0..count as u32).map(above).collect();
        let mut starts = vec![0; count + 1];
        parents.iter().flatten().for_each(|parent| starts[*parent as usize + 1] += 1);
        for at in 0..count {
            starts[at + 1] += starts[at];
        }
        let mut next = starts.clone();
        let mut below = vec![0; starts[count] as usize];
        for (group, parent) in (0..).zip(&parents) {
            if let Some(parent) = parent {
                below[next[*parent as usize] as usize] = group;
                next[*parent as usize] += 1;
            }
        }
        let top =
            (0..).zip(&parents).filter(|(_, parent)| parent.is_none()).map(|(group, _)| group).collect();
        let roots = file.roots().map(|id| id.0).collect();
        Tree { boxes, errors, top, roots, starts, below }
    }

    /// Whether a bound splits a group for a ray.
    #[inline]
    pub(crate) fn is_split(&self, group: u32, bound: &Bound, origin: &[f64; 3], cap: f64) -> bool {
        let bounds = &self.boxes[group as usize];
        f64::from(self.errors[group as usize]) > bound.allows(bounds, origin, cap)
    }

    /// The meshes that a bound stands for which is common to all rays.
    pub(crate) fn present<D: AsRef<[u8]>>(&self, file: &Chpm<D>, bound: &Bound) -> Vec<MeshKey> {
        let is_split = |group: GroupId| self.is_split(group.0, bound, &bound.eye, f64::INFINITY);
        let mut keys = Vec::new();
        for (cluster, record) in (0..).zip(file.clusters()) {
            let (own, above) = (is_split(record.group()), record.parent_group());
            if own && record.is_leaf() {
                keys.push(2 * cluster + 1);
            } else if !own && (!above.is_some() || is_split(above)) {
                keys.push(2 * cluster);
            }
        }
        keys
    }

    /// Bytes of memory for a file's tree.
    pub(crate) fn bytes<D: AsRef<[u8]>>(file: &Chpm<D>) -> u64 {
        // With what is only needed to make it; and boxes over clusters.
        200 * file.groups().len() as u64 + (size_of::<Wide>() + 64) as u64 * file.clusters().len() as u64
    }

    pub(crate) fn below(&self, group: u32) -> &[u32] {
        let [first, end] = [group, group + 1].map(|at| self.starts[at as usize] as usize);
        &self.below[first..end]
    }
}
