//! Trim: what lies outside the range of errors that a scene needs goes.
//!
//! For an error-bound below the fine end, the file that is left draws what the whole one draws for the fine end, and the same for all
//! others. At the fine end a group whose members' finest meshes keep to the bound needs nothing below it; groups without anything
//! below start at their position for the bound, all members alike, since an error stands for the same group border collapses in all of
//! them. A cluster that cannot go with its siblings keeps that one position. At the coarse end nothing was built above
//! groups whose base meshes exceed the bound, so these end at their position for it.

use crate::context::Context;
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::range::ErrorRange;
use crate::report::LevelReport;
use crate::simplify::{Clusters, PageRef, level_reports};
use chpm_format::{FormatError, Page, PageParts};
use chpm_mesh::{Aabb, Places};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The hierarchy as it is written.
#[derive(Serialize, Deserialize)]
pub(crate) struct Built {
    pub(crate) tree: Tree,
    pub(crate) clusters: Clusters,
    /// Clusters that are left where detail of the source was left out.
    pub(crate) trimmed: Option<Trimmed>,
}

/// Clusters that are left where detail of the source was left out.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Trimmed {
    /// Vertices of the leaves, shared ones counted once.
    pub(crate) vertex_count: u64,
    /// Shared vertices that a leaf still has.
    pub(crate) shared_count: u32,
    /// Their new ids, by old id.
    new_ids: Vec<u32>,
    /// By node, whether it is a leaf that is not the source's own.
    leaves: Vec<bool>,
}

impl Trimmed {
    /// Whether a node is a leaf whose triangles are not the source's own.
    pub(crate) fn is_trimmed(&self, node: u32) -> bool {
        self.leaves[node as usize]
    }

    /// Gives the shared vertices of a page their new ids.
    pub(crate) fn renumber(&self, bytes: &mut [u8]) -> Result<(), FormatError> {
        Page::renumber(bytes, |id| self.new_ids[id as usize])
    }
}

/// Takes away what the range of errors does not need, and gives the nodes that are left their levels.
pub(crate) fn run(
    mut tree: Tree,
    mut clusters: Clusters,
    context: &Context<'_>,
) -> Result<Built, BuildError> {
    clusters.raise_top(&mut tree);
    let range = clusters.range;
    if range == ErrorRange::ALL {
        return Ok(Built { tree, clusters, trimmed: None });
    }

    // The fine end: groups that need nothing below them lose it.
    let was_leaf: Vec<bool> = tree.nodes.iter().map(|node| node.children.is_none()).collect();
    if let Some(finest) = range.finest {
        drop_below(&mut clusters, &mut tree, finest);
        set_levels(&clusters, &mut tree);
    }

    // Both ends of what is left: each cluster keeps the positions of the range.
    let nodes: Vec<u32> = clusters.groups.concat();
    let phase = context.trace.phase();
    let clipped = (nodes.par_iter())
        .with_max_len(4)
        .map_init(Scratch::default, |scratch: &mut Scratch, node: &u32| {
            let _traced = phase.task("clip");
            context.check()?;
            let page = clusters.page(*node);
            // What a leaf starts at; other finest meshes are unions of base meshes below.
            let is_leaf = tree.nodes[*node as usize].children.is_none();
            let finest = range.finest.filter(|_| is_leaf).map(|finest| page.gaps.error_within(finest));
            let coarsest = Some(range.coarsest).filter(|error| page.group_error > *error);
            scratch.clip(&clusters, *node, finest, coarsest)
        })
        .collect::<Result<Vec<_>, BuildError>>()?;

    let mut leaves = Leaves::default();
    let mut coarser = vec![false; tree.nodes.len()];
    for (node, clipped) in nodes.iter().zip(clipped) {
        let at = *node as usize;
        if tree.nodes[at].children.is_none() {
            leaves.add(&clipped);
            coarser[at] = clipped.is_coarser || !was_leaf[at];
        }
        clusters.refs[at] = Some(clipped.page);
        clusters.reports[at] = clipped.report;
    }
    clusters.levels = level_reports(&tree, &clusters.refs, &clusters.reports);
    let trimmed = range.finest.map(|_| leaves.finish(coarser));
    Ok(Built { tree, clusters, trimmed })
}

/// Drops the children of every group whose members' finest meshes are no farther from the source than `finest`. Errors and gaps grow up the
/// groups, so nothing that is kept loses what is below it.
fn drop_below(clusters: &mut Clusters, tree: &mut Tree, finest: f32) {
    let Clusters { refs, groups, .. } = clusters;
    fn distance(page: PageRef) -> f32 {
        page.group_error.max(page.gaps.base)
    }
    let errors: Vec<f32> = refs.iter().map(|page| page.map_or(0.0, distance)).collect();
    for group in groups.iter() {
        let below = || group.iter().flat_map(|node| tree.children(*node));
        if below().any(|child| errors[*child as usize] > finest) {
            continue;
        }
        below().for_each(|child| refs[*child as usize] = None);
        group.iter().for_each(|node| tree.nodes[*node as usize].children = None);
    }
    groups.iter_mut().for_each(|group| group.retain(|node| refs[*node as usize].is_some()));
    groups.retain(|group| !group.is_empty());
}

