//! Long work beside Python: it runs in a thread of its own, and the one that asked for it looks after signals and tells progress.

use crate::error::Failure;
use crate::terminations::Terminations;
use chpm_build::BuildProgress;
use chpm_extmem::{Cancel, Progress};
use pyo3::prelude::*;
use std::panic::resume_unwind;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// Between two looks at signals and progress.
const TICK: Duration = Duration::from_millis(50);

/// Where work says how far it is.
#[derive(Default)]
pub(crate) struct Board {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Clone, Default, PartialEq)]
struct State {
    task: String,
    done: u64,
    total: u64,
    has_ended: bool,
}

impl Board {
    fn state(&self) -> MutexGuard<'_, State> {
        // Nobody panics while holding it.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn end_all(&self) {
        self.state().has_ended = true;
        self.changed.notify_all();
    }

    /// Waits for the end of all work, no longer than until the next look is due.
    fn wait(&self) -> State {
        let waited = self.changed.wait_timeout_while(self.state(), TICK, |state| !state.has_ended);
        waited.unwrap_or_else(PoisonError::into_inner).0.clone()
    }
}

impl Progress for Board {
    fn begin(&self, task: &str, total: u64) {
        let mut state = self.state();
        (state.task, state.done, state.total) = (task.to_owned(), 0, total);
    }

    fn advance(&self, done: u64) {
        self.state().done += done;
    }

    fn end(&self) {}
}

impl BuildProgress for Board {}

/// Work whatever ends it, even a panic.
struct Ending<'a>(&'a Board);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.end_all();
    }
}

/// Does `work` without holding Python up. Ctrl-C, SIGTERM and an exception of `progress` ask it to stop, and are raised when it has.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Board, &Cancel) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let (board, cancel) = (Board::default(), Cancel::default());
    let terminations = Terminations::withhold()?;
    let (result, raised) = thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let _ending = Ending(&board);
            work(&board, &cancel)
        });
        let raised = watch(py, progress, &board, &cancel, &terminations);
        (py.detach(|| worker.join()), raised)
    });
    terminations.deliver()?;
    raised?;
    Ok(result.unwrap_or_else(|panic| resume_unwind(panic))?)
}

/// Looks after signals and tells progress until the work has ended. Returns what was raised meanwhile.
fn watch(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    board: &Board,
    cancel: &Cancel,
    terminations: &Terminations,
) -> PyResult<()> {
    let (mut told, mut raised) = (State::default(), Ok(()));
    loop {
        let state = py.detach(|| board.wait());
        if raised.is_ok() {
            raised = py.check_signals();
        }
        if let (Some(progress), true, false) = (progress, raised.is_ok(), state.task.is_empty())
            && (&state.task, state.done, state.total) != (&told.task, told.done, told.total)
        {
            // What is counted is not always known beforehand to the last unit.
            let done = state.done.min(state.total);
            raised = progress.call1((&state.task, done, state.total)).map(drop);
            told = state.clone();
        }
        if raised.is_err() || terminations.is_any() {
            cancel.cancel();
        }
        if state.has_ended {
            return raised;
        }
    }
}
