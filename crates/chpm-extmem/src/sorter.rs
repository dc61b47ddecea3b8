//! Sorting what may not fit in memory: sorted runs in a spool, merged.

use crate::{ExtmemError, Reservation, Spool, Store};
use bytemuck::Pod;
use rayon::slice::ParallelSliceMut;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Bytes of a run: these, or an eighth of the whole budget, or what is left of it; a megabyte even if nothing is.
const RUN: u64 = 128 << 20;
const LEAST_RUN: u64 = 1 << 20;
/// Bytes that the merge reads of a run at once.
const BLOCK: usize = 1 << 16;

/// Takes items in any order.
pub struct Sorter<T> {
    run: Vec<T>,
    capacity: usize,
    share: Option<Reservation>,
    spool: Spool,
    /// Offset and length of each run in the spool, in items.
    runs: Vec<(u64, u64)>,
}

impl<T: Pod + Ord + Send> Sorter<T> {
    /// Nothing yet. A run is as long as the budget of `store` grants; `what` names it.
    pub fn new(store: &Store, what: &'static str) -> Self {
        let mut bytes = RUN.min(store.budget.limit() / 8).max(LEAST_RUN);
        let share = loop {
            match store.budget.try_reserve(what, bytes) {
                Some(share) => break Some(share),
                None if bytes / 2 < LEAST_RUN => break None,
                None => bytes /= 2,
            }
        };
        let capacity = bytes as usize / size_of::<T>();
        Sorter { run: Vec::new(), capacity, share, spool: Spool::new(store, what), runs: Vec::new() }
    }

    /// Takes an item.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn push(&mut self, item: T) -> Result<(), ExtmemError> {
        if self.run.len() == self.capacity {
            self.spill()?;
        }
        self.run.push(item);
        Ok(())
    }

    /// All items in order; equal ones cannot be told apart.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn finish(mut self) -> Result<Sorted<T>, ExtmemError> {
        if self.runs.is_empty() {
            self.run.par_sort_unstable();
            return Ok(Sorted(State::Memory { items: self.run, next: 0, _share: self.share }));
        }
        self.spill()?;
        let Sorter { spool, runs, .. } = self;
        let mut merge = Merge { spool, runs: Vec::new(), heap: BinaryHeap::new(), bytes: Vec::new() };
        for (index, (next, left)) in runs.into_iter().enumerate() {
            merge.runs.push(Run { next, left, block: Vec::new(), at: 0 });
            merge.take(index)?;
        }
        Ok(Sorted(State::Merge(merge)))
    }

    fn spill(&mut self) -> Result<(), ExtmemError> {
        self.run.par_sort_unstable();
        let offset = self.spool.append(bytemuck::cast_slice(&self.run))?;
        self.runs.push((offset, self.run.len() as u64));
        self.run.clear();
        Ok(())
    }
}

/// Hands items out in order.
pub struct Sorted<T>(State<T>);

enum State<T> {
    Memory { items: Vec<T>, next: usize, _share: Option<Reservation> },
    Merge(Merge<T>),
}

/// Runs side by side; the heap holds the next item of each.
struct Merge<T> {
    spool: Spool,
    runs: Vec<Run<T>>,
    heap: BinaryHeap<Reverse<(T, usize)>>,
    bytes: Vec<u8>,
}

struct Run<T> {
    /// Where in the spool the run goes on, and how many items are left there.
    next: u64,
    left: u64,
    block: Vec<T>,
    at: usize,
}

impl<T: Pod + Ord> Sorted<T> {
    /// The next item; none at the end.
    ///
    /// # Errors
    /// Those of the disk.
    #[expect(clippy::should_implement_trait, reason = "it may fail")]
    pub fn next(&mut self) -> Result<Option<T>, ExtmemError> {
        match &mut self.0 {
            State::Memory { items, next, .. } => {
                *next += 1;
                Ok(items.get(*next - 1).copied())
            }
            State::Merge(merge) => {
                let Some(Reverse((item, run))) = merge.heap.pop() else { return Ok(None) };
                merge.take(run)?;
                Ok(Some(item))
            }
        }
    }
}

impl<T: Pod + Ord> Merge<T> {
    /// Puts the next item of a run on the heap, if there is one.
    fn take(&mut self, index: usize) -> Result<(), ExtmemError> {
        let run = &mut self.runs[index];
        if run.at == run.block.len() && run.left > 0 {
            let count = run.left.min((BLOCK / size_of::<T>()) as u64) as usize;
            self.spool.read(run.next, count * size_of::<T>(), &mut self.bytes)?;
            run.block.clear();
            run.block.extend(self.bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned::<T>));
            run.next += self.bytes.len() as u64;
            run.left -= count as u64;
            run.at = 0;
        }
        if let Some(item) = run.block.get(run.at) {
            run.at += 1;
            self.heap.push(Reverse((*item, index)));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(limit: u64, items: &[u64]) -> (usize, Vec<u64>) {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::create(dir.path(), limit).unwrap();
        let mut sorter = Sorter::new(&store, "test");
        items.iter().for_each(|item| sorter.push(*item).unwrap());
        let runs = sorter.runs.len();
        let mut sorted = sorter.finish().unwrap();
        let mut out = Vec::new();
        while let Some(item) = sorted.next().unwrap() {
            out.push(item);
        }
        (runs, out)
    }

    #[test]
    fn any_budget_sorts_alike() {
        let mut items: Vec<u64> =
            (0..300_000u64).map(|i| i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40).collect();
        let (spilled, small) = sorted(0, &items);
        let (kept, large) = sorted(1 << 30, &items);
        items.sort_unstable();
        assert!(spilled >= 2 && kept == 0, "{spilled} {kept}");
        assert!(small == items && large == items);
        assert_eq!(sorted(0, &[]).1, [0u64; 0]);
    }
}
