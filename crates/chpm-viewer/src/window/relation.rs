//! How two models lie to each other: what is asked beside the pictures, and answered by whoever knows.

use crate::transform::Transform;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// A second model in the window.
pub struct Second {
    /// A CHPM.
    pub model: PathBuf,
    /// Where the first one is.
    pub first: Transform,
    /// Where this one is, step by step; one at least.
    pub steps: Vec<Transform>,
    /// Who knows about both.
    pub relate: Arc<dyn Relate>,
}

/// Answers questions about two models.
pub trait Relate: Send + Sync {
    /// Answers what is asked at a desk until it is closed, on a thread of its own. Of one step there may be many answers, each better than
    /// the one before.
    fn relate(&self, desk: &Desk);
}

/// Relation of two models at one step. Points are where their places put them.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Relation {
    /// The distance is proven to be between these; the second may be infinite.
    pub distance: [f64; 2],
    /// Two points that are as near as the second one tells, if any are known.
    pub ends: Option<[[f64; 3]; 2]>,
    /// Why it is not known better, or that it is as good as was asked for.
    pub state: String,
    /// Where the models come near, if that was asked for and is known.
    pub regions: Option<Regions>,
}

/// All places where two models come near.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Regions {
    /// How near.
    pub within: f64,
    /// The nearest first.
    pub all: Vec<Region>,
    /// Whether there may be more.
    pub complete: bool,
}

/// One of those.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Region {
    /// A box about it.
    pub low: [f64; 3],
    /// Its largest corner.
    pub high: [f64; 3],
    /// The two nearest points.
    pub ends: [[f64; 3]; 2],
    /// The models' distance in it is proven to be between these.
    pub distance: [f64; 2],
    /// Area of each model.
    pub area: [f64; 2],
    /// Levels of the meshes that were looked at, of each model the coarsest.
    pub levels: [u32; 2],
}

/// Where questions are asked and answered, from two threads.
pub struct Desk {
    state: Mutex<RelationState>,
    /// Something else is wanted.
    bell: Condvar,
    /// Takes the answers.
    hear: Box<dyn Fn(usize, Result<Relation, String>) + Send + Sync>,
}

#[derive(Clone, Copy, Debug, Default)]
struct RelationState {
    wanted: Option<usize>,
    /// The last question that somebody took.
    taken: Option<usize>,
    closed: bool,
}

impl Desk {
    /// Nothing is asked yet.
    pub fn new(hear: impl Fn(usize, Result<Relation, String>) + Send + Sync + 'static) -> Self {
        Desk { state: Mutex::default(), bell: Condvar::new(), hear: Box::new(hear) }
    }

    fn state(&self) -> MutexGuard<'_, RelationState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From now on this step is asked about, and no other.
    pub fn ask(&self, step: usize) {
        self.state().wanted = Some(step);
        self.bell.notify_all();
    }

    /// Nothing is asked any more.
    pub fn close(&self) {
        self.state().closed = true;
        self.bell.notify_all();
    }

    /// Waits for a step that is asked about and that nobody has taken; `None` when the desk is closed.
    pub fn take(&self) -> Option<usize> {
        let mut state = self.state();
        loop {
            if state.closed {
                return None;
            }
            if state.wanted != state.taken {
                state.taken = state.wanted;
                return state.taken;
            }
            state = self.bell.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Whether an answer about a step is of no use any more.
    pub fn is_old(&self, step: usize) -> bool {
        let state = self.state();
        state.closed || state.wanted != Some(step)
    }

    /// Answers about a step, or why there is no answer.
    pub fn tell(&self, step: usize, answer: Result<Relation, String>) {
        if !self.is_old(step) {
            (self.hear)(step, answer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
        desk.tell(2, Ok(Relation::default()));
        assert_eq!(heard.try_iter().collect::<Vec<_>>(), [(2, Ok(Relation::default()))]);
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
}
