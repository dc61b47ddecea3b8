//! Weighted pairs of clusters, summed up while they come: where everything is joined to everything, few pairs come very often.

/// Pairs that may come together before they are summed up.
const LIMIT: usize = 1 << 18;

/// Bytes that it takes to cut a graph of so many pairs: they themselves, the graph, and what METIS copies of it and makes coarser.
pub(crate) const fn graph_bytes(pairs: usize) -> u64 {
    PAIR * pairs as u64
}

const PAIR: u64 = 112;

/// Pairs (a, b) with weights that add up. Memory: three times the pairs that differ, or 3 MiB.
#[derive(Debug, Default)]
pub(crate) struct Pairs {
    list: Vec<(u32, u32, u32)>,
    summed: usize,
}

impl Pairs {
    pub(crate) fn add(&mut self, a: u32, b: u32, weight: u32) {
        // A triangle that joins two joins them by two edges.
        if let Some(last) = self.list.last_mut().filter(|last| (last.0, last.1) == (a, b)) {
            last.2 = last.2.saturating_add(weight);
            return;
        }
        if self.list.len() >= LIMIT.max(2 * self.summed) {
            self.sum();
        }
        self.list.push((a, b, weight));
    }

    /// Takes in those of others.
    pub(crate) fn merge(mut self, mut other: Self) -> Self {
        if self.list.len() < other.list.len() {
            std::mem::swap(&mut self, &mut other);
        }
        other.list.into_iter().for_each(|(a, b, weight)| self.add(a, b, weight));
        self
    }

    /// Each pair once, ascending.
    pub(crate) fn sums(mut self) -> Vec<(u32, u32, u32)> {
        self.sum();
        self.list
    }

    fn sum(&mut self) {
        self.list.sort_unstable_by_key(|(a, b, _)| u64::from(*a) << 32 | u64::from(*b));
        self.list.dedup_by(|next, kept| {
            let same = (next.0, next.1) == (kept.0, kept.1);
            if same {
                kept.2 = kept.2.saturating_add(next.2);
            }
            same
        });
        self.summed = self.list.len();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn weights_add_up_and_memory_follows_the_pairs_that_differ() {
        let mut pairs = Pairs::default();
        let mut plain = BTreeMap::new();
        for i in 0..3 * LIMIT as u32 {
            let (a, b) = (i.wrapping_mul(0x9e37_79b9) >> 28, i.wrapping_mul(0x85eb_ca6b) >> 28);
            pairs.add(a, b, i % 3);
            *plain.entry((a, b)).or_insert(0) += i % 3;
            assert!(pairs.list.len() <= LIMIT);
        }
        let plain: Vec<(u32, u32, u32)> = plain.into_iter().map(|((a, b), weight)| (a, b, weight)).collect();
        assert_eq!(pairs.sums(), plain);
    }
}
