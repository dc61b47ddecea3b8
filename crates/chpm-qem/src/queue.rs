//! The vertices in the order in which they may go.

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

/// Children of an entry of the heap: with four, an entry that goes down takes half as many steps as with two, and each step compares side by
/// side.
const CHILDREN: usize = 4;

/// A heap of entries, the largest first.
#[derive(Debug, Default)]
pub(crate) struct Queue(Vec<Entry>);

impl Queue {
    /// Refills the queue.
    pub(crate) fn refill(&mut self, entries: impl FnOnce(&mut Vec<Entry>)) {
        self.0.clear();
        entries(&mut self.0);
        for place in (0..self.0.len().div_ceil(CHILDREN)).rev() {
            self.sink(place, self.0[place]);
        }
    }

    pub(crate) fn push(&mut self, entry: Entry) {
        self.0.push(entry);
        self.rise(self.0.len() - 1, 0, entry);
    }

    pub(crate) fn pop(&mut self) -> Option<Entry> {
        let last = self.0.pop()?;
        let Some(top) = self.0.first().copied() else { return Some(last) };
        self.sink(0, last);
        Some(top)
    }

    /// The cost of the next entry; infinite if there is none.
    pub(crate) fn next_cost(&self) -> f32 {
        self.0.first().map_or(f32::INFINITY, |e| e.cost())
    }

    /// Puts an entry at a place or below it: the largest children move up, all the way, and it rises from there. Few rise far.
    fn sink(&mut self, top: usize, entry: Entry) {
        let all = &mut self.0[..];
        let mut hole = top;
        while let Some([a, b, c, d]) = all.get(CHILDREN * hole + 1..).and_then(<[Entry]>::first_chunk) {
            let (low, high) = (a.max(b), c.max(d));
            let (of_low, of_high) = (usize::from(b > a), 2 + usize::from(d > c));
            let (largest, child) = if high > low { (*high, of_high) } else { (*low, of_low) };
            all[hole] = largest;
            hole = CHILDREN * hole + 1 + child;
        }
        let last = CHILDREN * hole + 1..all.len();
        if let Some(child) = last.max_by_key(|child| all[*child]) {
            all[hole] = all[child];
            hole = child;
        }
        self.rise(hole, top, entry);
    }

    /// Puts an entry at a free place or above it, not above `top`.
    fn rise(&mut self, mut hole: usize, top: usize, entry: Entry) {
        let all = &mut self.0[..];
        while hole > top {
            let parent = (hole - 1) / CHILDREN;
            if all[parent] >= entry {
                break;
            }
            all[hole] = all[parent];
            hole = parent;
        }
        all[hole] = entry;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BinaryHeap;

    #[test]
    fn entries_come_in_order_whenever_they_were_put_in() {
        let mut state = 1u32;
        let mut chance = |below: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % below
        };
        for count in 0..40 {
            let mut queue = Queue::default();
            let mut plain = BinaryHeap::new();
            let entries: Vec<Entry> =
                (0..count).map(|_| Entry::new(chance(30) as f32, chance(9) as u16)).collect();
            queue.refill(|all| all.extend_from_slice(&entries));
            plain.extend(entries);
            for _ in 0..200 {
                if chance(3) == 0 {
                    let entry = Entry::bounded(chance(30) as f32, chance(9) as u16);
                    queue.push(entry);
                    plain.push(entry);
                } else {
                    assert_eq!(queue.pop(), plain.pop());
                }
                assert_eq!(queue.next_cost(), plain.peek().map_or(f32::INFINITY, |e| e.cost()));
            }
        }
    }
}
