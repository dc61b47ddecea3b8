//! Leaves: each cluster gathers the vertices that its triangles use and numbers them locally.

use crate::context::Context;
use crate::error::BuildError;
use chpm_extmem::Spool;
use rayon::prelude::*;
use std::ops::Range;

/// Most triangles of a leaf: with three vertices each they still fit 16-bit indices.
const MAX_LEAF_TRIANGLES: usize = u16::MAX as usize / 3;

/// One leaf cluster, whose data lie in a spool.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Leaf {
    offset: u64,
    pub(crate) vertex_count: u32,
    pub(crate) triangle_count: u32,
}

/// The data of a leaf, read back.
#[derive(Debug, Default)]
pub(crate) struct LeafData {
    bytes: Vec<u8>,
    /// Global numbers of the local vertices.
    pub(crate) vertices: Vec<u32>,
    /// Triangles over local vertices.
    pub(crate) triangles: Vec<[u16; 3]>,
}

impl LeafData {
    /// Refills from the spool.
    pub(crate) fn read(&mut self, leaf: &Leaf, spool: &Spool) -> Result<(), BuildError> {
        let vertex_len = 4 * leaf.vertex_count as usize;
        spool.read(leaf.offset, vertex_len + 6 * leaf.triangle_count as usize, &mut self.bytes)?;
        let (vertices, triangles) = self.bytes.split_at(vertex_len);
        self.vertices.clear();
        self.vertices.extend(vertices.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)));
        self.triangles.clear();
        let corner = |b: &[u8]| u16::from_le_bytes([b[0], b[1]]);
        self.triangles
            .extend(triangles.chunks_exact(6).map(|t| [corner(t), corner(&t[2..]), corner(&t[4..])]));
        Ok(())
    }
}

/// A gathered leaf, with what is needed to find shared vertices. It may be without triangles.
pub(crate) struct Gathered {
    pub(crate) leaf: Leaf,
    /// The vertices that its cluster owns; none for a piece of a split cluster.
    pub(crate) owned: Option<Range<u32>>,
    /// How many of the owned vertices it uses.
    pub(crate) own_count: u32,
    /// The owned vertices that it does not use, ascending.
    pub(crate) unused: Vec<u32>,
    /// All other vertices that it uses, ascending.
    pub(crate) foreign: Vec<u32>,
}

/// Gathers all leaves; a cluster of too many triangles is split into several.
pub(crate) fn gather(
    triangles: &[[u32; 3]],
    triangle_starts: &[usize],
    starts: &[u32],
    spool: &Spool,
    context: &Context<'_>,
) -> Result<Vec<Gathered>, BuildError> {
    let mut jobs = Vec::new();
    for part in 0..starts.len() - 1 {
        let triangles = &triangles[triangle_starts[part]..triangle_starts[part + 1]];
        let owned = starts[part]..starts[part + 1];
        if triangles.len() <= MAX_LEAF_TRIANGLES {
            jobs.push((triangles, owned, true));
        } else {
            let pieces = triangles.len().div_ceil(MAX_LEAF_TRIANGLES);
            jobs.extend(
                triangles.chunks(triangles.len().div_ceil(pieces)).map(|c| (c, owned.clone(), false)),
            );
        }
    }
    jobs.into_par_iter()
        .map_init(Vec::new, |scratch, (triangles, owned, whole)| {
            context.check()?;
            context.progress.advance(triangles.len() as u64);
            gather_one(triangles, owned, whole, scratch, spool)
        })
        .collect()
}

fn gather_one(
    triangles: &[[u32; 3]],
    owned: Range<u32>,
    whole: bool,
    local: &mut Vec<u32>,
    spool: &Spool,
) -> Result<Gathered, BuildError> {
    const UNUSED: u32 = u32::MAX;
    local.clear();
    local.resize(owned.len(), UNUSED);
    let mut foreign = Vec::new();
    for v in triangles.as_flattened() {
        if owned.contains(v) { local[(v - owned.start) as usize] = 0 } else { foreign.push(*v) }
    }
    foreign.sort_unstable();
    foreign.dedup();
    let mut vertices = Vec::with_capacity(owned.len() + foreign.len());
    let mut unused = Vec::new();
    for (slot, v) in local.iter_mut().zip(owned.clone()) {
        if *slot == UNUSED {
            unused.push(v);
        } else {
            *slot = vertices.len() as u32;
            vertices.push(v);
        }
    }
    let own_count = vertices.len();
    vertices.extend_from_slice(&foreign);
    let owned_range = owned.clone();
    let to_local = |v: u32| -> u16 {
        if owned.contains(&v) {
            local[(v - owned.start) as usize] as u16
        } else {
            (own_count + foreign.partition_point(|f| *f < v)) as u16
        }
    };
    let mut blob = Vec::with_capacity(4 * vertices.len() + 6 * triangles.len());
    blob.extend(vertices.iter().flat_map(|v| v.to_le_bytes()));
    for triangle in triangles {
        for corner in triangle.map(to_local) {
            blob.extend_from_slice(&corner.to_le_bytes());
        }
    }
    let leaf = Leaf {
        offset: if triangles.is_empty() { 0 } else { spool.append(&blob)? },
        vertex_count: vertices.len() as u32,
        triangle_count: triangles.len() as u32,
    };
    if !whole {
        // Pieces of one cluster may share any of its vertices, so all of them take part in the search.
        vertices.sort_unstable();
        return Ok(Gathered { leaf, own_count: 0, foreign: vertices, unused: Vec::new(), owned: None });
    }
    Ok(Gathered { leaf, own_count: own_count as u32, foreign, unused, owned: Some(owned_range) })
}
