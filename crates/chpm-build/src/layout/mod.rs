//! Layout: permutations that change no geometry (I9).
//!
//! Pages that a split brings are side by side in the file, by falling error (`page_order`), and are copied: their triangles are in an order for vertex caches
//! ([`triangle_order`](crate::triangle_order)), which they got while the cluster was simplified. Where it is asked for, clusters, and in each of them the base mesh's
//! vertices and the triangles, are ordered by the published cache-oblivious metric instead (`cluster_order`, `local_order`; Yoon 6 and 7). The collapsed vertices
//! keep their order, which is the collapse order.

mod cluster_order;
mod first_use;
mod local_order;
mod metric;
mod multilevel;
pub mod page_order;
mod whole;

use crate::config::{Layout, Settings};
use crate::context::Context;
use crate::error::BuildError;
use crate::in_order::in_order;
use crate::per_thread::PerThread;
use crate::range::ErrorRange;
use crate::simplify;
use crate::trim::Built;
use chpm_format::{ClusterRecord, Page, Remnant, checksum, packed};
use chpm_mesh::{Aabb, GroupId, Level};
use first_use::FirstUse;
use local_order::LocalOrder;
use page_order::Run;
use rayon::prelude::*;
use std::ops::Range;
pub use whole::{MOST_ORDERED, ORDER_BYTES, order_mesh};

/// The built nodes of the tree in the order of their pages in the file: roots first, so that whoever reads from its start can begin to draw.
pub(crate) fn order(built: &Built, settings: &Settings) -> Vec<u32> {
    let Built { tree, clusters, .. } = built;
    let mut order: Vec<u32> = match settings.layout {
        Layout::VertexCache => page_order::order(runs(built)),
        Layout::CacheOblivious => {
            cluster_order::order(tree, |node| clusters.refs[node as usize].map(|page| page.bounds))
        }
        // Breadth first from the root, as Quick-VDR 4.3 stores them.
        Layout::Simplification => {
            (0..tree.nodes.len() as u32).rev().filter(|node| clusters.is_built(*node)).collect()
        }
    };
    order.sort_by_key(|node| !is_root(built, *node));
    order
}

fn is_root(Built { tree, clusters, .. }: &Built, node: u32) -> bool {
    tree.nodes[node as usize].parent.is_none_or(|parent| !clusters.is_built(parent))
}

/// Pages that are read together: roots, and the fine clusters of groups.
fn runs(built: &Built) -> Vec<Run> {
    let Built { tree, clusters, .. } = built;
    fn run(error: f32, nodes: Vec<u32>, clusters: &crate::simplify::Clusters) -> Run {
        let mut bounds = Aabb::EMPTY;
        nodes.iter().for_each(|node| bounds.merge(&clusters.page(*node).bounds));
        Run { error, center: bounds.center().coords.map(|x| x as f32).into(), clusters: nodes }
    }
    let nodes = (0..tree.nodes.len() as u32).filter(|node| clusters.is_built(*node));
    let roots =
        nodes.filter(|node| is_root(built, *node)).map(|root| run(f32::INFINITY, vec![root], clusters));

    let splits = clusters.groups.iter().map(|group| -> Vec<u32> {
        let children = group.iter().flat_map(|node| tree.children(*node)).copied();
        children.filter(|child| clusters.is_built(*child)).collect()
    });
    let splits = splits.filter(|fine| !fine.is_empty()).map(|fine| {
        // A split is asked for where the finest mesh above is too coarse, which is what these have as base meshes.
        let error = fine.iter().map(|node| clusters.page(*node).group_error).fold(0.0, f32::max);
        run(error, fine, clusters)
    });
    roots.chain(splits).collect()
}

/// Hands every page to `write` with its place in `order`, from many threads and in any order. Answers the
/// clusters' records and remnants by place, but for what depends on other clusters.
pub(crate) fn run(
    order: &[u32],
    built: &Built,
    settings: &Settings,
    context: &Context<'_>,
    write: impl Fn(usize, &[u8]) -> Result<(), BuildError> + Sync,
) -> Result<Vec<(ClusterRecord, Vec<Remnant>)>, BuildError> {
    let phase = context.trace.phase();
    let nodes = order.par_iter().enumerate().with_max_len(4);
    let records = nodes.map_init(Scratch::default, |scratch, (place, node)| {
        let _traced = phase.task("page");
        context.check()?;
        let (record, remnants, stored) = lay_out(*node, built, settings, scratch)?;
        write(place, stored)?;
        context.progress.advance(1);
        Ok((record, remnants))
    });
    records.collect()
}

