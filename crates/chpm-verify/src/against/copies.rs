//! The comparison where the file tells that copies of triangles were left out: every triangle that the source has is in the leaves, at
//! most as often, and all that are missing together are as many as the file tells.
//!
//! Hashes of both sides go to buckets, which are in memory or on disk, and each bucket is sorted by itself.

use super::{BUCKETS, bucket};
use chpm_extmem::{Buckets, ExtmemError, Store};

/// Buckets of hashes.
const COUNT: usize = 1 << 12;
/// Bytes that a bucket gathers.
const BLOCK: usize = 1 << 9;
/// Hashes that are remembered, so that a million copies in a row are one record.
const REMEMBERED: usize = 1 << 14;

/// Hashes of triangles, with how often each is there.
pub(super) struct Multiset {
    records: Buckets<[u64; 3]>,
    recent: Vec<(u128, u64)>,
    /// The first record that could not be kept.
    failed: Result<(), ExtmemError>,
}

impl Multiset {
    pub(super) fn new(store: &Store, what: &'static str) -> Self {
        Multiset {
            records: Buckets::new(store, what, COUNT, BLOCK),
            recent: vec![(0, 0); REMEMBERED],
            failed: Ok(()),
        }
    }

    pub(super) fn add(&mut self, hash: u128) {
        let recent = &mut self.recent[hash as usize % REMEMBERED];
        if recent.0 == hash {
            recent.1 += 1;
            return;
        }
        let (hash, count) = std::mem::replace(recent, (hash, 1));
        if self.failed.is_ok() {
            self.failed = put(&mut self.records, hash, count);
        }
    }

    fn finish(mut self) -> Result<Buckets<[u64; 3]>, ExtmemError> {
        self.failed?;
        for (hash, count) in self.recent {
            put(&mut self.records, hash, count)?;
        }
        Ok(self.records)
    }
}

fn put(records: &mut Buckets<[u64; 3]>, hash: u128, count: u64) -> Result<(), ExtmemError> {
    if count > 0 {
        records.push(bucket(hash) / (BUCKETS / COUNT), [(hash >> 64) as u64, hash as u64, count])?;
    }
    Ok(())
}

/// Result of the comparison.
#[derive(PartialEq, Debug, Default)]
pub(super) struct Found {
    /// Buckets, numbered as the sums are, with a triangle that only one side has or the leaves have more often; ascending.
    pub(super) different: Vec<usize>,
    /// Triangles of the source beyond those of the leaves that are the same.
    pub(super) missing: u64,
}

/// Compares the leaves with the source.
pub(super) fn compare(leaves: Multiset, source: Multiset) -> Result<Found, ExtmemError> {
    let (leaves, source) = (leaves.finish()?, source.finish()?);
    let mut found = Found::default();
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for index in 0..COUNT {
        ours.clear();
        theirs.clear();
        leaves.read(index, &mut ours)?;
        source.read(index, &mut theirs)?;
        // Of equal hashes, those of the leaves come first.
        let mut all: Vec<(u128, bool, u64)> = Vec::with_capacity(ours.len() + theirs.len());
        let hash = |[high, low, _]: [u64; 3]| u128::from(high) << 64 | u128::from(low);
        all.extend(ours.iter().map(|record| (hash(*record), false, record[2])));
        all.extend(theirs.iter().map(|record| (hash(*record), true, record[2])));
        all.sort_unstable();
        for same in all.chunk_by(|a, b| a.0 == b.0) {
            let [ours, theirs] = [false, true]
                .map(|side| same.iter().filter(|(_, s, _)| *s == side).map(|(_, _, n)| n).sum::<u64>());
            if ours == 0 || ours > theirs {
                found.different.push(bucket(same[0].0));
            } else {
                found.missing += theirs - ours;
            }
        }
    }
    found.different.dedup();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(store: &Store, hashes: &[(u128, u64)]) -> Multiset {
        let mut set = Multiset::new(store, "hashes");
        for (hash, count) in hashes {
            (0..*count).for_each(|_| set.add(hash << 112 | hash));
        }
        set
    }

    #[test]
    fn copies_may_be_missing_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::create(folder.path(), 1 << 20).unwrap();
        let compared = |leaves: &[(u128, u64)], source: &[(u128, u64)]| {
            compare(set(&store, leaves), set(&store, source)).unwrap()
        };
        let many: Vec<(u128, u64)> = (1..5000).map(|hash| (hash, 3)).collect();
        assert_eq!(compared(&many, &many), Found::default());
        let once: Vec<(u128, u64)> = many.iter().map(|(hash, _)| (*hash, 1)).collect();
        assert_eq!(compared(&once, &many), Found { different: vec![], missing: 2 * 4999 });
        let of = |hash: u128| bucket(hash << 112 | hash);
        assert_eq!(compared(&many, &once).different.len(), 4999, "too many of each");
        assert_eq!(compared(&[(7, 1)], &[(7, 9), (40, 1)]), Found { different: vec![of(40)], missing: 8 });
        assert_eq!(compared(&[(7, 1), (40, 1)], &[(7, 1)]), Found { different: vec![of(40)], missing: 0 });
    }
}
