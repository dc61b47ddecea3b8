//! Everywhere that two models come near, by regions: nothing that is within a distance is missed, and nothing much beyond it is told.

use crate::error::ProximityError;
use crate::patch::Search;
use crate::pose::{Between, Frame, Pose};
use crate::search::{ClosestPoints, closest_points_of, since};
use crate::triangle;
use chpm_mesh::{ClusterId, GroupId};
use chpm_space::{Corners, Model, Patch, Reads};
use nalgebra::Vector3;
use rayon::ThreadPool;
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};
use std::ops::ControlFlow;
use std::sync::Arc;

/// A question about contacts.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Near {
    /// All that is within this distance is to be found.
    pub within: f64,
    /// Tolerance of the answer: pairs farther than `within` by more than this are not in it, but for rounding. Edges that are nearly parallel and nearly
    /// touch are told apart to some 1e-8 of their length.
    pub error: f64,
    /// Most triangles that may be near, and most pairs of groups that may be.
    pub limit: usize,
}

/// Triangles that hang together, by edges and by what they are near to.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Region {
    /// The sources are nowhere nearer in it.
    pub lower: f64,
    /// Somewhere in it they are as near.
    pub upper: f64,
    /// Where.
    pub closest_points: ClosestPoints,
    /// Triangles of each model.
    pub triangles: [u64; 2],
    /// Their area.
    pub area: [f64; 2],
    /// How far triangles that meet reach through each other's planes: an estimate of how deep the models are in each other, 0 where none meet.
    pub depth: f64,
    /// The coarsest level of each model that a triangle is of.
    pub levels: [u32; 2],
    /// A box about the triangles, where their poses put them.
    pub low: [f64; 3],
    /// Its largest corner.
    pub high: [f64; 3],
}

/// All regions.
#[derive(Clone, PartialEq, Debug)]
pub struct Contacts {
    /// The nearest first.
    pub regions: Vec<Region>,
    /// Whether nothing is missed; not, where the caller had enough.
    pub complete: bool,
    /// Reads of each model.
    pub reads: [Reads; 2],
    /// Pairs of triangles that are near.
    pub pairs: u64,
    /// How much f64 may have lost, the poses included.
    pub margin: f64,
    /// The margin, and how far the leaves of both are from their sources' triangles.
    pub rounding: f64,
    /// No two triangles that were found near are farther apart than this.
    pub farthest: f64,
}

/// Finds where two models in their poses are near, on the threads of a pool; whatever their number, the answer is one. `go_on` is asked
/// before every pair of groups; some hundred of them may be compared before what was read for them is told.
///
/// # Errors
/// A damaged page; lengths that are none; more triangles than may be.
pub fn contacts<D: AsRef<[u8]> + Sync, E: AsRef<[u8]> + Sync>(
    a: &Model<'_, D>,
    b: &Model<'_, E>,
    poses: [&Pose; 2],
    near: &Near,
    pool: &ThreadPool,
    go_on: &mut dyn FnMut(Reads) -> bool,
) -> Result<Contacts, ProximityError> {
    for (what, got) in [("distance", near.within), ("error", near.error)] {
        if got.is_nan() || got < 0.0 {
            return Err(ProximityError::Length { what, got });
        }
    }

    let between = Between::new(&Frame::of(a, poses[0]), &Frame::of(b, poses[1]));
    let before = [a.reads(), b.reads()];
    let mut search = ContactSearch {
        between,
        near,
        found: Found::default(),
        pairs: 0,
        farthest: 0.0,
        known: HashSet::new(),
        a,
        b,
        poses,
        pool,
        jobs: Vec::new(),
    };

    let complete = search.run(before, go_on)?;
    let regions = search.found.regions();
    let reads = [since(a.reads(), before[0]), since(b.reads(), before[1])];
    let (pairs, farthest, margin) = (search.pairs, search.farthest, between.margin);
    let rounding = margin + a.rounding() + b.rounding();
    Ok(Contacts { regions, complete, reads, pairs, margin, rounding, farthest })
}

struct ContactSearch<'s, 'a, 'b, D, E> {
    a: &'s Model<'a, D>,
    b: &'s Model<'b, E>,
    poses: [&'s Pose; 2],
    pool: &'s ThreadPool,
    between: Between,
    near: &'s Near,
    known: HashSet<(GroupId, GroupId)>,
    found: Found,
    pairs: u64,
    farthest: f64,
    /// Pairs still to be compared.
    jobs: Vec<Job>,
}

