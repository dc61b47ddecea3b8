//! Simplify: bottom-up, level by level; every cluster is halved (Quick-VDR 4.3).
//!
//! A leaf starts from its part of the source, a parent from the union of its children's base meshes (I4). A vertex that a
//! cluster shares with another is locked until the clusters that use it have merged, unless clusters form dependency groups:
//! then the members simplify their group borders first, all alike, and each its interior after that. The groups of a level (of one
//! cluster each where boundaries are locked) are independent tasks over the threads, and so are the members of each. Establishes I3, I4, I6 and I8.

mod anew;
mod cost;
mod dependency;
mod group;
mod group_border;
mod handed;
mod known;
mod lasting;
mod levels;
mod merge;
mod runaway;
mod vanished;
mod working_set;

use crate::config::Settings;
use crate::context::Context;
use crate::decompose::Decomposition;
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::in_order::while_not_due;
use crate::per_thread::PerThread;
use crate::range::ErrorRange;
use crate::report::LevelReport;
use chpm_extmem::{Spool, Store};
use chpm_format::{BoundaryMode, Gaps, MAX_CLUSTER_VERTICES};
use chpm_mesh::Aabb;
use chpm_qem::Deviation;
use dependency::GroupBorders;
use group::{Buffers, GroupDone, GroupTask, Scratch};
pub(crate) use handed::Handed;
pub(crate) use lasting::{REMNANT_BYTES, remnants};
pub(crate) use levels::Levels;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A cluster's page in a spool.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct PageRef {
    pub(crate) offset: u64,
    pub(crate) len: u32,
    /// Largest decoded error of a base mesh of its group: what errors above start from.
    pub(crate) group_error: f32,
    /// Box around the finest mesh.
    pub(crate) bounds: Aabb,
    /// Box around its part of the source.
    source: Aabb,
    /// Vertices of the base mesh: what a merge starts from.
    base_vertex_count: u32,
    base_triangle_count: u32,
    /// Where the base mesh's triangles, in the order of simplification, are in the spool of the level.
    base_triangles: u64,
    /// Where their displacements are.
    displacements: u64,
    /// Where their attribute errors are, and how many: none without normals and colours.
    attribute_errors: u64,
    attribute_error_count: u32,
    /// Where the dropped components are in the same spool, and how many.
    dropped: u64,
    dropped_count: u32,
    /// How many of them, the last, have no remnant.
    bare_count: u32,
    /// Those of its group.
    pub(crate) gaps: Gaps,
    /// That of components without a remnant, likewise.
    pub(crate) rest: f32,
    /// Where the remnants are in the spool of pages, and how many.
    lasting: u64,
    pub(crate) lasting_count: u32,
    /// The largest of its meshes and of those below.
    pub(crate) deviation: Deviation,
}

/// Pages of all clusters that were built.
#[derive(Serialize, Deserialize)]
pub(crate) struct Clusters {
    pub(crate) pages: Spool,
    /// By node of the tree; none above a merge that would not fit 16-bit indices.
    pub(crate) refs: Vec<Option<PageRef>>,
    /// By node, what was made of it.
    pub(crate) reports: Vec<LevelReport>,
    /// The sums of the levels.
    #[serde(skip)]
    pub(crate) levels: Vec<LevelReport>,
    /// Dependency groups of built nodes, from the leaves up; the members of one are of one level.
    pub(crate) groups: Vec<Vec<u32>>,
    /// Nodes that the root is made of as if they were its children, instead of all between; none where it is made of its own.
    top: Vec<u32>,
    /// The errors that are asked for.
    pub(crate) range: ErrorRange,
}

impl Clusters {
    /// Whether there is a page of a node.
    pub(crate) fn is_built(&self, node: u32) -> bool {
        self.refs[node as usize].is_some()
    }

    /// The page of a node that was built.
    pub(crate) fn page(&self, node: u32) -> PageRef {
        self.refs[node as usize].unwrap_or_else(|| panic!("node {node} was not built"))
    }

    /// The nodes that a node is made of.
    fn children<'a>(&'a self, tree: &'a Tree, node: u32) -> &'a [u32] {
        if tree.is_root(node) && !self.top.is_empty() { &self.top } else { tree.children(node) }
    }

