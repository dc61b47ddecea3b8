//! A stream that notes that it was read to its end: the codec takes what is missing for zeros.

use std::fmt;
use std::io::{self, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

pub(super) struct Ended<R> {
    bytes: R,
    has_ended: Arc<AtomicBool>,
}

impl<R> Ended<R> {
    /// The stream, and where it notes its end.
    pub(super) fn new(bytes: R) -> (Self, Arc<AtomicBool>) {
        let has_ended = Arc::new(AtomicBool::new(false));
        (Ended { bytes, has_ended: Arc::clone(&has_ended) }, has_ended)
    }
}

impl<R: Read> Read for Ended<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.bytes.read(out)?;
        if count == 0 && !out.is_empty() {
            self.has_ended.store(true, Relaxed);
        }
        Ok(count)
    }
}

impl<R> fmt::Debug for Ended<R> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Ended")
    }
}
