//! Vertices and faces to clusters: two counting sorts, sequential over the source (Quick-VDR 4.1, third vertex pass and face pass).

use super::Vertices;
use super::grid::Grid;
use crate::context::Context;
use crate::error::BuildError;
use crate::ingest::Source;
use bytemuck::Pod;
use chpm_extmem::{Buffer, Store};
use rayon::prelude::*;

/// Source data in cluster order.
pub(crate) struct Assigned {
    pub(crate) vertices: Vertices,
    /// Cluster c owns the vertices `starts[c]..starts[c + 1]`.
    pub(crate) starts: Vec<u32>,
    /// Triangles over the new vertex numbers, by cluster, in source order within one.
    pub(crate) triangles: Buffer<[u32; 3]>,
    /// Cluster c has the triangles `triangle_starts[c]..triangle_starts[c + 1]`.
    pub(crate) triangle_starts: Vec<usize>,
}

/// Sorts the source by cluster; `cell_parts` is the cluster of each grid cell.
pub(crate) fn run(
    source: Source,
    grid: &Grid,
    cells: Buffer<u32>,
    cell_parts: &[u32],
    context: &Context<'_>,
) -> Result<Assigned, BuildError> {
    let store = &context.store;
    let part_count = cell_parts.iter().max().map_or(0, |p| *p as usize + 1);
    let mapping = map_vertices(cells, grid, cell_parts, part_count, store)?;
    context.check()?;
    let Mapping { new_index, parts, starts } = mapping;

    let Source { positions, normals, colors, triangles, .. } = source;
    let vertices = Vertices {
        positions: permute(positions, &new_index, "positions by cluster", store)?,
        normals: normals.map(|n| permute(n, &new_index, "normals by cluster", store)).transpose()?,
        colors: colors.map(|c| permute(c, &new_index, "colors by cluster", store)).transpose()?,
    };
    context.check()?;
    let (triangles, triangle_starts) = sort_triangles(triangles, &new_index, &parts, part_count, context)?;
    Ok(Assigned { vertices, starts, triangles, triangle_starts })
}

struct Mapping {
    /// Old to new vertex number.
    new_index: Buffer<u32>,
    /// Cluster of a vertex, by old number.
    parts: Buffer<u32>,
    starts: Vec<u32>,
}

/// The cell of every vertex.
pub(crate) fn find_cells(
    positions: &[[f32; 3]],
    grid: &Grid,
    store: &Store,
) -> Result<Buffer<u32>, BuildError> {
    let mut cells = Buffer::zeroed(store, "vertex cells", positions.len())?;
    const CHUNK: usize = 1 << 14;
    cells.par_chunks_mut(CHUNK).zip(positions.par_chunks(CHUNK)).for_each(|(cells, positions)| {
        for (cell, p) in cells.iter_mut().zip(positions) {
            *cell = grid.cell_of(*p);
        }
    });
    Ok(cells)
}

fn map_vertices(
    cells: Buffer<u32>,
    grid: &Grid,
    cell_parts: &[u32],
    part_count: usize,
    store: &Store,
) -> Result<Mapping, BuildError> {
    let mut parts = cells;
    parts.par_iter_mut().for_each(|v| *v = cell_parts[*v as usize]);
    let mut starts = vec![0u32; part_count + 1];
    for (cell, part) in grid.cells.iter().zip(cell_parts) {
        starts[*part as usize + 1] += cell.count;
    }
    for part in 0..part_count {
        starts[part + 1] += starts[part];
    }
    let mut cursors = starts.clone();
    let mut new_index = Buffer::zeroed(store, "vertex mapping", parts.len())?;
    for (new, part) in new_index.iter_mut().zip(parts.iter()) {
        *new = cursors[*part as usize];
        cursors[*part as usize] += 1;
    }
    Ok(Mapping { new_index, parts, starts })
}

fn permute<T: Pod>(
    from: Buffer<T>,
    new_index: &[u32],
    what: &'static str,
    store: &Store,
) -> Result<Buffer<T>, BuildError> {
    let mut to = Buffer::zeroed(store, what, from.len())?;
    let out: &mut [T] = &mut to;
    for (item, new) in from.iter().zip(new_index) {
        out[*new as usize] = *item;
    }
    Ok(to)
}

/// The cluster that a triangle goes to: the one with most of its corners, else one of the three by a rule that does not
/// depend on the order of the corners, so that copies of a triangle stay together.
fn cluster_of(triangle: [u32; 3], parts: &[u32]) -> u32 {
    let [a, b, c] = triangle.map(|v| parts[v as usize]);
    if a == b || a == c {
        a
    } else if b == c {
        b
    } else {
        let mut distinct = [a, b, c];
        distinct.sort_unstable();
        let sum: u64 = triangle.iter().map(|v| u64::from(*v)).sum();
        distinct[(sum % 3) as usize]
    }
}

fn sort_triangles(
    triangles: Buffer<[u32; 3]>,
    new_index: &[u32],
    parts: &[u32],
    part_count: usize,
    context: &Context<'_>,
) -> Result<(Buffer<[u32; 3]>, Vec<usize>), BuildError> {
    const CHUNK: usize = 1 << 14;
    let mut clusters = Buffer::<u32>::zeroed(&context.store, "triangle clusters", triangles.len())?;
    let counts = clusters
        .par_chunks_mut(CHUNK)
        .zip(triangles.par_chunks(CHUNK))
        .fold(
            || vec![0usize; part_count],
            |mut counts, (clusters, triangles)| {
                for (cluster, triangle) in clusters.iter_mut().zip(triangles) {
                    *cluster = cluster_of(*triangle, parts);
                    counts[*cluster as usize] += 1;
                }
                counts
            },
        )
        .reduce_with(|mut a, b| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        })
        .unwrap_or_default();
    let mut starts = vec![0; part_count + 1];
    for part in 0..part_count {
        starts[part + 1] = starts[part] + counts[part];
    }
    let mut cursors = starts.clone();
    let mut sorted = Buffer::zeroed(&context.store, "triangles by cluster", triangles.len())?;
    let out: &mut [[u32; 3]] = &mut sorted;
    for (triangles, clusters) in triangles.chunks(CHUNK).zip(clusters.chunks(CHUNK)) {
        context.check()?;
        for (triangle, cluster) in triangles.iter().zip(clusters) {
            let cursor = &mut cursors[*cluster as usize];
            out[*cursor] = triangle.map(|v| new_index[v as usize]);
            *cursor += 1;
        }
    }
    Ok((sorted, starts))
}
