//! The distance of two models: pairs of groups, the nearest first, until the answer is as narrow as it has to be.

use crate::error::ProximityError;
use crate::model::{Model, Reads};
use crate::pose::{Between, Pose};
use crate::triangle::Near;
use chpm_mesh::{ClusterId, GroupId};
use std::collections::hash_map::Entry;
use std::collections::{BinaryHeap, HashMap};

/// What is asked.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Question {
    /// The interval may be this wide, object units.
    pub error: f64,
    /// Whether the models are farther apart than this is all that is to be known.
    pub above: Option<f64>,
    /// Pairs of groups that may wait; with more, the answer is what is proven by then.
    pub most_pairs: usize,
}

/// Why a search ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum End {
    /// The interval is as narrow as was asked for, or decides what was asked.
    Decided,
    /// At the triangles of the source: nothing narrows it further but more digits.
    Exact,
    /// The caller had enough.
    Stopped,
    /// More pairs would have to wait than may.
    Crowded,
}

/// Two points that are as near as the upper end of the interval tells, up to the errors of the meshes that they are on.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Witness {
    /// On the meshes, where their poses put them.
    pub points: [[f64; 3]; 2],
    /// How far the source is from each at most.
    pub errors: [f64; 2],
    /// Levels of the meshes; at 0 they are the source's triangles.
    pub levels: [u32; 2],
    /// The clusters.
    pub clusters: [ClusterId; 2],
    /// Which of their triangles.
    pub triangles: [u32; 2],
}

/// A distance that is proven to be in an interval.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Answer {
    /// The sources are nowhere nearer.
    pub least: f64,
    /// Somewhere they are as near as this; infinite where no triangles have been compared.
    pub most: f64,
    /// Where.
    pub witness: Option<Witness>,
    /// Why it is not narrower.
    pub end: End,
    /// What was read for it, of each model.
    pub reads: [Reads; 2],
    /// Pairs of groups that were looked at.
    pub pairs: u64,
    /// How much of the width is what f64 may have lost, the poses included.
    pub margin: f64,
}

/// A pair of groups that may be the nearest one.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Pair {
    /// Nothing that they stand for is nearer.
    least: f64,
    a: GroupId,
    b: GroupId,
    /// Whether their meshes were compared.
    compared: bool,
}

impl Eq for Pair {}

impl Ord for Pair {
    /// The nearest is the greatest; finer ones before coarser ones.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let key = |pair: &Pair| (pair.a, pair.b, pair.compared);
        other.least.total_cmp(&self.least).then_with(|| key(self).cmp(&key(other)))
    }
}

impl PartialOrd for Pair {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// The distance of two models in their poses. `go_on` is asked before every pair, with what was read so far. `hint` is the witness of an answer to a
/// question like this one.
///
/// # Errors
/// A damaged page; an error that is no length.
pub fn distance<D: AsRef<[u8]>, E: AsRef<[u8]>>(
    a: &Model<'_, D>,
    b: &Model<'_, E>,
    poses: [&Pose; 2],
    question: &Question,
    hint: Option<&Witness>,
    go_on: &mut dyn FnMut(Reads) -> bool,
) -> Result<Answer, ProximityError> {
    for (what, got) in [("error", Some(question.error)), ("distance to stay above", question.above)] {
        if let Some(got) = got.filter(|got| got.is_nan() || *got < 0.0) {
            return Err(ProximityError::Length { what, got });
        }
    }
    let between = Between::new(&a.frame(poses[0]), &b.frame(poses[1]));
    let before = [a.reads(), b.reads()];
    let mut search = Search {
        a,
        b,
        pose: poses[0],
        between,
        question,
        most: f64::INFINITY,
        settled: f64::INFINITY,
        witness: None,
        waiting: BinaryHeap::new(),
        known: HashMap::new(),
        pairs: 0,
    };
    if let Some(hint) = hint {
        search.begin_at(hint)?;
    }
    let end = search.run(before, go_on)?;
    let open = search.waiting.peek().map_or(f64::INFINITY, |pair| pair.least);
    let least = open.min(search.settled).min(search.most).max(0.0);
    let reads = [since(search.a.reads(), before[0]), since(search.b.reads(), before[1])];
    Ok(Answer {
        least,
        most: search.most,
        witness: search.witness,
        end,
        reads,
        pairs: search.pairs,
        margin: between.margin,
    })
}

pub(crate) fn since(now: Reads, before: Reads) -> Reads {
    let bytes = chpm_mesh::Bytes(now.bytes.0 - before.bytes.0);
    Reads { pages: now.pages - before.pages, bytes }
}

/// The points of a pair in the first model's frame, where its pose puts them.
pub(crate) fn witness_of<D: AsRef<[u8]>>(model: &Model<'_, D>, pose: &Pose, near: &Near) -> [[f64; 3]; 2] {
    let origin = nalgebra::Vector3::from(model.file().header().origin);
    [near.a, near.b].map(|point| pose.apply((point + origin).into()))
}

struct Search<'s, 'a, 'b, D, E> {
    a: &'s Model<'a, D>,
    b: &'s Model<'b, E>,
    pose: &'s Pose,
    between: Between,
    question: &'s Question,
    /// Somewhere the sources are as near.
    most: f64,
    /// What is not waiting any more is nowhere nearer.
    settled: f64,
    witness: Option<Witness>,
    waiting: BinaryHeap<Pair>,
    /// Pairs that were put there, and how far away it was then known at least what they were reached for.
    known: HashMap<(GroupId, GroupId), f64>,
    pairs: u64,
}

