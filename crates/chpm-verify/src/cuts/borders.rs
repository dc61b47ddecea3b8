//! Which edges of every cluster are on a border: those that other clusters must have too, whatever the cut.
//!
//! Clusters meet at shared vertices, so only edges between these can be on a border. Of those that an odd number of a cluster's triangles
//! have, a border edge is one for which the other leaves make the number even; where it is odd over all leaves the source is open, or three
//! sheets meet, and one cluster has an edge of the *rim* there. A collapse takes edges to edges, so border goes to border and rim to
//! rim, and what is odd in a base mesh and does not come from its border is rim. A coarse cluster is the base meshes below it; so its
//! border is what is odd in its own triangles less the rim that comes from below.

use super::local::{Local, UNSHARED, by_vertices, keep_odd, key};
use crate::error::VerifyError;
use bytemuck::{Pod, Zeroable};
use chpm_extmem::{Buckets, BufferWriter, Cancel, Column, Progress, Store};
use chpm_format::{Chpm, FormatError, Page};
use chpm_mesh::{ClusterId, GroupId};
use rayon::prelude::*;
use std::ops::Range;

/// Most groups, or leaves, that are read at a time.
const BATCH: usize = 64;
/// Bytes of rim that a group gathers before they go to disk, and of edges that are looked at together.
const BLOCK: usize = 256;
const EDGES_BLOCK: usize = 4096;
/// One part of so many of the memory for what is found in a batch, and as much for edges of leaves that are looked at together.
const SHARE: u64 = 4;
/// Bytes that an edge of a rim takes while the group above is looked at, at most, and bytes for the edges of a leaf's triangle.
const RIM: u64 = 32;
const TRIANGLE: u64 = 3 * size_of::<OfLeaf>() as u64;
/// Bytes for every shared vertex while borders are found.
const VERTEX: u64 = 1 + 2 * size_of::<u32>() as u64;

/// The border edges of every cluster's finest mesh.
pub(super) struct Borders {
    edges: Column<[u16; 2]>,
    /// By cluster.
    ranges: Vec<Range<usize>>,
    /// By shared id.
    loose: Vec<bool>,
}

/// An edge by its shared ids, and a leaf in which it is odd.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct OfLeaf {
    edge: [u32; 2],
    leaf: u32,
}

/// Part of a group: the borders of its coarse clusters, and the rims of their base meshes for the groups above.
#[derive(Default)]
struct OfGroup {
    borders: Vec<(ClusterId, Vec<[u16; 2]>)>,
    rims: Vec<(GroupId, Vec<[u32; 2]>)>,
    /// Ends, two by two, of rim that no coarse cluster has any more, though clusters outside the group may have both.
    lost: Vec<u32>,
    /// Shared vertices that collapse, and those that they go to.
    moved: Vec<(u32, u32)>,
}

