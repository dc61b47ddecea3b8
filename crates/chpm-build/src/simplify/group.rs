//! One dependency group: its members are loaded, their group borders simplified together, and each member halved.

use super::anew;
use super::dependency::GroupBorders;
use super::group_border::GroupBorder;
use super::lasting;
use super::runaway;
use super::vanished::Vanished;
use super::working_set::{Child, WorkingSet};
use super::{Clusters, PageRef};
use crate::config::{Division, Layout, Settings};
use crate::decompose::Decomposition;
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::per_thread::PerThread;
use crate::report::LevelReport;
use crate::trace::Trace;
use crate::triangle_order::TriangleOrder;
use chpm_extmem::Spool;
use chpm_format::{Gaps, PageParts};
use chpm_mesh::geom::round_up;
use chpm_mesh::{Aabb, ProgressiveMesh};
use chpm_qem::{
    Collapse, Decimator, Deviation, Displacement, DroppedComponent, FaceAttributeError, Outcome, Patch,
    Record,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::mem;

/// Triangles that the root goes down to, since no level above it will: a model in the distance.
const ROOT_TRIANGLES: usize = 100;

/// Levels that are simplified in haste: three quarters of the work. What the coarse ones lose is seen in everything far away.
const HASTY_LEVELS: u32 = 2;

/// Context that the groups of a level share.
pub(super) struct GroupTask<'a> {
    pub(super) trace: &'a Trace,
    pub(super) buffers: &'a PerThread<Buffers>,
    pub(super) level: u32,
    pub(super) tree: &'a Tree,
    pub(super) decomposition: &'a Decomposition,
    pub(super) built: &'a Clusters,
    /// Displacements of base meshes, a spool for each level up to this one.
    pub(super) displacements: &'a [Spool],
    pub(super) release: &'a [u8],
    pub(super) group_borders: &'a GroupBorders<'a>,
    pub(super) settings: &'a Settings,
}

/// Result of a group.
#[derive(Serialize, Deserialize)]
pub(super) struct GroupDone {
    pub(super) members: Vec<(PageRef, LevelReport)>,
    /// Shared vertices that collapsed.
    pub(super) removed: Vec<u32>,
}

/// Buffers of a group. A thread has one at a time, and works on members of others while its own are worked on elsewhere.
#[derive(Default)]
pub(super) struct Scratch {
    members: Vec<Member>,
    group_border: GroupBorder,
    errors: runaway::Errors,
}

/// Buffers of one thread, for whichever member it works on.
#[derive(Default)]
pub(super) struct Buffers {
    leaf: Vec<u8>,
    children: Vec<Child>,
    collapses: Vec<Collapse>,
    decimator: Decimator,
    order: TriangleOrder,
    ordered: Vec<[u16; 3]>,
    page: Vec<u8>,
}

/// One member and what was made of it.
#[derive(Default)]
struct Member {
    set: WorkingSet,
    min_error: f32,
    is_root: bool,
    locked: Vec<bool>,
    record: Record,
    renumbered: WorkingSet,
    /// Of the base mesh.
    base_triangles: Vec<[u16; 3]>,
    displacements: Vec<Displacement>,
    attribute_errors: Vec<FaceAttributeError>,
    vanished: Vanished,
    /// Box around its part of the source.
    source: Aabb,
    /// Collapses of group borders, the first of its record.
    group_border: usize,
    /// The largest of its meshes and of those below, and of these.
    deviation: Deviation,
    deviation_below: Deviation,
    report: LevelReport,
    /// Once it is spooled.
    done: Option<(PageRef, LevelReport)>,
}

