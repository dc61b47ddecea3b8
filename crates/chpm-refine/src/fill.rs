//! Refines a cut until a number of triangles is used up: the worst of it first, in steps as small as they need be.
//!
//! Steps smaller than an error-bound's are legal because collapses of vertices that no other cluster has can be undone in one cluster alone,
//! as long as the borders inside its group are as coarse as they get; then the group borders follow, vertex by vertex in all members at once; and
//! then every member is at its finest mesh, which is what the fine clusters' base meshes are, so that a split costs nothing. Where a group
//! is there in part, its group borders stay coarse.

use crate::cut::{Cut, Member};
use crate::error::RefineError;
use crate::group_borders::GroupBorders;
use crate::lod::Lod;
use crate::profile::{Meshes, Profiles};
use crate::splits::Splits;
use chpm_format::{Chpm, ClusterRecord, Page, PageBuf};
use chpm_mesh::{ClusterId, GroupId};
use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

/// Steps from a base mesh to the finest one: what is equally bad grows finer together.
const STRIDES: u32 = 32;

/// A cut on its way to a number of triangles.
pub(crate) struct Fill<'a, D, W, G> {
    file: &'a Chpm<D>,
    /// How bad an error is in a group; `None` where nothing is to be refined.
    weight: W,
    splits: Splits,
    /// By cluster: its vertices; 0 for one that is not in the cut.
    positions: Vec<u32>,
    /// Triangles that may still come.
    rest: u64,
    heap: BinaryHeap<Step>,
    profiles: Profiles<'a, D, G>,
    lod: Lod,
}