/// The same for some places, which are handed to `take` in their order.
pub(crate) fn run_in_order(
    range: Range<usize>,
    order: &[u32],
    built: &Built,
    settings: &Settings,
    context: &Context<'_>,
    mut take: impl FnMut(&ClusterRecord, Vec<Remnant>, &[u8]) -> Result<(), BuildError> + Send,
) -> Result<(), BuildError> {
    let scratch: PerThread<Scratch> = PerThread::new();
    let nodes = &order[range];
    let lay_out = |at: usize| {
        context.check()?;
        let mut scratch = scratch.own();
        let (record, remnants, stored) = lay_out(nodes[at], built, settings, &mut scratch)?;
        Ok((record, remnants, stored.to_vec()))
    };
    in_order(nodes.len(), rayon::current_num_threads(), lay_out, |(record, remnants, stored)| {
        context.progress.advance(1);
        take(&record, remnants, &stored)
    })
}

/// A node's record and remnants, and its page as it is stored.
fn lay_out<'a>(
    node: u32,
    built: &Built,
    settings: &Settings,
    Scratch { of_page, packed }: &'a mut Scratch,
) -> Result<(ClusterRecord, Vec<Remnant>, &'a [u8]), BuildError> {
    let page = of_page.page(node, built, settings)?;
    let level = Level(built.tree.nodes[node as usize].level);
    let deviation = built.clusters.page(node).deviation;
    let mut record = ClusterRecord {
        normal_deviation: deviation.degrees(),
        color_deviation: deviation.units(),
        ..ClusterRecord::of_page(page, level, GroupId::NONE, GroupId::NONE)?
    };
    if built.trimmed.as_ref().is_some_and(|trimmed| trimmed.is_trimmed(node)) {
        record.flags |= ClusterRecord::TRIMMED;
    }

    let Built { clusters, .. } = built;
    let remnants = match clusters.range == ErrorRange::ALL {
        true => simplify::remnants(&clusters.page(node), &clusters.pages, &Page::view(page)?)?,
        false => Vec::new(),
    };

    // Pages that packing does not make shorter stay as they are.
    packed.clear();
    // What is to be chained is so when all pages are there.
    if settings.is_chained() || !(settings.packed && packed::pack(page, packed)?) {
        return Ok((record, remnants, page));
    }
    record.flags |= ClusterRecord::PACKED;
    (record.page_len, record.page_checksum) = (packed.len() as u32, checksum(packed));
    Ok((record, remnants, packed))
}

#[derive(Default)]
struct Scratch {
    of_page: PageScratch,
    packed: Vec<u8>,
}

#[derive(Default)]
struct PageScratch {
    bytes: Vec<u8>,
    reordered: Vec<u8>,
    order: LocalOrder,
    first_use: FirstUse,
}

impl PageScratch {
    /// A node's page as it is written.
    fn page(&mut self, node: u32, built: &Built, settings: &Settings) -> Result<&[u8], BuildError> {
        let Built { clusters, trimmed, .. } = built;
        let page = clusters.page(node);
        clusters.pages.read(page.offset, page.len as usize, &mut self.bytes)?;
        if let Some(trimmed) = trimmed {
            trimmed.renumber(&mut self.bytes)?;
        }
        self.reordered.clear();
        match settings.layout {
            Layout::Simplification => return Ok(&self.bytes),
            Layout::VertexCache => self.first_use.reorder(&self.bytes, &mut self.reordered)?,
            Layout::CacheOblivious => {
                self.order.reorder(&Page::view(&self.bytes)?, &mut self.reordered)?;
            }
        }
        debug_assert_eq!(self.reordered.len(), self.bytes.len());
        Ok(&self.reordered)
    }
}