/// Two clusters that may be near.
#[derive(Clone, Copy, Debug)]
struct Job {
    groups: [GroupId; 2],
    clusters: [ClusterId; 2],
    /// How much nearer the sources may be than the meshes.
    lost: f64,
    /// Triangles that are nearer are near.
    reach: f64,
}

/// Two triangles that are near, by their places in the order of the boxes.
#[derive(Clone, Copy, Debug)]
struct Close {
    at: [u32; 2],
    near: triangle::Near,
    depth: f64,
}

/// Two clusters' patches, and their near triangles unless they are too many to keep.
type Compared = (Arc<Patch>, Arc<Patch>, Option<Vec<Close>>);

/// Most near triangles of two clusters that are kept until it is their turn; where there are more, they are found again then.
const KEPT: usize = 1 << 15;
/// Clusters that each thread is given at a time, to be compared.
const EACH: usize = 4;
/// Most pairs of clusters that wait to be compared.
const WAITING: usize = 256;

impl<D: AsRef<[u8]> + Sync, E: AsRef<[u8]> + Sync> ContactSearch<'_, '_, '_, D, E> {
    fn run(
        &mut self,
        before: [Reads; 2],
        go_on: &mut dyn FnMut(Reads) -> bool,
    ) -> Result<bool, ProximityError> {
        let mut open: Vec<(GroupId, GroupId)> = Vec::new();
        for a in self.a.top() {
            open.extend(self.b.top().into_iter().map(|b| (a, b)));
        }
        // Few at first, so that a limit of some pages is not left far behind.
        let (mut upper, mut told) = (1, Reads::default());
        while let Some((a, b)) = open.pop() {
            let [x, y] = [since(self.a.reads(), before[0]), since(self.b.reads(), before[1])];
            told = x.plus(y);
            if !go_on(told) {
                self.jobs.clear();
                return Ok(false);
            }
            if !self.known.insert((a, b)) || self.apart(a, b) > self.near.within {
                continue;
            }
            if self.known.len() > self.near.limit {
                return Err(ProximityError::TooMany { what: "pairs of groups", limit: self.near.limit });
            }
            if self.is_coarse(self.a, a) {
                open.extend(self.a.below(a).into_iter().map(|fine| (fine, b)));
            } else if self.is_coarse(self.b, b) {
                open.extend(self.b.below(b).into_iter().map(|fine| (a, fine)));
            } else {
                self.put(a, b);
                if self.jobs.len() >= upper {
                    if !self.work(&mut || go_on(told))? {
                        return Ok(false);
                    }
                    upper = (2 * upper).min(WAITING);
                }
            }
        }
        self.work(&mut || go_on(told))
    }

    /// Whether the meshes of a group are wrong by more than half of what is allowed, and there are finer ones.
    fn is_coarse<F: AsRef<[u8]>>(&self, model: &Model<'_, F>, group: GroupId) -> bool {
        let allowed = 0.5 * self.near.error - self.between.margin;
        !model.is_leaf(group) && model.wrong(group).both() > allowed
    }

    /// How far two groups are apart at least, by the tables.
    fn apart(&self, a: GroupId, b: GroupId) -> f64 {
        self.between.squared(&self.a.block(a), &self.b.block(b)).sqrt() - self.between.margin
    }

    /// Whether a cluster's part of the surface is not told by coarser ones, too.
    fn counts<F: AsRef<[u8]>>(&self, model: &Model<'_, F>, cluster: ClusterId) -> bool {
        let parent = model.file().clusters()[cluster.index()].parent_group();
        !parent.is_some() || self.is_coarse(model, parent)
    }

    /// The clusters of two groups are to be compared.
    fn put(&mut self, a: GroupId, b: GroupId) {
        let lost = self.a.wrong(a).distance + self.b.wrong(b).distance + self.between.margin;
        let reach = (self.near.within + lost) * (1.0 + 4.0 * f64::EPSILON);
        for x in self.a.coarse(a) {
            for y in self.b.coarse(b) {
                let apart = self.between.squared(&self.a.cluster_block(x), &self.b.cluster_block(y));
                if apart.sqrt() <= reach {
                    self.jobs.push(Job { groups: [a, b], clusters: [x, y], lost, reach });
                }
            }
        }
    }

    /// Compares what waits, by all threads, and takes what they find in the order of waiting. Answers whether it came to the end; what `go_on` is told does not change on
    /// the way, since how much is read at a time is a matter of the threads.
    fn work(&mut self, go_on: &mut dyn FnMut() -> bool) -> Result<bool, ProximityError> {
        let jobs = std::mem::take(&mut self.jobs);
        for jobs in jobs.chunks(EACH * self.pool.current_num_threads()) {
            let done: Vec<Result<Compared, ProximityError>> =
                self.pool.install(|| jobs.par_iter().map(|job| self.compare(job)).collect());
            for (job, done) in jobs.iter().zip(done) {
                let (p, q, close) = done?;
                if !go_on() {
                    return Ok(false);
                }
                let Some(close) = close else {
                    let (between, mut taken) = (self.between, 0_usize);
                    let mut take = |close: Close| {
                        taken += 1;
                        if taken.is_multiple_of(KEPT) && !go_on() {
                            return Err(None);
                        }
                        self.take(job, &p, &q, &close).map_err(Some)
                    };
                    match each_close(&p, &q, &between, job.reach, &mut take) {
                        Err(Some(error)) => return Err(error),
                        Err(None) => return Ok(false),
                        Ok(()) => continue,
                    }
                };
                close.iter().try_for_each(|close| self.take(job, &p, &q, close))?;
            }
        }
        Ok(true)
    }

    fn compare(&self, job: &Job) -> Result<Compared, ProximityError> {
        let [x, y] = job.clusters;
        let (p, q) = (self.a.patch(x)?, self.b.patch(y)?);
        let mut all = Vec::new();
        let whole = each_close(&p, &q, &self.between, job.reach, &mut |close| {
            if all.len() == KEPT {
                return Err(());
            }
            all.push(close);
            Ok(())
        });
        Ok((p, q, whole.is_ok().then_some(all)))
    }

    /// Notes two triangles that are near.
    fn take(&mut self, job: &Job, p: &Patch, q: &Patch, close: &Close) -> Result<(), ProximityError> {
        let Job { groups: [a, b], clusters: [x, y], lost, .. } = *job;
        let [i, j] = close.at.map(|at| at as usize);
        let ((t, place), (u, other)) = (p.triangle(i), q.moved(j, &self.between));
        let errors = [self.a.wrong(a).error, self.b.wrong(b).error];
        let levels = [self.a.level(a), self.b.level(b)];

        let (origin, pose) = (Vector3::from(self.a.file().header().origin), *self.poses[0]);
        let world = move |point: Vector3<f64>| pose.apply((point + origin).into());
        let counts = [self.counts(self.a, x), self.counts(self.b, y)];

        self.pairs += 1;
        let first = self.found.mark(0, (x, place), levels[0], counts[0], &t, &world);
        let second = self.found.mark(1, (y, other), levels[1], counts[1], &u, &world);
        if self.found.marks.len() > self.near.limit {
            let what = "triangles";
            return Err(ProximityError::TooMany { what, limit: self.near.limit });
        }

        let root = self.found.join(first, second);
        let best = &mut self.found.best[root];
        let near = &close.near;
        best.depth = best.depth.max(close.depth);
        best.lower = best.lower.min((near.lower - lost).max(0.0));
        let upper = near.upper + errors[0] + errors[1] + self.between.margin;
        self.farthest = self.farthest.max(upper);

        if upper < best.upper || best.closest_points.is_none() {
            best.upper = upper;
            let triangles = [place, other];
            let (points, errors) =
                closest_points_of(self.a, self.poses[0], near, errors, self.between.margin);
            best.closest_points = Some(ClosestPoints { points, errors, levels, clusters: [x, y], triangles });
        }
        Ok(())
    }
}

