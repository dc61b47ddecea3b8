//! The distance of two models: pairs of groups, the nearest first, until the answer is as narrow as it has to be.

use crate::error::ProximityError;
use crate::front::{Front, Pair};
use crate::patch::Search;
use crate::pose::{Between, Frame, Pose};
use crate::triangle::{self, Near};
use chpm_mesh::{ClusterId, GroupId};
use chpm_space::{Model, Reads};

/// A question about the distance.
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
pub struct ClosestPoints {
    /// On the meshes, where their poses put them.
    pub points: [[f64; 3]; 2],
    /// How far the source is from each at most, as it is told: what rounding and the poses do to it included.
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
    pub lower: f64,
    /// Somewhere they are as near as this; infinite where no triangles have been compared.
    pub upper: f64,
    /// Where.
    pub closest_points: Option<ClosestPoints>,
    /// Why it is not narrower.
    pub end: End,
    /// Reads of each model.
    pub reads: [Reads; 2],
    /// Pairs of groups that were looked at.
    pub pairs: u64,
    /// How much of the width, at either end, is what f64 may have lost, the poses included.
    pub margin: f64,
    /// The margin, and how far the leaves of both are from their sources' triangles: twice this is what the finest answer is wide.
    pub rounding: f64,
}

/// The distance of two models in their poses. `go_on` is asked before every pair, with what was read so far.
///
/// # Errors
/// A damaged page; an error that is no length.
pub fn distance<D: AsRef<[u8]>, E: AsRef<[u8]>>(
    a: &Model<'_, D>,
    b: &Model<'_, E>,
    poses: [&Pose; 2],
    question: &Question,
    go_on: &mut dyn FnMut(Reads) -> bool,
) -> Result<Answer, ProximityError> {
    follow(&mut Front::new(), a, b, poses, question, go_on)
}

/// The same, one pose after the other: a step costs what has changed since the one before, if it is short. What it proves holds as it does from the roots, and is
/// as narrow as was asked for.
///
/// # Errors
/// As for [`distance`]; the front then begins anew.
pub fn follow<D: AsRef<[u8]>, E: AsRef<[u8]>>(
    front: &mut Front,
    a: &Model<'_, D>,
    b: &Model<'_, E>,
    poses: [&Pose; 2],
    question: &Question,
    go_on: &mut dyn FnMut(Reads) -> bool,
) -> Result<Answer, ProximityError> {
    for (what, got) in [("error", Some(question.error)), ("distance to stay above", question.above)] {
        if let Some(got) = got.filter(|got| got.is_nan() || *got < 0.0) {
            return Err(ProximityError::Length { what, got });
        }
    }
    let between = Between::new(&Frame::of(a, poses[0]), &Frame::of(b, poses[1]));
    let before = [a.reads(), b.reads()];
    let bounds = b.bounds();
    let last = front.between();
    let room = front.follow(&between, &bounds);
    let rounding = between.margin + a.rounding() + b.rounding();
    let mut search = DistanceSearch {
        a,
        b,
        pose: poses[0],
        between,
        rounding,
        question,
        upper: f64::INFINITY,
        settled: f64::INFINITY,
        done: Vec::new(),
        closest_points: None,
        front: &mut *front,
        pairs: 0,
    };
    let mut end = search.begin(room.is_none()).and_then(|()| search.run(before, room, go_on));
    if let (Ok(None), Some(last)) = (&end, last) {
        search.front.give_up(&last, &bounds);
        search.done.clear();
        search.settled = f64::INFINITY;
        search.put_roots();
        end = search.run(before, None, go_on);
    }
    let DistanceSearch { upper, settled, done, closest_points, pairs, .. } = search;
    // There is always one where there was room for all.
    let end = end.inspect_err(|_| front.begin())?.unwrap_or(End::Stopped);
    let open = front.waiting.peek().map_or(f64::INFINITY, |pair| front.lower(pair));
    let lower = open.min(settled).min(upper).max(0.0);
    front.waiting.extend(done);
    front.closest_points = closest_points.or(front.closest_points);
    let reads = [since(a.reads(), before[0]), since(b.reads(), before[1])];
    Ok(Answer { lower, upper, closest_points, end, reads, pairs, margin: between.margin, rounding })
}

pub(crate) fn since(now: Reads, before: Reads) -> Reads {
    let bytes = chpm_mesh::Bytes(now.bytes.0 - before.bytes.0);
    Reads { pages: now.pages - before.pages, bytes }
}