impl Scratch {
    /// Simplifies a group and spools its pages, the members side by side where `together` allows it.
    pub(super) fn run(
        &mut self,
        task: &GroupTask<'_>,
        group: &[u32],
        together: bool,
    ) -> Result<GroupDone, BuildError> {
        if self.members.len() < group.len() {
            self.members.resize_with(group.len(), Member::default);
        }
        let Scratch { members, group_border, errors } = self;
        let members = &mut members[..group.len()];

        each(members, together, task, "load", |side, member, buffers| {
            member.load(task, group[side], buffers)
        })?;
        // Errors of a group start from one value, so that a group border's error is the same in every member.
        let min_error = members.iter().map(|m| m.min_error).fold(0.0, f32::max);

        // The group borders of several members are simplified once, for all of them.
        let mut removed = Vec::new();
        let mut has_group_border = false;
        if group.len() > 1 {
            let sets: Vec<&WorkingSet> = members.iter().map(|m| &m.set).collect();
            let inside = |id| task.group_borders.is_inside(id, group);
            let decimator = &mut task.buffers.own().decimator;
            task.prepare(decimator);
            has_group_border = group_border.simplify(decimator, &sets, inside, task.settings.keep, min_error);
            if has_group_border {
                removed.extend(group_border.removed());
            }
        }

        each(members, together, task, "halve", |side, member, buffers| {
            let Buffers { decimator, collapses, .. } = buffers;
            collapses.clear();
            if has_group_border {
                group_border.collapses_of(side, collapses);
                group_border.hand_to(side, &mut member.set);
                member.deviation_below = member.deviation_below.max(group_border.deviation);
            }
            task.prepare(decimator);
            let (triangles, goal) = member.goals(task);
            member.simplify(decimator, task, |decimator, patch| {
                decimator.decimate_after(patch, collapses, goal, min_error)
            });
            member.group_border = collapses.len();
            member.report.stalled = u32::from(member.report.base_triangles > triangles as u64);
            if member.is_root { member.find_anew(task, group[side]) } else { Ok(()) }
        })?;

        let limit = errors.limit(members.iter().map(|m| &m.record.errors[..]));
        each(members, together, task, "again", |_, member, Buffers { decimator, collapses, .. }| {
            if !member.is_root && member.max_error() > limit {
                task.prepare(decimator);
                member.go_back(decimator, collapses, task, limit, min_error);
            }
            Ok(())
        })?;

        // Errors and gaps are the group's: its members are drawn together or not at all.
        let farthest = farthest(members, task.decomposition.rounding.error());
        members.iter_mut().for_each(|m| m.limit_errors(farthest, min_error));
        let (gaps, rest) = gaps(members);
        let largest = members.iter().map(Member::max_error).fold(0.0, f32::max);

        each(members, together, task, "spool", |_, member, buffers| {
            if task.settings.layout == Layout::VertexCache {
                member.order_triangles(&mut buffers.order, &mut buffers.ordered);
            }
            member.spool(task, largest, &mut buffers.page)
        })?;
        let mut members: Vec<(PageRef, LevelReport)> = members.iter().filter_map(|m| m.done).collect();

        // Known only when all members are encoded, since codes round errors up.
        let group_error = members.iter().map(|m| m.1.max_error).fold(0.0, f32::max);
        for (page, report) in &mut members {
            (page.group_error, page.gaps, page.rest) = (group_error, gaps, rest);
            report.max_gap = gaps.base;
        }
        Ok(GroupDone { members, removed })
    }
}

/// Does `work` on each member, side by side unless they are to come one after another.
fn each(
    members: &mut [Member],
    together: bool,
    task: &GroupTask<'_>,
    name: &'static str,
    work: impl Fn(usize, &mut Member, &mut Buffers) -> Result<(), BuildError> + Sync,
) -> Result<(), BuildError> {
    let phase = task.trace.phase();
    let traced = |(side, member): (usize, &mut Member)| {
        let _traced = phase.task(name);
        work(side, member, &mut task.buffers.own())
    };
    match together {
        true => members.par_iter_mut().enumerate().with_max_len(1).try_for_each(traced),
        false => members.iter_mut().enumerate().try_for_each(traced),
    }
}

impl GroupTask<'_> {
    /// Gives a decimator the settings of the level.
    fn prepare(&self, decimator: &mut Decimator) {
        (decimator.topology, decimator.hasty) = (self.settings.topology, self.level < HASTY_LEVELS);
    }

    /// Whether clusters that have a shared vertex have not merged yet.
    pub(super) fn is_locked(&self, id: u32) -> bool {
        u32::from(self.release[self.decomposition.shared.interface_of(id) as usize]) > self.level
    }

    /// Remnants that a cluster has at most.
    pub(super) fn most_lasting(&self) -> usize {
        let nodes = self.tree.nodes.len();
        lasting::most(match self.settings.division {
            Division::Graph => nodes,
            // A few clusters more or less are to change nothing elsewhere.
            Division::Cubes => nodes.next_power_of_two(),
        })
    }
}