/// A group is one level above the highest of its members' children; those without any are the new leaves.
fn set_levels(clusters: &Clusters, tree: &mut Tree) {
    for group in &clusters.groups {
        let children = group.iter().flat_map(|node| tree.children(*node));
        let below = children.map(|child| tree.nodes[*child as usize].level).max();
        let level = below.map_or(0, |below| below + 1);
        group.iter().for_each(|node| tree.nodes[*node as usize].level = level);
    }
}

/// Result of clipping a cluster.
struct Clipped {
    page: PageRef,
    report: LevelReport,
    /// Whether its finest mesh has become coarser.
    is_coarser: bool,
    /// Vertices that it shares with none.
    own_vertices: u64,
    shared_ids: Vec<u32>,
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    bytes: Vec<u8>,
    out: Vec<u8>,
    places: Places,
    triangles: Vec<[u16; 3]>,
    errors: Vec<f32>,
    shared: Vec<(u16, u32)>,
}

impl Scratch {
    /// Cuts the ends of a node's progressive mesh off: collapses of an error up to `finest` are carried out for good, those of an
    /// error above `coarsest` never.
    fn clip(
        &mut self,
        clusters: &Clusters,
        node: u32,
        finest: Option<f32>,
        coarsest: Option<f32>,
    ) -> Result<Clipped, BuildError> {
        let (mut kept, mut report) = (clusters.page(node), clusters.reports[node as usize]);
        kept.gaps.fine = finest.map_or(kept.gaps.fine, |error| kept.gaps.at(error));

        let mut bytes = std::mem::take(&mut self.bytes);
        clusters.pages.read(kept.offset, kept.len as usize, &mut bytes)?;
        let mut page = Page::view(&bytes)?;
        let all = page.vertex_count();

        let end = finest.map_or(all, |error| page.vertices_for(error));
        let start = coarsest.map_or(page.base_vertex_count, |error| page.vertices_for(error));
        if (start, end) != (page.base_vertex_count, all) {
            self.encode(&page, start..end)?;
            kept.offset = clusters.pages.append(&self.out)?;
            kept.len = self.out.len() as u32;
            kept.bounds = Aabb::of_points(&page.positions[..end]);
            page = Page::view(&self.out)?;
            report.vertices = page.vertex_count() as u64;
            report.base_vertices = page.base_vertex_count as u64;
            report.triangles = page.triangles.len() as u64;
            report.base_triangles = page.base_triangle_count as u64;
            report.shared_vertices = page.shared_ids.len() as u64;
            (report.min_error, report.max_error) = (page.min_error, page.max_error());
        }

        let clipped = Clipped {
            page: kept,
            report,
            is_coarser: end < all,
            own_vertices: (page.vertex_count() - page.shared_ids.len()) as u64,
            shared_ids: if finest.is_some() { page.shared_ids.to_vec() } else { Vec::new() },
        };
        self.bytes = bytes;
        Ok(clipped)
    }

    /// Encodes the page with only these positions.
    fn encode(&mut self, page: &Page<'_>, positions: Range<usize>) -> Result<(), FormatError> {
        let Range { start, end } = positions;
        let base = page.base_vertex_count;

        self.places.go_to(&page.progressive_mesh(), end);
        self.triangles.clear();
        self.triangles.extend(self.places.triangles(page.triangles));
        self.errors.clear();
        self.errors.extend((start..end).map(|n| page.error_at(n)));
        self.shared.clear();
        self.shared.extend(page.shared().filter(|(vertex, _)| usize::from(*vertex) < end));

        self.out.clear();
        PageParts {
            vertices: page.vertices.first(end),
            triangles: &self.triangles,
            targets: &page.targets[start - base..end - base],
            errors: &self.errors,
            shared: &self.shared,
            min_error: page.error_at(end),
            scale_error: page.error_scale,
        }
        .encode(&mut self.out)?;
        Ok(())
    }
}

/// Counts the vertices of the new leaves.
#[derive(Default)]
struct Leaves {
    own_vertices: u64,
    listed: Vec<bool>,
}

impl Leaves {
    fn add(&mut self, leaf: &Clipped) {
        self.own_vertices += leaf.own_vertices;
        for id in &leaf.shared_ids {
            let id = *id as usize;
            if id >= self.listed.len() {
                self.listed.resize(id + 1, false);
            }
            self.listed[id] = true;
        }
    }

    fn finish(self, leaves: Vec<bool>) -> Trimmed {
        let mut shared_count = 0;
        let new_ids = self.listed.iter().map(|listed| {
            shared_count += u32::from(*listed);
            // Of no meaning where no leaf lists the id: then nothing above does.
            shared_count.saturating_sub(1)
        });
        let new_ids = new_ids.collect();
        Trimmed { vertex_count: self.own_vertices + u64::from(shared_count), shared_count, new_ids, leaves }
    }
}
