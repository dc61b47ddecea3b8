//! The memory budget: whoever keeps a large array reserves its memory first and gives it back by dropping.

use crate::ExtmemError;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};

/// A limit in bytes on what is reserved at any one time, shared by all threads.
///
/// Arrays, which may also spill to disk, reserve memory up to a first limit ([`Self::reserve`]). Work that cannot spill reserves
/// up to a second, higher one ([`Self::reserve_work`]); tasks of many wait for each other ([`Self::reserve_task`]). Where work does not
/// fit beside arrays, those that can move to disk do. It counts reservations; it measures nothing. See [`crate::process`] for what the process really uses.
///
/// ```
/// use chpm_extmem::MemoryBudget;
///
/// let budget = MemoryBudget::new(1 << 20);
/// let reservation = budget.reserve("positions", 1 << 19)?;
/// assert!(budget.try_reserve("normals", 1 << 20).is_none());
/// drop(reservation);
/// assert_eq!((budget.used(), budget.peak()), (0, 1 << 19));
/// # Ok::<(), chpm_extmem::ExtmemError>(())
/// ```
#[derive(Debug)]
pub struct MemoryBudget {
    limit: u64,
    work_limit: u64,
    used: AtomicU64,
    /// Bytes that work holds.
    work: AtomicU64,
    peak: AtomicU64,
    /// Tasks that hold a reservation and will give it back.
    tasks: Mutex<usize>,
    given_back: Condvar,
    /// Arrays that have memory and can do without, the oldest first.
    movable: Mutex<Vec<Weak<dyn Movable>>>,
}

/// An array that can go on on disk.
pub(crate) trait Movable: std::fmt::Debug + Send + Sync {
    /// Moves all of it there, and gives back what it has reserved.
    fn move_to_disk(&self) -> Result<(), ExtmemError>;
}

/// Why bytes are taken.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Kind {
    Array,
    Work,
}

impl MemoryBudget {
    /// A budget of `limit_bytes` for arrays, nothing of it in use, and without limit for work.
    pub fn new(limit_bytes: u64) -> Arc<Self> {
        Self::with_work_limit(limit_bytes, u64::MAX)
    }

    /// A budget of `limit_bytes` for arrays and `work_limit_bytes` for arrays and work together.
    pub fn with_work_limit(limit_bytes: u64, work_limit_bytes: u64) -> Arc<Self> {
        Arc::new(MemoryBudget {
            limit: limit_bytes,
            work_limit: work_limit_bytes,
            used: AtomicU64::new(0),
            work: AtomicU64::new(0),
            peak: AtomicU64::new(0),
            tasks: Mutex::new(0),
            given_back: Condvar::new(),
            movable: Mutex::default(),
        })
    }

    /// Reserves `bytes` until the reservation is dropped.
    ///
    /// # Errors
    /// [`ExtmemError::Budget`] when less than `bytes` is left.
    pub fn reserve(self: &Arc<Self>, what: &'static str, bytes: u64) -> Result<Reservation, ExtmemError> {
        self.hold(what, bytes, Kind::Array)
    }

    /// Reserves `bytes` for work that cannot spill, until the reservation is dropped. Arrays get so much less, and
    /// spools move to disk where it does not fit beside them.
    ///
    /// # Errors
    /// [`ExtmemError::Budget`] when that is more than all of the budget; what moving to disk fails with.
    pub fn reserve_work(
        self: &Arc<Self>,
        what: &'static str,
        bytes: u64,
    ) -> Result<Reservation, ExtmemError> {
        self.hold(what, bytes, Kind::Work)
    }

