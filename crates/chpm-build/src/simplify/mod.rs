//! Simplify: bottom-up, level by level; every cluster is halved (Quick-VDR 4.3).
//!
//! A leaf starts from its part of the source, a parent from the union of its children's base meshes (I4). Clusters of a
//! level are independent tasks over the threads: a vertex that a cluster shares with another is locked until the clusters
//! that use it have merged. Establishes I3, I4, I6 and I8.

mod merge;
mod working_set;

use crate::config::Settings;
use crate::context::Context;
use crate::decompose::{Decomposition, LeafData};
use crate::error::BuildError;
use crate::hierarchy::{Node, Tree};
use crate::report::LevelReport;
use chpm_extmem::Spool;
use chpm_format::{MAX_CLUSTER_VERTICES, PageParts};
use chpm_mesh::Aabb;
use chpm_qem::{Decimator, Patch, Record, Refusals};
use rayon::prelude::*;
use working_set::WorkingSet;

/// A cluster's page in a spool.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PageRef {
    pub(crate) offset: u64,
    pub(crate) len: u32,
    /// Decoded error of the base mesh.
    pub(crate) max_error: f32,
    /// Box around the finest mesh.
    pub(crate) bounds: Aabb,
    /// Vertices of the base mesh: what a merge starts from.
    base_vertex_count: u32,
}

/// Pages of all clusters that were built.
pub(crate) struct Hierarchy {
    pub(crate) pages: Spool,
    /// By node of the tree; none above a merge that would not fit 16-bit indices.
    pub(crate) refs: Vec<Option<PageRef>>,
    pub(crate) levels: Vec<LevelReport>,
}

impl Hierarchy {
    /// The page of a node that was built.
    pub(crate) fn page(&self, node: u32) -> PageRef {
        self.refs[node as usize].unwrap_or_else(|| panic!("node {node} was not built"))
    }
}

/// What one thread works with.
#[derive(Default)]
struct Scratch {
    set: WorkingSet,
    leaf: LeafData,
    children: [Vec<u8>; 2],
    locked: Vec<bool>,
    decimator: Decimator,
    record: Record,
    renumbered: WorkingSet,
    page: Vec<u8>,
}

/// Builds every cluster's progressive mesh; `release` is the level from which a shared vertex is free.
pub(crate) fn run(
    decomposition: &Decomposition,
    tree: &Tree,
    release: &[u8],
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Hierarchy, BuildError> {
    let pages = Spool::new(&context.store, "pages");
    let mut refs: Vec<Option<PageRef>> = vec![None; tree.nodes.len()];
    let mut levels = Vec::new();
    for level in 0..tree.level_count() {
        let nodes = tree.level(level);
        let built: Vec<Option<(PageRef, LevelReport)>> = nodes
            .clone()
            .into_par_iter()
            .with_max_len(1)
            .map_init(Scratch::default, |scratch, node| {
                context.check()?;
                let load = scratch.load(node, &tree.nodes[node], decomposition, &refs, &pages)?;
                let Some(min_error) = load else { return Ok(None) };
                let built = scratch.simplify(level, release, min_error, settings, &pages)?;
                context.progress.advance(1);
                Ok(Some(built))
            })
            .collect::<Result<_, BuildError>>()?;
        let mut report = LevelReport { level, min_error: f32::INFINITY, ..LevelReport::default() };
        for (node, built) in nodes.zip(built) {
            let Some((page, cluster)) = built else { continue };
            refs[node] = Some(page);
            add(&mut report, &cluster);
        }
        if report.clusters > 0 {
            levels.push(report);
        }
    }
    Ok(Hierarchy { pages, refs, levels })
}

fn add(level: &mut LevelReport, cluster: &LevelReport) {
    level.clusters += cluster.clusters;
    level.vertices += cluster.vertices;
    level.base_vertices += cluster.base_vertices;
    level.triangles += cluster.triangles;
    level.base_triangles += cluster.base_triangles;
    level.shared_vertices += cluster.shared_vertices;
    level.stalled += cluster.stalled;
    level.min_error = level.min_error.min(cluster.min_error);
    level.max_error = level.max_error.max(cluster.max_error);
    level.refusals += cluster.refusals;
}

impl Scratch {
    /// Fills the working set of a node; answers the error that it comes with, or none if it cannot be built.
    fn load(
        &mut self,
        node: usize,
        tree_node: &Node,
        decomposition: &Decomposition,
        refs: &[Option<PageRef>],
        pages: &Spool,
    ) -> Result<Option<f32>, BuildError> {
        let Some(children) = tree_node.children else {
            self.leaf.read(&decomposition.leaves[node], &decomposition.spool)?;
            self.set.fill_from_leaf(&self.leaf, decomposition);
            return Ok(Some(0.0));
        };
        let [Some(a), Some(b)] = children.map(|c| refs[c as usize]) else { return Ok(None) };
        if a.base_vertex_count + b.base_vertex_count > MAX_CLUSTER_VERTICES {
            return Ok(None);
        }
        for (bytes, child) in self.children.iter_mut().zip([a, b]) {
            pages.read(child.offset, child.len as usize, bytes)?;
        }
        self.set.fill_from_children(&self.children)?;
        Ok(Some(a.max_error.max(b.max_error)))
    }

    /// Simplifies the working set and spools its page.
    fn simplify(
        &mut self,
        level: u32,
        release: &[u8],
        min_error: f32,
        settings: &Settings,
        pages: &Spool,
    ) -> Result<(PageRef, LevelReport), BuildError> {
        let set = &mut self.set;
        set.shared.retain(|(_, id)| u32::from(release[*id as usize]) > level);
        self.locked.clear();
        self.locked.resize(set.positions.len(), false);
        for (vertex, _) in &set.shared {
            self.locked[usize::from(*vertex)] = true;
        }
        let patch = Patch { positions: &set.positions, triangles: &set.triangles, locked: &self.locked };
        let target = (set.triangles.len() as f64 * settings.keep) as usize;
        let outcome = self.decimator.decimate(&patch, target, min_error);
        self.record.renumber(&patch, &outcome);
        let (base_triangles, stalled, refusals) = (outcome.triangle_count, outcome.stalled, outcome.refusals);
        self.renumbered.fill_renumbered(set, &self.record);

        self.page.clear();
        let set = &self.renumbered;
        let max_error = PageParts {
            positions: &set.positions,
            normals: &set.normals,
            colors: &set.colors,
            triangles: &set.triangles,
            targets: &self.record.targets,
            errors: &self.record.errors,
            shared: &set.shared,
            min_error,
            scale_error: 0.0,
        }
        .encode(&mut self.page)?;
        let base_vertex_count = self.record.base_vertex_count() as u32;
        let page = PageRef {
            offset: pages.append(&self.page)?,
            len: self.page.len() as u32,
            max_error,
            bounds: Aabb::of_points(&set.positions),
            base_vertex_count,
        };
        Ok((page, self.report(level, base_triangles, stalled, refusals, min_error, max_error)))
    }

    fn report(
        &self,
        level: u32,
        base_triangles: usize,
        stalled: bool,
        refusals: Refusals,
        min_error: f32,
        max_error: f32,
    ) -> LevelReport {
        LevelReport {
            level,
            clusters: 1,
            vertices: self.set.positions.len() as u64,
            base_vertices: self.record.base_vertex_count() as u64,
            triangles: self.set.triangles.len() as u64,
            base_triangles: base_triangles as u64,
            shared_vertices: self.set.shared.len() as u64,
            stalled: u32::from(stalled),
            min_error,
            max_error,
            refusals,
        }
    }
}
