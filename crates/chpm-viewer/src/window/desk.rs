//! Where the window asks what takes a while, and another thread answers.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Questions, of which only the last one counts, and answers.
pub struct Desk<Q, A> {
    state: Mutex<DeskState<Q>>,
    /// Something else is wanted.
    bell: Condvar,
    /// Takes the answers.
    hear: Hear<Q, A>,
}

type Hear<Q, A> = Box<dyn Fn(Q, Result<A, String>) + Send + Sync>;

#[derive(Clone, Copy, Debug)]
struct DeskState<Q> {
    wanted: Option<Q>,
    /// The last question that somebody took.
    taken: Option<Q>,
    closed: bool,
}

impl<Q: Copy + PartialEq, A> Desk<Q, A> {
    /// Nothing is asked yet.
    pub fn new(hear: impl Fn(Q, Result<A, String>) + Send + Sync + 'static) -> Self {
        let state = DeskState { wanted: None, taken: None, closed: false };
        Desk { state: Mutex::new(state), bell: Condvar::new(), hear: Box::new(hear) }
    }

    fn state(&self) -> MutexGuard<'_, DeskState<Q>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From now on this is asked, and nothing else.
    pub fn ask(&self, question: Q) {
        self.state().wanted = Some(question);
        self.bell.notify_all();
    }

    /// Nothing is asked until the next question, even if it is the last one again.
    pub fn rest(&self) {
        let mut state = self.state();
        (state.wanted, state.taken) = (None, None);
    }

    /// Nothing is asked any more.
    pub fn close(&self) {
        self.state().closed = true;
        self.bell.notify_all();
    }

    /// Waits for a question that nobody has taken; `None` when the desk is closed.
    pub fn take(&self) -> Option<Q> {
        let mut state = self.state();
        loop {
            if state.closed {
                return None;
            }
            if state.wanted.is_some() && state.wanted != state.taken {
                state.taken = state.wanted;
                return state.taken;
            }
            state = self.bell.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Whether an answer to a question is of no use any more.
    pub fn is_old(&self, question: Q) -> bool {
        let state = self.state();
        state.closed || state.wanted != Some(question)
    }

    /// Answers a question, or tells why there is no answer.
    pub fn tell(&self, question: Q, answer: Result<A, String>) {
        if !self.is_old(question) {
            (self.hear)(question, answer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::mpsc::channel;
    use std::thread;

    #[test]
    fn a_desk_has_the_last_question_and_takes_no_answers_to_others() {
        let (sender, heard) = channel();
        let desk = Arc::new(Desk::new(move |step, answer| drop(sender.send((step, answer)))));
        desk.ask(1);
        desk.ask(2);
        assert_eq!(desk.take(), Some(2));
        assert!(desk.is_old(1) && !desk.is_old(2));
        desk.tell(1, Err("late".to_owned()));
        desk.tell(2, Ok("now"));
        assert_eq!(heard.try_iter().collect::<Vec<_>>(), [(2, Ok("now"))]);
        // Who waits hears of the next one, and of the end.
        let waiting = {
            let desk = Arc::clone(&desk);
            thread::spawn(move || [desk.take(), desk.take()])
        };
        desk.ask(7);
        while desk.state().taken != Some(7) {
            thread::yield_now();
        }
        desk.close();
        assert_eq!(waiting.join().unwrap(), [Some(7), None]);
        assert!(desk.is_old(7));
    }

    #[test]
    fn what_was_given_up_can_be_asked_again() {
        let (sender, heard) = channel();
        let desk = Desk::new(move |step: u8, answer: Result<(), String>| drop(sender.send((step, answer))));
        desk.ask(1);
        assert_eq!(desk.take(), Some(1));
        desk.rest();
        desk.tell(1, Ok(()));
        assert_eq!(heard.try_iter().count(), 0, "nobody asks");
        desk.ask(1);
        assert_eq!(desk.take(), Some(1));
        desk.tell(1, Ok(()));
        assert_eq!(heard.try_iter().collect::<Vec<_>>(), [(1, Ok(()))]);
    }
}
