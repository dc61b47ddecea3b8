//! Resource usage of the process, from the operating system; `None` where it does not tell.

pub use crate::platform::{peak_resident, process_time, resident, thread_time};

/// Has every large block of the heap go back to the system as soon as it is freed, where the C library is GNU's: it
/// would else keep what was freed between smaller blocks, and its share would grow with every block that did.
pub fn return_large_blocks() {
    crate::platform::map_large_blocks(LARGE_BLOCK);
}

/// Gives the system back what was freed in smaller blocks, where the C library is GNU's: it keeps that apart for each thread, and one cannot
/// use what another freed.
pub fn return_free_pages() {
    crate::platform::trim_heap();
}

/// Bytes from which a block of the heap is one to be returned.
const LARGE_BLOCK: i32 = 1 << 18;

/// Held by tests that look at what is resident: one at a time.
#[cfg(test)]
pub(crate) static WATCHED: std::sync::Mutex<()> = std::sync::Mutex::new(());

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn the_time_of_a_thread_is_time_of_its_process() {
        let work = || {
            let before = thread_time().unwrap();
            (0..1_000_000).fold(0.0, |sum, _| std::hint::black_box(f64::sqrt(sum + 1.0)));
            thread_time().unwrap() - before
        };
        let before = process_time().unwrap();
        let of_thread = std::thread::spawn(work).join().unwrap();
        let of_process = process_time().unwrap() - before;
        assert!(!of_thread.is_zero() && of_process >= of_thread, "{of_process:?} {of_thread:?}");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn touched_memory_shows() {
        let _alone = WATCHED.lock();
        let before = resident().unwrap();
        let touched = vec![1u8; 32 << 20];
        let during = resident().unwrap();
        assert!(during >= before + (16 << 20), "{before} then {during}");
        assert!(peak_resident().unwrap() >= during);
        assert_eq!(touched[touched.len() / 2], 1);
    }
}
