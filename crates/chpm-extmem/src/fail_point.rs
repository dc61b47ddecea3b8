//! Fail points: one access to a file fails, or the process ends there. All of this crate's files pass one before they are
//! created, opened, read, written, extended, synced or renamed.

use crate::platform::{end_process, error_of_device, error_of_full_disk};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Planned failures of file accesses; none by default. Clones count together.
///
/// ```
/// use chpm_extmem::FailPoints;
///
/// let fail_points = FailPoints::fail_at(1, true);
/// assert!(fail_points.access().is_ok());
/// assert_eq!(fail_points.access().unwrap_err().kind(), std::io::ErrorKind::StorageFull);
/// ```
#[derive(Clone, Debug, Default)]
pub struct FailPoints(Option<Arc<Armed>>);

#[derive(Debug)]
struct Armed {
    /// The access that it happens at; the first one is 0.
    at: u64,
    seen: AtomicU64,
    outcome: Outcome,
}

#[derive(Debug)]
enum Outcome {
    FullDisk,
    BadDevice,
    End,
}

impl FailPoints {
    /// The access of this number, the first one being 0, fails: with a full disk if `full`, else with a fault of the device.
    pub fn fail_at(at: u64, full: bool) -> Self {
        Self::armed(at, if full { Outcome::FullDisk } else { Outcome::BadDevice })
    }

    /// The process ends at the access of this number, without a chance to clean up.
    pub fn kill_at(at: u64) -> Self {
        Self::armed(at, Outcome::End)
    }

    fn armed(at: u64, outcome: Outcome) -> Self {
        FailPoints(Some(Arc::new(Armed { at, seen: AtomicU64::new(0), outcome })))
    }

    /// Accesses up to now; 0 where nothing is to go wrong, since then none is counted.
    pub fn seen(&self) -> u64 {
        self.0.as_ref().map_or(0, |armed| armed.seen.load(Relaxed))
    }

    /// To be called before each access to a file.
    ///
    /// # Errors
    /// The fault, when its time has come.
    #[inline]
    pub fn access(&self) -> io::Result<()> {
        match &self.0 {
            None => Ok(()),
            Some(armed) => armed.access(),
        }
    }
}

impl Armed {
    fn access(&self) -> io::Result<()> {
        if self.seen.fetch_add(1, Relaxed) != self.at {
            return Ok(());
        }
        Err(match self.outcome {
            Outcome::FullDisk => error_of_full_disk(),
            Outcome::BadDevice => error_of_device(),
            Outcome::End => end_process(),
        })
    }
}

/// The same faults, counted together.
impl PartialEq for FailPoints {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (None, None) => true,
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_chosen_access_fails() {
        for (full, kind) in [(true, io::ErrorKind::StorageFull), (false, io::ErrorKind::Other)] {
            let fail_points = FailPoints::fail_at(2, full);
            let clone = fail_points.clone();
            assert!(fail_points.access().is_ok() && clone.access().is_ok());
            let error = fail_points.access().unwrap_err();
            assert!(if full {
                error.kind() == kind
            } else {
                error.raw_os_error() == error_of_device().raw_os_error()
            });
            assert!(clone.access().is_ok());
            assert_eq!(
                (fail_points.seen(), fail_points == clone, fail_points == FailPoints::default()),
                (4, true, false)
            );
        }
        assert!(FailPoints::default().access().is_ok());
    }
}
