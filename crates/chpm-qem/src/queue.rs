//! The vertices in the order in which they may go.

use std::collections::BinaryHeap;

/// A vertex in the queue: cheapest first, then the smallest index. The costs are not negative.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct Entry(u64);

/// Kinds of cost, in the order in which equal ones come up.
const GUESS: u64 = 0;
const BOUND: u64 = 1;
const OFFER: u64 = 2;

impl Entry {
    /// At a guess.
    pub(crate) fn new(cost: f32, vertex: u16) -> Self {
        Self::of(cost, GUESS, vertex)
    }

    /// At the price that its bound gave.
    pub(crate) fn bounded(cost: f32, vertex: u16) -> Self {
        Self::of(cost, BOUND, vertex)
    }

    /// At the price of a forced collapse.
    pub(crate) fn offer(cost: f32, vertex: u16) -> Self {
        Self::of(cost, OFFER, vertex)
    }

    fn of(cost: f32, kind: u64, vertex: u16) -> Self {
        Entry(!(u64::from(cost.to_bits()) << 32 | kind << 16 | u64::from(vertex)))
    }

    fn kind(self) -> u64 {
        !self.0 >> 16 & 3
    }

    pub(crate) fn is_guess(self) -> bool {
        self.kind() == GUESS
    }

    pub(crate) fn is_bound(self) -> bool {
        self.kind() == BOUND
    }

    pub(crate) fn is_offer(self) -> bool {
        self.kind() == OFFER
    }

    pub(crate) fn vertex(self) -> u16 {
        !self.0 as u16
    }

    pub(crate) fn cost(self) -> f32 {
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
