//! Errors of a device that come when nobody waits for it.
//!
//! Most commands of a device run later, and by default wgpu panics where one fails. Here the first error is kept, until
//! somebody asks whether all is well.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, Once, OnceLock};

/// The first complaint of a device. It stays: what comes later may be its consequence, and a device that is lost stays lost.
#[derive(Clone, Debug, Default)]
pub struct Fault(Arc<OnceLock<String>>);

impl Fault {
    /// Listens to a device.
    pub fn of(device: &wgpu::Device) -> Self {
        let fault = Fault::default();
        let (refused, lost) = (fault.clone(), fault.clone());
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| refused.note(&error.to_string())));
        device.set_device_lost_callback(move |_, why| lost.note(&format!("the device was lost: {why}")));
        fault
    }

    /// Keeps a complaint, unless there is one.
    pub fn note(&self, complaint: &str) {
        // Only the first one counts.
        let _ = self.0.set(one_line(complaint));
    }

    /// The complaint.
    pub fn get(&self) -> Option<&str> {
        self.0.get().map(String::as_str)
    }
}

/// Message of wgpu in one line instead of many.
pub fn one_line(complaint: &str) -> String {
    let lines = complaint.lines().map(|line| line.trim().trim_end_matches(':'));
    let said = lines.filter(|line| !line.is_empty() && *line != "Caused by");
    said.collect::<Vec<_>>().join(": ").trim_end_matches('.').to_owned()
}

thread_local! {
    /// Whether a panic of this thread is about to become an error.
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Does what panics where the device is lost, as waiting for wgpu does; the panic is the error, and nothing is written about it.
///
/// # Errors
/// What the panic says.
pub fn catch<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !IS_CAUGHT.get() {
                before(info);
            }
        }));
    });
    IS_CAUGHT.set(true);
    let done = panic::catch_unwind(AssertUnwindSafe(work));
    IS_CAUGHT.set(false);
    done.map_err(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        one_line(text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("the driver failed"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_complaint_stays_in_one_line() {
        let fault = Fault::default();
        assert_eq!(fault.get(), None);
        fault.note("Validation Error\n\nCaused by:\n  In a pass, label = 'a'\n    no room.\n");
        fault.note("another");
        assert_eq!(fault.get(), Some("Validation Error: In a pass, label = 'a': no room"));
    }

    #[test]
    fn a_panic_is_an_error() {
        assert_eq!(catch(|| 5), Ok(5));
        assert_eq!(
            catch(|| panic!("lost:\n  its {}", "parent")),
            Err::<(), _>("lost: its parent".to_owned())
        );
        assert_eq!(catch(|| panic!("lost")), Err::<(), _>("lost".to_owned()));
    }
}