/// Upper bound on any error, whatever the collapses say: a cluster draws vertices of its part of the source, so that the two are within one
/// box. Infinite if a member draws nothing.
fn farthest(members: &[Member], rounding: f32) -> f32 {
    if members.iter().any(|m| m.report.base_triangles == 0) {
        return f32::INFINITY;
    }
    let diagonals = members.iter().map(|m| m.source.diagonal());
    round_up(diagonals.fold(0.0, f64::max) * (1.0 + 4.0 * f64::EPSILON) + f64::from(rounding))
}

/// How far what has vanished is from the members' meshes, in the worst of them: all of it, and what has no remnant.
fn gaps(members: &mut [Member]) -> (Gaps, f32) {
    let vanishing = members.iter().map(|m| m.vanished.from()).fold(f32::INFINITY, f32::min);
    let gaps = members.iter_mut().map(|m| m.vanished.base_gap(&m.renumbered, &m.record));
    let base = gaps.fold(0.0, f32::max);
    // Beside errors that are larger it does not matter.
    let from = vanishing.min(base);
    let gaps = members.iter_mut().map(|m| m.vanished.fine_gap(&m.renumbered, &m.record, from));
    let fine = gaps.fold(0.0, f32::max);
    let rest = members.iter_mut().map(|m| m.vanished.rest(&m.renumbered, &m.record)).fold(0.0, f32::max);
    let base = base.max(fine);
    (Gaps { fine, base, from }, rest.min(base))
}

impl Member {
    /// Fills the working set of a node, and the error that it comes with.
    fn load(&mut self, task: &GroupTask<'_>, node: u32, buffers: &mut Buffers) -> Result<(), BuildError> {
        self.deviation_below = Deviation::default();
        self.vanished.clear();
        self.source = Aabb::EMPTY;
        self.is_root = task.tree.is_root(node);
        let children = task.built.children(task.tree, node);
        if !children.is_empty() {
            self.min_error = 0.0;
            if buffers.children.len() < children.len() {
                buffers.children.resize_with(children.len(), Child::default);
            }
            for (read, &child) in buffers.children.iter_mut().zip(children) {
                let page = task.built.page(child);
                task.built.pages.read(page.offset, page.len as usize, &mut read.page)?;
                let displacements = &task.displacements[task.tree.nodes[child as usize].level as usize];
                let len = page.base_triangle_count as usize * size_of::<[u16; 3]>();
                displacements.read(page.base_triangles, len, &mut read.triangles)?;
                let len = page.base_triangle_count as usize * size_of::<Displacement>();
                displacements.read(page.displacements, len, &mut read.displacements)?;
                let len = page.attribute_error_count as usize * size_of::<FaceAttributeError>();
                displacements.read(page.attribute_errors, len, &mut read.attribute_errors)?;
                let len = page.dropped_count as usize * size_of::<DroppedComponent>();
                displacements.read(page.dropped, len, &mut read.dropped)?;
                self.vanished.add_child(&read.dropped, page.bare_count, [page.gaps.base, page.rest]);
                self.source.merge(&page.source);
                self.deviation_below = self.deviation_below.max(page.deviation);
                self.min_error = self.min_error.max(page.group_error);
            }
            self.set.fill_from_children(&buffers.children[..children.len()])?;
        } else {
            let rounding = task.decomposition.rounding;
            let leaf = task.decomposition.read_leaf(node, &mut buffers.leaf)?;
            self.set.fill_from_leaf(&leaf, rounding);
            self.min_error = rounding.error();
            self.source = Aabb::of_points(&self.set.vertices.positions);
        }

        // Vertices whose clusters have merged by now are inner ones.
        self.set.shared.retain(|(_, id)| task.is_locked(*id));
        Ok(())
    }

