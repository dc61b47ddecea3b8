//! METIS beside itself: the two things that all its calls of a process share, each made safe for calls from several threads.
//!
//! *Random numbers.* METIS draws from the C library's one sequence, through three functions of its own. They are defined here
//! instead, under the same names, with a sequence for each thread; a linker takes these and leaves METIS's where they are.
//!
//! *Signals.* During a call METIS has SIGABRT and SIGTERM jump back into it, since it raises them itself where it cannot go
//! on, and sets back afterwards what it found. Calls that overlap would set back what they found of each other: [`Traps`]
//! sets METIS's handler before the first of them and what was there before after the last one.
//!
//! All else METIS keeps for each thread, but for a compiler that cannot: there calls wait for each other.

use crate::platform::{SignalAction, THREADS_KEEP_VARIABLES};
use crate::sequence::Sequence;
use std::cell::RefCell;
use std::ffi::c_int;
use std::io;
use std::sync::{Mutex, MutexGuard, PoisonError};

// What has METIS in the program, whose handler is named below.
use metis_sys as _;

thread_local! {
    static SEQUENCE: RefCell<Sequence> = RefCell::new(Sequence::new(1));
}

// SAFETY: the name is METIS's own for a function of this type, and no other library has it.
#[unsafe(no_mangle)]
extern "C" fn gk_randinit(seed: u64) {
    SEQUENCE.with_borrow_mut(|sequence| *sequence = Sequence::new(seed as u32));
}

// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn gk_randint32() -> u32 {
    SEQUENCE.with_borrow_mut(Sequence::next)
}

// SAFETY: as above. Only METIS of 64-bit indices asks for it.
#[unsafe(no_mangle)]
extern "C" fn gk_randint64() -> u64 {
    let high = u64::from(gk_randint32());
    high << 32 | u64::from(gk_randint32())
}

unsafe extern "C" {
    /// METIS's handler: goes back to where the call of this thread began.
    safe fn gk_sigthrow(signal: c_int);
}

/// Calls that are running, and what the signals did before the first of them.
static RUNNING: Mutex<(usize, Vec<SignalAction>)> = Mutex::new((0, Vec::new()));

/// Held by the one call that may run where METIS's variables are the process's.
static TURN: Mutex<()> = Mutex::new(());

/// METIS's handlers, set from the first call of those that overlap to the end of the last one. While they are, every call of
/// METIS sets and sets back nothing but what is there.
///
/// With a compiler that has no variables of threads (MinGW's) no two of them are held at once: a second one waits.
#[derive(Debug)]
pub struct Traps {
    _turn: Option<MutexGuard<'static, ()>>,
}

impl Traps {
    /// To be held around a call.
    ///
    /// # Errors
    /// Whatever the system says that does not take a handler.
    pub fn set() -> io::Result<Self> {
        let turn = (!THREADS_KEEP_VARIABLES).then(|| TURN.lock().unwrap_or_else(PoisonError::into_inner));
        let mut running = running();
        // From here on, dropping it sets back what has been set.
        running.0 += 1;
        let traps = Traps { _turn: turn };
        if running.0 == 1 {
            for signal in SignalAction::OF_METIS {
                // SAFETY: the handler is the one that METIS sets itself, for as long as it would.
                let before = unsafe { SignalAction::set(signal, gk_sigthrow) };
                match before {
                    Ok(before) => running.1.push(before),
                    Err(error) => {
                        drop(running);
                        return Err(error);
                    }
                }
            }
        }
        drop(running);
        Ok(traps)
    }
}

impl Drop for Traps {
    fn drop(&mut self) {
        let mut running = running();
        running.0 -= 1;
        if running.0 == 0 {
            for before in running.1.drain(..) {
                // SAFETY: sets back what was set before, by whoever answers for it.
                unsafe { before.restore() };
            }
        }
    }
}

fn running() -> MutexGuard<'static, (usize, Vec<SignalAction>)> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}
