//! Records that many clusters list about the same vertices, brought together in memory that is bounded: as many vertices at a time as
//! fit, in as many passes as it takes.

use std::ops::Range;

/// Something that a cluster lists about the vertex `id`.
pub(super) trait Record: Ord + Copy {
    /// The vertex, or an end of it.
    fn id(&self) -> u32;
    /// Sorts records, and drops what says nothing more however many may come.
    fn settle(records: &mut Vec<Self>);
}

/// The records of a range of vertices.
pub(super) struct Ledger<R> {
    records: Vec<R>,
    range: Range<u64>,
    limit: usize,
}

const IDS: u64 = 1 << 32;

impl<R: Record> Ledger<R> {
    /// A ledger of about `bytes`, which begins at the first vertex.
    pub(super) fn new(bytes: u64) -> Self {
        let limit = (bytes / size_of::<R>() as u64).clamp(1 << 10, 1 << 31) as usize;
        Ledger { records: Vec::new(), range: 0..IDS, limit }
    }

    /// Takes a record in, unless it is about a vertex of another pass.
    pub(super) fn add(&mut self, record: R) {
        if !self.range.contains(&u64::from(record.id())) {
            return;
        }
        if self.records.len() >= self.limit {
            self.make_room();
            return self.add(record);
        }
        self.records.push(record);
    }

    /// Leaves half of the memory free, if need be by leaving the later vertices to the next pass.
    fn make_room(&mut self) {
        R::settle(&mut self.records);
        if self.records.len() > self.limit / 2 {
            let middle = u64::from(self.records[self.records.len() / 2].id());
            self.range.end = middle.max(self.range.start + 1);
            self.records.truncate(self.records.partition_point(|r| u64::from(r.id()) < self.range.end));
        }
        // So many records of one vertex cannot be parted.
        self.limit = self.limit.max(2 * self.records.len());
    }

    /// Records of this pass that are left.
    pub(super) fn settled(&mut self) -> &[R] {
        R::settle(&mut self.records);
        &self.records
    }

    /// Goes on to the vertices of the next pass; false after the last one.
    pub(super) fn next_pass(&mut self) -> bool {
        self.records.clear();
        self.range = self.range.end..IDS;
        !self.range.is_empty()
    }

    /// Goes back to the first vertex.
    pub(super) fn restart(&mut self) {
        self.records.clear();
        self.range = 0..IDS;
    }
}

#[cfg(test)]
mod tests {
    use super::super::local::keep_odd;
    use super::*;

    impl Record for [u32; 2] {
        fn id(&self) -> u32 {
            self[0]
        }
        fn settle(records: &mut Vec<Self>) {
            keep_odd(records, |record| *record);
        }
    }

    #[test]
    fn any_memory_gives_the_same_records() {
        let all: Vec<[u32; 2]> = (0..60_000u32).map(|i| [i * 7919 % 5003, i % 11]).collect();
        let mut expected = all.clone();
        keep_odd(&mut expected, |record| *record);
        for (bytes, least) in [(0, 10), (100_000, 2), (1 << 30, 1)] {
            let mut ledger = Ledger::new(bytes);
            for _ in 0..2 {
                let (mut found, mut passes) = (Vec::new(), 0);
                loop {
                    passes += 1;
                    all.iter().for_each(|record| ledger.add(*record));
                    found.extend_from_slice(ledger.settled());
                    assert!(ledger.records.capacity() <= (bytes as usize / 8).max(1 << 10) * 2);
                    if !ledger.next_pass() {
                        break;
                    }
                }
                assert_eq!(found, expected, "{bytes} bytes");
                assert!(passes >= least && (bytes < 1 << 30 || passes == 1), "{passes} passes");
                ledger.restart();
            }
        }
    }

    #[test]
    fn one_vertex_of_many_records_is_not_parted() {
        let mut ledger = Ledger::new(0);
        let mut found = Vec::new();
        loop {
            (0..50_000).for_each(|i| ledger.add([7, i]));
            ledger.add([u32::MAX, 0]);
            found.extend_from_slice(ledger.settled());
            if !ledger.next_pass() {
                break;
            }
        }
        assert_eq!(found.len(), 50_001);
    }
}