    /// Triangles that half of it are, or what `keep` says, and those that it goes down to.
    fn goals(&self, task: &GroupTask<'_>) -> (usize, usize) {
        let target = (self.set.triangles.len() as f64 * task.settings.keep) as usize;
        (target, if self.is_root { target.min(ROOT_TRIANGLES) } else { target })
    }

    /// Carries out its collapses again but for those that cost more than `limit`, as far as it does not grow by that.
    fn go_back(
        &mut self,
        decimator: &mut Decimator,
        collapses: &mut Vec<Collapse>,
        task: &GroupTask<'_>,
        limit: f32,
        min_error: f32,
    ) {
        collapses.clear();
        collapses.extend(self.record.collapses());
        let counts = [self.set.triangles.len(), self.base_triangles.len()];
        let most = runaway::MOST_LEFT * task.settings.cluster_triangles as usize;
        let kept = runaway::kept(collapses, self.group_border, limit, counts, most);
        if kept == collapses.len() {
            return;
        }
        let refusals = self.report.refusals;
        self.vanished.forget_own();
        let group_border = self.group_border;
        self.simplify(decimator, task, |decimator, patch| {
            decimator.decimate_again(patch, &collapses[..kept], group_border, min_error)
        });
        self.report.refusals = refusals;
    }

    /// Simplifies the member: the group border's collapses first, then its own, which leave shared vertices alone.
    fn simplify(
        &mut self,
        decimator: &mut Decimator,
        task: &GroupTask<'_>,
        decimate: impl for<'d> FnOnce(&'d mut Decimator, &Patch<'_>) -> Outcome<'d>,
    ) {
        let set = &self.set;
        self.locked.clear();
        self.locked.resize(set.vertices.positions.len(), false);
        for (vertex, _) in &set.shared {
            self.locked[usize::from(*vertex)] = true;
        }

        let patch = Patch {
            positions: &set.vertices.positions,
            triangles: &set.triangles,
            displacements: &set.displacements,
            locked: &self.locked,
            attribute_errors: set.attribute_errors(),
        };
        let outcome = decimate(decimator, &patch);
        self.record.renumber(&patch, &outcome);
        self.vanished.add_own(&outcome, &self.record, task.most_lasting());

        self.report = LevelReport {
            level: task.level,
            clusters: 1,
            vertices: set.vertices.positions.len() as u64,
            base_vertices: self.record.base_vertex_count() as u64,
            triangles: set.triangles.len() as u64,
            base_triangles: outcome.triangle_count as u64,
            shared_vertices: set.shared.len() as u64,
            stalled: 0,
            forced: outcome.forced as u64,
            min_error: self.min_error,
            max_error: 0.0,
            max_gap: 0.0,
            normal_deviation: 0.0,
            color_deviation: 0.0,
            refusals: outcome.refusals,
        };

        // The finest mesh for the page, and for the parent what is left, with how far it is from the source.
        self.renumbered.fill_renumbered(&self.set, &self.record);
        let left = || (0..self.set.triangles.len()).filter(|face| decimator.is_left(*face));
        let new = |vertex: u16| self.record.old_to_new[usize::from(vertex)];
        self.base_triangles.clear();
        self.base_triangles.extend(left().map(|face| decimator.corners(face).map(new)));
        self.displacements.clear();
        self.displacements.extend(left().map(|face| decimator.displacements()[face]));
        self.attribute_errors.clear();
        if !decimator.face_attribute_errors().is_empty() {
            self.attribute_errors.extend(left().map(|face| decimator.face_attribute_errors()[face]));
        }

        self.deviation = self.deviation_below.max(decimator.deviation());
        self.report.normal_deviation = self.deviation.degrees();
        self.report.color_deviation = self.deviation.units();
    }

    /// Lowers the errors of a root to what they are beside a finer mesh.
    fn find_anew(&mut self, task: &GroupTask<'_>, node: u32) -> Result<(), BuildError> {
        let finest = (&self.renumbered.vertices.positions[..], &self.renumbered.triangles[..]);
        anew::lower(task, node, finest, self.vanished.balls(), &mut self.record)?;
        let min_error = self.min_error;
        self.record.errors.iter_mut().for_each(|error| *error = error.max(min_error));
        Ok(())
    }

