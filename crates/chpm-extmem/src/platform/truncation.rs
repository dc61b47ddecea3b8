//! Truncation of a mapped file: the system answers every access behind its new end with SIGBUS. The handler here maps
//! zeros over the rest of the map and notes it, so that the access goes on and its result can be refused.

use nix::errno::Errno;
use nix::libc::{self, c_int, c_void, siginfo_t};
use nix::sys::signal::{SaFlags, SigAction, SigHandler, SigSet, Signal, raise, sigaction};
use std::ptr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Maps that can be guarded at a time. A map beyond them is not.
const SLOTS: usize = 1024;

/// The addresses of a map, in a place that a signal handler may look at: it must not wait for a lock.
#[derive(Debug)]
struct Slot {
    taken: AtomicBool,
    /// First address; 0 while there is no map.
    start: AtomicUsize,
    end: AtomicUsize,
    cut: AtomicBool,
}

static MAPS: [Slot; SLOTS] = [const {
    Slot {
        taken: AtomicBool::new(false),
        start: AtomicUsize::new(0),
        end: AtomicUsize::new(0),
        cut: AtomicBool::new(false),
    }
}; SLOTS];

/// Signal actions before ours, as a library that is loaded into another program has to keep them; `None` if there is
/// no handler.
static BEFORE: OnceLock<Option<SigAction>> = OnceLock::new();

/// Lets the handler know a map, until it is dropped.
#[derive(Debug)]
pub(crate) struct Guard(&'static Slot);

impl Guard {
    /// `None` if there is no place for one more, or no handler.
    pub(crate) fn of(map: &[u8]) -> Option<Guard> {
        // A signal may come before what was there before is known: then the default is taken for it.
        BEFORE.get_or_init(|| listen().ok()).as_ref()?;
        let slot = MAPS.iter().find(|slot| !slot.taken.swap(true, Ordering::AcqRel))?;
        let start = map.as_ptr().addr();
        slot.cut.store(false, Ordering::Relaxed);
        slot.end.store(start + map.len(), Ordering::Relaxed);
        slot.start.store(start, Ordering::Release);
        Some(Guard(slot))
    }

    /// Whether the handler has mapped zeros over the map.
    pub(crate) fn is_cut(&self) -> bool {
        self.0.cut.load(Ordering::Acquire)
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.0.start.store(0, Ordering::Release);
        self.0.taken.store(false, Ordering::Release);
    }
}

fn listen() -> nix::Result<SigAction> {
    let flags = SaFlags::SA_SIGINFO | SaFlags::SA_ONSTACK;
    let action = SigAction::new(SigHandler::SigAction(on_bus_error), flags, SigSet::empty());
    // SAFETY: the handler calls only what a signal handler may call: it reads and writes atomics and makes system calls.
    unsafe { sigaction(Signal::SIGBUS, &action) }
}

extern "C" fn on_bus_error(_: c_int, info: *mut siginfo_t, _: *mut c_void) {
    let errno = Errno::last_raw();
    // SAFETY: the system passes the signal's information to a handler that was set with SA_SIGINFO.
    let address = unsafe { (*info).si_addr() }.addr();
    if !MAPS.iter().any(|slot| slot.covers(address) && slot.map_zeros(address)) {
        // Not of a map: what would have happened without this handler, once it has returned.
        let default = SigAction::new(SigHandler::SigDfl, SaFlags::empty(), SigSet::empty());
        let before = BEFORE.get().copied().flatten().unwrap_or(default);
        // SAFETY: takes this handler away.
        let _ = unsafe { sigaction(Signal::SIGBUS, &before) };
        let _ = raise(Signal::SIGBUS);
    }
    Errno::set_raw(errno);
}

impl Slot {
    fn covers(&self, address: usize) -> bool {
        let start = self.start.load(Ordering::Acquire);
        start != 0 && (start..self.end.load(Ordering::Relaxed)).contains(&address)
    }

    /// Maps zeros from the page of `address` to the end of the map. `false` if the system refuses.
    fn map_zeros(&self, address: usize) -> bool {
        // Before the zeros can be seen.
        self.cut.store(true, Ordering::Release);
        // SAFETY: asks for a number.
        let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) } as usize;
        let from = address - address % page;
        let len = self.end.load(Ordering::Relaxed) - from;
        let at = ptr::with_exposed_provenance_mut(from);
        let (access, flags) = (libc::PROT_READ, libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED);
        // SAFETY: replaces pages of a map that belongs to a `MappedFile`, which lives while its guard is in the list, by
        // others that can be read as well; the map's own range is kept, and unmapped as a whole when it is dropped.
        let zeros = unsafe { libc::mmap(at, len, access, flags, -1, 0) };
        zeros != libc::MAP_FAILED
    }
}
