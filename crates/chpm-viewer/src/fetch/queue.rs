//! Queue of pages: wanted, being read, and there; the order of reading and the room for it, without threads.

use super::Arrival;
use chpm_mesh::ClusterId;
use std::collections::BTreeSet;

/// How soon a page is needed; what is more urgent comes first.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Urgency {
    /// By the view that is.
    Wanted,
    /// By one that may come.
    Ahead,
}

/// Where a page is on its way.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Stage {
    /// Nobody has asked for it, or it was handed out.
    Idle,
    /// Asked for; its key in the queue.
    Queued(Urgency, u64),
    /// A thread reads it.
    Reading,
    /// A thread reads it in vain.
    TakenBack,
    /// To be handed out.
    Arrived,
}

/// Pages on their way, at most one request for each.
#[derive(Debug)]
pub(super) struct Queue {
    /// Bytes of each page.
    lens: Vec<u64>,
    stages: Vec<Stage>,
    /// By urgency, then by the order of asking.
    queued: BTreeSet<(Urgency, u64, ClusterId)>,
    asked: u64,
    arrived: Vec<Arrival>,
    reading: usize,
    taken_back: usize,
    budget: u64,
    held: u64,
    peak: u64,
    closed: bool,
}

impl Queue {
    pub(super) fn new(lens: Vec<u64>, budget: u64) -> Self {
        Queue {
            stages: vec![Stage::Idle; lens.len()],
            lens,
            queued: BTreeSet::new(),
            asked: 0,
            arrived: Vec::new(),
            reading: 0,
            taken_back: 0,
            budget,
            held: 0,
            peak: 0,
            closed: false,
        }
    }

    /// Puts a request into the queue, or forward in it; answers whether there is something new to read.
    pub(super) fn request(&mut self, cluster: ClusterId, urgency: Urgency) -> bool {
        let stage = &mut self.stages[cluster.index()];
        match *stage {
            Stage::Queued(before, key) if urgency < before => {
                self.queued.remove(&(before, key, cluster));
            }
            Stage::TakenBack => {
                *stage = Stage::Reading;
                self.taken_back -= 1;
                return false;
            }
            Stage::Queued(..) | Stage::Reading | Stage::Arrived => return false,
            Stage::Idle => {}
        }
        self.asked += 1;
        *stage = Stage::Queued(urgency, self.asked);
        self.queued.insert((urgency, self.asked, cluster));
        true
    }

    /// Forgets a request. What had arrived for it is answered, to be dropped by the caller.
    pub(super) fn evict(&mut self, cluster: ClusterId) -> Option<Arrival> {
        let stage = &mut self.stages[cluster.index()];
        match *stage {
            Stage::Queued(urgency, key) => {
                self.queued.remove(&(urgency, key, cluster));
                *stage = Stage::Idle;
            }
            Stage::Reading => {
                *stage = Stage::TakenBack;
                self.taken_back += 1;
            }
            Stage::Arrived => {
                *stage = Stage::Idle;
                let place = self.arrived.iter().position(|(id, _)| *id == cluster);
                return place.map(|place| self.arrived.swap_remove(place));
            }
            Stage::Idle | Stage::TakenBack => {}
        }
        None
    }

    /// Whether the first in the queue finds room. Nobody overtakes it: a large page would wait for ever.
    fn next(&self) -> Option<(Urgency, u64, ClusterId)> {
        let next = self.queued.first().copied();
        next.filter(|(.., cluster)| self.held + self.lens[cluster.index()] <= self.budget)
    }

    /// Takes the first in the queue, if there is room for it; answers it and the one behind it.
    pub(super) fn start(&mut self) -> Option<(ClusterId, Option<ClusterId>)> {
        let key = self.next()?;
        self.queued.remove(&key);
        let (.., cluster) = key;
        self.stages[cluster.index()] = Stage::Reading;
        self.reading += 1;
        self.held += self.lens[cluster.index()];
        self.peak = self.peak.max(self.held);
        Some((cluster, self.queued.first().map(|(.., cluster)| *cluster)))
    }

    /// A page was read. It is answered if nobody wants it any more, to be dropped by the caller.
    pub(super) fn finish(&mut self, arrival: Arrival) -> Option<Arrival> {
        let stage = &mut self.stages[arrival.0.index()];
        self.reading -= 1;
        if *stage == Stage::TakenBack {
            *stage = Stage::Idle;
            self.taken_back -= 1;
            return Some(arrival);
        }
        *stage = Stage::Arrived;
        self.arrived.push(arrival);
        None
    }