/// The points of a pair in the first model's frame, where its pose puts them, and how far the sources are from there at most: `errors` from the meshes, `margin`
/// from what arithmetic makes of these, and what is lost on the way from the frame.
pub(crate) fn closest_points_of<D: AsRef<[u8]>>(
    model: &Model<'_, D>,
    pose: &Pose,
    near: &Near,
    errors: [f64; 2],
    margin: f64,
) -> ([[f64; 3]; 2], [f64; 2]) {
    let origin = nalgebra::Vector3::from(model.file().header().origin);
    let placed = [near.a, near.b].map(|point| pose.place((point + origin).into()));
    let errors = [0, 1].map(|i| (errors[i] + margin + placed[i].1) * (1.0 + 4.0 * f64::EPSILON));
    (placed.map(|(point, _)| point), errors)
}

struct DistanceSearch<'s, 'a, 'b, D, E> {
    a: &'s Model<'a, D>,
    b: &'s Model<'b, E>,
    pose: &'s Pose,
    between: Between,
    /// See [`Answer::rounding`].
    rounding: f64,
    question: &'s Question,
    /// Somewhere the sources are as near.
    upper: f64,
    /// Lower bound over the pairs that were compared at the sources' triangles.
    settled: f64,
    /// Pairs that were compared there.
    done: Vec<Pair>,
    closest_points: Option<ClosestPoints>,
    front: &'s mut Front,
    pairs: u64,
}

