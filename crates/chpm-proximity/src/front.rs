//! State between one search and the next: pairs of groups that stand for everything together, with a lower bound each. Where the models have moved by
//! some length since, they are nearer by that at most. So a step looks at those alone that may have come near enough to matter.

use crate::pose::Between;
use crate::search::ClosestPoints;
use chpm_mesh::{Aabb, GroupId};
use std::collections::hash_map::Entry;
use std::collections::{BinaryHeap, HashMap};

/// A pair of groups that may be the nearest one.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Pair {
    /// Nothing that they stand for is nearer, now less what has been moved since the front was begun.
    pub(crate) key: f64,
    pub(crate) a: GroupId,
    pub(crate) b: GroupId,
    /// The step in which the tables were asked last.
    pub(crate) asked: u32,
    /// The step in which their meshes were compared last; 0 if never.
    pub(crate) compared: u32,
}

impl Eq for Pair {}

impl Ord for Pair {
    /// The nearest is the greatest; finer ones before coarser ones.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        fn rest(pair: &Pair) -> (GroupId, GroupId, u32, u32) {
            (pair.a, pair.b, pair.compared, pair.asked)
        }
        other.key.total_cmp(&self.key).then_with(|| rest(self).cmp(&rest(other)))
    }
}

impl PartialOrd for Pair {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// Pairs and bounds of two models from earlier poses. It belongs to these two models alone.
#[derive(Debug, Default)]
pub struct Front {
    pub(crate) waiting: BinaryHeap<Pair>,
    /// Pairs that were put there, and how far away it was then known at least what they were reached for.
    known: HashMap<(GroupId, GroupId), f64>,
    between: Option<Between>,
    /// How far the second model has moved since the front was begun, all steps added.
    moved: f64,
    pub(crate) step: u32,
    pub(crate) closest_points: Option<ClosestPoints>,
    /// Pairs that the last search from the roots looked at.
    whole: u64,
    /// The shortest step after which a search from the roots was better.
    far: f64,
}

impl Front {
    /// Nothing is known yet.
    pub fn new() -> Self {
        Front { far: f64::INFINITY, ..Front::default() }
    }

    /// Goes on to a pose; `bounds` are about the second model. Answers how many pairs a step may look at before a search from the roots is
    /// better, or none where that is so already.
    pub(crate) fn follow(&mut self, between: &Between, bounds: &Aabb) -> Option<u64> {
        let before = self.between.replace(*between);
        let step = before.map_or(f64::INFINITY, |before| motion(&before, between, bounds));
        // Few steps have left more than many times what a search from the roots leaves.
        let is_large = self.known.len() as u64 > 16 * self.whole + 1024;
        if step >= self.far || is_large || self.step == u32::MAX || step.is_nan() {
            self.begin();
            return None;
        }
        self.step += 1;
        // Rounded up.
        self.moved = (self.moved + step) * (1.0 + 4.0 * f64::EPSILON);
        Some(2 * self.whole + 64)
    }

    /// Forgets all but where the models were near.
    pub(crate) fn begin(&mut self) {
        self.waiting.clear();
        self.known.clear();
        self.moved = 0.0;
        self.step = 1;
    }

    /// A step was not worth it.
    pub(crate) fn give_up(&mut self, before: &Between, bounds: &Aabb) {
        if let Some(now) = &self.between {
            self.far = self.far.min(motion(before, now, bounds));
        }
        self.begin();
    }

    pub(crate) fn between(&self) -> Option<Between> {
        self.between
    }

    pub(crate) fn pairs(&self) -> usize {
        self.known.len()
    }

    /// A search has ended that looked at so many pairs from the roots on.
    pub(crate) fn is_whole(&mut self, pairs: u64) {
        self.whole = pairs;
    }

    /// Key under which a present bound is kept: rounded down.
    pub(crate) fn key(&self, lower: f64) -> f64 {
        if self.moved == 0.0 { lower } else { (lower + self.moved) * (1.0 - 4.0 * f64::EPSILON) }
    }

    /// Lower bound of a pair by now.
    pub(crate) fn lower(&self, pair: &Pair) -> f64 {
        if self.moved == 0.0 { pair.key } else { pair.key - self.moved - 4.0 * f64::EPSILON * self.moved }
    }

    /// Whether a pair is to wait, being reached for something that is at least so far away. A group can be reached by several ways, each for a part of
    /// what it stands for: what is known of that part is not known of another.
    pub(crate) fn is_new(&mut self, a: GroupId, b: GroupId, lower_bound: f64) -> bool {
        let key = self.key(lower_bound);
        match self.known.entry((a, b)) {
            Entry::Occupied(entry) if *entry.get() <= key => return false,
            Entry::Occupied(mut entry) => *entry.get_mut() = key,
            Entry::Vacant(entry) => _ = entry.insert(key),
        }
        true
    }

    pub(crate) fn put(&mut self, a: GroupId, b: GroupId, lower: f64, compared: u32) {
        self.waiting.push(Pair { key: self.key(lower), a, b, asked: self.step, compared });
    }
}

/// How far a point of a box can have moved at most, what both poses are unsure of included: no further than one of its corners.
fn motion(from: &Between, to: &Between, bounds: &Aabb) -> f64 {
    let (turned, shifted) = (to.rotation - from.rotation, to.translation - from.translation);
    let ways = bounds.corners().map(|corner| (turned * corner.coords + shifted).norm());
    let upper = ways.into_iter().fold(0.0, f64::max);
    (upper + from.margin + to.margin) * (1.0 + 1e-9)
}
