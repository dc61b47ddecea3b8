//! Nodes of four boxes.

use crate::ray::Ready;
use chpm_mesh::Aabb;
use chpm_space::FEW;

/// Four boxes. What is not there is a box that nothing meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wide {
    min: [[f32; 4]; 3],
    max: [[f32; 4]; 3],
    /// The node below, or [`LEAF`] with the number of things and the first of them.
    below: [u32; 4],
}

pub(crate) const LEAF: u32 = 1 << 31;
pub(crate) const COUNT: u32 = 28;
pub(crate) const FIRST: u32 = (1 << COUNT) - 1;
const _: () = assert!(FEW < 8);

impl Wide {
    pub(crate) const EMPTY: Wide =
        Wide { min: [[f32::INFINITY; 4]; 3], max: [[f32::NEG_INFINITY; 4]; 3], below: [LEAF; 4] };

    pub(crate) fn put(&mut self, place: usize, min: &[f32; 3], max: &[f32; 3], below: u32) {
        for axis in 0..3 {
            (self.min[axis][place], self.max[axis][place]) = (min[axis], max[axis]);
        }
        self.below[place] = below;
    }

    /// Boxes that a ray comes into before a limit, where it does, and what is in them.
    #[inline]
    pub(crate) fn enter(&self, ready: &Ready, limit: f32) -> impl Iterator<Item = (f32, u32)> + use<> {
        let enters = ready.slabs.enter4(&self.min, &self.max, limit);
        enters.into_iter().zip(self.below).filter(|(enter, _)| *enter < f32::INFINITY)
    }
}

/// A box and its number.
type Boxed = (Aabb, u32);

/// Appends nodes over boxes, each with a number of its own, halved by their middles along the longest axis; answers what is at the top.
pub(crate) fn over(boxes: &mut [Boxed], nodes: &mut Vec<Wide>) -> u32 {
    if let [(_, number)] = boxes {
        return LEAF | 1 << COUNT | *number;
    }
    let place = nodes.len();
    nodes.push(Wide::EMPTY);
    let (low, high) = halves(boxes);
    let [(a, b), (c, d)] = [low, high].map(halves);
    for (i, part) in [a, b, c, d].into_iter().filter(|part| !part.is_empty()).enumerate() {
        let mut bounds = Aabb::EMPTY;
        part.iter().for_each(|(own, _)| bounds.merge(own));
        let below = over(part, nodes);
        nodes[place].put(i, &bounds.min, &bounds.max, below);
    }
    place as u32
}

fn halves(boxes: &mut [Boxed]) -> (&mut [Boxed], &mut [Boxed]) {
    // Sums, not means: only their order counts. Halves, so that none is too large.
    let middle = |bounds: &Aabb, axis: usize| 0.5 * bounds.min[axis] + 0.5 * bounds.max[axis];
    let mut middles = Aabb::EMPTY;
    boxes.iter().for_each(|(bounds, _)| middles.add([0, 1, 2].map(|axis| middle(bounds, axis))));
    let size = [0, 1, 2].map(|axis| middles.max[axis] - middles.min[axis]);
    let axis = (1..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
    let half = boxes.len().div_ceil(2);
    if half < boxes.len() {
        boxes.select_nth_unstable_by(half, |a, b| {
            middle(&a.0, axis).total_cmp(&middle(&b.0, axis)).then(a.1.cmp(&b.1))
        });
    }
    boxes.split_at_mut(half)
}
