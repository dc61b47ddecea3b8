//! The cache-oblivious metric (Yoon 6.2.6, equation 6.5).
//!
//! A local permutation changes the spans of some edges of a layout: the number of edges of span l changes by
//! delta |E_l|. With the changed spans in ascending order, l(1) < l(2) < ..., the permutation is expected to save cache misses, for
//! caches of any size, if the sum over j of j * delta |E_l(j)| is negative.

/// The metric's sum for a set of changes (span, delta), in any order; changes of one span are added up. Reorders `changes`.
pub(super) fn expected_change(changes: &mut [(u32, i32)]) -> i64 {
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

#[cfg(test)]
mod tests {
    use super::*;

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
