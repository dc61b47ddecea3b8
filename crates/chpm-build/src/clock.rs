//! When the next checkpoint is due: all that stages have to know of checkpoints.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A checkpoint waits for so many times what the last one took, beyond its interval.
const INTERVAL_BY_COST: u32 = 30;

/// Counts from the last checkpoint on.
#[derive(Debug)]
pub(crate) struct Clock {
    /// None: nothing is ever due.
    every: Option<Duration>,
    last: Mutex<Last>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    at: Instant,
    /// Time that it took.
    cost: Duration,
}

impl Clock {
    /// Begins to count; `every` is the least time between two checkpoints.
    pub(crate) fn new(every: Option<Duration>) -> Self {
        Clock { every, last: Mutex::new(Last { at: Instant::now(), cost: Duration::ZERO }) }
    }

    /// Whether it is time: later, but not twice as late, where checkpoints take long.
    pub(crate) fn is_due(&self) -> bool {
        self.every.is_some_and(|every| {
            let Last { at, cost } = *self.last.lock().unwrap_or_else(PoisonError::into_inner);
            at.elapsed() >= every + every.min(INTERVAL_BY_COST * cost)
        })
    }

    /// Counts from now on, after a checkpoint that was begun then.
    pub(crate) fn restart(&self, begun: Instant) {
        let now = Last { at: Instant::now(), cost: begun.elapsed() };
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = now;
    }
}
