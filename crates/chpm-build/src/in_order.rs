//! Independent jobs on some of the threads, their results taken in the order of the jobs.

use crate::context::Context;
use crate::error::BuildError;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// Makes `count` results on at most `workers` threads of the current pool and hands them to `take`, the first one first. So
/// at most `workers` jobs hold memory at one time, and what they leave does not depend on which was faster.
pub(crate) fn in_order<R: Send>(
    count: usize,
    workers: usize,
    make: impl Fn(usize) -> Result<R, BuildError> + Sync,
    take: impl FnMut(R) -> Result<(), BuildError> + Send,
) -> Result<(), BuildError> {
    let next = AtomicUsize::new(0);
    let taker = Mutex::new(Taker { take, waiting: BTreeMap::new(), next: 0, result: Ok(()) });
    let lock = || taker.lock().unwrap_or_else(PoisonError::into_inner);
    rayon::broadcast(|worker| {
        if worker.index() >= workers.max(1) {
            return;
        }
        loop {
            let job = next.fetch_add(1, Relaxed);
            if job >= count || lock().result.is_err() {
                return;
            }
            let result = make(job);
            lock().give(job, result);
        }
    });
    taker.into_inner().unwrap_or_else(PoisonError::into_inner).result
}

/// Does jobs on all threads of the current pool, each begun in its order, until all are done or a checkpoint is due; at least one by each
/// thread. Answers the results of those that were begun, which are the first ones. Threads wait only for what is begun when
/// the time comes, and where it does not come for nothing.
pub(crate) fn while_not_due<S, R: Send>(
    count: usize,
    context: &Context<'_>,
    scratch: impl Fn() -> S + Sync,
    make: impl Fn(&mut S, usize) -> Result<R, BuildError> + Sync,
) -> Result<Vec<R>, BuildError> {
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let phase = context.trace.phase();

    let by_thread = rayon::broadcast(|_| {
        let (mut scratch, mut made) = (scratch(), Vec::new());
        loop {
            let job = next.fetch_add(1, Relaxed);
            if job >= count || failed.load(Relaxed) {
                return Ok(made);
            }
            let traced = phase.task("group");
            let result = context.check().and_then(|()| make(&mut scratch, job));
            drop(traced);
            match result {
                Ok(result) => made.push((job, result)),
                Err(error) => {
                    failed.store(true, Relaxed);
                    return Err(error);
                }
            }
            if context.clock.is_due() {
                return Ok(made);
            }
        }
    });

    let mut all = Vec::new();
    for made in by_thread {
        all.extend(made?);
    }
    all.sort_unstable_by_key(|(job, _)| *job);
    Ok(all.into_iter().map(|(_, result)| result).collect())
}

struct Taker<R, F> {
    take: F,
    /// Results that came before an earlier one.
    waiting: BTreeMap<usize, R>,
    next: usize,
    result: Result<(), BuildError>,
}

impl<R, F: FnMut(R) -> Result<(), BuildError>> Taker<R, F> {
    fn give(&mut self, job: usize, result: Result<R, BuildError>) {
        if self.result.is_err() {
            return;
        }
        match result {
            Ok(result) => self.waiting.insert(job, result),
            Err(error) => return self.result = Err(error),
        };
        while let Some(result) = self.waiting.remove(&self.next) {
            self.next += 1;
            if let Err(error) = (self.take)(result) {
                return self.result = Err(error);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order_and_an_error_ends_it() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        for workers in [1, 3, 9] {
            let mut taken = Vec::new();
            let slow = |job: usize| Ok((0..(job * 7919) % 50_000).fold(job, |x, y| x ^ (y & 1)) / 2);
            let all = pool.install(|| {
                in_order(200, workers, slow, |x| {
                    taken.push(x);
                    Ok(())
                })
            });
            assert!(all.is_ok());
            assert_eq!(taken, (0..200).map(|job| slow(job).unwrap()).collect::<Vec<_>>());
        }

        let fails = |job: usize| if job == 60 { Err(BuildError::Cancelled) } else { Ok(job) };
        let mut last = 0;
        let result = pool.install(|| {
            in_order(10_000, 4, fails, |x| {
                last = x;
                Ok(())
            })
        });
        assert!(matches!(result, Err(BuildError::Cancelled)) && last < 60, "{last}");
    }
}
