//! Buffers that each thread of a pool has for itself.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// One value for each thread of a pool, so that what it takes in memory follows their number, however tasks travel.
#[derive(Debug)]
pub(crate) struct PerThread<T>(Vec<Mutex<T>>);

impl<T: Default> PerThread<T> {
    /// Values for the threads of the current pool.
    pub(crate) fn new() -> Self {
        PerThread((0..rayon::current_num_threads()).map(|_| Mutex::default()).collect())
    }

    /// That of this thread. It must be given back before other tasks may run here: they want it, too.
    pub(crate) fn own(&self) -> MutexGuard<'_, T> {
        let thread = rayon::current_thread_index().unwrap_or(0);
        self.0[thread].lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn each_thread_has_its_own() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let sums = pool.install(|| {
            let sums: PerThread<Vec<u32>> = PerThread::new();
            (0..1000_u32).into_par_iter().for_each(|number| sums.own().push(number));
            sums
        });
        assert_eq!(sums.0.len(), 3);
        let mut all: Vec<u32> = sums.0.into_iter().flat_map(|sum| sum.into_inner().unwrap()).collect();
        all.sort_unstable();
        assert_eq!(all, (0..1000).collect::<Vec<_>>());
    }
}
