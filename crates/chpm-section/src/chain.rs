//! Chains: things with two ends each, joined where ends have the same key.

use std::cmp::Ordering;

/// A thing of a chain, and whether it is passed from its second end to its first.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Link {
    pub(crate) index: usize,
    pub(crate) is_turned: bool,
}

/// An end: the thing's number, and which of its two.
pub(crate) type End = (usize, usize);

/// No end.
const NONE: u32 = u32::MAX;

/// Joins things into chains, as few as there can be, and hands each to `take`, with whether it is closed. Ends without a key stay open. Of more than two ends
/// with one key, first ends go with second ones as far as there are such, in the order that `compare` gives them; of an odd number one stays open. First ends go
/// with first ones, and second ones with each other, only where none elsewhere can have the key (`waits`).
pub(crate) fn chains<K: Ord + Copy>(
    ends: &[[Option<K>; 2]],
    waits: impl Fn(K) -> bool,
    compare: impl Fn(End, End) -> Ordering,
    mut take: impl FnMut(&[Link], bool),
) {
    let partner = partners(ends, waits, compare);
    let mut is_done = vec![false; ends.len()];
    let mut chain = Vec::new();
    let open = |end: &usize| partner[*end] == NONE;
    // Open chains from where they begin, if they have a beginning; the rest are rings.
    let begins = (0..ends.len()).map(|index| 2 * index).filter(open);
    let turned = (0..ends.len()).map(|index| 2 * index + 1).filter(open);
    let rings = (0..ends.len()).map(|index| 2 * index);

    for start in begins.chain(turned).chain(rings) {
        if is_done[start / 2] {
            continue;
        }
        chain.clear();
        let mut end = start;
        let is_closed = loop {
            let (index, side) = (end / 2, end % 2);
            is_done[index] = true;
            chain.push(Link { index, is_turned: side == 1 });
            match partner[end ^ 1] {
                NONE => break false,
                next if next as usize == start => break true,
                next => end = next as usize,
            }
        };
        take(&chain, is_closed);
    }
}

/// By end, twice the thing's number and one more for its second end: the end that it is joined with.
fn partners<K: Ord + Copy>(
    ends: &[[Option<K>; 2]],
    waits: impl Fn(K) -> bool,
    compare: impl Fn(End, End) -> Ordering,
) -> Vec<u32> {
    let mut keyed: Vec<(K, u32)> = Vec::with_capacity(2 * ends.len());
    for (index, sides) in ends.iter().enumerate() {
        for (side, key) in sides.iter().enumerate() {
            keyed.extend(key.map(|key| (key, (2 * index + side) as u32)));
        }
    }
    keyed.sort_unstable();

    let mut partner = vec![NONE; 2 * ends.len()];
    let mut join = |a: u32, b: u32| {
        partner[a as usize] = b;
        partner[b as usize] = a;
    };
    for group in keyed.chunk_by(|a, b| a.0 == b.0) {
        match group {
            [] | [_] => {}
            [(_, a), (_, b)] if a % 2 != b % 2 => join(*a, *b),
            [(key, _), ..] => {
                let mut all: Vec<End> =
                    group.iter().map(|(_, end)| (*end as usize / 2, *end as usize % 2)).collect();
                all.sort_by(|a, b| a.1.cmp(&b.1).then_with(|| compare(*a, *b)));
                let all: Vec<u32> = all.iter().map(|(index, side)| (2 * index + side) as u32).collect();
                let (first, second) = all.split_at(all.partition_point(|end| end % 2 == 0));
                first.iter().zip(second).for_each(|(a, b)| join(*a, *b));
                if waits(*key) {
                    continue;
                }
                let both = first.len().min(second.len());
                for rest in [&first[both..], &second[both..]] {
                    rest.chunks_exact(2).for_each(|pair| join(pair[0], pair[1]));
                }
            }
        }
    }
    partner
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(ends: &[[u32; 2]]) -> Vec<(Vec<(usize, bool)>, bool)> {
        let keys: Vec<[Option<u32>; 2]> = ends.iter().map(|ends| ends.map(Some)).collect();
        let mut found = Vec::new();
        chains(
            &keys,
            |key| key >= 100,
            |a, b| a.cmp(&b),
            |chain, is_closed| {
                found.push((chain.iter().map(|link| (link.index, link.is_turned)).collect(), is_closed));
            },
        );
        found
    }

    #[test]
    fn chains_are_open_or_closed() {
        assert_eq!(of(&[[1, 2], [0, 1], [2, 3]]), [(vec![(1, false), (0, false), (2, false)], false)]);
        assert_eq!(of(&[[1, 2], [2, 1]]), [(vec![(0, false), (1, false)], true)]);
        // The second one lies the other way round.
        assert_eq!(of(&[[1, 2], [1, 2]]), [(vec![(0, false), (1, true)], true)]);
        assert_eq!(of(&[[5, 5]]), [(vec![(0, false)], true)]);
        assert_eq!(of(&[]), []);
    }

    #[test]
    fn ends_pair_up_where_many_meet() {
        // Two rings that meet in 0: whatever goes with what, nothing is open.
        let rings = of(&[[0, 1], [1, 0], [0, 2], [2, 0]]);
        assert!(rings.iter().all(|(_, is_closed)| *is_closed), "{rings:?}");
        // Three ends of which none begins: two go together.
        let three = of(&[[1, 0], [2, 0], [3, 0]]);
        assert_eq!(three, [(vec![(0, false), (1, true)], false), (vec![(2, false)], false)]);
        // Those that somebody else may have wait for an end of the other kind.
        assert_eq!(of(&[[100, 1], [100, 2]]), [(vec![(0, false)], false), (vec![(1, false)], false)]);
        assert_eq!(of(&[[100, 1], [2, 100]]), [(vec![(1, false), (0, false)], false)]);
    }
}
