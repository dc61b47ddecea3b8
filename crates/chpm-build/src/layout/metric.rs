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

/// The same sum where every span changes by one, as it does when two neighbours in a layout swap: `steps` holds, for each edge
/// that changes, the shorter of its two spans and +1 if the edge becomes longer, -1 if it becomes shorter. Reorders `steps`.
pub fn expected_change_of_steps(steps: &mut [(u32, i32)]) -> i64 {
    steps.sort_unstable_by_key(|s| s.0);
    let (mut rank, mut sum) = (0, 0);
    let mut count = |delta: i32| {
        rank += i64::from(delta != 0);
        sum += rank * i64::from(delta);
    };
    // Edges that grow leave `span` for the next one: the gain of one span is the loss of the span before.
    let (mut at, mut carried) = (u32::MAX, 0);
    for same in steps.chunk_by(|a, b| a.0 == b.0) {
        let (span, grown) = (same[0].0, same.iter().map(|s| s.1).sum::<i32>());
        if span != at {
            count(carried);
            carried = 0;
        }
        count(carried - grown);
        (at, carried) = (span + 1, grown);
    }
    count(carried);
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_changes() {
        let mut state = 1u32;
        for _ in 0..1000 {
            let steps: Vec<(u32, i32)> = (0..8)
                .map(|_| {
                    state = state.wrapping_mul(1664525).wrapping_add(1013904223);
                    (1 + (state >> 16) % 7, if state >> 31 == 0 { 1 } else { -1 })
                })
                .collect();
            let longer =
                |&(span, sign): &(u32, i32)| if sign > 0 { (span, span + 1) } else { (span + 1, span) };
            let mut changes: Vec<_> =
                steps.iter().map(longer).flat_map(|(from, to)| [(from, -1), (to, 1)]).collect();
            assert_eq!(
                expected_change_of_steps(&mut steps.clone()),
                expected_change(&mut changes),
                "{steps:?}"
            );
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