    pub(super) fn take_arrived(&mut self) -> Vec<Arrival> {
        let mut arrived = std::mem::take(&mut self.arrived);
        arrived.sort_by_key(|(cluster, _)| *cluster);
        for (cluster, _) in &arrived {
            self.stages[cluster.index()] = Stage::Idle;
        }
        arrived
    }

    /// Whether something is being read, or will be without anybody's help.
    pub(super) fn is_moving(&self) -> bool {
        !self.closed && (self.reading > 0 || self.next().is_some())
    }

    pub(super) fn give_back(&mut self, bytes: u64) {
        self.held -= bytes;
    }

    pub(super) fn close(&mut self) {
        self.closed = true;
    }

    pub(super) fn is_closed(&self) -> bool {
        self.closed
    }
}

/// Access for tests and measurements.
#[cfg(feature = "internals")]
impl Queue {
    /// Requests that have not arrived.
    pub(super) fn pending(&self) -> usize {
        self.queued.len() + self.reading - self.taken_back
    }

    pub(super) fn held(&self) -> u64 {
        self.held
    }

    pub(super) fn peak(&self) -> u64 {
        self.peak
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Urgency::{Ahead, Wanted};

    fn page(n: u32) -> ClusterId {
        ClusterId(n)
    }

    /// A failed read, which is as good as a page here.
    fn read(n: u32) -> Arrival {
        (page(n), Err(crate::ViewerError::Thread(std::io::ErrorKind::Other.into())))
    }

    fn order(queue: &mut Queue) -> Vec<u32> {
        std::iter::from_fn(|| queue.start()).map(|(cluster, _)| cluster.0).collect()
    }

    #[test]
    fn what_is_wanted_overtakes_what_is_read_ahead() {
        let mut queue = Queue::new(vec![1; 10], 100);
        for (n, urgency) in [(5, Ahead), (3, Ahead), (7, Wanted), (1, Wanted), (3, Wanted), (7, Ahead)] {
            queue.request(page(n), urgency);
        }
        assert_eq!(queue.pending(), 4);
        assert_eq!(order(&mut queue), [7, 1, 3, 5]);
    }

    #[test]
    fn the_first_waits_for_room_and_nobody_passes() {
        let mut queue = Queue::new(vec![4, 7, 1], 10);
        for n in 0..3 {
            assert!(queue.request(page(n), Wanted));
        }
        assert_eq!(queue.start(), Some((page(0), Some(page(1)))));
        assert_eq!(queue.start(), None, "4 + 7 > 10");
        assert!(queue.is_moving(), "one is being read");
        assert!(queue.finish(read(0)).is_none());
        assert!(!queue.is_moving());
        queue.give_back(4);
        assert_eq!(order(&mut queue), [1, 2]);
        assert_eq!((queue.held(), queue.peak()), (8, 8));
    }

    #[test]
    fn a_request_can_be_taken_back_at_any_stage() {
        let mut queue = Queue::new(vec![1; 4], 10);
        let ask = |queue: &mut Queue| queue.request(page(2), Wanted);
        // In the queue.
        assert!(ask(&mut queue));
        assert!(queue.evict(page(2)).is_none() && queue.pending() == 0);
        // While it is read.
        assert!(ask(&mut queue) && queue.start().is_some());
        assert!(queue.evict(page(2)).is_none() && queue.pending() == 0 && queue.is_moving());
        assert!(queue.finish(read(2)).is_some() && queue.take_arrived().is_empty());
        // While it is read, and asked for again.
        assert!(ask(&mut queue) && queue.start().is_some());
        queue.evict(page(2));
        assert!(!ask(&mut queue), "it is on its way");
        assert!(queue.finish(read(2)).is_none());
        // When it is there.
        assert!(!ask(&mut queue));
        assert!(queue.evict(page(2)).is_some() && queue.take_arrived().is_empty());
        // And from anew.
        assert!(ask(&mut queue));
    }

    #[test]
    fn arrivals_are_in_the_order_of_clusters() {
        let mut queue = Queue::new(vec![1; 4], 10);
        for n in [2, 0, 3] {
            queue.request(page(n), Wanted);
        }
        assert_eq!(order(&mut queue), [2, 0, 3]);
        for n in [3, 2, 0] {
            queue.finish(read(n));
        }
        let ids: Vec<u32> = queue.take_arrived().iter().map(|(id, _)| id.0).collect();
        assert_eq!(ids, [0, 2, 3]);
        assert!(queue.take_arrived().is_empty() && queue.pending() == 0);
    }
}
