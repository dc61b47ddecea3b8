//! Resource usage of the process, from the operating system. Known on Linux, `None` elsewhere.

use std::fs;

/// The most bytes of physical memory that the process ever held, pages of mapped files included.
pub fn peak_resident() -> Option<u64> {
    field(&fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// Bytes of physical memory that the process holds now, pages of mapped files included.
pub fn resident() -> Option<u64> {
    field(&fs::read_to_string("/proc/self/status").ok()?, "VmRSS:")
}

/// Has every large block of the heap go back to the system as soon as it is freed, where the C library is GNU's: it
/// would else keep what was freed between smaller blocks, and its share would grow with every block that did.
pub fn return_large_blocks() {
    crate::map::map_large_blocks(LARGE_BLOCK);
}

/// Bytes from which a block of the heap is one to be returned.
const LARGE_BLOCK: i32 = 1 << 18;

/// The value of a line `Name:   123 kB`, in bytes.
fn field(text: &str, name: &str) -> Option<u64> {
    let value = text.lines().find_map(|line| line.strip_prefix(name))?;
    value.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Held by tests that look at what is resident: one at a time.
#[cfg(test)]
pub(crate) static WATCHED: std::sync::Mutex<()> = std::sync::Mutex::new(());

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_read_in_kibibytes() {
        let text = "Name:\tx\nVmHWM:\t    1200 kB\nVmRSS:\tmany kB\nThreads:\t3\n";
        assert_eq!(field(text, "VmHWM:"), Some(1200 << 10));
        assert_eq!(field(text, "VmRSS:"), None);
        assert_eq!(field(text, "VmSwap:"), None);
        assert_eq!(field(text, "Threads:"), None, "not a size");
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