/// A split that waits in the queue, the greatest first.
#[derive(Clone, Copy, Debug)]
struct Step {
    weight: f64,
    /// Levels above the leaves' finest meshes: decides between equal errors, which one outlier gives to whole groups.
    height: f64,
    unit: Reverse<Unit>,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Unit {
    /// A cluster, by collapses that are its own.
    Own(ClusterId),
    /// The borders inside a group whose members have undone their own.
    GroupBorders(GroupId),
}

impl<'a, D, E, W, G> Fill<'a, D, W, G>
where
    D: AsRef<[u8]>,
    E: From<RefineError>,
    W: Fn(GroupId, f32) -> Option<f64>,
    G: FnMut() -> Result<(), E>,
{
    /// Starts from a legal cut.
    pub(crate) fn new(
        file: &'a Chpm<D>,
        cut: Cut,
        limit: u64,
        weight: W,
        mut profiles: Profiles<'a, D, G>,
    ) -> Result<Self, E> {
        let splits = Splits::that_bring(file, cut.members().iter().map(|member| member.cluster));
        let mut positions = vec![0; file.clusters().len()];
        let mut used = 0;
        for member in cut.members() {
            positions[member.cluster.index()] = member.vertices;
            used += profiles.of(member.cluster)?.triangles(member.vertices as usize);
        }
        let (rest, heap, lod) = (limit.saturating_sub(used), BinaryHeap::new(), Lod::default());
        let mut fill = Fill { file, weight, splits, positions, rest, heap, profiles, lod };
        if fill.rest > 0 {
            fill.plan_all(cut.members().iter().map(|member| member.cluster))?;
        }
        Ok(fill)
    }

    /// Goes on until nothing fits any more; answers the cut.
    pub(crate) fn run(mut self) -> Result<Cut, E> {
        while self.rest > 0
            && let Some(step) = self.heap.pop()
        {
            match step.unit.0 {
                Unit::Own(cluster) => self.refine(cluster)?,
                Unit::GroupBorders(group) => self.refine_group_borders(group)?,
            }
        }
        let positions = (0..).map(ClusterId).zip(self.positions).filter(|(_, vertices)| *vertices > 0);
        Ok(Cut::new(positions.map(|(cluster, vertices)| Member { cluster, vertices }).collect()))
    }

    /// Queues what can be refined in clusters that have entered.
    fn plan_all(&mut self, entered: impl Iterator<Item = ClusterId>) -> Result<(), E> {
        let mut groups = BTreeSet::new();
        for cluster in entered {
            groups.insert(self.file.clusters()[cluster.index()].group());
            self.plan(cluster)?;
        }
        groups.into_iter().try_for_each(|group| self.plan_group_borders(group))
    }

    fn vertices(&self, cluster: ClusterId) -> usize {
        self.positions[cluster.index()] as usize
    }

    /// Queues a cluster if there are collapses of its own left.
    fn plan(&mut self, cluster: ClusterId) -> Result<(), E> {
        let n = self.vertices(cluster);
        let meshes = self.profiles.of(cluster)?;
        if n < meshes.own_end() {
            let record = &self.file.clusters()[cluster.index()];
            self.heap.extend(step(record, n, &meshes, Unit::Own(cluster), &self.weight));
        }
        Ok(())
    }

    /// Queues the borders inside a group if it is whole and its members have nothing else left.
    fn plan_group_borders(&mut self, group: GroupId) -> Result<(), E> {
        if !self.splits.is_whole(self.file, group) {
            return Ok(());
        }
        let mut worst = None;
        for cluster in self.file.coarse(group).iter().copied().map(ClusterId) {
            let n = self.vertices(cluster);
            let meshes = self.profiles.of(cluster)?;
            if n < meshes.own_end() {
                return Ok(());
            }
            let record = &self.file.clusters()[cluster.index()];
            worst = worst.max(step(record, n, &meshes, Unit::GroupBorders(group), &self.weight));
        }
        self.heap.extend(worst);
        Ok(())
    }

    /// One stride of a cluster's own, or as much of it as fits.
    fn refine(&mut self, cluster: ClusterId) -> Result<(), E> {
        let n = self.vertices(cluster);
        let record = &self.file.clusters()[cluster.index()];
        let mut meshes = self.profiles.of(cluster)?;
        let end = meshes.own_end();
        let stride = (record.vertex_count - record.base_vertex_count).div_ceil(STRIDES) as usize;
        let target = (n + stride).min(end);
        let before = meshes.triangles(n);
        let (reached, used) = farthest(n, target, self.rest, &mut |n| meshes.triangles(n) - before);
        self.rest -= used;
        self.positions[cluster.index()] = reached as u32;
        match reached {
            n if n < target => Ok(()),
            n if n < end => self.plan(cluster),
            _ => self.plan_group_borders(record.group()),
        }
    }

    /// All borders inside a group and its split, or as much as fits.
    fn refine_group_borders(&mut self, group: GroupId) -> Result<(), E> {
        let file = self.file;
        let coarse: Vec<ClusterId> = file.coarse(group).iter().copied().map(ClusterId).collect();
        let pages = coarse.iter().map(|id| self.profiles.page(*id)).collect::<Result<Vec<_>, E>>()?;
        let pages: Vec<_> = pages.iter().map(PageBuf::view).collect();
        let mut group_borders =
            GroupBorders::new(&pages, coarse.iter().map(|id| self.vertices(*id)).collect());

        let lod = &mut self.lod;
        let mut count = |positions: &[usize]| -> u64 {
            let meshes = pages.iter().map(Page::progressive_mesh).zip(positions);
            meshes.map(|(mesh, n)| lod.count(&mesh, *n) as u64).sum()
        };

        let before = count(group_borders.positions(0));
        let steps = group_borders.undo_all();
        let (reached, used) = farthest(0, steps, self.rest, &mut |step| {
            count(group_borders.positions(step)).saturating_sub(before)
        });
        self.rest -= used;
        for (cluster, n) in coarse.into_iter().zip(group_borders.positions(reached)) {
            self.positions[cluster.index()] = *n as u32;
        }

        if reached < steps || file.groups()[group.index()].is_leaf() {
            return Ok(());
        }
        self.split(group)
    }

    /// Replaces the finest meshes of a group by the base meshes below, which are the same.
    fn split(&mut self, group: GroupId) -> Result<(), E> {
        let clusters = self.file.clusters();
        let (coarse, fine) = (self.file.coarse(group), self.file.fine(group));
        let before: u64 = coarse.iter().map(|id| u64::from(clusters[*id as usize].triangle_count)).sum();
        let after: u64 = fine.iter().map(|id| u64::from(clusters[*id as usize].base_triangle_count)).sum();
        // More only in a file that breaks I4.
        let Some(rest) = (self.rest + before).checked_sub(after) else { return Ok(()) };
        self.rest = rest;
        self.splits.split(group);
        coarse.iter().for_each(|id| self.positions[*id as usize] = 0);
        for id in fine {
            self.positions[*id as usize] = clusters[*id as usize].base_vertex_count;
        }
        self.plan_all(fine.iter().copied().map(ClusterId))
    }
}

/// How bad it is that a cluster has `n` vertices.
fn step(
    record: &ClusterRecord,
    n: usize,
    meshes: &Meshes<'_>,
    unit: Unit,
    weight: impl Fn(GroupId, f32) -> Option<f64>,
) -> Option<Step> {
    let collapses = f64::from((record.vertex_count - record.base_vertex_count).max(1));
    let height = f64::from(record.level) - (n - record.base_vertex_count as usize) as f64 / collapses;
    let weight = weight(record.group(), meshes.error_at(n))?;
    Some(Step { weight, height, unit: Reverse(unit) })
}

/// The last of `from..=to` at which at most `limit` is added, and what is; more is added by what is later. The first adds nothing.
fn farthest(from: usize, to: usize, limit: u64, added: &mut impl FnMut(usize) -> u64) -> (usize, u64) {
    let all = added(to);
    if all <= limit {
        return (to, all);
    }
    let (mut good, mut bad) = ((from, 0), to);
    while bad - good.0 > 1 {
        let middle = good.0 + (bad - good.0) / 2;
        match added(middle) {
            fits if fits <= limit => good = (middle, fits),
            _ => bad = middle,
        }
    }
    good
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let by_weight = self.weight.total_cmp(&other.weight);
        by_weight.then(self.height.total_cmp(&other.height)).then(self.unit.cmp(&other.unit))
    }
}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Step {}