impl Borders {
    /// Goes through the hierarchy of a file whose pages are sound, from the leaves up. `memory` is in bytes.
    pub(super) fn of<D: AsRef<[u8]> + Sync>(
        file: &Chpm<D>,
        store: &Store,
        memory: u64,
        progress: &dyn Progress,
        cancel: &Cancel,
    ) -> Result<Self, VerifyError> {
        let groups = file.groups();
        let mut rims = Buckets::new(store, "rims", groups.len(), BLOCK);
        let share = memory / SHARE;
        rims_of_leaves(file, store, share, &mut rims, cancel)?;

        // Levels from below: what a group leaves open goes to the group above it.
        let mut order: Vec<GroupId> = (0..groups.len() as u32).map(GroupId).collect();
        order.sort_by_key(|group| groups[group.index()].level);
        progress.begin("borders", order.len() as u64);
        let mut edges = BufferWriter::new(store, "borders", 0)?;
        let mut ranges = vec![0..0; file.clusters().len()];
        let ids = file.header().shared_vertex_count as usize;
        let (mut loose, mut targets) = (vec![false; ids], vec![UNSHARED; ids]);
        // By shared id: clusters that have it, of those that nothing coarser has replaced yet.
        let mut listed = vec![0_u32; ids];

        for level in order.chunk_by(|a, b| groups[a.index()].level == groups[b.index()].level) {
            let mut left = level;
            while !left.is_empty() {
                let batch = first_batch(&mut left, share, |group| RIM * rims.len(group.index()) as u64);
                let found: Vec<OfGroup> = batch
                    .par_iter()
                    .map_init(
                        Local::default,
                        |local: &mut Local, group: &GroupId| -> Result<OfGroup, VerifyError> {
                            cancel.check()?;
                            let mut below = Vec::new();
                            rims.read(group.index(), &mut below)?;
                            Ok(of_group(file, *group, below, &listed, local)?)
                        },
                    )
                    .collect::<Result<_, VerifyError>>()?;

                for (cluster, border) in found.iter().flat_map(|group| &group.borders) {
                    ranges[cluster.index()] = edges.len()..edges.len() + border.len();
                    edges.extend_from_slice(border)?;
                }
                for (above, rim) in found.iter().flat_map(|group| &group.rims) {
                    rim.iter().try_for_each(|edge| rims.push(above.index(), *edge))?;
                }
                for group in found {
                    group.lost.iter().for_each(|id| loose[*id as usize] = true);
                    group.moved.iter().for_each(|(id, to)| targets[*id as usize] = *to);
                }
                progress.advance(batch.len() as u64);
            }

            for group in level {
                for fine in file.fine(*group) {
                    shared_ids(file, *fine)?.iter().for_each(|id| listed[*id as usize] -= 1);
                }
                for coarse in file.coarse(*group) {
                    shared_ids(file, *coarse)?.iter().for_each(|id| listed[*id as usize] += 1);
                }
            }
        }
        progress.end();
        for id in 0..ids {
            // What was marked before was followed to its end.
            let mut at = if loose[id] { targets[id] } else { UNSHARED };
            while at != UNSHARED && !std::mem::replace(&mut loose[at as usize], true) {
                at = targets[at as usize];
            }
        }
        Ok(Borders { edges: edges.finish_column()?, ranges, loose })
    }

    /// Bytes that finding the borders of a file takes whatever memory there is.
    pub(super) fn least<D: AsRef<[u8]>>(file: &Chpm<D>) -> u64 {
        let by_cluster =
            (size_of::<Range<usize>>() * file.clusters().len() + BLOCK * file.groups().len()) as u64;
        VERTEX * u64::from(file.header().shared_vertex_count) + by_cluster
    }

    /// No border edge in any of `clusters`.
    #[cfg(test)]
    pub(super) fn none(store: &Store, clusters: usize) -> Self {
        let edges = BufferWriter::new(store, "borders", 0).and_then(BufferWriter::finish_column).unwrap();
        Borders { edges, ranges: vec![0..0; clusters], loose: Vec::new() }
    }

    /// Whether a vertex is where a strip between a border and the rim has vanished from one cluster and all above it: the other side of
    /// the border is the rim then, wherever that cluster is drawn, and an edge between two such vertices may be without a partner.
    pub(super) fn is_loose(&self, id: u32) -> bool {
        self.loose.get(id as usize).copied().unwrap_or(false)
    }

    /// The border edges of a cluster's finest mesh.
    pub(super) fn of_cluster<'a>(
        &'a self,
        cluster: ClusterId,
        scratch: &'a mut Vec<[u16; 2]>,
    ) -> Result<&'a [[u16; 2]], VerifyError> {
        Ok(self.edges.read(self.ranges[cluster.index()].clone(), scratch)?)
    }
}

/// Takes as many items off as may be looked at together by their weights, at least one.
fn first_batch<'a, T>(left: &mut &'a [T], most: u64, weight: impl Fn(&T) -> u64) -> &'a [T] {
    let mut all = 0;
    let fitting = left.iter().take(BATCH).take_while(|item| {
        all += weight(item);
        all <= most
    });
    let count = fitting.count();
    let (batch, rest) = left.split_at(count.max(1));
    *left = rest;
    batch
}