impl<D: AsRef<[u8]>, E: AsRef<[u8]>> DistanceSearch<'_, '_, '_, D, E> {
    fn begin(&mut self, from_roots: bool) -> Result<(), ProximityError> {
        if let Some(hint) = self.front.closest_points {
            self.begin_at(&hint)?;
        }
        if from_roots {
            self.put_roots();
        }
        Ok(())
    }

    fn put_roots(&mut self) {
        for a in self.a.top() {
            for b in self.b.top() {
                self.put(a, b, 0.0);
            }
        }
    }

    /// Looks at pairs, if there is `room` for them; answers nothing where there is not.
    fn run(
        &mut self,
        before: [Reads; 2],
        room: Option<u64>,
        go_on: &mut dyn FnMut(Reads) -> bool,
    ) -> Result<Option<End>, ProximityError> {
        let from = self.pairs;
        let mut end = None;
        while let Some(pair) = self.front.waiting.peek().copied() {
            let lower = self.front.lower(&pair);
            if let Some(decided) = self.decided(lower) {
                end = Some(decided);
                break;
            }

            let is_crowded = self.front.pairs() > self.question.most_pairs;
            if room.is_some_and(|room| self.pairs - from > room || is_crowded) {
                return Ok(None);
            }
            if is_crowded {
                return Ok(Some(End::Crowded));
            }
            let [a, b] = [since(self.a.reads(), before[0]), since(self.b.reads(), before[1])];
            if !go_on(a.plus(b)) {
                return Ok(Some(End::Stopped));
            }

            self.front.waiting.pop();
            self.pairs += 1;
            self.take(pair, lower)?;
        }

        if room.is_none() {
            self.front.is_whole(self.pairs - from);
        }
        Ok(end.or_else(|| self.decided(self.settled)).or(Some(End::Exact)))
    }

    /// Why enough is known where nothing that is left is nearer than `lower`, if it is.
    fn decided(&self, lower: f64) -> Option<End> {
        let lower = lower.min(self.settled).min(self.upper).max(0.0);
        let is_enough = match self.question.above {
            Some(above) => lower > above || self.upper <= above,
            None => self.upper - lower <= self.question.error,
        };
        // Models that meet do so in many places, and none tells more than the first.
        let is_exact = self.upper - lower <= 2.0 * self.rounding;
        is_enough.then_some(End::Decided).or_else(|| is_exact.then_some(End::Exact))
    }

    fn take(&mut self, pair: Pair, mut lower: f64) -> Result<(), ProximityError> {
        let (Pair { a, b, .. }, step) = (pair, self.front.step);
        if pair.asked != step {
            // It may have come nearer since it was asked for; the tables know whether it has.
            let tables = self.tables(a, b) - self.between.margin;
            if tables > lower {
                self.front.put(a, b, tables, pair.compared);
                return Ok(());
            }
        }
        let (is_end_a, is_end_b) = (self.a.is_leaf(a), self.b.is_leaf(b));
        let is_compared = pair.compared == step;
        if !is_compared && ((is_end_a && is_end_b) || self.is_worth(a, b)) {
            lower = lower.max(self.compare(a, b)?);
            self.front.put(a, b, lower, step);
            return Ok(());
        }
        if is_end_a && is_end_b {
            self.settled = self.settled.min(lower);
            self.done.push(pair);
            return Ok(());
        }
        let (wrong_a, wrong_b) = (self.a.wrong(a), self.b.wrong(b));
        let (size_a, size_b) = (self.a.block(a).size(), self.b.block(b).size());
        let first = if is_compared { wrong_a.both() >= wrong_b.both() } else { size_a >= size_b };
        if !is_end_a && (first || is_end_b) {
            for fine in self.a.below(a) {
                self.put(fine, b, lower);
            }
        } else {
            for fine in self.b.below(b) {
                self.put(a, fine, lower);
            }
        }
        Ok(())
    }

    /// Whether the meshes of two groups, which have to be read, tell more than what is below them in the tables.
    fn is_worth(&self, a: GroupId, b: GroupId) -> bool {
        self.a.wrong(a).both() + self.b.wrong(b).both() <= WORTH * self.question.error
    }

    /// Lets a pair wait, unless it waits already.
    fn put(&mut self, a: GroupId, b: GroupId, lower_bound: f64) {
        if self.front.is_new(a, b, lower_bound) {
            let lower = lower_bound.max(self.tables(a, b) - self.between.margin);
            self.front.put(a, b, lower, 0);
        }
    }

    /// Distance from which on a pair plays no part.
    fn limit(&self) -> f64 {
        // Beyond what is asked for by the margin, so that what is found to be so far away is above it.
        self.question.above.map_or(self.upper, |above| self.upper.min(above + self.between.margin))
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
            order.extend(
                self.b
                    .coarse(b)
                    .map(|y| (self.between.squared(&block, &self.b.cluster_block(y)).sqrt(), x, y)),
            );
        }
        order.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
        // Meshes that are farther apart prove that the pair plays no part.
        let mut lower = f64::INFINITY;
        // Nothing is finer than leaves: there, no more is left open than they are off by.
        let is_end = self.a.is_leaf(a) && self.b.is_leaf(b);
        let least_slack = if is_end { 0.0 } else { 0.1 * (wrong + error) };
        let slack = (SLACK * (self.question.error - wrong - error)).max(least_slack);
        for (away, x, y) in order {
            let below = (self.limit() + wrong + margin).min(lower + slack);
            if away >= below {
                lower = lower.min(away);
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
            lower = lower.min(found.lower);
            if let Some((near, triangles)) = found.near {
                self.note(near, [wrong_a.error, wrong_b.error], [a, b], [x, y], triangles);
            }
        }
        Ok(less(lower, wrong + margin))
    }

    fn note(
        &mut self,
        near: Near,
        errors: [f64; 2],
        groups: [GroupId; 2],
        clusters: [ClusterId; 2],
        triangles: [u32; 2],
    ) {
        let upper = near.upper + errors[0] + errors[1] + self.between.margin;
        if upper >= self.upper {
            return;
        }
        self.upper = upper;
        let (points, errors) = closest_points_of(self.a, self.pose, &near, errors, self.between.margin);
        self.closest_points = Some(ClosestPoints {
            points,
            errors,
            levels: [self.a.level(groups[0]), self.b.level(groups[1])],
            clusters,
            triangles,
        });
    }

    /// Compares the clusters of an earlier answer first: where little has moved, they are near again.
    fn begin_at(&mut self, hint: &ClosestPoints) -> Result<(), ProximityError> {
        let [x, y] = hint.clusters;
        let (count_a, count_b) = (self.a.file().clusters().len(), self.b.file().clusters().len());
        if x.index() >= count_a || y.index() >= count_b {
            return Ok(());
        }
        let groups =
            [self.a.file().clusters()[x.index()].group(), self.b.file().clusters()[y.index()].group()];
        let errors = [self.a.wrong(groups[0]).error, self.b.wrong(groups[1]).error];
        let (p, q) = (self.a.patch(x)?, self.b.patch(y)?);
        let [t, u] = hint.triangles;
        // They are near, and what is nearer is found the sooner.
        if let (Some(i), Some(j)) = (p.index_of(t), q.index_of(u)) {
            let near = triangle::distance(&p.triangle(i).0, &q.moved(j, &self.between).0);
            self.note(near, errors, groups, hint.clusters, hint.triangles);
        }
        let below = less(self.upper, errors[0] + errors[1] + self.between.margin);
        let found = p.nearest(&q, &self.between, below, 0.5 * self.question.error);
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

/// Meshes are read where they are wrong by at most this share of what the answer may be. Coarser ones rule out less: reading them was slower, and more in all.
const WORTH: f64 = 0.1;
/// Which part of the error that is left by meshes a search among their triangles may use up.
const SLACK: f64 = 0.8;