/// Tells the triangles of two patches that are within `reach`, until `found` has enough.
fn each_close<X>(
    p: &Patch,
    q: &Patch,
    between: &Between,
    reach: f64,
    found: &mut dyn FnMut(Close) -> Result<(), X>,
) -> Result<(), X> {
    let end = p.pairs_within(q, between, reach, &mut |i, j| {
        let (t, u) = (p.triangle(i).0, q.moved(j, between).0);
        let near = triangle::distance(&t, &u);
        if near.lower > reach {
            return ControlFlow::Continue(());
        }
        let depth = if near.lower <= 0.0 { depth(&t, &u) } else { 0.0 };
        match found(Close { at: [i as u32, j as u32], near, depth }) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => ControlFlow::Break(error),
        }
    });
    match end {
        ControlFlow::Break(error) => Err(error),
        ControlFlow::Continue(()) => Ok(()),
    }
}

/// How far a triangle that meets another reaches behind it, the less far of both.
fn depth(t: &Corners, u: &Corners) -> f64 {
    behind(t, u).min(behind(u, t))
}

fn behind(of: &Corners, plane: &Corners) -> f64 {
    let normal = (plane[1] - plane[0]).cross(&(plane[2] - plane[0]));
    let normal = normal.try_normalize(f64::MIN_POSITIVE).unwrap_or_default();
    of.iter().map(|p| normal.dot(&(plane[0] - p))).fold(0.0, f64::max)
}