    /// Triangles and vertices of the base meshes of those of these nodes that were built.
    fn base_counts(&self, nodes: &[u32]) -> (u64, u64) {
        nodes.iter().filter_map(|node| self.refs[*node as usize]).fold((0, 0), |sum, page| {
            (sum.0 + u64::from(page.base_triangle_count), sum.1 + u64::from(page.base_vertex_count))
        })
    }

    /// The largest error that any of these nodes leaves; none unless all were built.
    fn error_above(&self, nodes: &[u32]) -> Option<f32> {
        let mut pages = nodes.iter().map(|node| self.refs[*node as usize]);
        pages.try_fold(0.0, |largest: f32, page| Some(largest.max(page?.group_error)))
    }

    /// The error that a node's finest mesh comes with; none if what it is made of is not built, does not fit 16-bit indices together or stalled, if
    /// it is more than is asked for, or if the root is made of what is below the node.
    fn finest_error(&self, node: u32, tree: &Tree, rounding: f32) -> Option<f32> {
        if !self.top.is_empty() && !tree.is_root(node) {
            return None;
        }
        let children = self.children(tree, node);
        let (triangles, vertices) = self.base_counts(children);
        let fits = triangles <= MAX_MERGED_TRIANGLES && vertices <= u64::from(MAX_CLUSTER_VERTICES);
        let error = if children.is_empty() { Some(rounding) } else { self.error_above(children) };
        error.filter(|error| fits && *error <= self.range.coarsest)
    }

    /// Looks whether all that the levels below `level` leave makes one cluster that is small enough to be the root.
    fn look_for_top(&mut self, tree: &Tree, level: u32) {
        // As many inner nodes are above a front as it has nodes, but one.
        let above = tree.nodes.len() - tree.level(level).start;
        if level == 0 || !(2..MOST_CHILDREN).contains(&above) {
            return;
        }
        let front = tree.front_below(level);
        let (triangles, vertices) = self.base_counts(&front);
        let is_small = triangles <= TOP_TRIANGLES && vertices <= u64::from(MAX_CLUSTER_VERTICES);
        if is_small && self.error_above(&front).is_some_and(|error| error <= self.range.coarsest) {
            self.top = front;
        }
    }

    /// Makes the nodes that the root was made of its children in the tree, which loses those between.
    pub(crate) fn raise_top(&mut self, tree: &mut Tree) {
        if self.top.is_empty() {
            return;
        }
        let between = tree.raise(std::mem::take(&mut self.top));
        let root = between.start as u32;
        // Its group is the last.
        self.groups.iter_mut().rev().take(1).for_each(|group| *group = vec![root]);
        self.refs.drain(between.clone());
        self.reports.drain(between);
        self.levels = level_reports(tree, &self.refs, &self.reports);
    }

    /// Remnants that the file gets. None where ends were cut off: what remnants are of may be beyond them.
    pub(crate) fn remnant_count(&self) -> usize {
        match self.range == ErrorRange::ALL {
            true => self.refs.iter().flatten().map(|page| page.lasting_count as usize).sum(),
            false => 0,
        }
    }
}

/// Most triangles of a union of base meshes, more than any two have that did not stall: a pile of what nothing can simplify ends
/// as several roots, each of which fits the memory that a task may take.
const MAX_MERGED_TRIANGLES: u64 = 1 << 16;

/// Most triangles of a root that is made of more than two clusters. Within one cluster errors can be found anew, and the larger the root is,
/// the smaller are the distances from which on they are; but it is what is loaded first, and as a whole.
const TOP_TRIANGLES: u64 = 20_000;

/// Most clusters that a root is made of.
const MOST_CHILDREN: usize = 8;

/// Inputs of the levels.
pub(crate) struct Inputs<'a> {
    pub(crate) decomposition: &'a Decomposition,
    pub(crate) tree: &'a Tree,
    /// By interface, the level from which its shared vertices are free.
    pub(crate) release: &'a [u8],
    pub(crate) settings: &'a Settings,
    pub(crate) context: &'a Context<'a>,
}

