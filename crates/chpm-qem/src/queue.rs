//! The vertices in the order in which they may go.

use std::collections::BinaryHeap;

/// A vertex in the queue: cheapest first, then the smallest index. The costs are not negative.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct Entry(u64);

impl Entry {
    pub(crate) fn new(cost: f32, vertex: u16) -> Self {
        Entry(!(u64::from(cost.to_bits()) << 32 | u64::from(vertex)))
    }

    /// At the price of a forced collapse; behind a legal one of the same cost.
    pub(crate) fn offer(cost: f32, vertex: u16) -> Self {
        Entry(!(u64::from(cost.to_bits()) << 32 | 1 << 16 | u64::from(vertex)))
    }

    pub(crate) fn is_offer(self) -> bool {
        !self.0 >> 16 & 1 == 1
    }

    pub(crate) fn vertex(self) -> u16 {
        !self.0 as u16
    }

    fn cost(self) -> f32 {
        f32::from_bits((!self.0 >> 32) as u32)
    }
}

/// A heap of entries.
#[derive(Debug, Default)]
pub(crate) struct Queue(BinaryHeap<Entry>);

impl Queue {
    /// Refills the queue.
    pub(crate) fn refill(&mut self, entries: impl FnOnce(&mut Vec<Entry>)) {
        let mut all = std::mem::take(&mut self.0).into_vec();
        all.clear();
        entries(&mut all);
        self.0 = BinaryHeap::from(all);
    }

    pub(crate) fn push(&mut self, entry: Entry) {
        self.0.push(entry);
    }

    pub(crate) fn pop(&mut self) -> Option<Entry> {
        self.0.pop()
    }

    /// The cost of the next entry; infinite if there is none.
    pub(crate) fn next_cost(&self) -> f32 {
        self.0.peek().map_or(f32::INFINITY, |e| e.cost())
    }
}
