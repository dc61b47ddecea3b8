//! Layout: permutations that change no geometry (I9).
//!
//! Clusters in the file are ordered by the published cache-oblivious metric (`cluster_order`; Yoon 6 and 7). So are, if that is asked for,
//! the base mesh's vertices and the triangles in each cluster (`local_order`). Otherwise the triangles are in an order for vertex caches
//! ([`triangle_order`](crate::triangle_order)), which they get while the cluster is simplified, and pages are copied. The collapsed vertices keep their order,
//! which is the collapse order.

mod cluster_order;
mod local_order;
pub mod metric;
mod multilevel;

use crate::config::{Layout, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::trim::Built;
use chpm_format::{ClusterRecord, Page};
use chpm_mesh::{GroupId, Level};
use local_order::LocalOrder;
use rayon::prelude::*;

/// The built nodes of the tree in the order of their pages in the file.
pub(crate) fn order(built: &Built, settings: &Settings) -> Vec<u32> {
    let Built { tree, clusters, .. } = built;
    if settings.layout != Layout::Simplification {
        cluster_order::order(tree, |node| clusters.refs[node as usize].map(|page| page.bounds))
    } else {
        // Breadth first from the root, as Quick-VDR 4.3 stores them.
        (0..tree.nodes.len() as u32).rev().filter(|node| clusters.refs[*node as usize].is_some()).collect()
    }
}

/// Hands every page to `write` with its place in `order`, from many threads and in any order. Answers the
/// clusters' records by place, but for what depends on other clusters.
pub(crate) fn run(
    order: &[u32],
    built: &Built,
    settings: &Settings,
    context: &Context<'_>,
    write: impl Fn(usize, &[u8]) -> Result<(), BuildError> + Sync,
) -> Result<Vec<ClusterRecord>, BuildError> {
    let lay_out = |scratch: &mut Scratch, (place, node): (usize, &u32)| {
        context.check()?;
        let page = scratch.page(*node, built, settings)?;
        write(place, page)?;
        context.progress.advance(1);
        let level = Level(built.tree.nodes[*node as usize].level);
        let deviation = built.clusters.page(*node).deviation;
        let mut record = ClusterRecord {
            normal_deviation: deviation.degrees(),
            color_deviation: deviation.units(),
            ..ClusterRecord::of_page(page, level, GroupId::NONE, GroupId::NONE)?
        };
        if built.trimmed.as_ref().is_some_and(|trimmed| trimmed.is_trimmed(*node)) {
            record.flags |= ClusterRecord::TRIMMED;
        }
        Ok(record)
    };
    order.par_iter().enumerate().with_max_len(4).map_init(Scratch::default, lay_out).collect()
}

#[derive(Default)]
struct Scratch {
    bytes: Vec<u8>,
    reordered: Vec<u8>,
    order: LocalOrder,
}

impl Scratch {
    /// A node's page as it is written.
    fn page(&mut self, node: u32, built: &Built, settings: &Settings) -> Result<&[u8], BuildError> {
        let Built { clusters, trimmed, .. } = built;
        let page = clusters.page(node);
        clusters.pages.read(page.offset, page.len as usize, &mut self.bytes)?;
        if let Some(trimmed) = trimmed {
            trimmed.renumber(&mut self.bytes)?;
        }
        if settings.layout != Layout::CacheOblivious {
            return Ok(&self.bytes);
        }
        self.reordered.clear();
        self.order.reorder(&Page::view(&self.bytes)?, &mut self.reordered)?;
        debug_assert_eq!(self.reordered.len(), self.bytes.len());
        Ok(&self.reordered)
    }
}
