//! Upload rate: how much a frame can bring to the GPU in a time, by earlier frames.

use std::time::Duration;

/// Bytes that are brought in some time: read, placed, sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rate {
    /// Bytes a second.
    bytes: f64,
}

/// Before anything was measured, bytes a second.
const FIRST: f64 = 400e6;
/// Fewer bytes tell little.
const TELLING: u64 = 64 << 10;
/// The least and the most that any machine is taken for.
const SOUND: (f64, f64) = (4e6, 2e10);

impl Default for Rate {
    fn default() -> Self {
        Rate { bytes: FIRST }
    }
}

impl Rate {
    /// So many bytes took so long.
    pub(super) fn take(&mut self, bytes: u64, time: Duration) {
        let seconds = time.as_secs_f64();
        if bytes >= TELLING && seconds > 0.0 {
            let now = (bytes as f64 / seconds).clamp(SOUND.0, SOUND.1);
            self.bytes += 0.3 * (now - self.bytes);
        }
    }

    /// The bytes for a time.
    pub(super) fn bytes(&self, time: Duration) -> u64 {
        (self.bytes * time.as_secs_f64()) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_follow_what_they_took() {
        let mut rate = Rate::default();
        let ms = Duration::from_millis;
        let first = rate.bytes(ms(10));
        rate.take(100, ms(50));
        assert_eq!(rate.bytes(ms(10)), first, "too few to tell");
        (0..40).for_each(|_| rate.take(1_000_000, ms(10)));
        assert!((990_000..1_020_000).contains(&rate.bytes(ms(10))), "{}", rate.bytes(ms(10)));
        (0..99).for_each(|_| rate.take(u64::MAX, Duration::from_nanos(1)));
        (0..99).for_each(|_| rate.take(TELLING, Duration::from_secs(9)));
        assert!((SOUND.0..1.01 * SOUND.0).contains(&(rate.bytes(Duration::from_secs(1)) as f64)));
        assert_eq!(rate.bytes(Duration::ZERO), 0);
    }
}