/// Gives every edge that is odd over all leaves to the group of the last leaf in which it is. The edges go to disk, side by side by
/// their hashes, and come back in parts that fit in memory.
fn rims_of_leaves<D: AsRef<[u8]> + Sync>(
    file: &Chpm<D>,
    store: &Store,
    memory: u64,
    rims: &mut Buckets<[u32; 2]>,
    cancel: &Cancel,
) -> Result<(), VerifyError> {
    let clusters = (0..).map(ClusterId).zip(file.clusters());
    let leaves: Vec<ClusterId> = clusters.filter(|(_, record)| record.is_leaf()).map(|(id, _)| id).collect();
    let bytes = |leaf: &ClusterId| TRIANGLE * u64::from(file.clusters()[leaf.index()].triangle_count);
    let most: u64 = leaves.iter().map(bytes).sum();
    let parts = most.div_ceil(memory.max(1)).clamp(1, (memory / EDGES_BLOCK as u64).max(1));
    let mut edges = Buckets::new(store, "edges of leaves", parts as usize, EDGES_BLOCK);
    let mut left = &leaves[..];
    while !left.is_empty() {
        let batch = first_batch(&mut left, memory, bytes);
        let found: Vec<_> = batch
            .par_iter()
            .map_init(
                Local::default,
                |local: &mut Local, leaf: &ClusterId| -> Result<Vec<[u32; 2]>, VerifyError> {
                    cancel.check()?;
                    let page = file.page_known(*leaf)?;
                    let page = page.view();
                    local.enter(&page, page.vertex_count());
                    let odd = local.odd_edges(&page).to_vec();
                    Ok(odd.into_iter().map(|edge| local.by_id(edge)).collect())
                },
            )
            .collect::<Result<_, VerifyError>>()?;
        for (leaf, found) in batch.iter().zip(found) {
            for edge in found {
                let part = key(&edge).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
                edges.push(((part * parts) >> 32) as usize, OfLeaf { edge, leaf: leaf.0 })?;
            }
        }
    }
    let mut part = Vec::new();
    for of_part in 0..edges.count() {
        cancel.check()?;
        part.clear();
        edges.read(of_part, &mut part)?;
        part.sort_unstable_by_key(|of: &OfLeaf| (key(&of.edge), of.leaf));
        for same in part.chunk_by(|a, b| a.edge == b.edge).filter(|same| same.len() % 2 == 1) {
            let leaf = same[same.len() - 1].leaf;
            rims.push(file.clusters()[leaf as usize].group().index(), same[0].edge)?;
        }
    }
    Ok(())
}