    /// Lowers errors to what none exceeds, but not below the one that the group came with.
    fn limit_errors(&mut self, farthest: f32, min_error: f32) {
        let limited = |error: f32| error.min(farthest).max(min_error);
        self.record.errors.iter_mut().for_each(|error| *error = limited(*error));
        self.vanished.limit(limited);
        self.vanished.keep_within(&self.record);
    }

    fn max_error(&self) -> f32 {
        self.record.errors.first().copied().unwrap_or(self.min_error)
    }

    /// Puts the finest mesh's triangles in the order of the page.
    fn order_triangles(&mut self, order: &mut TriangleOrder, ordered: &mut Vec<[u16; 3]>) {
        let mesh = ProgressiveMesh {
            vertex_count: self.renumbered.vertices.vertex_count(),
            base_vertex_count: self.record.base_vertex_count(),
            triangles: &self.renumbered.triangles,
            targets: &self.record.targets,
        };
        order.fill(&mesh, ordered);
        mem::swap(ordered, &mut self.renumbered.triangles);
    }

    /// Spools the member's page. `largest` is the group's largest error, by which all of its pages scale theirs.
    fn spool(&mut self, task: &GroupTask<'_>, largest: f32, page: &mut Vec<u8>) -> Result<(), BuildError> {
        page.clear();
        let set = &self.renumbered;
        self.report.max_error = PageParts {
            vertices: set.vertices.view(),
            triangles: &set.triangles,
            targets: &self.record.targets,
            errors: &self.record.errors,
            shared: &set.shared,
            min_error: self.min_error,
            scale_error: largest,
        }
        .encode(page)?;

        let distances = &task.displacements[task.level as usize];
        let lasting = self.vanished.lasting();
        let lasting_count = lasting.len() as u32;
        let lasting =
            if lasting.is_empty() { 0 } else { task.built.pages.append(bytemuck::cast_slice(lasting))? };
        let (dropped, bare_count) = self.vanished.bytes();
        let spooled = PageRef {
            offset: task.built.pages.append(page)?,
            len: page.len() as u32,
            group_error: self.report.max_error,
            bounds: Aabb::of_points(&set.vertices.positions),
            source: self.source,
            base_vertex_count: self.record.base_vertex_count() as u32,
            base_triangle_count: self.displacements.len() as u32,
            base_triangles: distances.append(bytemuck::cast_slice(&self.base_triangles))?,
            displacements: distances.append(bytemuck::cast_slice(&self.displacements))?,
            attribute_errors: distances.append(bytemuck::cast_slice(&self.attribute_errors))?,
            attribute_error_count: self.attribute_errors.len() as u32,
            dropped: distances.append(dropped)?,
            dropped_count: (dropped.len() / size_of::<DroppedComponent>()) as u32,
            bare_count,
            gaps: Gaps::default(),
            rest: 0.0,
            lasting,
            lasting_count,
            deviation: self.deviation,
        };
        self.done = Some((spooled, self.report));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use chpm_qem::{Outcome, Refusals};

    /// Where errors are lowered to what none exceeds, so is that from which on something is missing: or the gap of what is missing would not count.
    #[test]
    fn what_is_missing_is_missing_at_errors_that_are_lowered() {
        let mut member = Member::default();
        member.vanished.clear();
        let outcome = Outcome {
            collapses: &[],
            triangle_count: 1,
            stalled: false,
            forced: 0,
            dropped: &[DroppedComponent::default()],
            last_faces: &[],
            vanishing: 7.0,
            refusals: Refusals::default(),
        };
        member.vanished.add_own(&outcome, &member.record, 9);
        member.record.errors = vec![9.0, 7.0, 3.0, 1.0];
        member.limit_errors(4.0, 2.0);
        assert_eq!(member.record.errors, [4.0, 4.0, 3.0, 2.0]);
        assert_eq!(member.vanished.from(), member.record.errors[1]);
        assert!(member.vanished.from() <= member.max_error());
    }
}
