//! Proposals of vertices that were put back into the queue, for when they come up unchanged.

use crate::displacement::Displaced;

/// Proposals by vertex: the collapse, and what it leaves behind.
#[derive(Debug, Default)]
pub(crate) struct Kept {
    slots: Vec<Slot>,
    arena: Vec<Displaced>,
}

/// A collapse to v within a bound at a price, and where its displacements are in the arena; none are there if it was not kept.
#[derive(Clone, Copy, Debug, Default)]
struct Slot {
    bound: f64,
    price: f32,
    start: u32,
    count: u16,
    v: u16,
}

impl Kept {
    /// Forgets the last patch.
    pub(crate) fn clear(&mut self, vertex_count: usize) {
        self.arena.clear();
        self.slots.clear();
        self.slots.resize(vertex_count, Slot::default());
    }

    /// Keeps the displacements after u -> v. They take the place of those that were kept before, if there is room.
    pub(crate) fn keep(&mut self, u: u16, v: u16, bound: f64, price: f32, displacements: &[Displaced]) {
        let slot = &mut self.slots[usize::from(u)];
        let room = usize::from(slot.count);
        if displacements.len() > room {
            slot.start = self.arena.len() as u32;
            self.arena.extend_from_slice(displacements);
        } else {
            self.arena[slot.start as usize..][..displacements.len()].copy_from_slice(displacements);
        }
        (slot.bound, slot.price, slot.count, slot.v) = (bound, price, displacements.len() as u16, v);
    }

    /// Forgets what was kept of u.
    pub(crate) fn forget(&mut self, u: u16) {
        self.slots[usize::from(u)].count = 0;
    }

    /// The proposal that u was queued with at this price: target, bound, and displacements. A vertex that is in the queue
    /// twice may come up at a price that was another proposal's.
    pub(crate) fn at_price(&self, u: u16, price: f32) -> Option<(u16, f64, &[Displaced])> {
        let slot = self.slots[usize::from(u)];
        let displacements = &self.arena[slot.start as usize..][..usize::from(slot.count)];
        (slot.count > 0 && slot.price == price).then_some((slot.v, slot.bound, displacements))
    }
}