impl<D: AsRef<[u8]>, E: AsRef<[u8]>> Search<'_, '_, '_, D, E> {
    fn run(
        &mut self,
        before: [Reads; 2],
        go_on: &mut dyn FnMut(Reads) -> bool,
    ) -> Result<End, ProximityError> {
        for a in self.a.top() {
            for b in self.b.top() {
                self.put(a, b, 0.0);
            }
        }
        while let Some(pair) = self.waiting.peek().copied() {
            if self.is_decided(pair.least) {
                return Ok(End::Decided);
            }
            if self.known.len() > self.question.most_pairs {
                return Ok(End::Crowded);
            }
            let [a, b] = [since(self.a.reads(), before[0]), since(self.b.reads(), before[1])];
            if !go_on(a.plus(b)) {
                return Ok(End::Stopped);
            }
            self.waiting.pop();
            self.pairs += 1;
            self.take(pair)?;
        }
        Ok(if self.is_decided(self.settled) { End::Decided } else { End::Exact })
    }

    /// Whether enough is known where nothing that is left is nearer than `least`.
    fn is_decided(&self, least: f64) -> bool {
        let least = least.min(self.settled).min(self.most).max(0.0);
        match self.question.above {
            Some(above) => least > above || self.most <= above,
            None => self.most - least <= self.question.error,
        }
    }

    fn take(&mut self, pair: Pair) -> Result<(), ProximityError> {
        let Pair { a, b, .. } = pair;
        let (is_end_a, is_end_b) = (self.a.is_leaf(a), self.b.is_leaf(b));
        let mut least = pair.least;
        if !pair.compared && ((is_end_a && is_end_b) || self.is_worth(a, b)) {
            least = least.max(self.compare(a, b)?);
            self.waiting.push(Pair { least, compared: true, ..pair });
            return Ok(());
        }
        if is_end_a && is_end_b {
            self.settled = self.settled.min(least);
            return Ok(());
        }
        let (wrong_a, wrong_b) = (self.a.wrong(a), self.b.wrong(b));
        let (size_a, size_b) = (self.a.block(a).size(), self.b.block(b).size());
        let first = if pair.compared { wrong_a.both() >= wrong_b.both() } else { size_a >= size_b };
        if !is_end_a && (first || is_end_b) {
            for fine in self.a.below(a) {
                self.put(fine, b, least);
            }
        } else {
            for fine in self.b.below(b) {
                self.put(a, fine, least);
            }
        }
        Ok(())
    }

    /// Whether the meshes of two groups, which have to be read, tell more than what is below them in the tables.
    fn is_worth(&self, a: GroupId, b: GroupId) -> bool {
        let wrong = self.a.wrong(a).both() + self.b.wrong(b).both();
        let size = self.a.block(a).size().min(self.b.block(b).size());
        wrong <= (0.5 * self.question.error).max(WORTH * size)
    }

    /// Lets a pair wait, unless it is known to be too far away, or waits already. A group can be reached by several ways, each for a part of what it
    /// stands for: what is known of that part is not known of another.
    fn put(&mut self, a: GroupId, b: GroupId, at_least: f64) {
        match self.known.entry((a, b)) {
            Entry::Occupied(entry) if *entry.get() <= at_least => return,
            Entry::Occupied(mut entry) => *entry.get_mut() = at_least,
            Entry::Vacant(entry) => _ = entry.insert(at_least),
        }
        let least = at_least.max(self.tables(a, b) - self.between.margin);
        if least >= self.limit() {
            self.settled = self.settled.min(least);
        } else {
            self.waiting.push(Pair { least, a, b, compared: false });
        }
    }

    /// What is farther away than this plays no part.
    fn limit(&self) -> f64 {
        // Beyond what is asked for by the margin, so that what is found to be so far away is above it.
        self.question.above.map_or(self.most, |above| self.most.min(above + self.between.margin))
    }

    /// How far two groups are apart at least, by the tables.
    fn tables(&self, a: GroupId, b: GroupId) -> f64 {
        let whole = self.between.squared(&self.a.block(a), &self.b.block(b)).sqrt();
        if whole >= self.limit() {
            return whole;
        }
        let wrong = self.a.wrong(a).distance + self.b.wrong(b).distance;
        let mut nearest = f64::INFINITY;
        for x in self.a.coarse(a) {
            let x = self.a.cluster_block(x);
            for y in self.b.coarse(b) {
                nearest = nearest.min(self.between.squared(&x, &self.b.cluster_block(y)));
            }
        }
        whole.max(less(nearest.sqrt(), wrong))
    }

    /// How far two groups are apart at least, by their meshes; the nearest points may narrow the answer from above.
    fn compare(&mut self, a: GroupId, b: GroupId) -> Result<f64, ProximityError> {
        let (wrong_a, wrong_b) = (self.a.wrong(a), self.b.wrong(b));
        let wrong = wrong_a.distance + wrong_b.distance;
        let error = wrong_a.error + wrong_b.error;
        let margin = self.between.margin;
        let mut order: Vec<(f64, ClusterId, ClusterId)> = Vec::new();
        for x in self.a.coarse(a) {
            let block = self.a.cluster_block(x);
            let pair = |y| (self.between.squared(&block, &self.b.cluster_block(y)).sqrt(), x, y);
            order.extend(self.b.coarse(b).map(pair));
        }
        order.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
        // Meshes that are farther apart prove that the pair plays no part.
        let mut least = f64::INFINITY;
        let slack = 0.1 * self.question.error.min(wrong + error);
        for (away, x, y) in order {
            let below = (self.limit() + wrong + margin).min(least + slack);
            if away >= below {
                least = least.min(away);
                break;
            }
            let (p, q) = (self.a.patch(x)?, self.b.patch(y)?);
            if p.is_empty() || q.is_empty() {
                // What they stand for is not drawn: nothing is known but what the tables tell.
                if wrong > 0.0 {
                    return Ok(0.0);
                }
                continue;
            }
            let found = p.nearest(&q, &self.between, below, slack);
            least = least.min(found.least);
            if let Some((near, triangles)) = found.near {
                self.note(near, [wrong_a.error, wrong_b.error], [a, b], [x, y], triangles);
            }
        }
        Ok(less(least, wrong + margin))
    }

    fn note(
        &mut self,
        near: Near,
        errors: [f64; 2],
        groups: [GroupId; 2],
        clusters: [ClusterId; 2],
        triangles: [u32; 2],
    ) {
        let most = near.most + errors[0] + errors[1] + self.between.margin;
        if most >= self.most {
            return;
        }
        self.most = most;
        self.witness = Some(Witness {
            points: witness_of(self.a, self.pose, &near),
            errors,
            levels: [self.a.level(groups[0]), self.b.level(groups[1])],
            clusters,
            triangles,
        });
    }

    /// Compares the clusters of an earlier answer first: where little has moved, they are near again.
    fn begin_at(&mut self, hint: &Witness) -> Result<(), ProximityError> {
        let [x, y] = hint.clusters;
        let (count_a, count_b) = (self.a.file().clusters().len(), self.b.file().clusters().len());
        if x.index() >= count_a || y.index() >= count_b {
            return Ok(());
        }
        let groups =
            [self.a.file().clusters()[x.index()].group(), self.b.file().clusters()[y.index()].group()];
        let errors = [self.a.wrong(groups[0]).error, self.b.wrong(groups[1]).error];
        let (p, q) = (self.a.patch(x)?, self.b.patch(y)?);
        let found = p.nearest(&q, &self.between, f64::INFINITY, 0.1 * self.question.error);
        if let Some((near, triangles)) = found.near {
            self.note(near, errors, groups, hint.clusters, triangles);
        }
        Ok(())
    }
}

/// A difference, and what rounding may have added to it taken off.
fn less(from: f64, by: f64) -> f64 {
    from - by - 4.0 * f64::EPSILON * (from + by)
}

/// Meshes are read where they are wrong by at most this share of their size.
const WORTH: f64 = 0.0;
