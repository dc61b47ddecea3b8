//! Layout: three orders by the published cache-oblivious metric ([Y] 6 and 7), each a permutation that changes no geometry (I9).
//!
//! Clusters in the file (`cluster_order`), and in each cluster the base mesh's vertices and the triangles (`local_order`). The
//! collapsed vertices keep their order, which is the collapse order.

mod cluster_order;
mod local_order;
pub mod metric;
mod multilevel;

use crate::config::Settings;
use crate::context::Context;
use crate::error::BuildError;
use crate::hierarchy::Tree;
use crate::simplify::Hierarchy;
use chpm_format::{ClusterRecord, Page};
use chpm_mesh::{GroupId, Level};
use local_order::LocalOrder;
use rayon::prelude::*;

/// A cluster at its place in the file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    pub(crate) node: u32,
    /// Its record, but for what depends on other clusters.
    pub(crate) record: ClusterRecord,
}

/// Reorders every page in place, and answers the clusters in the order of the file.
pub(crate) fn run(
    clusters: &Hierarchy,
    tree: &Tree,
    settings: &Settings,
    context: &Context<'_>,
) -> Result<Vec<Placed>, BuildError> {
    let nodes: Vec<u32> = (0..clusters.refs.len() as u32).filter(|n| clusters.refs[*n as usize].is_some()).collect();
    let placed: Vec<Placed> = nodes
        .par_iter()
        .with_max_len(4)
        .map_init(Default::default, |scratch: &mut Scratch, node| {
            context.check()?;
            let placed = scratch.reorder(*node, clusters, tree, settings)?;
            context.progress.advance(1);
            Ok(placed)
        })
        .collect::<Result<_, BuildError>>()?;
    if !settings.layout {
        // Breadth first from the root, as [Q] 4.3 stores them.
        return Ok(placed.into_iter().rev().collect());
    }
    let mut by_node = vec![None; clusters.refs.len()];
    for cluster in placed {
        by_node[cluster.node as usize] = Some(cluster);
    }
    let order = cluster_order::order(tree, |node| by_node[node as usize].map(|c: Placed| c.record.aabb()));
    Ok(order.into_iter().filter_map(|node| by_node[node as usize]).collect())
}

#[derive(Default)]
struct Scratch {
    bytes: Vec<u8>,
    reordered: Vec<u8>,
    order: LocalOrder,
}

impl Scratch {
    fn reorder(
        &mut self,
        node: u32,
        clusters: &Hierarchy,
        tree: &Tree,
        settings: &Settings,
    ) -> Result<Placed, BuildError> {
        let Some(page) = clusters.refs[node as usize] else { unreachable!("only built nodes are laid out") };
        clusters.pages.read(page.offset, page.len as usize, &mut self.bytes)?;
        if settings.layout {
            self.reordered.clear();
            self.order.reorder(&Page::view(&self.bytes)?, &mut self.reordered)?;
            debug_assert_eq!(self.reordered.len(), self.bytes.len());
            std::mem::swap(&mut self.bytes, &mut self.reordered);
            clusters.pages.overwrite(page.offset, &self.bytes)?;
        }
        let level = Level(tree.nodes[node as usize].level);
        let record = ClusterRecord::of_page(&self.bytes, level, GroupId::NONE, GroupId::NONE)?;
        Ok(Placed { node, record })
    }
}