/// Best pair of a region, kept at its first triangle.
#[derive(Clone, Copy, Debug)]
struct Best {
    lower: f64,
    upper: f64,
    depth: f64,
    closest_points: Option<ClosestPoints>,
}

/// A triangle that is near.
#[derive(Clone, Copy, Debug)]
struct Mark {
    side: usize,
    level: u32,
    area: f64,
    low: [f64; 3],
    high: [f64; 3],
}

/// Triangles that are near, and which of them hang together.
#[derive(Default)]
struct Found {
    index: HashMap<(usize, ClusterId, u32), usize>,
    /// By side and position: who has a corner there.
    corners: HashMap<(usize, [u64; 3]), usize>,
    marks: Vec<Mark>,
    parent: Vec<usize>,
    best: Vec<Best>,
}

impl Found {
    /// The number of a triangle; it joins those with a corner in the same place.
    fn mark(
        &mut self,
        side: usize,
        (cluster, place): (ClusterId, u32),
        level: u32,
        counts: bool,
        corners: &Corners,
        world: &impl Fn(Vector3<f64>) -> [f64; 3],
    ) -> usize {
        let new = self.marks.len();
        let id = *self.index.entry((side, cluster, place)).or_insert(new);
        if id < new {
            return id;
        }
        let area = 0.5 * (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).norm();
        let at = corners.map(world);
        fn fold(f: fn(f64, f64) -> f64, at: &[[f64; 3]; 3]) -> [f64; 3] {
            [0, 1, 2].map(|axis| f(f(at[0][axis], at[1][axis]), at[2][axis]))
        }
        let (low, high) = (fold(f64::min, &at), fold(f64::max, &at));
        self.marks.push(Mark { side, level, area: if counts { area } else { 0.0 }, low, high });
        self.parent.push(new);
        self.best.push(Best { lower: f64::INFINITY, upper: f64::INFINITY, depth: 0.0, closest_points: None });
        for corner in corners {
            let bits: [u64; 3] = (corner + Vector3::zeros()).map(f64::to_bits).into();
            let other = *self.corners.entry((side, bits)).or_insert(new);
            self.join(other, new);
        }
        new
    }

    fn root(&mut self, mut id: usize) -> usize {
        while self.parent[id] != id {
            self.parent[id] = self.parent[self.parent[id]];
            id = self.parent[id];
        }
        id
    }

    /// Makes one region of two; the first triangle of both keeps what is known of them.
    fn join(&mut self, a: usize, b: usize) -> usize {
        let (a, b) = (self.root(a), self.root(b));
        if a == b {
            return a;
        }
        let (keep, drop) = (a.min(b), a.max(b));
        self.parent[drop] = keep;
        let (one, two) = (self.best[keep], self.best[drop]);
        self.best[keep] = Best {
            lower: one.lower.min(two.lower),
            upper: one.upper.min(two.upper),
            depth: one.depth.max(two.depth),
            closest_points: if two.upper < one.upper { two.closest_points } else { one.closest_points },
        };
        keep
    }

    fn regions(mut self) -> Vec<Region> {
        let mut order: Vec<usize> = Vec::new();
        let mut regions: HashMap<usize, Region> = HashMap::new();
        for id in 0..self.marks.len() {
            let root = self.root(id);
            let (best, mark) = (self.best[root], self.marks[id]);
            let Some(closest_points) = best.closest_points else { continue };

            let region = regions.entry(root).or_insert_with(|| {
                order.push(root);
                Region {
                    lower: best.lower,
                    upper: best.upper,
                    closest_points,
                    triangles: [0; 2],
                    area: [0.0; 2],
                    depth: best.depth,
                    levels: [0; 2],
                    low: mark.low,
                    high: mark.high,
                }
            });

            region.triangles[mark.side] += 1;
            region.area[mark.side] += mark.area;
            region.levels[mark.side] = region.levels[mark.side].max(mark.level);
            for axis in 0..3 {
                region.low[axis] = region.low[axis].min(mark.low[axis]);
                region.high[axis] = region.high[axis].max(mark.high[axis]);
            }
        }

        let mut regions: Vec<Region> = order.iter().filter_map(|root| regions.remove(root)).collect();
        regions.sort_by(|a, b| a.lower.total_cmp(&b.lower).then(b.depth.total_cmp(&a.depth)));
        regions
    }
}
