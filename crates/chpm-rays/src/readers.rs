//! Threads that read pages side by side: no more than there is memory for, however many cast rays.

use crate::error::RayError;
use rayon::prelude::*;

/// How many pages are in the making at a time.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Readers(usize);

impl Readers {
    /// Bytes of a page in the making, with its boxes, at most.
    pub(crate) const EACH: u64 = 12 << 20;

    /// One for each thread, whatever they take.
    pub(crate) const ALL: Readers = Readers(usize::MAX);

    /// One, and as many more as find room, up to one for each thread.
    pub(crate) fn within(room: u64, threads: usize) -> Self {
        Readers((1 + (room / Self::EACH) as usize).min(threads.max(1)))
    }

    /// Bytes of all but the first.
    pub(crate) fn more(self) -> u64 {
        (self.0 as u64 - 1) * Self::EACH
    }

    /// Reads each, on the threads of rayon's current pool; answers are in the order of what is read.
    pub(crate) fn read<T: Sync, R: Send>(
        self,
        from: &[T],
        read: impl Fn(&T) -> Result<R, RayError> + Sync,
    ) -> Result<Vec<R>, RayError> {
        let at_once = if self.0 < rayon::current_num_threads() { self.0 } else { from.len().max(1) };
        let mut made = Vec::with_capacity(from.len());
        for some in from.chunks(at_once) {
            made.extend(some.par_iter().map(&read).collect::<Result<Vec<R>, RayError>>()?);
        }
        Ok(made)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

    #[test]
    fn pages_in_the_making_are_no_more_than_find_room() {
        assert_eq!(Readers::within(0, 8), Readers(1));
        assert_eq!(Readers::within(3 * Readers::EACH, 8), Readers(4));
        assert_eq!(Readers::within(3 * Readers::EACH, 2), Readers(2));
        assert_eq!(Readers(4).more(), 3 * Readers::EACH);

        let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let double = |n: &usize| {
            most.fetch_max(now.fetch_add(1, SeqCst) + 1, SeqCst);
            std::thread::sleep(std::time::Duration::from_millis(1));
            now.fetch_sub(1, SeqCst);
            if *n == 40 { Err(RayError::Stopped) } else { Ok(2 * n) }
        };
        let numbers: Vec<usize> = (0..40).collect();
        let made = pool.install(|| Readers(3).read(&numbers, double)).unwrap();
        assert_eq!(made, (0..40).map(|n| 2 * n).collect::<Vec<_>>());
        assert!((2..=3).contains(&most.load(SeqCst)), "{most:?}");
        assert!(pool.install(|| Readers(3).read(&[1, 40, 2], double)).is_err());
        assert!(pool.install(|| Readers::ALL.read(&numbers, double)).is_ok());
    }
}