    /// Reserves `bytes` for one of several tasks side by side: where they do not fit beside what the others hold, waits until those have
    /// given back.
    ///
    /// # Errors
    /// [`ExtmemError::Budget`] when it does not fit although no other task holds anything.
    pub fn reserve_task(
        self: &Arc<Self>,
        what: &'static str,
        bytes: u64,
    ) -> Result<TaskReservation, ExtmemError> {
        let mut tasks = self.tasks();
        loop {
            match self.reserve_work(what, bytes) {
                Ok(reservation) => {
                    *tasks += 1;
                    return Ok(TaskReservation(Some(reservation)));
                }
                Err(error) if *tasks == 0 => return Err(error),
                Err(_) => tasks = self.given_back.wait(tasks).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }

    fn tasks(&self) -> MutexGuard<'_, usize> {
        self.tasks.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn hold(
        self: &Arc<Self>,
        what: &'static str,
        bytes: u64,
        kind: Kind,
    ) -> Result<Reservation, ExtmemError> {
        self.take_or_move(what, bytes, kind)?;
        Ok(Reservation { budget: Arc::clone(self), what, bytes, kind })
    }

    /// Bytes that work may still reserve.
    pub fn available_for_work(&self) -> u64 {
        self.work_limit.saturating_sub(self.used())
    }

    /// Like [`Self::reserve`], for callers that have another place to go.
    pub fn try_reserve(self: &Arc<Self>, what: &'static str, bytes: u64) -> Option<Reservation> {
        self.reserve(what, bytes).ok()
    }

    /// Bytes reserved now.
    pub fn used(&self) -> u64 {
        self.used.load(Relaxed)
    }

    /// The most bytes that were reserved at once.
    pub fn peak(&self) -> u64 {
        self.peak.load(Relaxed)
    }

    /// The limit for arrays in bytes.
    pub fn limit(&self) -> u64 {
        self.limit
    }

    /// Bytes that may still be reserved.
    pub fn available(&self) -> u64 {
        self.limit.saturating_sub(self.used())
    }

    /// Has an array of its memory moved to disk when work needs it.
    pub(crate) fn register(&self, array: Weak<dyn Movable>) {
        let mut movable = self.movable.lock().unwrap_or_else(PoisonError::into_inner);
        movable.retain(|array| array.strong_count() > 0);
        movable.push(array);
    }

    /// Takes `bytes`; where they are for work and do not fit, one array after another makes room.
    fn take_or_move(&self, what: &'static str, bytes: u64, kind: Kind) -> Result<(), ExtmemError> {
        let refused = self.take(what, bytes, kind);
        if refused.is_ok() || kind == Kind::Array || bytes > self.work_limit {
            return refused;
        }
        // No lock is held while an array moves: it may be waiting for one that asks here.
        let arrays = self.movable.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for array in arrays.iter().filter_map(Weak::upgrade) {
            array.move_to_disk()?;
            if self.take(what, bytes, kind).is_ok() {
                return Ok(());
            }
        }
        self.take(what, bytes, kind)
    }

    fn take(&self, what: &'static str, bytes: u64, kind: Kind) -> Result<(), ExtmemError> {
        let limit = if kind == Kind::Work { self.work_limit } else { self.limit };
        // The counters order no other memory, so relaxed operations suffice.
        let fits = |used: u64| used.checked_add(bytes).filter(|&sum| sum <= limit);
        match self.used.fetch_update(Relaxed, Relaxed, fits) {
            Ok(before) => {
                self.peak.fetch_max(before + bytes, Relaxed);
                if kind == Kind::Work {
                    self.work.fetch_add(bytes, Relaxed);
                }
                Ok(())
            }
            Err(used) => {
                let work = if kind == Kind::Work { self.work.load(Relaxed).saturating_add(bytes) } else { 0 };
                let enough = used.saturating_add(bytes);
                Err(ExtmemError::Budget { what, asked: bytes, used, limit, work, enough })
            }
        }
    }

    fn give(&self, bytes: u64, kind: Kind) {
        if kind == Kind::Work {
            self.work.fetch_sub(bytes, Relaxed);
        }
        self.used.fetch_sub(bytes, Relaxed);
    }
}

/// Reserved bytes of a [`MemoryBudget`], given back when dropped.
#[derive(Debug)]
pub struct Reservation {
    budget: Arc<MemoryBudget>,
    what: &'static str,
    bytes: u64,
    kind: Kind,
}

/// Memory of a task out of a [`MemoryBudget`]; given back when it is dropped.
#[derive(Debug)]
pub struct TaskReservation(Option<Reservation>);

impl Drop for TaskReservation {
    fn drop(&mut self) {
        if let Some(reservation) = self.0.take() {
            let budget = Arc::clone(&reservation.budget);
            drop(reservation);
            *budget.tasks() -= 1;
            budget.given_back.notify_all();
        }
    }
}

impl Reservation {
    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Grows or shrinks the reservation to `bytes`; it is unchanged if that fails.
    ///
    /// # Errors
    /// [`ExtmemError::Budget`] when the budget cannot grant the difference.
    pub fn resize(&mut self, bytes: u64) -> Result<(), ExtmemError> {
        match bytes.checked_sub(self.bytes) {
            // Nothing more is needed, also where work left arrays nothing.
            Some(0) => {}
            Some(more) => self.budget.take_or_move(self.what, more, self.kind)?,
            None => self.budget.give(self.bytes - bytes, self.kind),
        }
        self.bytes = bytes;
        Ok(())
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.budget.give(self.bytes, self.kind);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn reservations_end_at_the_limit() {
        let budget = MemoryBudget::new(100);
        let first = budget.reserve("first", 60).unwrap();
        assert!(budget.try_reserve("second", 41).is_none());
        let second = budget.reserve("second", 40).unwrap();
        assert_eq!((budget.used(), budget.available(), budget.peak()), (100, 0, 100));
        drop(first);
        assert_eq!((budget.used(), budget.peak(), budget.limit()), (40, 100, 100));
        drop(second);
        assert_eq!(budget.used(), 0);
    }

    #[test]
    fn work_comes_first_and_has_its_own_limit() {
        let budget = MemoryBudget::with_work_limit(100, 150);
        let mut array = budget.reserve("array", 80).unwrap();
        let mut work = budget.reserve_work("work", 60).unwrap();
        assert!(array.resize(80).is_ok() && array.resize(81).is_err());
        assert_eq!((budget.used(), budget.available(), budget.available_for_work()), (140, 0, 10));
        assert!(budget.try_reserve("array", 1).is_none() && budget.reserve_work("more", 11).is_err());
        work.resize(70).unwrap();
        assert!(work.resize(71).is_err());
        drop(array);
        assert_eq!((budget.available(), budget.available_for_work(), budget.peak()), (30, 80, 150));
    }

    #[test]
    fn a_task_waits_for_another_and_fails_where_none_would_give_back() {
        let budget = MemoryBudget::with_work_limit(0, 100);
        let order = Mutex::new(Vec::new());
        let first = budget.reserve_task("task", 70).unwrap();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let second = budget.reserve_task("task", 60).unwrap();
                order.lock().unwrap().push("second began");
                assert_eq!(budget.used(), 60);
                drop(second);
            });
            order.lock().unwrap().push("first ends");
            drop(first);
        });
        assert_eq!(*order.lock().unwrap(), ["first ends", "second began"]);
        let _kept = budget.reserve_work("tables", 50).unwrap();
        match budget.reserve_task("task", 60).unwrap_err() {
            ExtmemError::Budget { asked: 60, used: 50, work: 110, .. } => {}
            other => panic!("{other}"),
        }
    }

    #[test]
    fn a_refusal_says_what_how_much_and_the_remedy() {
        let budget = MemoryBudget::new(4 << 20);
        let _held = budget.reserve("vertices", 3 << 20).unwrap();
        let text = budget.reserve("faces", 2 << 20).unwrap_err().to_string();
        assert_eq!(
            text,
            "no memory for faces: 2.0 MiB asked, 3.0 MiB of 4.0 MiB in use; raise --memory to at least 5.0 MiB"
        );
        assert!(budget.reserve("everything", u64::MAX).is_err(), "the sum overflows");
    }

    #[test]
    fn resizing_fails_whole_or_succeeds_whole() {
        let budget = MemoryBudget::new(100);
        let mut share = budget.reserve("array", 10).unwrap();
        share.resize(100).unwrap();
        assert!(share.resize(101).is_err());
        assert_eq!((share.bytes(), budget.used()), (100, 100));
        share.resize(5).unwrap();
        assert_eq!((share.bytes(), budget.used()), (5, 5));
    }

    #[test]
    fn threads_never_exceed_the_limit_together() {
        let budget = MemoryBudget::new(1000);
        std::thread::scope(|scope| {
            for bytes in [300, 400, 700, 250] {
                let budget = &budget;
                scope.spawn(move || {
                    for _ in 0..2000 {
                        let share = budget.try_reserve("thread", bytes);
                        assert!(budget.used() <= 1000);
                        drop(share);
                    }
                });
            }
        });
        assert_eq!(budget.used(), 0);
        // Which of them meet is up to the system: that one was let in is certain.
        assert!((250..=1000).contains(&budget.peak()));
    }

    proptest! {
        /// Against a plain sum over the shares that are alive.
        #[test]
        fn used_is_the_sum_of_what_is_held(asks in prop::collection::vec((0u64..60, any::<bool>()), 0..60)) {
            let budget = MemoryBudget::new(200);
            let mut held: Vec<Reservation> = Vec::new();
            for (bytes, release) in asks {
                if release && !held.is_empty() {
                    held.remove(bytes as usize % held.len());
                }
                let sum: u64 = held.iter().map(Reservation::bytes).sum();
                match budget.try_reserve("share", bytes) {
                    Some(share) => held.push(share),
                    None => prop_assert!(sum + bytes > 200),
                }
                prop_assert_eq!(budget.used(), held.iter().map(Reservation::bytes).sum::<u64>());
            }
        }
    }
}