/// `below` is the rim of what the group's coarse clusters are made of.
fn of_group<D: AsRef<[u8]>>(
    file: &Chpm<D>,
    group: GroupId,
    mut below: Vec<[u32; 2]>,
    listed: &[u32],
    local: &mut Local,
) -> Result<OfGroup, FormatError> {
    // What the fine clusters left open along this group is matched with the rims of its coarse ones; what remains of these is
    // their borders.
    keep_odd(&mut below, key);
    let mut taken = vec![false; below.len()];
    let mut found = OfGroup::default();
    for cluster in file.coarse(group).iter().copied().map(ClusterId) {
        let page = file.page_known(cluster)?;
        let page = page.view();
        local.enter(&page, page.vertex_count());
        let mut border = local.odd_edges(&page).to_vec();
        let is_rim = take_rim(&border, local, &below, &mut taken);
        let mut is_rim = is_rim.into_iter();
        border.retain(|_| !is_rim.next().unwrap_or(false));
        found.borders.push((cluster, border));
    }
    let mut taken = taken.into_iter();
    below.retain(|_| !taken.next().unwrap_or(false));

    for (cluster, border) in &mut found.borders {
        let page = file.page_known(*cluster)?;
        let page = page.view();
        // Rim and border of one cluster may be at one edge, and then it is even there.
        if !below.is_empty() {
            let mut vertices: Vec<(u32, u16)> = page.shared().map(|(vertex, id)| (id, vertex)).collect();
            vertices.sort_unstable();
            let vertex = |id: u32| vertices.binary_search_by_key(&id, |v| v.0).ok().map(|at| vertices[at].1);
            below.retain(|[a, b]| match (vertex(*a), vertex(*b)) {
                (Some(a), Some(b)) => {
                    border.push([a.min(b), a.max(b)]);
                    false
                }
                _ => true,
            });
            keep_odd(border, by_vertices);
        }

        local.enter(&page, page.base_vertex_count);
        let gone = page.shared().filter(|(vertex, _)| usize::from(*vertex) >= page.base_vertex_count);
        found.moved.extend(gone.map(|(vertex, id)| (id, local.id(local.at(vertex)))));
        let above = file.clusters()[cluster.index()].parent_group();
        if above.is_some() {
            let rim = rim_of_base(&page, border, local);
            if !rim.is_empty() {
                found.rims.push((above, rim));
            }
        }
    }
    // Where a vertex was between these clusters only, it has become an inner one.
    found.lost = below.into_flattened();
    let mut ends = found.lost.clone();
    ends.sort_unstable();
    ends.dedup();
    let mut outside: Vec<u32> = ends.iter().map(|id| listed[*id as usize]).collect();
    if !ends.is_empty() {
        for fine in file.fine(group) {
            for at in shared_ids(file, *fine)?.iter().filter_map(|id| ends.binary_search(id).ok()) {
                outside[at] -= 1;
            }
        }
    }

    let edges = found
        .lost
        .chunks(2)
        .filter(|edge| edge.iter().all(|id| ends.binary_search(id).is_ok_and(|at| outside[at] > 0)));
    found.lost = edges.flatten().copied().collect();
    Ok(found)
}

/// Which of a cluster's edges are the rim's: for each edge of the rim the first that it has, unless it was `taken`.
fn take_rim(edges: &[[u16; 2]], local: &Local, rim: &[[u32; 2]], taken: &mut [bool]) -> Vec<bool> {
    let mut is_rim = vec![false; edges.len()];
    if rim.is_empty() {
        return is_rim;
    }
    // Side by side in one order, which is quicker than a search for each.
    let mut by_id: Vec<(u64, usize)> = edges.iter().map(|edge| key(&local.by_id(*edge))).zip(0..).collect();
    by_id.sort_unstable();
    let mut rest = rim.iter().map(key).zip(taken).peekable();
    for (id, edge) in by_id {
        while rest.next_if(|(other, _)| *other < id).is_some() {}
        if let Some((_, taken)) = rest.peek_mut().filter(|(other, _)| *other == id) {
            is_rim[edge] = !std::mem::replace(*taken, true);
        }
    }
    is_rim
}

fn shared_ids<D: AsRef<[u8]>>(file: &Chpm<D>, cluster: u32) -> Result<Vec<u32>, FormatError> {
    Ok(file.page_known(ClusterId(cluster))?.view().shared_ids.to_vec())
}

/// Odd edges of the base mesh, which was entered, that do not come from the border; by shared ids.
fn rim_of_base(page: &Page<'_>, border: &[[u16; 2]], local: &mut Local) -> Vec<[u32; 2]> {
    let mut rim = local.odd_edges(page).to_vec();
    let moved = border.iter().map(|edge| edge.map(|v| local.at(v))).filter(|[a, b]| a != b);
    rim.extend(moved.map(|[a, b]| [a.min(b), a.max(b)]));
    keep_odd(&mut rim, by_vertices);
    rim.iter().map(|edge| local.by_id(*edge)).filter(|edge| edge[1] != UNSHARED).collect()
}