/// Builds every cluster's progressive mesh, up to those whose finest meshes have the largest error that is asked for. Goes on where
/// `begun` is, and lets `keep` save how far it is when it is time.
pub(crate) fn run(
    inputs: &Inputs<'_>,
    begun: Option<Box<Levels>>,
    mut keep: impl FnMut(&Levels) -> Result<(), BuildError>,
) -> Result<Clusters, BuildError> {
    let Inputs { tree, context, .. } = *inputs;
    let mut levels = begun.map_or_else(|| Levels::begin(inputs), |begun| *begun);

    // What a saved state does not have: the group borders of the levels that are done, which follow from the tree.
    let mut group_borders = GroupBorders::at(levels.level, inputs);
    context.progress.advance(levels.built.refs.iter().flatten().count() as u64);

    while levels.level < tree.level_count() {
        let traced = context.trace.task("form");
        group_borders.rise(tree, levels.level);
        if levels.first.is_none() {
            levels.form_groups(&group_borders, inputs);
        }
        drop(traced);
        while levels.done < levels.groups().len() {
            levels.work(&group_borders, inputs)?;
            if context.clock.is_due() {
                keep(&levels)?;
            }
        }
        levels.end(inputs)?;
    }

    let mut built = levels.built;
    built.levels = level_reports(tree, &built.refs, &built.reports);
    Ok(built)
}

impl Levels {
    /// Forms the groups of the level.
    fn form_groups(&mut self, group_borders: &GroupBorders<'_>, inputs: &Inputs<'_>) {
        let Inputs { tree, settings, context, .. } = *inputs;
        let rounding = inputs.decomposition.rounding.error();
        if self.built.top.is_empty() {
            self.built.look_for_top(tree, self.level);
        }
        let built = &self.built;
        let finest_error = |node: u32| built.finest_error(node, tree, rounding);
        let mut formed: Vec<Vec<u32>> = match settings.boundary {
            BoundaryMode::Dependencies => {
                group_borders.groups(tree, self.level, &self.left, settings, finest_error, |node: u32| {
                    cost::member(node, tree, inputs.decomposition, built)
                })
            }
            _ => tree.level(self.level).map(|node| vec![node as u32]).collect(),
        };
        formed.retain(|g| g.iter().all(|n| finest_error(*n).is_some()));
        self.first = Some(self.built.groups.len());
        self.built.groups.extend(formed);
        self.displacements.push(levels::displacements(&context.store, self.level as usize));
    }

    /// Simplifies groups of the level until all are done or it is time to save.
    fn work(&mut self, group_borders: &GroupBorders<'_>, inputs: &Inputs<'_>) -> Result<(), BuildError> {
        let results = self.simplify(self.done..self.groups().len(), group_borders, inputs)?;
        let _traced = inputs.context.trace.task("take");
        for done in results {
            self.take(done, inputs.decomposition);
        }
        Ok(())
    }

    /// Simplifies the first groups of a range, until it is time to save: the results in the order of the groups, whichever thread was done first.
    fn simplify(
        &self,
        range: Range<usize>,
        group_borders: &GroupBorders<'_>,
        inputs: &Inputs<'_>,
    ) -> Result<Vec<GroupDone>, BuildError> {
        let Inputs { decomposition, tree, release, settings, context } = *inputs;
        let buffers = PerThread::new();
        let task = GroupTask {
            trace: &context.trace,
            buffers: &buffers,
            level: self.level,
            tree,
            decomposition,
            built: &self.built,
            displacements: &self.displacements,
            release,
            group_borders,
            settings,
        };

        let (first, open) = (range.start, &self.groups()[range]);
        let work = |scratch: &mut Scratch, group: &[u32]| {
            Ok(match cost::beyond_usual(group, tree, decomposition, &self.built) {
                0 => scratch.run(&task, group, true)?,
                more => {
                    // What the thread has kept counts as part of it, and goes before the rest is asked for; nothing so large is kept. Nor do
                    // other threads get a part of it.
                    let forget = |scratch: &mut Scratch| {
                        *scratch = Scratch::default();
                        *buffers.own() = Buffers::default();
                    };
                    forget(scratch);
                    let _share = context.store.budget.reserve_task("a group of clusters", more)?;
                    let done = scratch.run(&task, group, false)?;
                    forget(scratch);
                    done
                }
            })
        };
        let scratch = <(Scratch, known::Reader)>::default;
        while_not_due(open.len(), context, scratch, |(scratch, reader), index| {
            let group = &open[index];
            let done = match &context.memo {
                None => work(scratch, group)?,
                Some(memo) => {
                    known::group(memo, &task, (first + index, group), reader, || work(scratch, group))?
                }
            };
            context.progress.advance(group.len() as u64);
            Ok(done)
        })
    }

