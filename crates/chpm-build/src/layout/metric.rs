//! The cache-oblivious metric (Yoon 6.2.6, equation 6.5).
//!
//! A local permutation changes the spans of some edges of a layout: the number of edges of span l changes by
//! delta |E_l|. With the changed spans in ascending order, l(1) < l(2) < ..., the permutation is expected to save cache misses, for
//! caches of any size, if the sum over j of j * delta |E_l(j)| is negative.

/// The metric's sum for a set of changes (span, delta), in any order; changes of one span are added up. Reorders `changes`.
pub fn expected_change(changes: &mut [(u32, i32)]) -> i64 {
    changes.sort_unstable();
    let mut rank = 0;
    let mut sum = 0;
    for same in changes.chunk_by(|a, b| a.0 == b.0) {
        let delta: i32 = same.iter().map(|c| c.1).sum();
        if delta != 0 {
            rank += 1;
            sum += rank * i64::from(delta);
        }
    }
    sum
}

/// The same sum where every span changes by one, as it does when two neighbours in a layout swap.
///
/// Edges that grow leave a span for the next one: with g(l) for how many more grow than shrink at the shorter span l, delta |E_l| is
/// g(l - 1) - g(l), and those of all spans from l on add up to g(l - 1). A span l adds that to the sum over all ranks if its own delta is
/// not zero, wherever it is in the order; so nothing needs to be sorted.
#[derive(Debug, Default)]
pub struct Steps {
    /// The shorter span of each edge, and +1 if the edge becomes longer, -1 if it becomes shorter.
    all: Vec<(u32, i32)>,
    /// g by span, and which edge is its last; g is zero between two sums.
    grown: Vec<(i32, u32)>,
}

impl Steps {
    /// Makes room for layouts of so many nodes.
    pub fn fit(&mut self, node_count: usize) {
        self.grown.resize(self.grown.len().max(node_count + 1), (0, 0));
    }

    /// Adds an edge.
    #[inline]
    pub fn push(&mut self, span: u32, sign: i32) {
        let (grown, last) = &mut self.grown[span as usize];
        *grown += sign;
        *last = self.all.len() as u32;
        self.all.push((span, sign));
    }

    /// The metric's sum for the edges so far, which are forgotten.
    pub fn expected_change(&mut self) -> i32 {
        let mut sum = 0;
        for (edge, &(span, _)) in (0..).zip(&self.all) {
            let ((grown, last), (next, _)) = (self.grown[span as usize], self.grown[span as usize + 1]);
            let counts = (last == edge) & (grown != next);
            sum += if counts { grown } else { 0 };
        }
        for (span, _) in self.all.drain(..) {
            self.grown[span as usize].0 = 0;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_changes() {
        let mut state = 1u32;
        let mut steps = Steps::default();
        steps.fit(9);
        for _ in 0..1000 {
            let all: Vec<(u32, i32)> = (0..8)
                .map(|_| {
                    state = state.wrapping_mul(1664525).wrapping_add(1013904223);
                    (1 + (state >> 16) % 7, if state >> 31 == 0 { 1 } else { -1 })
                })
                .collect();
            let longer =
                |&(span, sign): &(u32, i32)| if sign > 0 { (span, span + 1) } else { (span + 1, span) };
            let mut changes: Vec<_> =
                all.iter().map(longer).flat_map(|(from, to)| [(from, -1), (to, 1)]).collect();
            all.iter().for_each(|(span, sign)| steps.push(*span, *sign));
            assert_eq!(i64::from(steps.expected_change()), expected_change(&mut changes), "{all:?}");
        }
    }

    #[test]
    fn shorter_spans_are_an_improvement() {
        assert_eq!(expected_change(&mut [(5, -1), (2, 1)]), -1);
        assert_eq!(expected_change(&mut [(2, -1), (5, 1)]), 1);
    }

    #[test]
    fn only_ranks_count_and_equal_spans_cancel() {
        assert_eq!(expected_change(&mut [(5, -1), (2, 1)]), expected_change(&mut [(5000, -1), (2, 1)]));
        assert_eq!(expected_change(&mut [(3, -1), (3, 1)]), 0);
        assert_eq!(expected_change(&mut []), 0);
        // One edge of span 9 and one of span 1 become two of span 4: ranks 1, 2, 3.
        assert_eq!(expected_change(&mut [(9, -1), (1, -1), (4, 1), (4, 1)]), 0);
    }
}