    /// Ends the level, whose groups are all done.
    fn end(&mut self, inputs: &Inputs<'_>) -> Result<(), BuildError> {
        let Inputs { decomposition, tree, settings, context, .. } = *inputs;
        if self.level == 0 {
            self.built.range =
                ErrorRange::of(settings, diagonal(&self.built.refs), decomposition.rounding.error())?;
        }
        let _traced = context.trace.task("drop");
        self.rise(tree, &context.store);
        Ok(())
    }

    /// Takes in the next group.
    fn take(&mut self, done: GroupDone, decomposition: &Decomposition) {
        let Clusters { refs, reports, groups, .. } = &mut self.built;
        let group = &groups[self.first.unwrap_or(0) + self.done];
        for (node, (page, cluster)) in group.iter().zip(done.members) {
            refs[*node as usize] = Some(page);
            reports[*node as usize] = cluster;
        }
        for id in done.removed {
            self.left[decomposition.shared.interface_of(id) as usize] -= 1;
        }
        self.done += 1;
    }

    /// Drops what no level above needs, and goes on to the next.
    fn rise(&mut self, tree: &Tree, store: &Store) {
        // One of the last is what the root is held against.
        let top = tree.level_count().saturating_sub(1);
        for (below, spool) in self.displacements.iter_mut().enumerate().filter(|(_, s)| !s.is_empty()) {
            let last = last_reader(tree, below as u32);
            if last <= self.level && last + anew::BELOW <= top {
                *spool = levels::displacements(store, below);
            }
        }
        (self.level, self.first, self.done) = (self.level + 1, None, 0);
    }
}

/// Of the box around the finest meshes that there are.
fn diagonal(refs: &[Option<PageRef>]) -> f64 {
    let mut all = Aabb::EMPTY;
    refs.iter().flatten().for_each(|page| all.merge(&page.bounds));
    all.diagonal()
}

/// The sums of the levels over the nodes that were built.
pub(crate) fn level_reports(
    tree: &Tree,
    refs: &[Option<PageRef>],
    reports: &[LevelReport],
) -> Vec<LevelReport> {
    let mut levels: Vec<LevelReport> = Vec::new();
    for ((node, report), _) in tree.nodes.iter().zip(reports).zip(refs).filter(|(_, page)| page.is_some()) {
        let level = node.level as usize;
        for above in levels.len()..=level {
            let empty =
                LevelReport { level: above as u32, min_error: f32::INFINITY, ..LevelReport::default() };
            levels.push(empty);
        }
        add(&mut levels[level], report);
    }
    levels
}

/// The highest level that reads what the given one leaves.
fn last_reader(tree: &Tree, level: u32) -> u32 {
    let parents = tree.nodes[tree.level(level)].iter().filter_map(|n| n.parent);
    parents.map(|parent| tree.nodes[parent as usize].level).max().unwrap_or(level)
}

fn add(level: &mut LevelReport, cluster: &LevelReport) {
    level.clusters += cluster.clusters;
    level.vertices += cluster.vertices;
    level.base_vertices += cluster.base_vertices;
    level.triangles += cluster.triangles;
    level.base_triangles += cluster.base_triangles;
    level.shared_vertices += cluster.shared_vertices;
    level.stalled += cluster.stalled;
    level.forced += cluster.forced;
    level.min_error = level.min_error.min(cluster.min_error);
    level.max_error = level.max_error.max(cluster.max_error);
    level.max_gap = level.max_gap.max(cluster.max_gap);
    level.normal_deviation = level.normal_deviation.max(cluster.normal_deviation);
    level.color_deviation = level.color_deviation.max(cluster.color_deviation);
    level.refusals += cluster.refusals;
}
